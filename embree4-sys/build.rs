//! Generates the bindings from the installed header.

use std::path::PathBuf;

fn main() {
    println!("cargo:rustc-link-lib=dylib=embree4");
    println!("cargo::rustc-check-cfg=cfg(embree_instance_array, embree_instance_stack)");
    println!("cargo::rustc-cfg=embree_instance_array");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    bindgen::Builder::default()
        .header_contents("embree.h", "#include <embree4/rtcore.h>")
        .allowlist_item("(rtc|RTC).*")
        .prepend_enum_name(false)
        .generate()
        .expect("bindgen")
        .write_to_file(out.join("bindings.rs"))
        .expect("writable OUT_DIR");
}
