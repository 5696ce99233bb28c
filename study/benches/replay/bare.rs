//! Embree and nothing else: the least time that a ray stream can take.

use std::ffi::c_void;
use std::sync::atomic::{AtomicI64, Ordering};

use bismar::rays::{RayBatch, RayOrder};
use bismar::scene::Scene;
use bismar_study::clock::thread_seconds;
use bismar_study::rays::stream::Kind;
use embree4_sys as sys;

/// Bytes that the last built device holds and held at most.
static NOW: AtomicI64 = AtomicI64::new(0);
static MOST: AtomicI64 = AtomicI64::new(0);

unsafe extern "C" fn on_memory(_: *mut c_void, bytes: isize, _post: bool) -> bool {
    let now = NOW.fetch_add(bytes as i64, Ordering::Relaxed) + bytes as i64;
    MOST.fetch_max(now, Ordering::Relaxed);
    true
}

/// Bytes that Embree held at most during the last build.
pub fn peak_bytes() -> u64 {
    MOST.load(Ordering::Relaxed).max(0) as u64
}

/// A scene without instances, built as the renderer builds it.
pub struct Bare {
    device: sys::RTCDevice,
    scene: sys::RTCScene,
}

impl Bare {
    /// The scene must outlive it.
    pub fn build(from: &Scene) -> Self {
        assert!(from.instances.iter().all(|i| i.transform.is_none()), "this scene has instances");
        // SAFETY: the handles are valid; the buffers outlive them (see above) and are padded; the importer has checked
        // the indices.
        unsafe {
            let device = sys::rtcNewDevice(std::ptr::null());
            NOW.store(0, Ordering::Relaxed);
            MOST.store(0, Ordering::Relaxed);
            sys::rtcSetDeviceMemoryMonitorFunction(device, Some(on_memory), std::ptr::null_mut());
            let scene = sys::rtcNewScene(device);
            sys::rtcSetSceneBuildQuality(scene, sys::RTC_BUILD_QUALITY_MEDIUM);
            for mesh in &from.meshes {
                let geometry = sys::rtcNewGeometry(device, sys::RTC_GEOMETRY_TYPE_TRIANGLE);
                let (vertices, triangles) = (mesh.positions.padded().as_ptr().cast(), mesh.indices.as_ptr().cast());
                let (vertex, index) = (sys::RTC_BUFFER_TYPE_VERTEX, sys::RTC_BUFFER_TYPE_INDEX);
                let (float3, uint3) = (sys::RTC_FORMAT_FLOAT3, sys::RTC_FORMAT_UINT3);
                sys::rtcSetSharedGeometryBuffer(geometry, vertex, 0, float3, vertices, 0, 12, mesh.positions.len());
                sys::rtcSetSharedGeometryBuffer(geometry, index, 0, uint3, triangles, 0, 12, mesh.indices.len());
                sys::rtcCommitGeometry(geometry);
                sys::rtcAttachGeometry(scene, geometry);
                sys::rtcReleaseGeometry(geometry);
            }
            sys::rtcCommitScene(scene);
            assert_eq!(sys::rtcGetDeviceError(device), sys::RTC_ERROR_NONE, "Embree refuses the scene");
            Self { device, scene }
        }
    }

    fn flags(order: RayOrder) -> sys::RTCRayQueryFlags {
        match order {
            RayOrder::Coherent => sys::RTC_RAY_QUERY_FLAG_COHERENT,
            RayOrder::Incoherent => sys::RTC_RAY_QUERY_FLAG_INCOHERENT,
        }
    }
}

impl Drop for Bare {
    fn drop(&mut self) {
        // SAFETY: both are valid and released once.
        unsafe {
            sys::rtcReleaseScene(self.scene);
            sys::rtcReleaseDevice(self.device);
        }
    }
}

/// Embree wants a packet's lane mask aligned like the packet.
#[repr(C, align(64))]
struct Lanes<const N: usize>([i32; N]);

macro_rules! width {
    ($name:ident, $n:literal, $ray_hit:ident, $ray:ident, $intersect:ident, $occluded:ident) => {
        /// Seconds inside the calls for one batch, and how many rays hit. The rays stand ready in packets.
        pub fn $name(bare: &Bare, kind: Kind, order: RayOrder, rays: &RayBatch) -> (f64, usize) {
            let starts = (0..rays.len()).step_by($n);
            let valid: Vec<Lanes<$n>> = starts
                .clone()
                .map(|s| Lanes(std::array::from_fn(|i| if s + i < rays.len() { -1 } else { 0 })))
                .collect();
            let packet = |start: usize| {
                let lane = |column: &[f32]| std::array::from_fn(|i| column.get(start + i).copied().unwrap_or(0.0));
                let mut packet = sys::$ray_hit::default();
                [packet.ray.org_x, packet.ray.org_y, packet.ray.org_z] = std::array::from_fn(|a| lane(&rays.origin[a]));
                [packet.ray.dir_x, packet.ray.dir_y, packet.ray.dir_z] =
                    std::array::from_fn(|a| lane(&rays.direction[a]));
                (packet.ray.tnear, packet.ray.tfar) = (lane(&rays.tnear), lane(&rays.tfar));
                packet.ray.mask = [u32::MAX; $n];
                packet.hit.geomID = [sys::RTC_INVALID_GEOMETRY_ID; $n];
                packet
            };
            let mut context = sys::init_ray_query_context();
            match kind {
                Kind::Closest => {
                    let mut packets: Vec<_> = starts.map(packet).collect();
                    let mut arguments = sys::RTCIntersectArguments {
                        flags: Bare::flags(order),
                        feature_mask: sys::RTC_FEATURE_FLAG_ALL,
                        context: &raw mut context,
                        filter: None,
                        intersect: None,
                    };
                    let start = thread_seconds();
                    for (packet, valid) in packets.iter_mut().zip(&valid) {
                        // SAFETY: the scene is committed, mask and packet are aligned by their types.
                        unsafe { sys::$intersect(valid.0.as_ptr(), bare.scene, packet, &raw mut arguments) };
                    }
                    let seconds = thread_seconds() - start;
                    let hit = |p: &sys::$ray_hit| p.hit.geomID.iter().filter(|g| **g != u32::MAX).count();
                    (seconds, packets.iter().map(hit).sum())
                }
                Kind::Occluded => {
                    let mut packets: Vec<sys::$ray> = starts.map(|s| packet(s).ray).collect();
                    let mut arguments = sys::RTCOccludedArguments {
                        flags: Bare::flags(order),
                        feature_mask: sys::RTC_FEATURE_FLAG_ALL,
                        context: &raw mut context,
                        filter: None,
                        occluded: None,
                    };
                    let start = thread_seconds();
                    for (packet, valid) in packets.iter_mut().zip(&valid) {
                        // SAFETY: as above.
                        unsafe { sys::$occluded(valid.0.as_ptr(), bare.scene, packet, &raw mut arguments) };
                    }
                    let seconds = thread_seconds() - start;
                    let hit = |p: &sys::$ray| p.tfar.iter().filter(|t| **t == f32::NEG_INFINITY).count();
                    (seconds, packets.iter().map(hit).sum())
                }
            }
        }
    };
}

width!(wide16, 16, RTCRayHit16, RTCRay16, rtcIntersect16, rtcOccluded16);
width!(wide8, 8, RTCRayHit8, RTCRay8, rtcIntersect8, rtcOccluded8);

/// As the others, ray by ray.
pub fn single(bare: &Bare, kind: Kind, order: RayOrder, rays: &RayBatch) -> (f64, usize) {
    let ray_hit = |i: usize| {
        let mut one = sys::RTCRayHit::default();
        [one.ray.org_x, one.ray.org_y, one.ray.org_z] = std::array::from_fn(|a| rays.origin[a][i]);
        [one.ray.dir_x, one.ray.dir_y, one.ray.dir_z] = std::array::from_fn(|a| rays.direction[a][i]);
        (one.ray.tnear, one.ray.tfar, one.ray.mask) = (rays.tnear[i], rays.tfar[i], u32::MAX);
        one.hit.geomID = sys::RTC_INVALID_GEOMETRY_ID;
        one
    };
    let mut context = sys::init_ray_query_context();
    let mut all: Vec<_> = (0..rays.len()).map(ray_hit).collect();
    let mut intersect = sys::RTCIntersectArguments {
        flags: Bare::flags(order),
        feature_mask: sys::RTC_FEATURE_FLAG_ALL,
        context: &raw mut context,
        filter: None,
        intersect: None,
    };
    let mut occluded = sys::RTCOccludedArguments {
        flags: Bare::flags(order),
        feature_mask: sys::RTC_FEATURE_FLAG_ALL,
        context: &raw mut context,
        filter: None,
        occluded: None,
    };
    let start = thread_seconds();
    for one in &mut all {
        // SAFETY: the scene is committed, the ray is aligned by its type.
        match kind {
            Kind::Closest => unsafe { sys::rtcIntersect1(bare.scene, one, &raw mut intersect) },
            Kind::Occluded => unsafe { sys::rtcOccluded1(bare.scene, &raw mut one.ray, &raw mut occluded) },
        }
    }
    let seconds = thread_seconds() - start;
    let hit = |one: &&sys::RTCRayHit| match kind {
        Kind::Closest => one.hit.geomID != sys::RTC_INVALID_GEOMETRY_ID,
        Kind::Occluded => one.ray.tfar == f32::NEG_INFINITY,
    };
    (seconds, all.iter().filter(hit).count())
}
