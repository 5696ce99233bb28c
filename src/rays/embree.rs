//! Debian's Embree 4 behind [`RayQueries`].
//!
//! An object that is placed without a transform becomes triangle geometries of the top scene; every other placed
//! object becomes one sub-scene, and each of its placements an instance geometry of the top scene. Vertex and index
//! buffers are shared with the [`Scene`], not copied.
//!
//! Rays go to Embree in packets, 16 wide where that is native and 8 wide elsewhere. Camera rays, and all rays in a scene
//! of few triangles, carry `RTC_RAY_QUERY_FLAG_COHERENT`: then a packet is traversed together, once for each octant that
//! its rays point to; otherwise Embree traverses ray by ray. Packets of one octant are up to three times as fast as single
//! rays for camera rays, and one and a half times for sorted bounces in a scene of few triangles; unsorted bounces are
//! half as fast as single rays. Together, it is the packet's other rays that decide which of two
//! coincident surfaces is hit (measured: 2 to 10 % of the hits on two equal instances in one place changed with the
//! packets). The renderer therefore fills its packets tile by tile, always alike.

use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use embree4_sys as sys;

use packets::{filter_alpha, wide8, wide16};

use super::{BackendInfo, HitBatch, RayBatch, RayOrder, RayQueries};
use crate::scene::{Mesh, Scene};
use crate::{Error, Result};

mod packets;

/// Choices of a build.
#[derive(Debug, Clone, Default)]
pub struct EmbreeOptions {
    /// Threads of the build; 0 for all.
    pub threads: usize,
    /// An instruction set below the CPU's best, in Embree's words: `sse2`, `sse4.2`, `avx`, `avx2`.
    pub isa: Option<&'static str>,
}

/// A [`Scene`] built into Embree's acceleration structure.
pub struct EmbreeRays {
    // Dropped in this order: the library's handles before what they point to.
    top: SceneHandle,
    _device: DeviceHandle,
    _monitor: Arc<Monitor>,
    scene: Arc<Scene>,
    placements: Vec<Placement>,
    has_alpha: bool,
    /// Are 16-wide packets native? 8-wide ones are wherever AVX is, and narrower CPUs emulate them.
    wide16: bool,
    /// At most [`SMALL_SCENE`] triangles and instances?
    small: bool,
    info: BackendInfo,
}

// SAFETY: traversal of a committed scene is thread-safe by Embree's manual, the handles are used for nothing else
// after the build, and the monitor is made of atomics and a mutex.
unsafe impl Send for EmbreeRays {}
// SAFETY: as above.
unsafe impl Sync for EmbreeRays {}

/// What a geometry of the top scene is.
#[derive(Debug, Clone, Copy, Default)]
struct Placement {
    /// Index into [`Scene::instances`].
    instance: u32,
    /// Index into [`Scene::meshes`]; for an instance geometry that of its first mesh.
    mesh: u32,
}

/// What Embree reports while it builds.
#[derive(Default)]
struct Monitor {
    bytes: AtomicI64,
    error: Mutex<Option<(sys::RTCError, String)>>,
}

struct DeviceHandle(sys::RTCDevice);

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and released once.
        unsafe { sys::rtcReleaseDevice(self.0) }
    }
}

struct SceneHandle(sys::RTCScene);

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and released once.
        unsafe { sys::rtcReleaseScene(self.0) }
    }
}

unsafe extern "C" fn on_memory(monitor: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `build` registered a `Monitor` that outlives the device.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    monitor.bytes.fetch_add(bytes as i64, Ordering::Relaxed);
    true
}

unsafe extern "C" fn on_error(monitor: *mut c_void, code: sys::RTCError, message: *const c_char) {
    // SAFETY: `build` registered a `Monitor` that outlives the device.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    let text = if message.is_null() {
        String::new()
    } else {
        // SAFETY: Embree hands over a terminated string.
        unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()
    };
    if let Ok(mut first) = monitor.error.lock() {
        first.get_or_insert((code, text));
    }
}

/// An Embree error as one of ours.
fn error_of(code: sys::RTCError, message: &str) -> Error {
    match code {
        sys::RTC_ERROR_OUT_OF_MEMORY => Error::Host(format!("Embree: not enough memory for this scene: {message}")),
        sys::RTC_ERROR_UNSUPPORTED_CPU => Error::Host(format!("Embree: this CPU is not supported: {message}")),
        _ => Error::Bug(format!("Embree error {code}: {message}")),
    }
}

impl Monitor {
    /// The first error since the last call.
    fn check(&self) -> Result<()> {
        match self.error.lock().ok().and_then(|mut error| error.take()) {
            Some((code, message)) => Err(error_of(code, &message)),
            None => Ok(()),
        }
    }
}

impl DeviceHandle {
    fn new(options: &EmbreeOptions, monitor: &Arc<Monitor>) -> Result<Self> {
        let mut config = format!("threads={}", options.threads);
        if let Some(isa) = &options.isa {
            config += &format!(",isa={isa}");
        }
        let config = CString::new(config).unwrap_or_default();
        // SAFETY: a terminated string that the call copies.
        let device = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        if device.is_null() {
            // SAFETY: null asks for the error of the failed creation.
            return Err(error_of(unsafe { sys::rtcGetDeviceError(device) }, "no device"));
        }
        let device = Self(device);
        let monitor = Arc::as_ptr(monitor).cast_mut().cast();
        // SAFETY: the device is valid; the monitor stays in its place and is dropped after the device.
        unsafe {
            sys::rtcSetDeviceErrorFunction(device.0, Some(on_error), monitor);
            sys::rtcSetDeviceMemoryMonitorFunction(device.0, Some(on_memory), monitor);
        }
        Ok(device)
    }

    fn property(&self, property: sys::RTCDeviceProperty) -> isize {
        // SAFETY: the device is valid.
        unsafe { sys::rtcGetDeviceProperty(self.0, property) }
    }

    /// The library's version, when its structs are those of the header: same major and minor version.
    fn version(&self) -> Result<String> {
        let [major, minor, patch] = [
            sys::RTC_DEVICE_PROPERTY_VERSION_MAJOR,
            sys::RTC_DEVICE_PROPERTY_VERSION_MINOR,
            sys::RTC_DEVICE_PROPERTY_VERSION_PATCH,
        ]
        .map(|part| self.property(part));
        let version = format!("{major}.{minor}.{patch}");
        if (major, minor) == (sys::RTC_VERSION_MAJOR as isize, sys::RTC_VERSION_MINOR as isize) {
            return Ok(version);
        }
        Err(Error::Host(format!(
            "Embree {version} is installed, but this program was built for {}.{}.x: \
             install that, or build the program again on this machine",
            sys::RTC_VERSION_MAJOR,
            sys::RTC_VERSION_MINOR
        )))
    }

    fn new_scene(&self, has_alpha: bool) -> SceneHandle {
        // SAFETY: the device is valid; the flags are set before the commit.
        unsafe {
            let scene = sys::rtcNewScene(self.0);
            if has_alpha {
                sys::rtcSetSceneFlags(scene, sys::RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS);
            }
            sys::rtcSetSceneBuildQuality(scene, sys::RTC_BUILD_QUALITY_MEDIUM);
            SceneHandle(scene)
        }
    }

    /// Attaches `mesh` to `target` as geometry `id`. The caller has checked the indices and keeps the mesh alive.
    fn attach_mesh(&self, target: &SceneHandle, id: u32, mesh: &Mesh, has_alpha: bool) {
        if mesh.indices.is_empty() {
            return;
        }
        let vertices = mesh.positions.padded();
        // SAFETY: both buffers live as long as the `Arc<Scene>`, which is dropped after Embree's handles, and nobody
        // changes them; the vertex buffer is readable 16 bytes from its last vertex thanks to the padding; every index
        // is below the vertex count (`check`).
        unsafe {
            let geometry = sys::rtcNewGeometry(self.0, sys::RTC_GEOMETRY_TYPE_TRIANGLE);
            sys::rtcSetSharedGeometryBuffer(
                geometry,
                sys::RTC_BUFFER_TYPE_VERTEX,
                0,
                sys::RTC_FORMAT_FLOAT3,
                vertices.as_ptr().cast(),
                0,
                size_of::<[f32; 3]>(),
                mesh.positions.len(),
            );
            sys::rtcSetSharedGeometryBuffer(
                geometry,
                sys::RTC_BUFFER_TYPE_INDEX,
                0,
                sys::RTC_FORMAT_UINT3,
                mesh.indices.as_ptr().cast(),
                0,
                size_of::<[u32; 3]>(),
                mesh.indices.len(),
            );
            if has_alpha {
                sys::rtcSetGeometryEnableFilterFunctionFromArguments(geometry, true);
            }
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(target.0, geometry, id);
            sys::rtcReleaseGeometry(geometry);
        }
    }

    /// Attaches a placement of `object` to `target` as geometry `id`.
    fn attach_instance(&self, target: &SceneHandle, id: u32, object: &SceneHandle, transform: &glam::Affine3A) {
        let columns = transform.to_cols_array();
        // SAFETY: all handles are valid; the instance takes a reference to `object`; the matrix is copied.
        unsafe {
            let geometry = sys::rtcNewGeometry(self.0, sys::RTC_GEOMETRY_TYPE_INSTANCE);
            sys::rtcSetGeometryInstancedScene(geometry, object.0);
            sys::rtcSetGeometryTransform(geometry, 0, sys::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.as_ptr().cast());
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(target.0, geometry, id);
            sys::rtcReleaseGeometry(geometry);
        }
    }
}

impl SceneHandle {
    fn commit(&self, monitor: &Monitor) -> Result<()> {
        // SAFETY: the handle is valid.
        unsafe { sys::rtcCommitScene(self.0) };
        monitor.check()
    }
}

impl EmbreeRays {
    /// Builds the acceleration structure; keeps the scene for its buffers and its alpha.
    ///
    /// # Errors
    /// [`Error::Data`] for a malformed scene (an index beyond the vertices, say), [`Error::Host`] for a library of
    /// another version than the header's, a CPU that it does not run on or too little memory.
    pub fn build(scene: Arc<Scene>, options: &EmbreeOptions) -> Result<Self> {
        let start = Instant::now();
        super::check::check(&scene)?;
        let monitor = Arc::<Monitor>::default();
        let device = DeviceHandle::new(options, &monitor)?;
        let version = device.version()?;
        let mesh_range = |object: u32| scene.objects[object as usize].meshes.clone();
        let has_alpha =
            scene.instances.iter().flat_map(|instance| mesh_range(instance.object)).any(|mesh| scene.has_alpha(mesh));
        let top = device.new_scene(has_alpha);
        let attach = |target: &SceneHandle, id: u32, mesh: u32| {
            device.attach_mesh(target, id, &scene.meshes[mesh as usize], scene.has_alpha(mesh));
        };
        let mut objects: Vec<Option<SceneHandle>> = scene.objects.iter().map(|_| None).collect();
        let mut placements = Vec::new();
        for (index, instance) in scene.instances.iter().enumerate() {
            let meshes = mesh_range(instance.object);
            let Some(transform) = &instance.transform else {
                for mesh in meshes {
                    attach(&top, placements.len() as u32, mesh);
                    placements.push(Placement { instance: index as u32, mesh });
                }
                continue;
            };
            let object = &mut objects[instance.object as usize];
            if object.is_none() {
                let built = device.new_scene(has_alpha);
                for (id, mesh) in meshes.clone().enumerate() {
                    attach(&built, id as u32, mesh);
                }
                built.commit(&monitor)?;
                *object = Some(built);
            }
            if let Some(object) = object {
                device.attach_instance(&top, placements.len() as u32, object, transform);
                placements.push(Placement { instance: index as u32, mesh: meshes.start });
            }
        }
        top.commit(&monitor)?;
        let info = BackendInfo {
            name: "embree",
            version,
            isa: options.isa.map_or_else(|| best_isa().to_owned(), str::to_uppercase),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: monitor.bytes.load(Ordering::Relaxed).max(0) as u64,
        };
        let placed = scene.instances.iter().map(|i| {
            let meshes = &scene.meshes[mesh_range(i.object).start as usize..mesh_range(i.object).end as usize];
            1 + meshes.iter().map(|m| m.indices.len()).sum::<usize>()
        });
        let small = placed.sum::<usize>() <= SMALL_SCENE;
        let wide16 = device.property(sys::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
        drop(objects); // the instance geometries keep them
        Ok(Self { top, _device: device, _monitor: monitor, scene, placements, has_alpha, wide16, small, info })
    }

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
}

/// The instruction set that Embree picks on this CPU: the highest that it was built for and that the CPU has whole.
fn best_isa() -> &'static str {
    macro_rules! has { ($($feature:tt),+) => { $(std::arch::is_x86_feature_detected!($feature))&&+ } }
    if has!("avx512f", "avx512dq", "avx512cd", "avx512bw", "avx512vl") {
        "AVX512"
    } else if has!("avx2", "fma", "bmi1", "bmi2", "lzcnt", "f16c") {
        "AVX2"
    } else if has!("avx") {
        "AVX"
    } else if has!("sse4.2") {
        "SSE4.2"
    } else {
        "SSE2"
    }
}

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
    /// Is a batch to be sorted into packets of one octant?
    fn sorts(&self, order: RayOrder) -> bool {
        self.small && order == RayOrder::Incoherent
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
const SMALL_SCENE: usize = 2000;

/// MXCSR's flush-to-zero and denormals-are-zero.
const FLUSH: u32 = 1 << 15 | 1 << 6;

fn mxcsr() -> u32 {
    let mut value = 0;
    // SAFETY: stores a register of every x86-64 into a local variable.
    unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
    value
}

fn set_mxcsr(value: u32) {
    // SAFETY: `value` is what was read, but for the two flush bits: no exception gets unmasked, the rounding stays.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, preserves_flags, readonly)) };
}

/// Makes arithmetic of the calling thread flush denormals to zero from now on, as Embree wants it on every thread
/// that traces. To be called where threads start; queries on a thread without it set and reset it for each batch.
pub fn set_flush_to_zero() {
    set_mxcsr(mxcsr() | FLUSH);
}

/// Flush-to-zero until dropped.
struct FlushToZero {
    before: u32,
}

impl FlushToZero {
    fn new() -> Self {
        let before = mxcsr();
        if before & FLUSH != FLUSH {
            set_mxcsr(before | FLUSH);
        }
        Self { before }
    }
}

impl Drop for FlushToZero {
    fn drop(&mut self) {
        if self.before & FLUSH != FLUSH {
            set_mxcsr(self.before);
        }
    }
}
