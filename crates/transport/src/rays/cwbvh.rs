//! obvhs in pure Rust behind [`RayQueries`]: the second opinion on Embree. By default its compressed eight-wide BVH.
//!
//! All meshes that stand in world space make one group; every other placed object makes one. Each group has a BVH of
//! its own, over its placements' bounds lies another.

use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;

use super::{BackendInfo, HitBatch, MISS, RayBatch, RayOrder, RayQueries, Watch, go_on};
use crate::scene::Scene;
use crate::{Error, Result};

mod options;
mod test;
mod tree;

pub use options::{ObvhsOptions, Preset, TreeKind, TriangleTest};
use test::{Embree, Own, Test};
use tree::{Tree, union};

/// The library's version, as in Cargo.lock.
pub const VERSION: &str = env!("BISMAR_OBVHS_VERSION");
/// Instruction set that this program, and so the library, is compiled for: `x86-64-v3`, say.
pub const ISA_BASELINE: &str = env!("BISMAR_ISA_BASELINE");

/// obvhs skips boxes that end before t = 1e-4. Directions are shortened by this power of two, which is exact and makes
/// that 1.5e-9 of the caller's t.
const SHORTER: f32 = 1.0 / 65536.0;

/// Largest reciprocal of a direction's component: finite, so that no box test computes 0 · ∞.
const STEEPEST: f32 = 1e18;

/// A [`Scene`] built into obvhs' acceleration structure.
pub struct ObvhsRays {
    scene: Arc<Scene>,
    groups: Vec<Group>,
    placements: Vec<Placement>,
    /// Over the placements' bounds.
    top: Tree,
    test: TriangleTest,
    /// [`Scene::has_alpha`] of each mesh.
    has_alpha: Vec<bool>,
    info: BackendInfo,
}

/// Triangles that move together.
struct Group {
    bvh: Tree,
    /// In the order of the BVH's leaves.
    triangles: Vec<RtTriangle>,
    /// What each of them is.
    ids: Vec<TriangleId>,
    bounds: Aabb,
}

#[derive(Debug, Clone, Copy)]
struct TriangleId {
    /// [`MISS`] where the placement says it.
    instance: u32,
    mesh: u32,
    prim: u32,
}

struct Placement {
    group: u32,
    /// Index into [`Scene::instances`]; [`MISS`] for the group in world space.
    instance: u32,
    /// World to object; `None` for the group in world space.
    to_object: Option<Affine3A>,
}

/// The closest hit so far.
struct Closest {
    t: f32,
    u: f32,
    v: f32,
    id: TriangleId,
}

impl ObvhsRays {
    /// Builds the acceleration structure; keeps the scene for its alpha. `watch` follows it object by
    /// object: obvhs itself reports nothing.
    ///
    /// # Errors
    /// [`Error::Data`] for a malformed scene or one that makes too deep a tree, [`Error::Usage`] for one that moves,
    /// [`Error::Interrupted`] when `watch` says so.
    pub fn build(scene: Arc<Scene>, options: &ObvhsOptions, watch: Watch) -> Result<Self> {
        let start = Instant::now();
        super::check::check(&scene)?;
        if scene.moves() {
            let why =
                "--rays obvhs traces nothing that moves while the shutter is open: take --rays embree, or no --shutter";
            return Err(Error::Usage(why.into()));
        }
        let units = super::units(&scene) as f64;
        go_on(watch, 0.0)?;
        let (mut groups, mut placements, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        let meshes_of = |object: u32| scene.objects[object as usize].meshes.clone();
        let standing = scene.instances.iter().enumerate().filter(|(_, instance)| instance.transform.is_none());
        let standing = standing.flat_map(|(index, i)| meshes_of(i.object).map(move |mesh| (index as u32, mesh)));
        if let Some(group) = Group::build(&scene, standing, options)? {
            bounds.push(group.bounds);
            placements.push(Placement { group: 0, instance: MISS, to_object: None });
            groups.push(group);
        }
        let mut built: usize = groups.iter().map(|group: &Group| group.ids.len()).sum();
        // By object; the inner `None` is an object without triangles.
        let mut of_object: Vec<Option<Option<u32>>> = vec![None; scene.objects.len()];
        for (index, instance) in scene.instances.iter().enumerate() {
            let Some(transform) = instance.transform else { continue };
            let of_object = &mut of_object[instance.object as usize];
            if of_object.is_none() {
                go_on(watch, built as f64 / units)?;
                built += scene.triangles(instance.object);
                let group = Group::build(&scene, meshes_of(instance.object).map(|mesh| (MISS, mesh)), options)?;
                *of_object = Some(group.map(|group| {
                    groups.push(group);
                    groups.len() as u32 - 1
                }));
            }
            let Some(Some(group)) = *of_object else { continue };
            bounds.push(transformed(&groups[group as usize].bounds, &transform));
            let to_object = Some(transform.inverse());
            placements.push(Placement { group, instance: index as u32, to_object });
        }
        let top = Tree::build(bounds, None, options)?;
        let has_alpha = (0..scene.meshes.len() as u32).map(|mesh| scene.has_alpha(mesh)).collect();
        let memory_bytes = groups.iter().map(Group::bytes).sum::<usize>() + top.bytes();
        let info = BackendInfo {
            name: "obvhs",
            version: VERSION.to_owned(),
            isa: ISA_BASELINE.to_owned(),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: memory_bytes as u64,
            peak_bytes: None,
        };
        Ok(Self { scene, groups, placements, top, test: options.test, has_alpha, info })
    }

    /// The hit of a ray with one triangle as (t, u, v), when it counts.
    #[inline(always)]
    fn hit_triangle<T: Test>(
        &self,
        group: &Group,
        instance: u32,
        at: usize,
        ray: &Ray,
        key: u32,
    ) -> Option<(f32, f32, f32)> {
        let (t, u, v) = T::intersect(&group.triangles[at], ray)?;
        let id = group.ids[at];
        if self.has_alpha[id.mesh as usize] {
            let instance = if id.instance == MISS { instance } else { id.instance };
            if !self.scene.is_present(key, instance, id.mesh, id.prim, u, v) {
                return None;
            }
        }
        Some((t, u, v))
    }

    fn closest<T: Test>(&self, ray: &Ray, key: u32) -> Option<Closest> {
        let mut closest = None;
        let mut nearest = RayHit::none();
        self.top.closest(*ray, &mut nearest, |world, at| {
            let placement = &self.placements[self.top.order()[at] as usize];
            let group = &self.groups[placement.group as usize];
            let mut hit = RayHit::none();
            group.bvh.closest(placement.ray(world), &mut hit, |ray, at| {
                match self.hit_triangle::<T>(group, placement.instance, at, ray, key) {
                    Some((t, u, v)) if t < ray.tmax => {
                        closest = Some(Closest { t, u, v, id: group.ids[at].placed(placement.instance) });
                        t
                    }
                    _ => f32::INFINITY,
                }
            });
            hit.t
        });
        closest
    }

    fn is_occluded<T: Test>(&self, ray: &Ray, key: u32) -> bool {
        !self.top.misses(*ray, |world, at| {
            let placement = &self.placements[self.top.order()[at] as usize];
            let group = &self.groups[placement.group as usize];
            let missed = group.bvh.misses(placement.ray(world), |ray, at| {
                self.hit_triangle::<T>(group, placement.instance, at, ray, key).map_or(f32::INFINITY, |(t, _, _)| t)
            });
            if missed { f32::INFINITY } else { f32::NEG_INFINITY }
        })
    }
}

impl ObvhsRays {
    fn closest_hits_by<T: Test>(&self, rays: &RayBatch, hits: &mut HitBatch) {
        for at in 0..rays.len() {
            let hit = self.closest::<T>(&shorter_ray(rays, at), rays.key[at]);
            let miss =
                Closest { t: f32::INFINITY, u: 0.0, v: 0.0, id: TriangleId { instance: MISS, mesh: MISS, prim: MISS } };
            let hit = hit.unwrap_or(miss);
            hits.t[at] = hit.t * SHORTER;
            (hits.u[at], hits.v[at]) = (hit.u, hit.v);
            (hits.instance[at], hits.mesh[at], hits.prim[at]) = (hit.id.instance, hit.id.mesh, hit.id.prim);
        }
    }

    fn occluded_by<T: Test>(&self, rays: &RayBatch, occluded: &mut Vec<bool>) {
        occluded.clear();
        occluded.extend((0..rays.len()).map(|at| self.is_occluded::<T>(&shorter_ray(rays, at), rays.key[at])));
    }
}

impl RayQueries for ObvhsRays {
    fn closest_hits(&self, rays: &RayBatch, _order: RayOrder, hits: &mut HitBatch) {
        hits.resize(rays.len());
        match self.test {
            TriangleTest::Embree => self.closest_hits_by::<Embree>(rays, hits),
            TriangleTest::Own => self.closest_hits_by::<Own>(rays, hits),
        }
    }

    fn occluded(&self, rays: &RayBatch, _order: RayOrder, occluded: &mut Vec<bool>) {
        match self.test {
            TriangleTest::Embree => self.occluded_by::<Embree>(rays, occluded),
            TriangleTest::Own => self.occluded_by::<Own>(rays, occluded),
        }
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

impl TriangleId {
    fn placed(self, instance: u32) -> Self {
        if self.instance == MISS { Self { instance, ..self } } else { self }
    }
}

impl Placement {
    /// A world-space ray in the group's space, with the same t.
    #[inline(always)]
    fn ray(&self, world: &Ray) -> Ray {
        match &self.to_object {
            None => *world,
            Some(to_object) => ray(
                to_object.transform_point3a(world.origin),
                to_object.transform_vector3a(world.direction),
                world.tmin,
                world.tmax,
            ),
        }
    }
}

impl Group {
    /// The triangles of (instance, mesh) pairs; `None` when there are none.
    fn build(scene: &Scene, meshes: impl Iterator<Item = (u32, u32)>, options: &ObvhsOptions) -> Result<Option<Self>> {
        let (mut triangles, mut ids, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
        let mut whole = options.splits().then(Vec::new);
        for (instance, mesh) in meshes {
            let data = &scene.meshes[mesh as usize];
            for (prim, corners) in data.indices.iter().enumerate() {
                let [a, b, c] = corners.map(|vertex| Vec3A::from(data.positions[vertex as usize]));
                triangles.push(RtTriangle::new(a, b, c));
                boxes.push(Aabb::from_points(&[a, b, c]));
                if let Some(whole) = &mut whole {
                    whole.push(Triangle { v0: a, v1: b, v2: c });
                }
                ids.push(TriangleId { instance, mesh, prim: prim as u32 });
            }
        }
        if triangles.is_empty() {
            return Ok(None);
        }
        let bounds = union(&boxes);
        let bvh = Tree::build(boxes, whole.as_deref(), options)?;
        let order = bvh.order();
        Ok(Some(Self {
            triangles: order.iter().map(|&at| triangles[at as usize]).collect(),
            ids: order.iter().map(|&at| ids[at as usize]).collect(),
            bvh,
            bounds,
        }))
    }

    fn bytes(&self) -> usize {
        self.bvh.bytes() + size_of_val(&*self.triangles) + size_of_val(&*self.ids)
    }
}

/// The box around a transformed box.
fn transformed(aabb: &Aabb, transform: &Affine3A) -> Aabb {
    let corner = |at: usize| {
        let pick = |bit: usize, axis: usize| if at & bit == 0 { aabb.min[axis] } else { aabb.max[axis] };
        transform.transform_point3a(Vec3A::new(pick(1, 0), pick(2, 1), pick(4, 2)))
    };
    Aabb::from_points(&std::array::from_fn::<_, 8, _>(corner))
}

/// The ray of a batch with its direction times [`SHORTER`].
#[inline(always)]
fn shorter_ray(rays: &RayBatch, at: usize) -> Ray {
    let column = |of: &[Vec<f32>; 3]| Vec3A::new(of[0][at], of[1][at], of[2][at]);
    ray(column(&rays.origin), column(&rays.direction) * SHORTER, rays.tnear[at] / SHORTER, rays.tfar[at] / SHORTER)
}

#[inline(always)]
fn ray(origin: Vec3A, direction: Vec3A, tmin: f32, tmax: f32) -> Ray {
    // obvhs takes −0 for positive, so its reciprocal must be: the sum of −0 and 0 is 0.
    let inv_direction = (direction + Vec3A::ZERO).recip().clamp(Vec3A::splat(-STEEPEST), Vec3A::splat(STEEPEST));
    Ray { origin, direction, inv_direction, tmin, tmax }
}
