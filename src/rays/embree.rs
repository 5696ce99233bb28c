//! Debian's Embree 4 behind [`RayQueries`].
//!
//! An object that is placed without a transform becomes triangle geometries of the top scene; every other placed
//! object becomes one sub-scene, and each of its placements an instance geometry of the top scene. Vertex and index
//! buffers are shared with the [`Scene`], not copied.
//!
//! Rays go to Embree in packets, 16 wide where that is native and 8 wide elsewhere, without
//! `RTC_RAY_QUERY_FLAG_COHERENT`: then a hit has the same bits in whatever packet the ray travels. With the flag camera
//! rays are twice as fast, but of coincident surfaces it is the packet's other rays that decide which one is hit
//! (2 to 10 % of the hits changed on two equal instances in one place), and a crop would no longer have the bits of the
//! whole. Mrays/s that the choice rests on, one thread, Embree 4.3.3, AVX-512, on a machine with other work:
//!
//! | 36-triangle room | single | 8 wide | 16 wide | 16 wide, flag |
//! | --- | --- | --- | --- | --- |
//! | camera, closest | 17 | 32 | 33 | 86 |
//! | diffuse bounce, closest | 13 | 20 | 21 | 12 |
//! | diffuse bounce, occluded | 18 | 25 | 38 | 22 |
//! | to a lamp, occluded | 23 | 75 | 78 | 75 |
//!
//! | 490,000-triangle blob | single | 8 wide | 16 wide | 16 wide, flag |
//! | --- | --- | --- | --- | --- |
//! | camera, closest | 12 | 20 | 20 | 41 |
//! | diffuse bounce, closest | 5.8 | 6.4 | 6.4 | 3.3 |
//! | diffuse bounce, occluded | 5.6 | 5.9 | 6.3 | 3.3 |
//! | to a lamp, occluded | 5.9 | 6.9 | 7.1 | 4.5 |
//!
//! Where 16-wide packets are emulated (AVX2) they are as slow as single rays. Today's rates on this machine:
//! `cargo test --release --test rays_speed -- --ignored --nocapture`.

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::mem::offset_of;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use embree4_sys as sys;

use super::{BackendInfo, HitBatch, MISS, RayBatch, RayOrder, RayQueries};
use crate::scene::{Mesh, Scene};
use crate::{Error, Result};

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
        let wide16 = device.property(sys::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
        drop(objects); // the instance geometries keep them
        Ok(Self { top, _device: device, _monitor: monitor, scene, placements, has_alpha, wide16, info })
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

            pub(super) fn closest_hits(to: &EmbreeRays, rays: &RayBatch, hits: &mut HitBatch) {
                let mut context = QueryContext::new(to, rays);
                let mut args = sys::RTCIntersectArguments {
                    flags: FLAGS,
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

            pub(super) fn occluded(by: &EmbreeRays, rays: &RayBatch, occluded: &mut [bool]) {
                let mut context = QueryContext::new(by, rays);
                let mut args = sys::RTCOccludedArguments {
                    flags: FLAGS,
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
    fn closest_hits(&self, rays: &RayBatch, _order: RayOrder, hits: &mut HitBatch) {
        hits.resize(rays.len());
        let _flushed = FlushToZero::new();
        if self.wide16 {
            wide16::closest_hits(self, rays, hits);
        } else {
            wide8::closest_hits(self, rays, hits);
        }
    }

    fn occluded(&self, rays: &RayBatch, _order: RayOrder, occluded: &mut Vec<bool>) {
        occluded.resize(rays.len(), false);
        let _flushed = FlushToZero::new();
        if self.wide16 {
            wide16::occluded(self, rays, occluded);
        } else {
            wide8::occluded(self, rays, occluded);
        }
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

/// No `RTC_RAY_QUERY_FLAG_COHERENT`, see the module's text.
const FLAGS: sys::RTCRayQueryFlags = sys::RTC_RAY_QUERY_FLAG_INCOHERENT;

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
