//! The obvhs backend of [`RayQueries`], in pure Rust: an independent check of Embree. It uses the compressed eight-wide BVH by
//! default.
//!
//! All meshes that are placed without a transform share one bottom-level BVH; every other object has one of its own. The
//! top-level BVH is built over the bounds of their placements.

use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;

use super::batch::{AnyHit, HitBatch, MISS, NO_PRIMITIVE, RayBatch, RayOrder};
use super::build::{Watch, build_units, check_watch};
use super::check::check;
use super::queries::{BackendInfo, RayQueries};
use crate::scene::{Primitive, Scene};
use crate::{Error, Result};

mod options;
mod test;
mod tree;

pub use options::{ObvhsOptions, Preset, TreeKind, TriangleTest};
use test::{EmbreeTest, IntersectionTest, ObvhsTest};
use tree::{Tree, union};

/// Version of obvhs in Cargo.lock.
pub const VERSION: &str = env!("BISMAR_OBVHS_VERSION");
/// Instruction set that this program is compiled for, for example `x86-64-v3`.
pub const ISA_BASELINE: &str = env!("BISMAR_ISA_BASELINE");

/// Directions are scaled by this power of two, which is exact: obvhs skips boxes that end before t = 1e-4, which then is
/// 1.5e-9 in the caller's units.
const DIRECTION_SCALE: f32 = 1.0 / 65536.0;

/// Largest reciprocal of a direction component; finite, so that box tests never compute 0 · ∞.
const MAX_RECIPROCAL: f32 = 1e18;

/// The acceleration structure of a [`Scene`] by obvhs.
pub struct ObvhsRays {
    scene: Arc<Scene>,
    bottom_levels: Vec<BottomLevel>,
    placements: Vec<Placement>,
    /// Top-level BVH over the bounds of the placements.
    top: Tree,
    test: TriangleTest,
    /// [`Scene::has_alpha`] by mesh.
    has_alpha: Vec<bool>,
    info: BackendInfo,
}

/// A bottom-level BVH with its triangles.
struct BottomLevel {
    bvh: Tree,
    /// In the order of the BVH's leaves.
    triangles: Vec<RtTriangle>,
    /// Of each triangle. The instance is [`MISS`] if the placement determines it.
    ids: Vec<Primitive>,
    bounds: Aabb,
}

struct Placement {
    bottom_level: u32,
    /// Index into [`Scene::instances`]; [`MISS`] for the triangles in world space.
    instance: u32,
    /// World to object; `None` for the triangles in world space.
    to_object: Option<Affine3A>,
}

impl ObvhsRays {
    /// Builds the acceleration structure; keeps the scene for alpha tests. `watch` is called once per object, because obvhs does
    /// not report progress.
    ///
    /// # Errors
    /// [`Error::Data`] for a malformed scene or one whose tree is too deep, [`Error::Usage`] for a scene with motion,
    /// [`Error::Interrupted`] if `watch` stops the build.
    pub fn build(scene: Arc<Scene>, options: &ObvhsOptions, watch: Watch) -> Result<Self> {
        let start = Instant::now();
        check(&scene)?;
        if scene.moves() {
            let why = "obvhs does not support motion while the shutter is open: use Embree, or no shutter";
            return Err(Error::Usage(why.into()));
        }
        let units = build_units(&scene) as f64;
        check_watch(watch, 0.0)?;
        let (mut bottom_levels, mut placements, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        let meshes_of = |object: u32| scene.objects[object as usize].meshes.clone();
        let untransformed = (0..).zip(&scene.instances).filter(|(_, instance)| instance.transform.is_none());
        let untransformed = untransformed.flat_map(|(index, i)| meshes_of(i.object).map(move |mesh| (index, mesh)));
        if let Some(bottom_level) = BottomLevel::build(&scene, untransformed, options)? {
            bounds.push(bottom_level.bounds);
            placements.push(Placement { bottom_level: 0, instance: MISS, to_object: None });
            bottom_levels.push(bottom_level);
        }
        let mut built: usize = bottom_levels.iter().map(|bottom_level: &BottomLevel| bottom_level.ids.len()).sum();
        // By object: its bottom level once built; the inner `None` is an object without triangles.
        let mut of_object: Vec<Option<Option<u32>>> = vec![None; scene.objects.len()];
        for (index, instance) in scene.instances.iter().enumerate() {
            let Some(transform) = instance.transform else { continue };
            let of_object = &mut of_object[instance.object as usize];
            if of_object.is_none() {
                check_watch(watch, built as f64 / units)?;
                built += scene.triangles(instance.object);
                let bottom_level =
                    BottomLevel::build(&scene, meshes_of(instance.object).map(|mesh| (MISS, mesh)), options)?;
                *of_object = Some(bottom_level.map(|bottom_level| {
                    bottom_levels.push(bottom_level);
                    bottom_levels.len() as u32 - 1
                }));
            }
            let Some(Some(bottom_level)) = *of_object else { continue };
            bounds.push(transformed(&bottom_levels[bottom_level as usize].bounds, &transform));
            let to_object = Some(transform.inverse());
            placements.push(Placement { bottom_level, instance: index as u32, to_object });
        }
        let top = Tree::build(bounds, None, options)?;
        let has_alpha = (0..scene.meshes.len() as u32).map(|mesh| scene.has_alpha(mesh)).collect();
        let memory_bytes = bottom_levels.iter().map(BottomLevel::bytes).sum::<usize>() + top.bytes();
        let info = BackendInfo {
            name: "obvhs",
            version: VERSION.to_owned(),
            isa: ISA_BASELINE.to_owned(),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: memory_bytes as u64,
            peak_bytes: None,
        };
        Ok(Self { scene, bottom_levels, placements, top, test: options.test, has_alpha, info })
    }

    /// Intersects a ray with one triangle: (t, u, v), or `None` for a miss and for hits that fail the alpha test.
    #[inline(always)]
    fn hit_triangle<T: IntersectionTest>(
        &self,
        bottom_level: &BottomLevel,
        instance: u32,
        at: usize,
        ray: &Ray,
        key: u32,
    ) -> Option<(f32, f32, f32)> {
        let (t, u, v) = T::intersect(&bottom_level.triangles[at], ray)?;
        let id = bottom_level.ids[at];
        let is_present = |of: Primitive| self.scene.is_present(key, of.instance, of.mesh, of.prim, u, v);
        (!self.has_alpha[id.mesh as usize] || is_present(placed(id, instance))).then_some((t, u, v))
    }

    fn is_back(&self, rays: &RayBatch, at: usize, primitive: Primitive) -> bool {
        self.scene.is_back(primitive, rays.direction(at), rays.time(at))
    }

    /// Distance, barycentric weights and triangle of the closest hit that `counts`, or of a miss.
    #[inline(always)]
    fn closest<T: IntersectionTest>(
        &self,
        ray: &Ray,
        key: u32,
        counts: impl Fn(Primitive) -> bool,
    ) -> ((f32, f32, f32), Primitive) {
        let mut closest = ((f32::INFINITY, 0.0, 0.0), NO_PRIMITIVE);
        let mut nearest = RayHit::none();
        self.top.closest(*ray, &mut nearest, |world, at| {
            let placement = &self.placements[self.top.order()[at] as usize];
            let bottom_level = &self.bottom_levels[placement.bottom_level as usize];
            let mut hit = RayHit::none();
            bottom_level.bvh.closest(placement.ray(world), &mut hit, |ray, at| {
                let primitive = placed(bottom_level.ids[at], placement.instance);
                match self.hit_triangle::<T>(bottom_level, placement.instance, at, ray, key) {
                    Some((t, u, v)) if t < ray.tmax && counts(primitive) => {
                        closest = ((t, u, v), primitive);
                        t
                    }
                    _ => f32::INFINITY,
                }
            });
            hit.t
        });
        closest
    }

    fn is_occluded<T: IntersectionTest>(&self, ray: &Ray, key: u32) -> bool {
        !self.top.misses(*ray, |world, at| {
            let placement = &self.placements[self.top.order()[at] as usize];
            let bottom_level = &self.bottom_levels[placement.bottom_level as usize];
            let missed = bottom_level.bvh.misses(placement.ray(world), |ray, at| {
                self.hit_triangle::<T>(bottom_level, placement.instance, at, ray, key)
                    .map_or(f32::INFINITY, |(t, _, _)| t)
            });
            if missed { f32::INFINITY } else { f32::NEG_INFINITY }
        })
    }

    fn all_hits_of<T: IntersectionTest>(&self, ray: &Ray, mut found: impl FnMut(f32, Primitive)) {
        // None of them ends the ray.
        self.top.misses(*ray, |world, at| {
            let placement = &self.placements[self.top.order()[at] as usize];
            let bottom_level = &self.bottom_levels[placement.bottom_level as usize];
            bottom_level.bvh.misses(placement.ray(world), |ray, at| {
                if let Some((t, _, _)) = T::intersect(&bottom_level.triangles[at], ray) {
                    found(t, placed(bottom_level.ids[at], placement.instance));
                }
                f32::INFINITY
            });
            f32::INFINITY
        });
    }

    /// Closest hits that `count` for the ray of this row.
    fn closest_hits_by<T: IntersectionTest>(
        &self,
        rays: &RayBatch,
        hits: &mut HitBatch,
        counts: impl Fn(usize, Primitive) -> bool,
    ) {
        hits.resize(rays.len());
        for at in 0..rays.len() {
            let ((t, u, v), primitive) =
                self.closest::<T>(&scaled_ray(rays, at), rays.key[at], |primitive| counts(at, primitive));
            let back = primitive.mesh != MISS && self.is_back(rays, at, primitive);
            hits.set(at, (t * DIRECTION_SCALE, u, v), primitive, back);
        }
    }

    fn occluded_by<T: IntersectionTest>(&self, rays: &RayBatch, occluded: &mut Vec<bool>) {
        occluded.clear();
        occluded.extend((0..rays.len()).map(|at| self.is_occluded::<T>(&scaled_ray(rays, at), rays.key[at])));
    }
}

impl RayQueries for ObvhsRays {
    fn closest_hits(&self, rays: &RayBatch, _order: RayOrder, hits: &mut HitBatch) {
        match self.test {
            TriangleTest::Embree => self.closest_hits_by::<EmbreeTest>(rays, hits, |_, _| true),
            TriangleTest::Obvhs => self.closest_hits_by::<ObvhsTest>(rays, hits, |_, _| true),
        }
    }

    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch) {
        let is_front = |at: usize, primitive: Primitive| {
            !(self.scene.is_single_sided(primitive.mesh) && self.is_back(rays, at, primitive))
        };
        match self.test {
            TriangleTest::Embree => self.closest_hits_by::<EmbreeTest>(rays, hits, is_front),
            TriangleTest::Obvhs => self.closest_hits_by::<ObvhsTest>(rays, hits, is_front),
        }
    }

    fn occluded(&self, rays: &RayBatch, _order: RayOrder, occluded: &mut Vec<bool>) {
        match self.test {
            TriangleTest::Embree => self.occluded_by::<EmbreeTest>(rays, occluded),
            TriangleTest::Obvhs => self.occluded_by::<ObvhsTest>(rays, occluded),
        }
    }

    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        found.clear();
        for at in 0..rays.len() {
            let ray = scaled_ray(rays, at);
            let add = |t, primitive| found.push(AnyHit { ray: at as u32, t: t * DIRECTION_SCALE, primitive });
            match self.test {
                TriangleTest::Embree => self.all_hits_of::<EmbreeTest>(&ray, add),
                TriangleTest::Obvhs => self.all_hits_of::<ObvhsTest>(&ray, add),
            }
        }
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

/// A triangle whose instance the placement determines if it has none.
#[inline(always)]
fn placed(id: Primitive, instance: u32) -> Primitive {
    if id.instance == MISS { Primitive { instance, ..id } } else { id }
}

impl Placement {
    /// Transforms a world-space ray to the space of the bottom level; t stays the same.
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

impl BottomLevel {
    /// Builds a BVH over the triangles of (instance, mesh) pairs; `None` if there are none.
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
                ids.push(Primitive { instance, mesh, prim: prim as u32 });
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

/// Bounding box of a transformed box.
fn transformed(aabb: &Aabb, transform: &Affine3A) -> Aabb {
    let corner = |at: usize| {
        let pick = |bit: usize, axis: usize| if at & bit == 0 { aabb.min[axis] } else { aabb.max[axis] };
        transform.transform_point3a(Vec3A::new(pick(1, 0), pick(2, 1), pick(4, 2)))
    };
    Aabb::from_points(&std::array::from_fn::<_, 8, _>(corner))
}

/// A ray of a batch with its direction scaled by [`DIRECTION_SCALE`].
#[inline(always)]
fn scaled_ray(rays: &RayBatch, at: usize) -> Ray {
    let column = |of: &[Vec<f32>; 3]| Vec3A::new(of[0][at], of[1][at], of[2][at]);
    ray(
        column(&rays.origin),
        column(&rays.direction) * DIRECTION_SCALE,
        rays.tnear[at] / DIRECTION_SCALE,
        rays.tfar[at] / DIRECTION_SCALE,
    )
}

#[inline(always)]
fn ray(origin: Vec3A, direction: Vec3A, tmin: f32, tmax: f32) -> Ray {
    // obvhs treats −0 as positive, so its reciprocal must be +∞: −0 + 0 = 0.
    let inv_direction =
        (direction + Vec3A::ZERO).recip().clamp(Vec3A::splat(-MAX_RECIPROCAL), Vec3A::splat(MAX_RECIPROCAL));
    Ray { origin, direction, inv_direction, tmin, tmax }
}
