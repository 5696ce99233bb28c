//! Embree device and scene handles, and the callbacks of a build.

use std::ffi::{CStr, CString, c_char, c_void};
use std::ops::Range;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};

use embree4_sys as sys;

use super::options::{EmbreeOptions, Quality};
use crate::rays::build::{Watch, check_watch, interrupted};
use crate::scene::Mesh;
use crate::scene::motion::{Key, Motion};
use crate::{Error, Result};

/// Memory use and errors that Embree reports.
#[derive(Default)]
pub(super) struct DeviceMonitor {
    pub(super) bytes: AtomicI64,
    /// Peak of `bytes`.
    pub(super) peak: AtomicI64,
    error: Mutex<Option<(sys::RTCError, String)>>,
}

pub(super) struct DeviceHandle(sys::RTCDevice);

impl Drop for DeviceHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and released once.
        unsafe { sys::rtcReleaseDevice(self.0) }
    }
}

pub(super) struct SceneHandle(pub(super) sys::RTCScene);

impl Drop for SceneHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and released once.
        unsafe { sys::rtcReleaseScene(self.0) }
    }
}

unsafe extern "C" fn on_memory(monitor: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `build` registered a `DeviceMonitor` that outlives the device.
    let monitor = unsafe { &*monitor.cast::<DeviceMonitor>() };
    let before = monitor.bytes.fetch_add(bytes as i64, Ordering::Relaxed);
    monitor.peak.fetch_max(before + bytes as i64, Ordering::Relaxed);
    true
}

unsafe extern "C" fn on_error(monitor: *mut c_void, code: sys::RTCError, message: *const c_char) {
    // SAFETY: `build` registered a `DeviceMonitor` that outlives the device.
    let monitor = unsafe { &*monitor.cast::<DeviceMonitor>() };
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

/// The part of one commit in the progress of a build.
#[derive(Clone)]
pub(super) struct CommitProgress<'a> {
    watch: Watch<'a>,
    /// Range of progress, within [0, 1].
    part: Range<f64>,
    /// Number of triangles and placements of the build.
    units: f64,
}

impl<'a> CommitProgress<'a> {
    /// Progress of a build of `units` triangles and placements, at its start.
    pub(super) fn new(watch: Watch<'a>, units: usize) -> Self {
        Self { watch, part: 0.0..0.0, units: units as f64 }
    }

    /// The part of the next commit, of so many triangles.
    pub(super) fn next(&mut self, triangles: usize) -> Self {
        self.part = self.part.end..(self.part.end + triangles as f64 / self.units).min(1.0);
        self.clone()
    }

    pub(super) fn rest(self) -> Self {
        Self { part: self.part.end..1.0, ..self }
    }
}

unsafe extern "C" fn on_progress(progress: *mut c_void, fraction: f64) -> bool {
    // SAFETY: `commit` registered a `CommitProgress` that outlives the commit.
    let CommitProgress { watch, part, .. } = unsafe { &*progress.cast::<CommitProgress>() };
    watch(part.start + (part.end - part.start) * fraction.clamp(0.0, 1.0))
}

fn convert_error(code: sys::RTCError, message: &str) -> Error {
    match code {
        sys::RTC_ERROR_OUT_OF_MEMORY => Error::Host(format!("Embree: not enough memory for this scene: {message}")),
        sys::RTC_ERROR_CANCELLED => interrupted(),
        sys::RTC_ERROR_UNSUPPORTED_CPU => Error::Host(format!("Embree: this CPU is not supported: {message}")),
        _ => Error::Bug(format!("Embree error {code}: {message}")),
    }
}

impl DeviceMonitor {
    /// Returns the first error since the last call.
    fn check(&self) -> Result<()> {
        match self.error.lock().ok().and_then(|mut error| error.take()) {
            Some((code, message)) => Err(convert_error(code, &message)),
            None => Ok(()),
        }
    }
}

impl DeviceHandle {
    pub(super) fn new(options: &EmbreeOptions, monitor: &Arc<DeviceMonitor>) -> Result<Self> {
        // By default Embree maps 128 MiB for subdivision surfaces. They are never used, but count for memory limits.
        let mut config = format!("threads={},tessellation_cache_size=1", options.threads);
        if let Some(isa) = &options.isa {
            config += &format!(",isa={isa}");
        }
        if let Some(level) = &options.frequency_level {
            config += &format!(",frequency_level={level}");
        }
        let config = CString::new(config).unwrap_or_default();
        // SAFETY: a terminated string that the call copies.
        let device = unsafe { sys::rtcNewDevice(config.as_ptr()) };
        if device.is_null() {
            // SAFETY: null asks for the error of the failed creation.
            return Err(convert_error(unsafe { sys::rtcGetDeviceError(device) }, "no device"));
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

    pub(super) fn property(&self, property: sys::RTCDeviceProperty) -> isize {
        // SAFETY: the device is valid.
        unsafe { sys::rtcGetDeviceProperty(self.0, property) }
    }

    /// Version of the library. Its major and minor version must be those of the header, so that structs agree.
    pub(super) fn version(&self) -> Result<String> {
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

    /// A scene; `filters` allows queries to bring a filter function.
    pub(super) fn new_scene(&self, filters: bool, options: &EmbreeOptions) -> SceneHandle {
        let flags = [
            (filters, sys::RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS),
            (options.compact, sys::RTC_SCENE_FLAG_COMPACT),
            (options.robust, sys::RTC_SCENE_FLAG_ROBUST),
        ];
        let flags = flags.iter().filter(|(set, _)| *set).fold(sys::RTC_SCENE_FLAG_NONE, |all, (_, flag)| all | flag);
        let quality = match options.quality {
            Quality::Low | Quality::TwoLevel => sys::RTC_BUILD_QUALITY_LOW,
            Quality::Medium => sys::RTC_BUILD_QUALITY_MEDIUM,
            Quality::High => sys::RTC_BUILD_QUALITY_HIGH,
        };
        // SAFETY: the device is valid; flags and quality are set before the commit.
        unsafe {
            let scene = sys::rtcNewScene(self.0);
            sys::rtcSetSceneFlags(scene, flags);
            sys::rtcSetSceneBuildQuality(scene, quality);
            SceneHandle(scene)
        }
    }

    /// Attaches `mesh` to `target` as geometry `id`. The caller has checked the indices and keeps the mesh alive.
    pub(super) fn attach_mesh(&self, target: &SceneHandle, id: u32, mesh: &Mesh, filters: bool, quality: Quality) {
        if mesh.indices.is_empty() {
            return;
        }
        let steps = match &mesh.motion {
            Some(motion) => motion.positions.iter().collect::<Vec<_>>(),
            None => vec![&mesh.positions],
        };
        // SAFETY: all buffers live as long as the `Arc<Scene>`, which is dropped after Embree's handles, and nobody
        // changes them; the vertex buffer is readable 16 bytes from its last vertex thanks to the padding; every index
        // is below the vertex count (`check`).
        unsafe {
            let geometry = sys::rtcNewGeometry(self.0, sys::RTC_GEOMETRY_TYPE_TRIANGLE);
            sys::rtcSetGeometryTimeStepCount(geometry, steps.len() as u32);
            // Elements are three numbers of four bytes.
            let share = |kind, slot, format, data, count| {
                sys::rtcSetSharedGeometryBuffer(geometry, kind, slot, format, data, 0, size_of::<[u32; 3]>(), count);
            };
            let (vertices, indices) = (sys::RTC_BUFFER_TYPE_VERTEX, sys::RTC_BUFFER_TYPE_INDEX);
            for (step, positions) in (0..).zip(steps) {
                let data = positions.padded().as_ptr().cast();
                share(vertices, step, sys::RTC_FORMAT_FLOAT3, data, mesh.positions.len());
            }
            share(indices, 0, sys::RTC_FORMAT_UINT3, mesh.indices.as_ptr().cast(), mesh.indices.len());
            if filters {
                sys::rtcSetGeometryEnableFilterFunctionFromArguments(geometry, true);
            }
            if quality == Quality::Low {
                // Low quality of the scene only selects two levels; the quality of their trees is set by geometry.
                sys::rtcSetGeometryBuildQuality(geometry, sys::RTC_BUILD_QUALITY_LOW);
            }
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(target.0, geometry, id);
            sys::rtcReleaseGeometry(geometry);
        }
    }

    /// Attaches a placement of `object` to `target` as geometry `id`.
    pub(super) fn attach_instance(
        &self,
        target: &SceneHandle,
        id: u32,
        object: &SceneHandle,
        (transform, motion): (&glam::Affine3A, Option<&Motion>),
    ) {
        let keys = motion.map_or(&[][..], Motion::keys);
        // SAFETY: all handles are valid; the instance takes a reference to `object`; matrices are copied; Embree takes as
        // many steps as a motion has.
        unsafe {
            let geometry = sys::rtcNewGeometry(self.0, sys::RTC_GEOMETRY_TYPE_INSTANCE);
            sys::rtcSetGeometryInstancedScene(geometry, object.0);
            let set = |step: u32, transform: &glam::Affine3A| {
                let columns = transform.to_cols_array();
                let format = sys::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR;
                sys::rtcSetGeometryTransform(geometry, step, format, columns.as_ptr().cast());
            };
            if keys.is_empty() {
                set(0, transform);
            } else {
                sys::rtcSetGeometryTimeStepCount(geometry, keys.len() as u32);
            }
            for (step, key) in (0..).zip(keys) {
                match motion.is_some_and(Motion::has_rotation) {
                    true => sys::rtcSetGeometryTransformQuaternion(geometry, step, &decomposition(key)),
                    false => set(step, &key.transform()),
                }
            }
            sys::rtcCommitGeometry(geometry);
            sys::rtcAttachGeometryByID(target.0, geometry, id);
            sys::rtcReleaseGeometry(geometry);
        }
    }
}

/// A motion key as Embree's quaternion decomposition.
fn decomposition(key: &Key) -> sys::RTCQuaternionDecomposition {
    let (q, m, t) = (key.rotation, &key.linear, key.translation);
    sys::RTCQuaternionDecomposition {
        scale_x: m.x_axis.x,
        scale_y: m.y_axis.y,
        scale_z: m.z_axis.z,
        skew_xy: m.y_axis.x,
        skew_xz: m.z_axis.x,
        skew_yz: m.z_axis.y,
        quaternion_r: q.w,
        quaternion_i: q.x,
        quaternion_j: q.y,
        quaternion_k: q.z,
        translation_x: t.x,
        translation_y: t.y,
        translation_z: t.z,
        ..Default::default()
    }
}

impl SceneHandle {
    /// Builds the scene; `progress` is its part in the progress of the whole build.
    pub(super) fn commit(&self, monitor: &DeviceMonitor, progress: CommitProgress) -> Result<()> {
        // Embree calls the monitor only every few thousand triangles.
        check_watch(progress.watch, progress.part.start)?;
        // SAFETY: the handle is valid; `progress` outlives the commit, and Embree drops it afterwards.
        unsafe {
            sys::rtcSetSceneProgressMonitorFunction(self.0, Some(on_progress), (&raw const progress).cast_mut().cast());
            sys::rtcCommitScene(self.0);
            sys::rtcSetSceneProgressMonitorFunction(self.0, None, null_mut());
        }
        monitor.check()
    }
}

/// The instruction set that Embree selects on this CPU: the highest one that the CPU supports completely.
pub(super) fn best_isa() -> &'static str {
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
