//! Area lights: emissive triangles. Two triangles that form a parallelogram are one light.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

use super::learned::LearnedLights;
use super::samples::ROUNDING;
use super::tree::{Emitter, LightTree};
use super::{LightProposal, LightSampleContext, LightSamples};
use crate::color::luminance;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::warp;
use crate::scene::Primitive;
use crate::scene::{Instance, Material, Mesh, Scene, TextureSlot};

/// An emissive triangle, or two that form a parallelogram, in world space, laid out to be loaded into lanes.
#[derive(Debug, Clone, Copy)]
struct AreaLight {
    /// A corner (3), an edge from it (3), x and y of the other edge from it.
    geometry: [f32; LANES],
    /// z of the other edge, unit normal of the front side by winding (3), emitted radiance before a texture (3), one over the
    /// area.
    emission: [f32; LANES],
    instance: u32,
    mesh: u32,
    prim: u32,
    two_sided: bool,
    /// Whether its radiance depends on the point or the direction.
    varies: bool,
    /// May rays pass it, by its material's alpha?
    has_alpha: bool,
    parallelogram: bool,
    /// Whether it moves: `geometry` and `emission` hold the picture's reference time.
    moves: bool,
}

impl AreaLight {
    /// Sets a corner, the edges from it, and the normal from their cross product, which points to the front.
    fn set_geometry(&mut self, [v, e, f]: [Vec3; 3], cross: Vec3) {
        let area = if self.parallelogram { 1.0 } else { 0.5 } * cross.length();
        let n = cross.normalize_or_zero();
        let [.., lx, ly, lz, _] = self.emission;
        self.geometry = [v.x, v.y, v.z, e.x, e.y, e.z, f.x, f.y];
        self.emission = [f.z, n.x, n.y, n.z, lx, ly, lz, 1.0 / area];
    }

    /// The light at a time in [0, 1] of the shutter.
    #[inline(never)]
    fn at(&self, scene: &Scene, time: f32) -> Self {
        let mut light = *self;
        if self.moves {
            let instance = &scene.instances[self.instance as usize];
            let mesh = &scene.meshes[self.mesh as usize];
            let (edges, cross) = edges(corners(instance, mesh, self.prim as usize, Some(time)), instance);
            light.set_geometry(edges, cross);
        }
        light
    }
}

/// Corners of a triangle in world space, at a time in [0, 1] of the shutter or, for `None`, at the picture's reference time.
fn corners(instance: &Instance, mesh: &Mesh, prim: usize, time: Option<f32>) -> [Vec3; 3] {
    let vertices = mesh.indices[prim];
    let corners = match (&mesh.motion, time) {
        (Some(motion), Some(time)) => motion.corners(vertices, time),
        _ => vertices.map(|i| Vec3::from_array(mesh.positions[i as usize])),
    };
    match time.map_or(instance.transform, |time| instance.at(time)) {
        None => corners,
        Some(to_world) => corners.map(|p| to_world.transform_point3(p)),
    }
}

/// A corner and the edges from it, and their cross product toward the front.
fn edges([v, s, t]: [Vec3; 3], instance: &Instance) -> ([Vec3; 3], Vec3) {
    let (e, f) = (s - v, t - v);
    let mirrored = instance.transform.is_some_and(|t| t.matrix3.determinant() < 0.0);
    ([v, e, f], e.cross(f) * if mirrored { -1.0 } else { 1.0 })
}

/// All area lights of a scene, chosen by a light tree.
#[derive(Debug)]
pub struct AreaLights {
    lights: Vec<AreaLight>,
    tree: LightTree,
    /// Index in `light_of` of the first triangle of each emissive (instance, mesh), sorted.
    first: Vec<((u32, u32), u32)>,
    /// The area light of each emissive triangle.
    light_of: Vec<u32>,
    moves: bool,
}

impl AreaLights {
    /// Number of levels of a balanced light tree: log₂ of the number of lights.
    pub fn levels(&self) -> f32 {
        (self.lights.len() as f32).log2()
    }

    /// The area lights of a scene; `None` if nothing emits.
    pub fn new(scene: &Scene) -> Option<Self> {
        let (mut lights, mut emitters) = (Vec::new(), Vec::new());
        let (mut first, mut light_of) = (Vec::new(), Vec::new());
        let moving = scene.moving_meshes();
        let mut alpha = vec![None; scene.meshes.len()];
        for (instance_index, instance) in scene.instances.iter().enumerate() {
            for mesh_index in scene.objects[instance.object as usize].meshes.clone() {
                let mesh = &scene.meshes[mesh_index as usize];
                let material = &scene.materials[mesh.material as usize];
                if !material.is_emissive() {
                    continue;
                }
                first.push(((instance_index as u32, mesh_index), light_of.len() as u32));
                let moves = moving[mesh_index as usize] && (mesh.motion.is_some() || instance.motion.is_some());
                let corners = |prim: usize| corners(instance, mesh, prim, None);
                let has_alpha = *alpha[mesh_index as usize].get_or_insert_with(|| scene.has_alpha(mesh_index));
                let varies =
                    material.textures[TextureSlot::Emissive].is_some() || material.clearcoat > 0.0 || has_alpha;
                let mut prim = 0;
                while prim < mesh.indices.len() {
                    let mut triangle = corners(prim);
                    let mut far = triangle[0];
                    let pair = (!varies && !moves && prim + 1 < mesh.indices.len())
                        .then(|| parallelogram(triangle, corners(prim + 1)))
                        .flatten();
                    if let Some([a, b, c, d]) = pair {
                        (triangle, far) = ([a, b, c], d);
                    }
                    let ([v, e, f], cross) = edges(triangle, instance);
                    let area = if pair.is_some() { 1.0 } else { 0.5 } * cross.length();
                    let radiance = luminance(mean_emission(scene, mesh, prim as u32, has_alpha));
                    let mut emitter = emitter(material, ([v, e, f], cross), far, (area, radiance));
                    if moves {
                        sweep(&mut emitter, instance, mesh, prim);
                    }
                    emitters.push(emitter);
                    let l = material.emissive;
                    let triangles = if pair.is_some() { 2 } else { 1 };
                    light_of.extend(std::iter::repeat_n(lights.len() as u32, triangles));
                    let mut light = AreaLight {
                        geometry: [0.0; LANES],
                        emission: [0.0, 0.0, 0.0, 0.0, l.x, l.y, l.z, 0.0],
                        instance: instance_index as u32,
                        mesh: mesh_index,
                        prim: prim as u32,
                        two_sided: material.double_sided,
                        varies,
                        has_alpha,
                        parallelogram: pair.is_some(),
                        moves,
                    };
                    light.set_geometry([v, e, f], cross);
                    lights.push(light);
                    prim += triangles;
                }
            }
        }
        let tree = LightTree::new(&emitters)?;
        let moves = lights.iter().any(|light| light.moves);
        Some(Self { lights, tree, first, light_of, moves })
    }

    /// Instance and mesh of each area light.
    pub fn surfaces(&self) -> impl Iterator<Item = [u32; 2]> {
        self.lights.iter().map(|light| [light.instance, light.mesh])
    }

    pub fn tree(&self) -> &LightTree {
        &self.tree
    }

    /// Upper bound of the number of a scene's area lights: the emissive triangles of all instances.
    pub fn count(scene: &Scene) -> u64 {
        let emits = |mesh: &&Arc<Mesh>| scene.materials[mesh.material as usize].is_emissive();
        let triangles: Vec<u64> = scene
            .objects
            .iter()
            .map(|object| &scene.meshes[object.meshes.start as usize..object.meshes.end as usize])
            .map(|meshes| meshes.iter().filter(emits).map(|mesh| mesh.indices.len() as u64).sum())
            .collect();
        scene.instances.iter().map(|instance| triangles[instance.object as usize]).sum()
    }

    /// Luminance of the emitted power, in W.
    pub fn power(&self) -> f32 {
        self.tree.power()
    }

    /// Emitted radiance (linear RGB) of triangle `prim` of `mesh` at barycentric weights (`u`, `v`) of its second and third
    /// vertex, on an emitting side. `cos` is the cosine, of either sign, between the direction and the triangle's normal.
    #[inline]
    pub fn radiance(scene: &Scene, mesh: &Mesh, prim: u32, (u, v): (f32, f32), cos: f32) -> Vec3 {
        let material = &scene.materials[mesh.material as usize];
        let texel = |slot: TextureSlot| {
            let texture = material.textures[slot].as_ref()?;
            Some(scene.sample_texture(texture, mesh.texcoord(texture, prim, (u, v))).truncate())
        };
        let emitted = texel(TextureSlot::Emissive).map_or(material.emissive, |texel| material.emissive * texel);
        if material.clearcoat == 0.0 {
            return emitted;
        }
        // The clear coat transmits what it does not reflect: Schlick's approximation for an index of refraction of 1.5.
        let coat = texel(TextureSlot::Clearcoat).map_or(material.clearcoat, |texel| material.clearcoat * texel.x);
        emitted * (1.0 - coat * (0.04 + 0.96 * (1.0 - cos.abs()).clamp(0.0, 1.0).powi(5)))
    }

    /// Samples points on area lights, uniform over the area of a light. The first of three random numbers in [0, 1) chooses the
    /// light, the others the point on it.
    #[inline]
    pub fn sample(
        &self,
        context: &LightSampleContext,
        proposal: &LightProposal,
        [choice, u, v]: [F; 3],
    ) -> LightSamples {
        let LightSampleContext { scene, time, p, origin_error, n } = *context;
        let (chosen, pmf) = self.tree.sample(p, n, choice, proposal.learned);
        let mut lights = eight(|lane| &self.lights[chosen[lane] as usize]);
        let moved;
        if self.moves {
            moved = eight(|lane| lights[lane].at(scene, time.as_array()[lane]));
            lights = moved.each_ref();
        }
        let [vx, vy, vz, ex, ey, ez, fx, fy] = F::transpose(eight(|lane| F::from(lights[lane].geometry)));
        let [fz, nx, ny, nz, lx, ly, lz, one_over_area] = F::transpose(eight(|lane| F::from(lights[lane].emission)));
        let whole = F::from(eight(|lane| f32::from(u8::from(lights[lane].parallelogram)))).simd_gt(F::ZERO);
        let (b1, b2) = warp::triangles(u, v);
        let (b1, b2) = (whole.select(u, b1), whole.select(v, b2));
        let (edge1, edge2) = (V3 { x: ex, y: ey, z: ez }, V3 { x: fx, y: fy, z: fz });
        let to = V3 { x: vx, y: vy, z: vz } + edge1 * b1 + edge2 * b2 - p;
        let distance2 = to.length_squared();
        let distance = distance2.sqrt();
        let wi = to * (F::ONE / distance);
        let cos = -(V3 { x: nx, y: ny, z: nz }).dot(wi);
        let two_sided = F::from(eight(|lane| f32::from(u8::from(lights[lane].two_sided)))).simd_gt(F::ZERO);
        let facing = two_sided.select(cos.abs(), cos);
        let pdf = pmf * one_over_area * distance2 / facing;
        let mut radiance = V3 { x: lx, y: ly, z: lz };
        if lights.iter().any(|l| l.varies) {
            radiance = V3::gather(std::array::from_fn(|i| {
                let mesh = &scene.meshes[lights[i].mesh as usize];
                let at = (b1.as_array()[i], b2.as_array()[i]);
                let radiance = Self::radiance(scene, mesh, lights[i].prim, at, cos.as_array()[i]);
                if lights[i].has_alpha { radiance * scene.coverage(mesh, lights[i].prim, at) } else { radiance }
            }));
        }
        let seen = facing.simd_gt(F::ZERO) & pdf.is_finite();
        // The end lies at a height above the light's plane, however far the light is and however it is inclined.
        let extent = |v: V3| v.x.abs().fast_max(v.y.abs()).fast_max(v.z.abs());
        let size = extent(to + p).fast_max(extent(edge1)).fast_max(extent(edge2)).fast_max(extent(p));
        let end = (distance - (F::splat(ROUNDING) * size + origin_error) / facing).fast_max(F::ZERO);
        LightSamples { wi, distance, end, radiance, pdf: pdf & seen, emitter: chosen }
    }

    /// Cosine between the reverse of `direction` and the emitting side of area light `light`, at a time in [0, 1] of the shutter;
    /// 0 where it does not emit.
    pub fn facing(&self, scene: &Scene, light: u32, time: f32, direction: Vec3) -> f32 {
        let AreaLight { emission: [_, x, y, z, ..], two_sided, .. } = self.lights[light as usize].at(scene, time);
        let cos = -Vec3::new(x, y, z).dot(direction);
        if two_sided { cos.abs() } else { cos.max(0.0) }
    }

    /// Density per solid angle of [`sample`](Self::sample) at `p` with normal `n`, for a hit of triangle `prim` at `distance`
    /// metres along `wi`, at a time in [0, 1] of the shutter. Zero if the triangle is not a light.
    #[inline]
    pub fn pdf(
        &self,
        (scene, time): (&Scene, f32),
        (p, n): (Vec3, Vec3),
        Primitive { instance, mesh, prim }: Primitive,
        wi: Vec3,
        distance: f32,
        learned: Option<&LearnedLights>,
    ) -> f32 {
        let Ok(index) = self.first.binary_search_by_key(&(instance, mesh), |&(key, _)| key) else { return 0.0 };
        let light = self.light_of[(self.first[index].1 + prim) as usize];
        let chosen = &self.lights[light as usize];
        let moved;
        let chosen = match chosen.moves {
            false => chosen,
            true => {
                moved = chosen.at(scene, time);
                &moved
            }
        };
        let AreaLight { emission: [_, nx, ny, nz, .., one_over_area], two_sided, .. } = *chosen;
        let cos = -Vec3::new(nx, ny, nz).dot(wi);
        let facing = if two_sided { cos.abs() } else { cos };
        if facing <= 0.0 {
            return 0.0;
        }
        let [_, pmf] = self.tree.pmfs(p, n, light, learned);
        let pdf = pmf * one_over_area * distance * distance / facing;
        if pdf.is_finite() { pdf } else { 0.0 }
    }
}

/// The emitter of a light with corner `v`, edges `e` and `f` from it and the `far` corner, by its area and the luminance of its
/// radiance. Emitters without area or with infinite power have no power.
fn emitter(
    material: &Material,
    ([v, e, f], cross): ([Vec3; 3], Vec3),
    far: Vec3,
    (area, radiance): (f32, f32),
) -> Emitter {
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let power = PI * area * radiance * sides;
    let n = cross.normalize_or_zero();
    Emitter {
        low: v.min(v + e).min(v + f).min(far),
        high: v.max(v + e).max(v + f).max(far),
        normal: n,
        spread: 0.0,
        power: if power.is_finite() && n != Vec3::ZERO { power } else { 0.0 },
        two_sided: material.double_sided,
    }
}

/// Extends the bounds of an emitter to its motion while the shutter is open.
fn sweep(emitter: &mut Emitter, instance: &Instance, mesh: &Mesh, prim: usize) {
    let keys = mesh.motion.as_ref().map_or(1, |motion| motion.positions.len());
    // Twice as many steps as keys, because the keys of mesh and instance may differ.
    let steps = 2 * keys.max(instance.motion.as_ref().map_or(1, |motion| motion.keys().len()));
    for step in 0..=steps {
        let triangle = corners(instance, mesh, prim, Some(step as f32 / steps as f32));
        for p in triangle {
            (emitter.low, emitter.high) = (emitter.low.min(p), emitter.high.max(p));
        }
        let normal = edges(triangle, instance).1.normalize_or(emitter.normal);
        emitter.spread = emitter.spread.max(normal.angle_between(emitter.normal));
    }
    // A margin for the motion between the steps.
    emitter.spread = (1.2 * emitter.spread + 0.01).min(PI);
    let margin = 0.01 * (emitter.high - emitter.low).length();
    (emitter.low, emitter.high) = (emitter.low - margin, emitter.high + margin);
}

/// The parallelogram of two triangles that share an edge: a corner, its two neighbours in the first triangle's winding, and
/// the opposite corner. `None` if they form none.
fn parallelogram(a: [Vec3; 3], b: [Vec3; 3]) -> Option<[Vec3; 4]> {
    for i in 0..3 {
        for j in 0..3 {
            let (s, t) = (a[(i + 1) % 3], a[(i + 2) % 3]);
            if (s, t) == (b[(j + 2) % 3], b[(j + 1) % 3]) {
                // Equal up to rounding, relative to the largest coordinate.
                let (error, size) = (a[i] + b[j] - s - t, s.abs().max(t.abs()).max(a[i].abs()).max_element());
                return (error.abs().max_element() <= 8.0 * f32::EPSILON * size).then_some([a[i], s, t, b[j]]);
            }
        }
    }
    None
}

/// Emitted radiance averaged over 16 points of a triangle, by what its surface covers of them, which is accurate enough for the
/// light tree.
fn mean_emission(scene: &Scene, mesh: &Mesh, prim: u32, has_alpha: bool) -> Vec3 {
    let material = &scene.materials[mesh.material as usize];
    let texture = material.textures[TextureSlot::Emissive].as_ref();
    let has_texture = texture.is_some() || material.textures[TextureSlot::BaseColor].is_some() || mesh.colors.is_some();
    if texture.is_none() && !has_alpha {
        return material.emissive;
    }
    let mut sum = Vec3::ZERO;
    for k in 0..16 {
        let (u, v) = warp::triangles(F::splat((k % 4) as f32 / 4.0 + 0.125), F::splat((k / 4) as f32 / 4.0 + 0.125));
        let at = (u.as_array()[0], v.as_array()[0]);
        let texel = texture.map_or(Vec3::ONE, |t| scene.sample_texture(t, mesh.texcoord(t, prim, at)).truncate());
        sum += if has_alpha { texel * scene.coverage(mesh, prim, at) } else { texel };
    }
    // A small addition for emission between the 16 points.
    material.emissive * (sum / 16.0 + if has_texture { 1e-3 } else { 0.0 })
}
