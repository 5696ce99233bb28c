//! The bindings' structs are the installed library's: by its header, and by what it writes.

use std::mem::{offset_of, size_of};
use std::ptr;

use embree4_sys as sys;

#[test]
#[cfg(embree_instance_array)]
fn hits_of_a_header_with_instance_arrays_have_48_bytes() {
    assert_eq!(size_of::<sys::RTCHit>(), 48);
    assert_eq!(size_of::<sys::RTCRayHit>(), 96);
    assert_eq!(offset_of!(sys::RTCHit, instPrimID), 32);
}

#[test]
#[cfg(not(embree_instance_array))]
fn hits_of_a_header_without_instance_arrays_have_32_bytes() {
    assert_eq!(size_of::<sys::RTCHit>(), 32);
    assert_eq!(size_of::<sys::RTCRayHit>(), 80);
}

#[test]
fn the_library_has_the_headers_version() {
    // SAFETY: null asks for the default configuration; the device is released once.
    let version = unsafe {
        let device = sys::rtcNewDevice(ptr::null());
        let version = sys::rtcGetDeviceProperty(device, sys::RTC_DEVICE_PROPERTY_VERSION);
        sys::rtcReleaseDevice(device);
        version
    };
    assert_eq!(version, sys::RTC_VERSION as isize);
}

const CANARY: u8 = 0xa5;

/// A hit record with room behind it.
#[repr(C, align(16))]
struct Guarded {
    record: sys::RTCRayHit,
    behind: [u8; 64],
}

/// Which bytes of a hit record, and of the 64 bytes behind it, a hit changes from the canary.
fn bytes_written_by_a_hit() -> Vec<usize> {
    let vertices: [[f32; 3]; 4] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3]];
    let indices = [[0_u32, 1, 2]];
    let mut guarded = Guarded { record: Default::default(), behind: [CANARY; 64] };
    // SAFETY: the whole of RTCHit is made of numbers.
    unsafe { ptr::write_bytes(&raw mut guarded.record.hit, CANARY, 1) };
    guarded.record.ray =
        sys::RTCRay { org_z: 1.0, dir_z: -1.0, tfar: f32::INFINITY, mask: u32::MAX, ..Default::default() };
    guarded.record.hit.geomID = sys::RTC_INVALID_GEOMETRY_ID;
    // SAFETY: the buffers outlive the scene, the last vertex is padded, the handles are released once each.
    unsafe {
        let device = sys::rtcNewDevice(ptr::null());
        let scene = sys::rtcNewScene(device);
        let triangle = sys::rtcNewGeometry(device, sys::RTC_GEOMETRY_TYPE_TRIANGLE);
        let share = |kind, format, data, count| {
            sys::rtcSetSharedGeometryBuffer(triangle, kind, 0, format, data, 0, 12, count);
        };
        share(sys::RTC_BUFFER_TYPE_VERTEX, sys::RTC_FORMAT_FLOAT3, vertices.as_ptr().cast(), 3);
        share(sys::RTC_BUFFER_TYPE_INDEX, sys::RTC_FORMAT_UINT3, indices.as_ptr().cast(), 1);
        sys::rtcCommitGeometry(triangle);
        sys::rtcAttachGeometry(scene, triangle);
        sys::rtcReleaseGeometry(triangle);
        sys::rtcCommitScene(scene);
        sys::rtcIntersect1(scene, &mut guarded.record, ptr::null_mut());
        sys::rtcReleaseScene(scene);
        sys::rtcReleaseDevice(device);
    }
    // A hit shortens the ray. The last bits of the distance depend on the CPU: Embree divides by an approximate reciprocal.
    assert_eq!(guarded.record.hit.primID, 0);
    assert!(guarded.record.ray.tfar < f32::INFINITY);
    // SAFETY: numbers and bytes without padding between them, but for the hit's end, which the canary filled.
    let bytes = unsafe { std::slice::from_raw_parts((&raw const guarded).cast::<u8>(), size_of::<Guarded>()) };
    let hit = size_of::<sys::RTCRay>();
    (hit..bytes.len()).filter(|&at| bytes[at] != CANARY).collect()
}

#[test]
fn a_hit_stays_within_its_record() {
    let last = bytes_written_by_a_hit().pop().unwrap();
    assert!(last < size_of::<sys::RTCRayHit>(), "byte {last} was written");
}

/// The proof that bindings from Embree 4.2's header, with their record of 80 bytes, corrupt memory with a library that
/// has instance arrays.
#[test]
#[cfg(embree_instance_array)]
fn a_hit_writes_four_bytes_behind_a_record_of_80() {
    let beyond: Vec<usize> = bytes_written_by_a_hit().into_iter().filter(|&at| at >= 80).collect();
    println!("bytes written behind a record of 80: {beyond:?}");
    assert_eq!(beyond, [80, 81, 82, 83]);
}
