//! Batches to packets and back: the queries themselves.

use std::ffi::c_int;
use std::mem::offset_of;

use embree4_sys as sys;

use super::flush::FlushToZero;
use super::{EmbreeRays, Placement};
use crate::rays::{BackendInfo, HitBatch, MISS, RayBatch, RayOrder, RayQueries};

/// Embree's context of a batch, followed by what the alpha filter needs.
#[repr(C)]
struct QueryContext<'a> {
    embree: sys::RTCRayQueryContext,
    rays: &'a EmbreeRays,
    /// By ray id.
    keys: &'a [u32],
}

impl<'a> QueryContext<'a> {
    fn new(embree: &'a EmbreeRays, rays: &'a RayBatch) -> Self {
        Self { embree: sys::init_ray_query_context(), rays: embree, keys: &rays.key }
    }
}

/// Rejects the hits of a packet at which the surface is not there.
unsafe extern "C" fn filter_alpha(args: *const sys::RTCFilterFunctionNArguments) {
    // A packet of N is a column of N for every field of the single struct.
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
            let place = context.rays.place(hit(GEOMETRY), hit(INSTANCE));
            let [u, v] = [hit(U), hit(V)].map(f32::from_bits);
            let key = context.keys[ray(ID) as usize];
            if !context.rays.scene.is_present(key, place.instance, place.mesh, hit(PRIM), u, v) {
                *valid = 0;
            }
        }
    }
}

/// Embree wants a packet's lane mask aligned like the packet.
#[repr(C, align(64))]
struct Lanes<const N: usize>([c_int; N]);

impl<const N: usize> Lanes<N> {
    fn first(count: usize) -> Self {
        Self(std::array::from_fn(|lane| if lane < count { -1 } else { 0 }))
    }
}

/// Copies a part of a column; lanes beyond it keep what they have.
#[inline(always)]
fn load<const N: usize>(lanes: &mut [f32; N], column: &[f32], start: usize) {
    let rest = &column[start..];
    match rest.first_chunk() {
        Some(chunk) => *lanes = *chunk,
        None => lanes[..rest.len()].copy_from_slice(rest),
    }
}

/// The way back; lanes beyond the column are dropped.
#[inline(always)]
fn store<T: Copy, const N: usize>(column: &mut [T], start: usize, lanes: &[T; N]) {
    let rest = &mut column[start..];
    match rest.first_chunk_mut() {
        Some(chunk) => *chunk = *lanes,
        None => rest.copy_from_slice(&lanes[..rest.len()]),
    }
}

macro_rules! packet_queries {
    ($module:ident, $n:literal, $ray:ident, $hit:ident, $ray_hit:ident, $intersect:ident, $occluded:ident) => {
        mod $module {
            use super::*;

            fn load_rays(lanes: &mut sys::$ray, rays: &RayBatch, start: usize) -> Lanes<$n> {
                load(&mut lanes.org_x, &rays.origin[0], start);
                load(&mut lanes.org_y, &rays.origin[1], start);
                load(&mut lanes.org_z, &rays.origin[2], start);
                load(&mut lanes.dir_x, &rays.direction[0], start);
                load(&mut lanes.dir_y, &rays.direction[1], start);
                load(&mut lanes.dir_z, &rays.direction[2], start);
                load(&mut lanes.tnear, &rays.tnear, start);
                load(&mut lanes.tfar, &rays.tfar, start);
                lanes.id = std::array::from_fn(|lane| (start + lane) as u32);
                Lanes::first(rays.len() - start)
            }

            pub(super) fn closest_hits(to: &EmbreeRays, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
                let mut context = QueryContext::new(to, rays);
                let mut args = sys::RTCIntersectArguments {
                    flags: to.flags(order),
                    feature_mask: sys::RTC_FEATURE_FLAG_ALL,
                    context: (&raw mut context).cast(),
                    filter: to.filter(),
                    intersect: None,
                };
                let missed = sys::$hit {
                    primID: [MISS; $n],
                    geomID: [sys::RTC_INVALID_GEOMETRY_ID; $n],
                    instID: [[sys::RTC_INVALID_GEOMETRY_ID; $n]; sys::RTC_MAX_INSTANCE_LEVEL_COUNT as usize],
                    ..Default::default()
                };
                let mut packet = sys::$ray_hit::default();
                packet.ray.mask = [u32::MAX; $n];
                for start in (0..rays.len()).step_by($n) {
                    let valid = load_rays(&mut packet.ray, rays, start);
                    packet.hit = missed;
                    // SAFETY: the scene is committed, `context` lives, mask and packet are aligned by their types.
                    unsafe { sys::$intersect(valid.0.as_ptr(), to.top.0, &mut packet, &mut args) };
                    let hit = &packet.hit;
                    let (mut t, mut instance, mut mesh) = (packet.ray.tfar, [MISS; $n], [MISS; $n]);
                    for lane in 0..$n {
                        if hit.geomID[lane] == sys::RTC_INVALID_GEOMETRY_ID {
                            t[lane] = f32::INFINITY;
                        } else {
                            let place = to.place(hit.geomID[lane], hit.instID[0][lane]);
                            (instance[lane], mesh[lane]) = (place.instance, place.mesh);
                        }
                    }
                    store(&mut hits.t, start, &t);
                    store(&mut hits.u, start, &hit.u);
                    store(&mut hits.v, start, &hit.v);
                    store(&mut hits.instance, start, &instance);
                    store(&mut hits.mesh, start, &mesh);
                    store(&mut hits.prim, start, &hit.primID);
                }
            }

            pub(super) fn occluded(by: &EmbreeRays, rays: &RayBatch, order: RayOrder, occluded: &mut [bool]) {
                let mut context = QueryContext::new(by, rays);
                let mut args = sys::RTCOccludedArguments {
                    flags: by.flags(order),
                    feature_mask: sys::RTC_FEATURE_FLAG_ALL,
                    context: (&raw mut context).cast(),
                    filter: by.filter(),
                    occluded: None,
                };
                let mut packet = sys::$ray { mask: [u32::MAX; $n], ..Default::default() };
                for start in (0..rays.len()).step_by($n) {
                    let valid = load_rays(&mut packet, rays, start);
                    // SAFETY: the scene is committed, `context` lives, mask and packet are aligned by their types.
                    unsafe { sys::$occluded(valid.0.as_ptr(), by.top.0, &mut packet, &mut args) };
                    store(occluded, start, &packet.tfar.map(|tfar| tfar == f32::NEG_INFINITY));
                }
            }
        }
    };
}

packet_queries!(wide16, 16, RTCRay16, RTCHit16, RTCRayHit16, rtcIntersect16, rtcOccluded16);
packet_queries!(wide8, 8, RTCRay8, RTCHit8, RTCRayHit8, rtcIntersect8, rtcOccluded8);

impl RayQueries for EmbreeRays {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        hits.resize(rays.len());
        let _flushed = FlushToZero::new();
        if self.wide16 {
            wide16::closest_hits(self, rays, order, hits);
        } else {
            wide8::closest_hits(self, rays, order, hits);
        }
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        occluded.resize(rays.len(), false);
        let _flushed = FlushToZero::new();
        if self.wide16 {
            wide16::occluded(self, rays, order, occluded);
        } else {
            wide8::occluded(self, rays, order, occluded);
        }
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

impl EmbreeRays {
    /// Instance and mesh of a hit by Embree's ids.
    fn place(&self, geometry: u32, instance: u32) -> Placement {
        if instance == sys::RTC_INVALID_GEOMETRY_ID {
            self.placements[geometry as usize]
        } else {
            let placement = self.placements[instance as usize];
            Placement { mesh: placement.mesh + geometry, ..placement }
        }
    }

    fn filter(&self) -> sys::RTCFilterFunctionN {
        if self.has_alpha { Some(filter_alpha) } else { None }
    }

    /// Packets stay together through a scene that any ray soon knows by heart, and where they are of one mind.
    fn flags(&self, order: RayOrder) -> sys::RTCRayQueryFlags {
        if self.small || order == RayOrder::Coherent {
            sys::RTC_RAY_QUERY_FLAG_COHERENT
        } else {
            sys::RTC_RAY_QUERY_FLAG_INCOHERENT
        }
    }
}

/// Triangles and instances up to which packets pay for every ray.
pub(super) const SMALL_SCENE: usize = 2000;
