//! Emissive triangles as lights.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::LightSamples;
use crate::color::luminance;
use crate::lanes::{F, LANES, V3};
use crate::sampling::{Discrete, warp};
use crate::scene::{Material, Mesh, Scene};

/// One emissive triangle, in world space.
#[derive(Debug, Clone, Copy)]
pub struct EmissiveTriangle {
    vertex: Vec3,
    /// From the first vertex to the second and to the third.
    edges: [Vec3; 2],
    /// Unit, on the side that the winding calls the front.
    normal: Vec3,
    area: f32,
    /// Emitted radiance, before a texture.
    radiance: Vec3,
    mesh: u32,
    prim: u32,
    two_sided: bool,
    textured: bool,
}

/// All emissive triangles of a scene, chosen by power.
#[derive(Debug)]
pub struct AreaLights {
    triangles: Vec<EmissiveTriangle>,
    choice: Discrete,
    /// First triangle of each (instance, mesh) that emits, sorted.
    first: Vec<((u32, u32), u32)>,
    power: f32,
}

impl AreaLights {
    /// Gathers them; `None` when nothing shines.
    pub fn new(scene: &Scene) -> Option<Self> {
        let mut triangles = Vec::new();
        let mut weights = Vec::new();
        let mut first = Vec::new();
        for (instance_index, instance) in scene.instances.iter().enumerate() {
            for mesh_index in scene.objects[instance.object as usize].meshes.clone() {
                let mesh = &scene.meshes[mesh_index as usize];
                let material = &scene.materials[mesh.material as usize];
                if !material.is_emissive() {
                    continue;
                }
                first.push(((instance_index as u32, mesh_index), triangles.len() as u32));
                let mirrored = instance.transform.is_some_and(|t| t.matrix3.determinant() < 0.0);
                for (prim, &index) in mesh.indices.iter().enumerate() {
                    let corners = index.map(|i| {
                        let p = Vec3::from_array(mesh.positions[i as usize]);
                        instance.transform.map_or(p, |t| t.transform_point3(p))
                    });
                    let edges = [corners[1] - corners[0], corners[2] - corners[0]];
                    let cross = edges[0].cross(edges[1]) * if mirrored { -1.0 } else { 1.0 };
                    let area = 0.5 * cross.length();
                    let radiance = luminance(mean_emission(scene, material, mesh, index));
                    let sides = if material.double_sided { 2.0 } else { 1.0 };
                    let power = PI * area * radiance * sides;
                    weights.push(if power.is_finite() { power } else { 0.0 });
                    triangles.push(EmissiveTriangle {
                        vertex: corners[0],
                        edges,
                        normal: cross.normalize_or_zero(),
                        area,
                        radiance: material.emissive,
                        mesh: mesh_index,
                        prim: prim as u32,
                        two_sided: material.double_sided,
                        textured: material.emissive_texture.is_some(),
                    });
                }
            }
        }
        let choice = Discrete::new(weights.into_iter())?;
        let power = choice.total() as f32;
        Some(Self { triangles, choice, first, power })
    }

    /// Emitted power (luminance), in W.
    pub fn power(&self) -> f32 {
        self.power
    }

    /// How many triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Are there none? (Never: see [`new`](Self::new).)
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Draws points on triangles chosen by power, uniform over their area, as seen from `p`. `choice`, `u` and `v` in
    /// [0, 1).
    #[inline]
    pub fn sample(&self, scene: &Scene, p: V3, choice: F, u: F, v: F) -> LightSamples {
        let chosen = choice.to_array().map(|c| self.choice.sample(c).0);
        let lights = chosen.map(|i| &self.triangles[i as usize]);
        let gather = |field: fn(&EmissiveTriangle) -> Vec3| {
            V3::from_arrays([lights.map(|l| field(l).x), lights.map(|l| field(l).y), lights.map(|l| field(l).z)])
        };
        let (b1, b2) = warp::triangles(u, v);
        let to = gather(|l| l.vertex) + gather(|l| l.edges[0]) * b1 + gather(|l| l.edges[1]) * b2 - p;
        let distance2 = to.length_squared();
        let distance = distance2.sqrt();
        let wi = to * (F::ONE / distance);
        let cos = -gather(|l| l.normal).dot(wi);
        let two_sided = F::from(lights.map(|l| if l.two_sided { 1.0 } else { 0.0 })).simd_gt(F::ZERO);
        let facing = cos ^ (two_sided & cos & F::splat(-0.0));
        let density: [f32; LANES] = std::array::from_fn(|i| self.choice.pmf(chosen[i]) / lights[i].area);
        let pdf = F::from(density) * distance2 / facing;
        let mut radiance = gather(|l| l.radiance);
        if lights.iter().any(|l| l.textured) {
            let textured: [Vec3; LANES] = std::array::from_fn(|i| {
                let mesh = &scene.meshes[lights[i].mesh as usize];
                emission(scene, mesh, lights[i].prim, b1.as_array()[i], b2.as_array()[i])
            });
            radiance = V3::from_arrays([textured.map(|t| t.x), textured.map(|t| t.y), textured.map(|t| t.z)]);
        }
        let seen = facing.simd_gt(F::ZERO) & pdf.is_finite();
        LightSamples { wi, distance, radiance, pdf: pdf & seen }
    }

    /// Density per solid angle of [`sample`](Self::sample) for a hit of triangle `prim`.
    #[inline]
    pub fn pdf(&self, instance: u32, mesh: u32, prim: u32, wi: Vec3, distance: f32) -> f32 {
        let Ok(found) = self.first.binary_search_by_key(&(instance, mesh), |&(key, _)| key) else { return 0.0 };
        let index = self.first[found].1 + prim;
        let light = &self.triangles[index as usize];
        let cos = -light.normal.dot(wi);
        let facing = if light.two_sided { cos.abs() } else { cos };
        if facing <= 0.0 {
            return 0.0;
        }
        let pdf = self.choice.pmf(index) * distance * distance / (facing * light.area);
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// Emitted radiance of triangle `prim` of `mesh` at barycentric weights (`u`, `v`) of its second and third vertex,
/// from a side that shines.
#[inline]
pub fn emission(scene: &Scene, mesh: &Mesh, prim: u32, u: f32, v: f32) -> Vec3 {
    let material = &scene.materials[mesh.material as usize];
    let Some(texture) = &material.emissive_texture else { return material.emissive };
    let Some(texcoords) = &mesh.texcoords[usize::from(texture.set.min(1))] else { return material.emissive };
    let [a, b, c] = mesh.indices[prim as usize].map(|i| Vec2::from_array(texcoords[i as usize]));
    material.emissive * scene.sample_texture(texture, a + (b - a) * u + (c - a) * v).truncate()
}

/// Emission averaged over a triangle, by the texture at 16 points of it: good enough to choose by.
fn mean_emission(scene: &Scene, material: &Material, mesh: &Mesh, index: [u32; 3]) -> Vec3 {
    let Some(texture) = &material.emissive_texture else { return material.emissive };
    let Some(texcoords) = &mesh.texcoords[usize::from(texture.set.min(1))] else { return material.emissive };
    let [a, b, c] = index.map(|i| Vec2::from_array(texcoords[i as usize]));
    let mut sum = Vec3::ZERO;
    for k in 0..16 {
        let (u, v) = warp::triangles(F::splat((k % 4) as f32 / 4.0 + 0.125), F::splat((k / 4) as f32 / 4.0 + 0.125));
        let (u, v) = (u.as_array()[0], v.as_array()[0]);
        sum += scene.sample_texture(texture, a + (b - a) * u + (c - a) * v).truncate();
    }
    // A little for what 16 points may have missed.
    material.emissive * (sum / 16.0 + 1e-3)
}
