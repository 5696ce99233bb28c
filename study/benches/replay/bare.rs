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

/// Rays of a packet.
const WIDTH: usize = 16;

/// Embree wants a packet's lane mask aligned like the packet.
#[repr(C, align(64))]
struct Lanes([i32; WIDTH]);

/// Seconds inside the calls for one batch, and how many rays hit. The rays stand ready in packets.
pub fn query(bare: &Bare, kind: Kind, order: RayOrder, rays: &RayBatch) -> (f64, usize) {
    let starts = (0..rays.len()).step_by(WIDTH);
    let mask = |s: usize| Lanes(std::array::from_fn(|i| if s + i < rays.len() { -1 } else { 0 }));
    let valid: Vec<_> = starts.clone().map(mask).collect();
    let packet = |start: usize| {
        let lane = |column: &[f32]| std::array::from_fn(|i| column.get(start + i).copied().unwrap_or(0.0));
        let mut packet = sys::RTCRayHit16::default();
        [packet.ray.org_x, packet.ray.org_y, packet.ray.org_z] = std::array::from_fn(|a| lane(&rays.origin[a]));
        [packet.ray.dir_x, packet.ray.dir_y, packet.ray.dir_z] = std::array::from_fn(|a| lane(&rays.direction[a]));
        (packet.ray.tnear, packet.ray.tfar) = (lane(&rays.tnear), lane(&rays.tfar));
        packet.ray.mask = [u32::MAX; WIDTH];
        packet.hit.geomID = [sys::RTC_INVALID_GEOMETRY_ID; WIDTH];
        packet
    };
    let flags = match order {
        RayOrder::Coherent => sys::RTC_RAY_QUERY_FLAG_COHERENT,
        RayOrder::Incoherent => sys::RTC_RAY_QUERY_FLAG_INCOHERENT,
    };
    let (feature_mask, mut context) = (sys::RTC_FEATURE_FLAG_ALL, sys::init_ray_query_context());
    let context = &raw mut context;
    match kind {
        Kind::Closest => {
            let mut packets: Vec<_> = starts.map(packet).collect();
            let mut arguments =
                sys::RTCIntersectArguments { flags, feature_mask, context, filter: None, intersect: None };
            let start = thread_seconds();
            for (packet, valid) in packets.iter_mut().zip(&valid) {
                // SAFETY: the scene is committed, mask and packet are aligned by their types.
                unsafe { sys::rtcIntersect16(valid.0.as_ptr(), bare.scene, packet, &raw mut arguments) };
            }
            let seconds = thread_seconds() - start;
            (seconds, packets.iter().flat_map(|p| p.hit.geomID).filter(|g| *g != sys::RTC_INVALID_GEOMETRY_ID).count())
        }
        Kind::Occluded => {
            let mut packets: Vec<_> = starts.map(|s| packet(s).ray).collect();
            let mut arguments =
                sys::RTCOccludedArguments { flags, feature_mask, context, filter: None, occluded: None };
            let start = thread_seconds();
            for (packet, valid) in packets.iter_mut().zip(&valid) {
                // SAFETY: as above.
                unsafe { sys::rtcOccluded16(valid.0.as_ptr(), bare.scene, packet, &raw mut arguments) };
            }
            let seconds = thread_seconds() - start;
            (seconds, packets.iter().flat_map(|p| p.tfar).filter(|t| *t == f32::NEG_INFINITY).count())
        }
    }
}
