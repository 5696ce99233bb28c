//! Queries in packets: conversion of batches to Embree's packets and back.

use std::cell::RefCell;
use std::ffi::c_int;
use std::mem::offset_of;

use embree4_sys as sys;

use super::committed::{CommittedScene, Placement};
use crate::rays::batch::{AnyHit, HitBatch, MISS, NO_PRIMITIVE, RayBatch};
use crate::scene::Primitive;

/// How the rays of a packet are traversed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coherence {
    /// One by one after they diverge.
    Incoherent,
    /// Together, in the order of the batch.
    Coherent,
    /// Together, after sorting the batch into packets of one octant.
    Sorted,
}

impl Coherence {
    fn flags(self) -> sys::RTCRayQueryFlags {
        match self {
            Self::Incoherent => sys::RTC_RAY_QUERY_FLAG_INCOHERENT,
            Self::Coherent | Self::Sorted => sys::RTC_RAY_QUERY_FLAG_COHERENT,
        }
    }
}

/// Which sides of single-sided surfaces rays hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sides {
    Both,
    Fronts,
}

/// Embree's query context, extended by the data of the filter.
#[repr(C)]
struct QueryContext<'a> {
    embree: sys::RTCRayQueryContext,
    committed: &'a CommittedScene,
    /// By ray id.
    rays: &'a RayBatch,
    sides: Sides,
}

impl<'a> QueryContext<'a> {
    fn new(committed: &'a CommittedScene, rays: &'a RayBatch, sides: Sides) -> Self {
        Self { embree: sys::init_ray_query_context(), committed, rays, sides }
    }

    fn filter(&self) -> sys::RTCFilterFunctionN {
        if self.committed.has_alpha || self.sides == Sides::Fronts { Some(filter) } else { None }
    }

    /// Arguments of queries for closest hits, which the context must outlive.
    fn intersect(&mut self, mut flags: sys::RTCRayQueryFlags) -> sys::RTCIntersectArguments {
        if self.sides == Sides::Fronts {
            // Else it is called for meshes with alpha only.
            flags |= sys::RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
        }
        sys::RTCIntersectArguments {
            flags,
            feature_mask: sys::RTC_FEATURE_FLAG_ALL,
            filter: self.filter(),
            context: (&raw mut *self).cast(),
            intersect: None,
        }
    }

    /// Arguments of queries for any hit, which the context must outlive.
    fn occluded(&mut self, flags: sys::RTCRayQueryFlags) -> sys::RTCOccludedArguments {
        sys::RTCOccludedArguments {
            flags,
            feature_mask: sys::RTC_FEATURE_FLAG_ALL,
            filter: self.filter(),
            context: (&raw mut *self).cast(),
            occluded: None,
        }
    }
}

/// Intersection filter: rejects the hits of a packet that fail the alpha test, and those on backs if only fronts count.
unsafe extern "C" fn filter(args: *const sys::RTCFilterFunctionNArguments) {
    // A packet of N has a column of N values for each field of the single-ray struct.
    const ID: usize = offset_of!(sys::RTCRay, id) / 4;
    const U: usize = offset_of!(sys::RTCHit, u) / 4;
    const V: usize = offset_of!(sys::RTCHit, v) / 4;
    const PRIM: usize = offset_of!(sys::RTCHit, primID) / 4;
    const GEOMETRY: usize = offset_of!(sys::RTCHit, geomID) / 4;
    const INSTANCE: usize = offset_of!(sys::RTCHit, instID) / 4;
    // SAFETY: Embree calls this with valid arguments, and the context is the one that the queries below hand over.
    let (args, context) = unsafe { (&*args, &*(*args).context.cast::<QueryContext>()) };
    let n = args.N as usize;
    for lane in 0..n {
        // SAFETY: `valid`, and each column of ray and hit, has N entries.
        unsafe {
            let valid = args.valid.add(lane);
            if *valid != -1 {
                continue;
            }
            let ray = |column: usize| *args.ray.cast::<u32>().add(column * n + lane);
            let hit = |column: usize| *args.hit.cast::<u32>().add(column * n + lane);
            let placement = context.committed.placement_of(hit(GEOMETRY), hit(INSTANCE));
            let [u, v] = [hit(U), hit(V)].map(f32::from_bits);
            let (rays, id) = (context.rays, ray(ID) as usize);
            let hit = Primitive { instance: placement.instance, mesh: placement.mesh, prim: hit(PRIM) };
            let scene = &context.committed.scene;
            let is_culled = context.sides == Sides::Fronts
                && scene.is_single_sided(hit.mesh)
                && scene.is_back(hit, rays.direction(id), rays.time(id));
            if is_culled || !scene.is_present(rays.key[id], hit.instance, hit.mesh, hit.prim, u, v) {
                *valid = 0;
            }
        }
    }
}

/// Embree's query context, extended by a list of all hits.
#[repr(C)]
struct AllHitsContext<'a> {
    embree: sys::RTCRayQueryContext,
    committed: &'a CommittedScene,
    found: &'a mut Vec<AnyHit>,
}

/// Intersection filter for single rays: keeps the hit, and rejects it, so that the ray goes on.
unsafe extern "C" fn collect_hit(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree calls this with valid arguments for one ray, and a packet of one has the layout of a single ray; the context
    // is the one that `all_hits` hands over, and nobody else uses it meanwhile.
    unsafe {
        let context = &mut *(*args).context.cast::<AllHitsContext>();
        let (ray, hit) =
            ((*args).ray.cast::<sys::RTCRay>().read_unaligned(), (*args).hit.cast::<sys::RTCHit>().read_unaligned());
        let Placement { instance, mesh } = context.committed.placement_of(hit.geomID, hit.instID[0]);
        let primitive = Primitive { instance, mesh, prim: hit.primID };
        context.found.push(AnyHit { ray: ray.id, t: ray.tfar, primitive });
        *(*args).valid = 0;
    }
}

/// Lane mask of a packet, with the alignment that Embree requires.
#[repr(C, align(64))]
struct LaneMask<const N: usize>([c_int; N]);

impl<const N: usize> LaneMask<N> {
    fn first(count: usize) -> Self {
        Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
    }
}

/// The rays of a batch that are in a packet.
#[derive(Clone, Copy)]
enum PacketRows<'a> {
    /// Consecutive rays from this one on.
    From(usize),
    Each(&'a [u32]),
}

/// Loads a part of a column; spare lanes keep their values.
#[inline(always)]
fn load<const N: usize>(lanes: &mut [f32; N], column: &[f32], rows: PacketRows) {
    match rows {
        PacketRows::From(start) => match column[start..].first_chunk() {
            Some(chunk) => *lanes = *chunk,
            None => lanes[..column.len() - start].copy_from_slice(&column[start..]),
        },
        PacketRows::Each(rays) => {
            for (lane, &ray) in lanes.iter_mut().zip(rays) {
                *lane = column[ray as usize];
            }
        }
    }
}

/// Stores lanes to a part of a column; spare lanes are dropped.
#[inline(always)]
fn store<T: Copy, const N: usize>(column: &mut [T], rows: PacketRows, lanes: &[T; N]) {
    match rows {
        PacketRows::From(start) => match column[start..].first_chunk_mut() {
            Some(chunk) => *chunk = *lanes,
            None => {
                let len = column.len() - start;
                column[start..].copy_from_slice(&lanes[..len]);
            }
        },
        PacketRows::Each(rays) => {
            for (&lane, &ray) in lanes.iter().zip(rays) {
                column[ray as usize] = lane;
            }
        }
    }
}

/// Calls `packet` with the rays of each packet of `n`, in the order of the batch or `sorted` by the octant of the direction.
/// Embree traverses a coherent packet once per octant: sorting reduces the cost of diffuse bounces in a small scene to a
/// third.
#[inline(always)]
fn for_each_packet(rays: &RayBatch, n: usize, sorted: bool, mut packet: impl FnMut(PacketRows, usize)) {
    thread_local! {
        static ORDER: RefCell<Vec<u32>> = const { RefCell::new(Vec::new()) };
    }
    if !sorted {
        for start in (0..rays.len()).step_by(n) {
            packet(PacketRows::From(start), n.min(rays.len() - start));
        }
        return;
    }
    ORDER.with_borrow_mut(|order| {
        let [x, y, z] = &rays.direction;
        let octant = |i: usize| (x[i].to_bits() >> 31 | y[i].to_bits() >> 31 << 1 | z[i].to_bits() >> 31 << 2) as usize;
        let mut ends = [0; 8];
        (0..rays.len()).for_each(|i| ends[octant(i)] += 1);
        let mut start = 0;
        for end in &mut ends {
            (start, *end) = (start + *end, start);
        }
        order.resize(rays.len(), 0);
        for i in 0..rays.len() {
            let next = &mut ends[octant(i)];
            order[*next] = i as u32;
            *next += 1;
        }
        for rows in order.chunks(n) {
            packet(PacketRows::Each(rows), rows.len());
        }
    });
}

const LEVELS: usize = sys::RTC_MAX_INSTANCE_LEVEL_COUNT as usize;

macro_rules! packet_queries {
    ($module:ident, $n:literal, $ray:ident, $ray_hit:ident, $intersect:ident, $occluded:ident) => {
        pub(super) mod $module {
            use super::*;

            #[inline(always)]
            fn load_rays(lanes: &mut sys::$ray, rays: &RayBatch, rows: PacketRows) {
                load(&mut lanes.org_x, &rays.origin[0], rows);
                load(&mut lanes.org_y, &rays.origin[1], rows);
                load(&mut lanes.org_z, &rays.origin[2], rows);
                load(&mut lanes.dir_x, &rays.direction[0], rows);
                load(&mut lanes.dir_y, &rays.direction[1], rows);
                load(&mut lanes.dir_z, &rays.direction[2], rows);
                load(&mut lanes.tnear, &rays.tnear, rows);
                load(&mut lanes.tfar, &rays.tfar, rows);
                if !rays.time.is_empty() {
                    load(&mut lanes.time, &rays.time, rows);
                }
                match rows {
                    PacketRows::From(start) => lanes.id = std::array::from_fn(|lane| (start + lane) as u32),
                    PacketRows::Each(rays) => lanes.id[..rays.len()].copy_from_slice(rays),
                }
            }

            pub fn closest_hits(
                scene: &CommittedScene,
                rays: &RayBatch,
                (coherence, sides): (Coherence, Sides),
                hits: &mut HitBatch,
            ) {
                let mut context = QueryContext::new(scene, rays, sides);
                let mut args = context.intersect(coherence.flags());
                let mut packet = sys::$ray_hit::default();
                packet.ray.mask = [u32::MAX; $n];
                for_each_packet(rays, $n, coherence == Coherence::Sorted, |rows, len| {
                    load_rays(&mut packet.ray, rays, rows);
                    packet.hit.geomID = [sys::RTC_INVALID_GEOMETRY_ID; $n];
                    packet.hit.instID = [[sys::RTC_INVALID_GEOMETRY_ID; $n]; LEVELS];
                    let valid = LaneMask::<$n>::first(len);
                    // SAFETY: the scene is committed, `context` lives, mask and packet are aligned by their types.
                    unsafe { sys::$intersect(valid.0.as_ptr(), scene.top.0, &mut packet, &mut args) };
                    let (hit, ray) = (&packet.hit, &packet.ray);
                    // Embree's normals are those of the winding, in the space of the object.
                    let mut back: [bool; $n] = std::array::from_fn(|lane| {
                        let along = hit.Ng_x[lane] * ray.dir_x[lane] + hit.Ng_y[lane] * ray.dir_y[lane];
                        along + hit.Ng_z[lane] * ray.dir_z[lane] > 0.0
                    });
                    let (mut t, mut prim) = (packet.ray.tfar, hit.primID);
                    let (mut instance, mut mesh) = ([MISS; $n], [MISS; $n]);
                    for lane in 0..$n {
                        if hit.geomID[lane] == sys::RTC_INVALID_GEOMETRY_ID {
                            (t[lane], prim[lane]) = (f32::INFINITY, MISS);
                        } else {
                            let placement = scene.placement_of(hit.geomID[lane], hit.instID[0][lane]);
                            (instance[lane], mesh[lane]) = (placement.instance, placement.mesh);
                            if hit.instID[0][lane] != sys::RTC_INVALID_GEOMETRY_ID {
                                let primitive =
                                    Primitive { instance: instance[lane], mesh: mesh[lane], prim: prim[lane] };
                                let id = ray.id[lane] as usize;
                                back[lane] = scene.scene.is_back(primitive, rays.direction(id), rays.time(id));
                            }
                        }
                    }
                    store(&mut hits.t, rows, &t);
                    store(&mut hits.u, rows, &hit.u);
                    store(&mut hits.v, rows, &hit.v);
                    store(&mut hits.instance, rows, &instance);
                    store(&mut hits.mesh, rows, &mesh);
                    store(&mut hits.prim, rows, &prim);
                    store(&mut hits.back, rows, &back);
                });
            }

            pub fn occluded(scene: &CommittedScene, rays: &RayBatch, coherence: Coherence, occluded: &mut [bool]) {
                let mut context = QueryContext::new(scene, rays, Sides::Both);
                let mut args = context.occluded(coherence.flags());
                let mut packet = sys::$ray { mask: [u32::MAX; $n], ..Default::default() };
                for_each_packet(rays, $n, coherence == Coherence::Sorted, |rows, len| {
                    load_rays(&mut packet, rays, rows);
                    let valid = LaneMask::<$n>::first(len);
                    // SAFETY: the scene is committed, `context` lives, mask and packet are aligned by their types.
                    unsafe { sys::$occluded(valid.0.as_ptr(), scene.top.0, &mut packet, &mut args) };
                    store(occluded, rows, &packet.tfar.map(|tfar| tfar == f32::NEG_INFINITY));
                });
            }
        }
    };
}

packet_queries!(wide16, 16, RTCRay16, RTCRayHit16, rtcIntersect16, rtcOccluded16);
packet_queries!(wide8, 8, RTCRay8, RTCRayHit8, rtcIntersect8, rtcOccluded8);
packet_queries!(wide4, 4, RTCRay4, RTCRayHit4, rtcIntersect4, rtcOccluded4);

/// Queries of single rays.
pub(super) mod single {
    use super::*;

    fn ray(rays: &RayBatch, i: usize) -> sys::RTCRay {
        sys::RTCRay {
            org_x: rays.origin[0][i],
            org_y: rays.origin[1][i],
            org_z: rays.origin[2][i],
            dir_x: rays.direction[0][i],
            dir_y: rays.direction[1][i],
            dir_z: rays.direction[2][i],
            tnear: rays.tnear[i],
            tfar: rays.tfar[i],
            time: rays.time(i),
            mask: u32::MAX,
            id: i as u32,
            ..Default::default()
        }
    }

    pub fn closest_hits(scene: &CommittedScene, rays: &RayBatch, (_, sides): (Coherence, Sides), hits: &mut HitBatch) {
        let mut context = QueryContext::new(scene, rays, sides);
        let mut args = context.intersect(sys::RTC_RAY_QUERY_FLAG_INCOHERENT);
        for i in 0..rays.len() {
            let mut one = sys::RTCRayHit { ray: ray(rays, i), ..Default::default() };
            one.hit.geomID = sys::RTC_INVALID_GEOMETRY_ID;
            one.hit.instID = [sys::RTC_INVALID_GEOMETRY_ID; LEVELS];
            // SAFETY: the scene is committed, `context` lives, the ray is aligned by its type.
            unsafe { sys::rtcIntersect1(scene.top.0, &raw mut one, &raw mut args) };
            let hit = one.hit;
            let (mut t, mut primitive, mut back) = (f32::INFINITY, NO_PRIMITIVE, false);
            if hit.geomID != sys::RTC_INVALID_GEOMETRY_ID {
                let Placement { instance, mesh } = scene.placement_of(hit.geomID, hit.instID[0]);
                (t, primitive) = (one.ray.tfar, Primitive { instance, mesh, prim: hit.primID });
                back = scene.scene.is_back(primitive, rays.direction(i), rays.time(i));
            }
            hits.set(i, (t, hit.u, hit.v), primitive, back);
        }
    }

    pub fn all_hits(committed: &CommittedScene, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        found.clear();
        let mut context = AllHitsContext { embree: sys::init_ray_query_context(), committed, found };
        let mut args = sys::RTCIntersectArguments {
            flags: sys::RTC_RAY_QUERY_FLAG_INCOHERENT,
            feature_mask: sys::RTC_FEATURE_FLAG_ALL,
            filter: Some(collect_hit),
            context: (&raw mut context).cast(),
            intersect: None,
        };
        for i in 0..rays.len() {
            let mut one = sys::RTCRayHit { ray: ray(rays, i), ..Default::default() };
            one.hit.geomID = sys::RTC_INVALID_GEOMETRY_ID;
            one.hit.instID = [sys::RTC_INVALID_GEOMETRY_ID; LEVELS];
            // SAFETY: the scene is committed, `context` lives, the ray is aligned by its type.
            unsafe { sys::rtcIntersect1(committed.top.0, &raw mut one, &raw mut args) };
        }
    }

    pub fn occluded(scene: &CommittedScene, rays: &RayBatch, occluded: &mut [bool]) {
        let mut context = QueryContext::new(scene, rays, Sides::Both);
        let mut args = context.occluded(sys::RTC_RAY_QUERY_FLAG_INCOHERENT);
        for (i, occluded) in occluded.iter_mut().enumerate() {
            let mut one = ray(rays, i);
            // SAFETY: the scene is committed, `context` lives, the ray is aligned by its type.
            unsafe { sys::rtcOccluded1(scene.top.0, &raw mut one, &raw mut args) };
            *occluded = one.tfar == f32::NEG_INFINITY;
        }
    }
}
