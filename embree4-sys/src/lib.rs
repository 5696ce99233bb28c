//! Raw bindings to Embree 4, generated from the installed `<embree4/rtcore.h>`.
//!
//! The header's inline functions and cast macros have no symbol to bind to; the ones that are needed are written
//! out below. Everything else is the C API: see the [manual](https://github.com/RenderKit/embree).
#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs, clippy::all)]
include!(concat!(env!("OUT_DIR"), "/bindings.rs"));

/// The header's `(unsigned int) -1`: no geometry, no instance.
pub const RTC_INVALID_GEOMETRY_ID: u32 = u32::MAX;

/// The header's `rtcInitRayQueryContext`.
pub const fn init_ray_query_context() -> RTCRayQueryContext {
    RTCRayQueryContext {
        #[cfg(embree_instance_stack)]
        instStackSize: 0,
        instID: [RTC_INVALID_GEOMETRY_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize],
        #[cfg(embree_instance_array)]
        instPrimID: [RTC_INVALID_GEOMETRY_ID; RTC_MAX_INSTANCE_LEVEL_COUNT as usize],
    }
}
