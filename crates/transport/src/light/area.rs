//! Emissive triangles as lights; two that make a parallelogram are sampled as one.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::LightSamples;
use super::learned::LearnedLights;
use super::tree::{Emitter, LightTree};
use crate::color::luminance;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::warp;
use crate::scene::{Instance, Material, Mesh, Scene, TextureSlot};

/// One emissive triangle, or two that make a parallelogram, in world space, as numbers that can be loaded into lanes.
#[derive(Debug, Clone, Copy)]
struct AreaLight {
    /// A corner (3), an edge from it (3), x and y of the other edge.
    place: [f32; LANES],
    /// z of that edge, unit normal on the side that the winding calls the front (3), emitted radiance before a texture
    /// (3), one over the area.
    light: [f32; LANES],
    instance: u32,
    mesh: u32,
    prim: u32,
    two_sided: bool,
    /// Its radiance follows from the place and the direction.
    varies: bool,
    parallelogram: bool,
    /// It is elsewhere at other times: `place` and `light` are of the picture's own moment.
    moves: bool,
}

impl AreaLight {
    /// A corner, the edges from it, the cross product that points to the front.
    fn stand(&mut self, [v, e, f]: [Vec3; 3], cross: Vec3) {
        let area = if self.parallelogram { 1.0 } else { 0.5 } * cross.length();
        let n = cross.normalize_or_zero();
        let [.., lx, ly, lz, _] = self.light;
        self.place = [v.x, v.y, v.z, e.x, e.y, e.z, f.x, f.y];
        self.light = [f.z, n.x, n.y, n.z, lx, ly, lz, 1.0 / area];
    }

    /// As it is at a time in [0, 1] of the shutter.
    #[inline(never)]
    fn at(&self, scene: &Scene, time: f32) -> Self {
        let mut light = *self;
        if self.moves {
            let instance = &scene.instances[self.instance as usize];
            let mesh = &scene.meshes[self.mesh as usize];
            let (edges, cross) = edges(corners(instance, mesh, self.prim as usize, Some(time)), instance);
            light.stand(edges, cross);
        }
        light
    }
}

/// Corners of a triangle in world space: at a time of the shutter, or at the picture's own moment.
fn corners(instance: &Instance, mesh: &Mesh, prim: usize, time: Option<f32>) -> [Vec3; 3] {
    let vertices = mesh.indices[prim];
    let own = match (&mesh.motion, time) {
        (Some(motion), Some(time)) => motion.corners(vertices, time),
        _ => vertices.map(|i| Vec3::from_array(mesh.positions[i as usize])),
    };
    match time.map_or(instance.transform, |time| instance.at(time)) {
        None => own,
        Some(to_world) => own.map(|p| to_world.transform_point3(p)),
    }
}

/// A corner and the edges from it, and their cross product, turned to the front.
fn edges([v, s, t]: [Vec3; 3], instance: &Instance) -> ([Vec3; 3], Vec3) {
    let (e, f) = (s - v, t - v);
    let mirrored = instance.transform.is_some_and(|t| t.matrix3.determinant() < 0.0);
    ([v, e, f], e.cross(f) * if mirrored { -1.0 } else { 1.0 })
}

/// All that emits in a scene, chosen by a light tree.
#[derive(Debug)]
pub struct AreaLights {
    lights: Vec<AreaLight>,
    tree: LightTree,
    /// Place in `light_of` of the first triangle of each (instance, mesh) that emits, sorted.
    first: Vec<((u32, u32), u32)>,
    /// The area light of each emissive triangle.
    light_of: Vec<u32>,
    /// Do some of them move?
    moves: bool,
}

impl AreaLights {
    /// Levels of the light tree, were it even: log₂ of the lights that it chooses from.
    pub fn levels(&self) -> f32 {
        (self.lights.len() as f32).log2()
    }

    /// Gathers them; `None` when nothing shines.
    pub fn new(scene: &Scene) -> Option<Self> {
        let (mut lights, mut emitters) = (Vec::new(), Vec::new());
        let (mut first, mut light_of) = (Vec::new(), Vec::new());
        let moving = scene.moving_meshes();
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
                let varies = material.textures[TextureSlot::Emissive].is_some() || material.clearcoat > 0.0;
                let mut prim = 0;
                while prim < mesh.indices.len() {
                    let mut own = corners(prim);
                    let mut far = own[0];
                    let pair = (!varies && !moves && prim + 1 < mesh.indices.len())
                        .then(|| parallelogram(own, corners(prim + 1)))
                        .flatten();
                    if let Some([a, b, c, d]) = pair {
                        (own, far) = ([a, b, c], d);
                    }
                    let ([v, e, f], cross) = edges(own, instance);
                    let area = if pair.is_some() { 1.0 } else { 0.5 } * cross.length();
                    let radiance = luminance(mean_emission(scene, material, mesh, mesh.indices[prim]));
                    let sides = if material.double_sided { 2.0 } else { 1.0 };
                    let power = PI * area * radiance * sides;
                    let n = cross.normalize_or_zero();
                    let mut emitter = Emitter {
                        low: v.min(v + e).min(v + f).min(far),
                        high: v.max(v + e).max(v + f).max(far),
                        normal: n,
                        spread: 0.0,
                        power: if power.is_finite() && n != Vec3::ZERO { power } else { 0.0 },
                        two_sided: material.double_sided,
                    };
                    if moves {
                        sweep(&mut emitter, instance, mesh, prim);
                    }
                    emitters.push(emitter);
                    let l = material.emissive;
                    let triangles = if pair.is_some() { 2 } else { 1 };
                    light_of.extend(std::iter::repeat_n(lights.len() as u32, triangles));
                    let mut light = AreaLight {
                        place: [0.0; LANES],
                        light: [0.0, 0.0, 0.0, 0.0, l.x, l.y, l.z, 0.0],
                        instance: instance_index as u32,
                        mesh: mesh_index,
                        prim: prim as u32,
                        two_sided: material.double_sided,
                        varies,
                        parallelogram: pair.is_some(),
                        moves,
                    };
                    light.stand([v, e, f], cross);
                    lights.push(light);
                    prim += triangles;
                }
            }
        }
        let tree = LightTree::new(&emitters)?;
        let moves = lights.iter().any(|light| light.moves);
        Some(Self { lights, tree, first, light_of, moves })
    }

    /// What chooses among them.
    pub fn tree(&self) -> &LightTree {
        &self.tree
    }

    /// Bytes of a light and its place in the tree while both are made.
    pub const BYTES_EACH: u64 = 240;

    /// How many a scene has at most: emissive triangles, as they are placed.
    pub fn count(scene: &Scene) -> u64 {
        let shines = |mesh: &&Arc<Mesh>| scene.materials[mesh.material as usize].is_emissive();
        let triangles: Vec<u64> = scene
            .objects
            .iter()
            .map(|object| &scene.meshes[object.meshes.start as usize..object.meshes.end as usize])
            .map(|meshes| meshes.iter().filter(shines).map(|mesh| mesh.indices.len() as u64).sum())
            .collect();
        scene.instances.iter().map(|instance| triangles[instance.object as usize]).sum()
    }

    /// Emitted power (luminance), in W.
    pub fn power(&self) -> f32 {
        self.tree.power()
    }

    /// Emitted radiance of triangle `prim` of `mesh` at barycentric weights (`u`, `v`) of its second and third vertex,
    /// from a side that shines, seen at cosine `cos` to the triangle's normal, of either sign.
    #[inline]
    pub fn radiance(scene: &Scene, mesh: &Mesh, prim: u32, (u, v): (f32, f32), cos: f32) -> Vec3 {
        let material = &scene.materials[mesh.material as usize];
        let texel = |slot: TextureSlot| {
            let texture = material.textures[slot].as_ref()?;
            let texcoords = mesh.texcoords[usize::from(texture.set.min(1))].as_ref()?;
            let [a, b, c] = mesh.indices[prim as usize].map(|i| Vec2::from_array(texcoords[i as usize]));
            Some(scene.sample_texture(texture, a + (b - a) * u + (c - a) * v).truncate())
        };
        let emitted = texel(TextureSlot::Emissive).map_or(material.emissive, |texel| material.emissive * texel);
        if material.clearcoat == 0.0 {
            return emitted;
        }
        // A coat lies over what shines, and lets through what it does not reflect: Schlick's term for index 1.5.
        let coat = texel(TextureSlot::Clearcoat).map_or(material.clearcoat, |texel| material.clearcoat * texel.x);
        emitted * (1.0 - coat * (0.04 + 0.96 * (1.0 - cos.abs()).clamp(0.0, 1.0).powi(5)))
    }

    /// Draws points on area lights, uniform over their area, as seen from `p` with normals `n` as for
    /// [`LightTree::sample`], at times in [0, 1] of the shutter, by three numbers in [0, 1): one chooses the light, by what is
    /// `learned` of them too, two the point on it.
    #[inline]
    pub fn sample(
        &self,
        (scene, time): (&Scene, F),
        (p, n): (V3, V3),
        learned: Option<&LearnedLights>,
        [choice, u, v]: [F; 3],
    ) -> LightSamples {
        let (chosen, pmf) = self.tree.sample(p, n, choice, learned);
        let mut lights = eight(|lane| &self.lights[chosen[lane] as usize]);
        let moved;
        if self.moves {
            moved = eight(|lane| lights[lane].at(scene, time.as_array()[lane]));
            lights = moved.each_ref();
        }
        let [vx, vy, vz, ex, ey, ez, fx, fy] = F::transpose(eight(|lane| F::from(lights[lane].place)));
        let [fz, nx, ny, nz, lx, ly, lz, one_over_area] = F::transpose(eight(|lane| F::from(lights[lane].light)));
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
                Self::radiance(scene, mesh, lights[i].prim, at, cos.as_array()[i])
            }));
        }
        let seen = facing.simd_gt(F::ZERO) & pdf.is_finite();
        LightSamples { wi, distance, radiance, pdf: pdf & seen, emitter: chosen }
    }

    /// Density per solid angle of [`sample`](Self::sample), at `p` with normal `n`, for a hit of triangle `prim` at
    /// `distance` along `wi`, at a time in [0, 1] of the shutter.
    #[inline]
    pub fn pdf(
        &self,
        (scene, time): (&Scene, f32),
        (p, n): (Vec3, Vec3),
        (instance, mesh, prim): (u32, u32, u32),
        wi: Vec3,
        distance: f32,
        learned: Option<&LearnedLights>,
    ) -> f32 {
        let Ok(found) = self.first.binary_search_by_key(&(instance, mesh), |&(key, _)| key) else { return 0.0 };
        let light = self.light_of[(self.first[found].1 + prim) as usize];
        let chosen = &self.lights[light as usize];
        let moved;
        let chosen = match chosen.moves {
            false => chosen,
            true => {
                moved = chosen.at(scene, time);
                &moved
            }
        };
        let AreaLight { light: [_, nx, ny, nz, .., one_over_area], two_sided, .. } = *chosen;
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

/// Widens an emitter to all that it is while the shutter is open.
fn sweep(emitter: &mut Emitter, instance: &Instance, mesh: &Mesh, prim: usize) {
    let keys = mesh.motion.as_ref().map_or(1, |motion| motion.positions.len());
    // Where both move, between the keys of either, too.
    let steps = 2 * keys.max(instance.motion.as_ref().map_or(1, |motion| motion.keys().len()));
    for step in 0..=steps {
        let own = corners(instance, mesh, prim, Some(step as f32 / steps as f32));
        for p in own {
            (emitter.low, emitter.high) = (emitter.low.min(p), emitter.high.max(p));
        }
        let normal = edges(own, instance).1.normalize_or(emitter.normal);
        emitter.spread = emitter.spread.max(normal.angle_between(emitter.normal));
    }
    // For what lies between the steps.
    emitter.spread = (1.2 * emitter.spread + 0.01).min(PI);
    let margin = 0.01 * (emitter.high - emitter.low).length();
    (emitter.low, emitter.high) = (emitter.low - margin, emitter.high + margin);
}

/// The parallelogram that two triangles make which share an edge: a corner, its two neighbours in the first triangle's
/// winding, the corner across.
fn parallelogram(a: [Vec3; 3], b: [Vec3; 3]) -> Option<[Vec3; 4]> {
    for i in 0..3 {
        for j in 0..3 {
            let (s, t) = (a[(i + 1) % 3], a[(i + 2) % 3]);
            if (s, t) == (b[(j + 2) % 3], b[(j + 1) % 3]) {
                // As good as equal: some roundings of the largest coordinate.
                let (error, size) = (a[i] + b[j] - s - t, s.abs().max(t.abs()).max(a[i].abs()).max_element());
                return (error.abs().max_element() <= 8.0 * f32::EPSILON * size).then_some([a[i], s, t, b[j]]);
            }
        }
    }
    None
}

/// Emission averaged over a triangle, by the texture at 16 points of it: good enough to choose by.
fn mean_emission(scene: &Scene, material: &Material, mesh: &Mesh, index: [u32; 3]) -> Vec3 {
    let Some(texture) = &material.textures[TextureSlot::Emissive] else { return material.emissive };
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
