//! obvhs' compressed eight-wide BVH in pure Rust behind [`RayQueries`]: the second opinion on Embree.
//!
//! All meshes that stand in world space make one group; every other placed object makes one. Each group has a BVH of
//! its own, over its placements' bounds lies another. The triangle test is Embree's default one (Möller–Trumbore).

use std::sync::Arc;
use std::time::Instant;

use glam::{Affine3A, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::{CwBvh, node::CwBvhNode};
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;

use super::{BackendInfo, HitBatch, MISS, RayBatch, RayOrder, RayQueries, Watch, go_on};
use crate::scene::Scene;
use crate::{Error, Result};

/// obvhs skips boxes that end before t = 1e-4. Directions are shortened by this power of two, which is exact and makes
/// that 1.5e-9 of the caller's t.
const SHORTER: f32 = 1.0 / 65536.0;

/// Largest reciprocal of a direction's component: finite, so that no box test computes 0 · ∞.
const STEEPEST: f32 = 1e18;

/// Boxes grow by this share of their tree's largest coordinate, so that rounding in the box tests loses no hit.
const SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Levels that obvhs' traversal stack holds; it forgets nodes of deeper trees silently.
const DEEPEST: u32 = 32;

/// A [`Scene`] built into obvhs' acceleration structure.
pub struct ObvhsRays {
    scene: Arc<Scene>,
    groups: Vec<Group>,
    placements: Vec<Placement>,
    /// Over the placements' bounds.
    top: CwBvh,
    /// [`Scene::has_alpha`] of each mesh.
    has_alpha: Vec<bool>,
    info: BackendInfo,
}

/// Triangles that move together.
struct Group {
    bvh: CwBvh,
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
    /// [`Error::Data`] for a malformed scene or one that makes too deep a tree, [`Error::Interrupted`] when `watch` says
    /// so.
    pub fn build(scene: Arc<Scene>, watch: Watch) -> Result<Self> {
        let start = Instant::now();
        super::check::check(&scene)?;
        let units = super::units(&scene) as f64;
        go_on(watch, 0.0)?;
        let (mut groups, mut placements, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        let meshes_of = |object: u32| scene.objects[object as usize].meshes.clone();
        let standing = scene.instances.iter().enumerate().filter(|(_, instance)| instance.transform.is_none());
        let standing = standing.flat_map(|(index, i)| meshes_of(i.object).map(move |mesh| (index as u32, mesh)));
        if let Some(group) = Group::build(&scene, standing)? {
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
                let group = Group::build(&scene, meshes_of(instance.object).map(|mesh| (MISS, mesh)))?;
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
        let top = build_bvh(&mut bounds)?;
        let has_alpha = (0..scene.meshes.len() as u32).map(|mesh| scene.has_alpha(mesh)).collect();
        let memory_bytes = groups.iter().map(Group::bytes).sum::<usize>() + bvh_bytes(&top);
        let info = BackendInfo {
            name: "obvhs",
            version: env!("BISMAR_OBVHS_VERSION").to_owned(),
            isa: env!("BISMAR_ISA_BASELINE").to_owned(),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: memory_bytes as u64,
        };
        Ok(Self { scene, groups, placements, top, has_alpha, info })
    }

    /// The hit of a ray with one triangle as (t, u, v), when it counts.
    #[inline(always)]
    fn hit_triangle(&self, group: &Group, instance: u32, at: usize, ray: &Ray, key: u32) -> Option<(f32, f32, f32)> {
        let (t, u, v) = intersect(&group.triangles[at], ray)?;
        let id = group.ids[at];
        if self.has_alpha[id.mesh as usize] {
            let instance = if id.instance == MISS { instance } else { id.instance };
            if !self.scene.is_present(key, instance, id.mesh, id.prim, u, v) {
                return None;
            }
        }
        Some((t, u, v))
    }

    fn closest(&self, ray: &Ray, key: u32) -> Option<Closest> {
        let mut closest = None;
        let mut nearest = RayHit::none();
        self.top.ray_traverse(*ray, &mut nearest, |world, at| {
            let placement = &self.placements[self.top.primitive_indices[at] as usize];
            let group = &self.groups[placement.group as usize];
            let mut hit = RayHit::none();
            group.bvh.ray_traverse(placement.ray(world), &mut hit, |ray, at| {
                match self.hit_triangle(group, placement.instance, at, ray, key) {
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

    fn is_occluded(&self, ray: &Ray, key: u32) -> bool {
        !self.top.ray_traverse_miss(*ray, |world, at| {
            let placement = &self.placements[self.top.primitive_indices[at] as usize];
            let group = &self.groups[placement.group as usize];
            let missed = group.bvh.ray_traverse_miss(placement.ray(world), |ray, at| {
                self.hit_triangle(group, placement.instance, at, ray, key).map_or(f32::INFINITY, |(t, _, _)| t)
            });
            if missed { f32::INFINITY } else { f32::NEG_INFINITY }
        })
    }
}

impl RayQueries for ObvhsRays {
    fn closest_hits(&self, rays: &RayBatch, _order: RayOrder, hits: &mut HitBatch) {
        hits.resize(rays.len());
        for at in 0..rays.len() {
            let hit = self.closest(&shorter_ray(rays, at), rays.key[at]);
            let miss =
                Closest { t: f32::INFINITY, u: 0.0, v: 0.0, id: TriangleId { instance: MISS, mesh: MISS, prim: MISS } };
            let hit = hit.unwrap_or(miss);
            hits.t[at] = hit.t * SHORTER;
            (hits.u[at], hits.v[at]) = (hit.u, hit.v);
            (hits.instance[at], hits.mesh[at], hits.prim[at]) = (hit.id.instance, hit.id.mesh, hit.id.prim);
        }
    }

    fn occluded(&self, rays: &RayBatch, _order: RayOrder, occluded: &mut Vec<bool>) {
        occluded.clear();
        occluded.extend((0..rays.len()).map(|at| self.is_occluded(&shorter_ray(rays, at), rays.key[at])));
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
    fn build(scene: &Scene, meshes: impl Iterator<Item = (u32, u32)>) -> Result<Option<Self>> {
        let (mut triangles, mut ids, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
        for (instance, mesh) in meshes {
            let data = &scene.meshes[mesh as usize];
            for (prim, corners) in data.indices.iter().enumerate() {
                let [a, b, c] = corners.map(|vertex| Vec3A::from(data.positions[vertex as usize]));
                triangles.push(RtTriangle::new(a, b, c));
                boxes.push(Aabb::from_points(&[a, b, c]));
                ids.push(TriangleId { instance, mesh, prim: prim as u32 });
            }
        }
        if triangles.is_empty() {
            return Ok(None);
        }
        let bounds = union(&boxes);
        let bvh = build_bvh(&mut boxes)?;
        let order = &bvh.primitive_indices;
        Ok(Some(Self {
            triangles: order.iter().map(|&at| triangles[at as usize]).collect(),
            ids: order.iter().map(|&at| ids[at as usize]).collect(),
            bvh,
            bounds,
        }))
    }

    fn bytes(&self) -> usize {
        bvh_bytes(&self.bvh) + size_of_val(&*self.triangles) + size_of_val(&*self.ids)
    }
}

fn bvh_bytes(bvh: &CwBvh) -> usize {
    bvh.nodes.len() * size_of::<CwBvhNode>() + size_of_val(&*bvh.primitive_indices)
}

fn union(boxes: &[Aabb]) -> Aabb {
    boxes.iter().fold(Aabb::empty(), |all, one| all.union(one))
}

/// The box around a transformed box.
fn transformed(aabb: &Aabb, transform: &Affine3A) -> Aabb {
    let corner = |at: usize| {
        let pick = |bit: usize, axis: usize| if at & bit == 0 { aabb.min[axis] } else { aabb.max[axis] };
        transform.transform_point3a(Vec3A::new(pick(1, 0), pick(2, 1), pick(4, 2)))
    };
    Aabb::from_points(&std::array::from_fn::<_, 8, _>(corner))
}

/// A BVH over boxes, which grow by [`SLACK`].
fn build_bvh(boxes: &mut [Aabb]) -> Result<CwBvh> {
    if boxes.is_empty() {
        return Ok(CwBvh::default());
    }
    let bounds = union(boxes);
    let slack = SLACK * bounds.min.abs().max(bounds.max.abs()).max_element();
    for one in boxes.iter_mut() {
        *one = Aabb::new(one.min - slack, one.max + slack);
    }
    let choices = BvhBuildParams::medium_build();
    // As `build_cwbvh`, which validates with absolute tolerances in debug builds.
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        choices.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        choices.sort_precision,
        choices.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, choices.reinsertion_batch_ratio, None);
    let bvh = bvh2_to_cwbvh(&binary, choices.max_prims_per_leaf.clamp(1, 3), true, false);
    let depth = depth(&bvh);
    if depth > DEEPEST {
        return Err(Error::Data(format!(
            "the scene's triangles overlap so much that obvhs' tree has {depth} levels, more than the {DEEPEST} that \
             it can walk; use --rays embree"
        )));
    }
    Ok(bvh)
}

/// Levels of nodes. Children come after their parent.
fn depth(bvh: &CwBvh) -> u32 {
    let mut levels = vec![1; bvh.nodes.len()];
    for (at, node) in bvh.nodes.iter().enumerate() {
        let children = node.child_base_idx as usize..;
        let below = levels[at] + 1;
        for child in children.take(node.imask.count_ones() as usize) {
            levels[child] = below;
        }
    }
    levels.into_iter().max().unwrap_or(0)
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

/// Embree's Möller–Trumbore test without culling; (t, u, v) with t in (`tmin`, `tmax`].
#[inline(always)]
fn intersect(triangle: &RtTriangle, ray: &Ray) -> Option<(f32, f32, f32)> {
    // RtTriangle has e1 = v0 − v1, e2 = v2 − v0, ng = e1 × e2.
    let to_vertex = triangle.v0 - ray.origin;
    let moment = ray.direction.cross(to_vertex);
    let determinant = triangle.ng.dot(ray.direction);
    let (size, sign) = (determinant.abs(), 1.0_f32.copysign(determinant));
    let u = moment.dot(triangle.e2) * sign;
    let v = moment.dot(triangle.e1) * sign;
    // Not the negation with `||`: NaN misses.
    if !(determinant != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= size) {
        return None;
    }
    let t = triangle.ng.dot(to_vertex) * sign;
    if !(size * ray.tmin < t && t <= size * ray.tmax) {
        return None;
    }
    Some((t / size, u / size, v / size))
}
