//! Raw bindings to Embree 4, generated from the installed `<embree4/rtcore.h>`.
#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs, clippy::all)]
include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
