//! Refuses an Embree that `src/rays` was not written for, and says which versions and instructions rays are traced with.

use std::{env, fs};

/// Embree's C API is the same within a major version.
const EMBREE_MAJOR: &str = "4";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // From embree4-sys/build.rs: the version of the header that the bindings were made from.
    let embree = env::var("DEP_EMBREE4_VERSION").unwrap_or_default();
    if embree.split('.').next() != Some(EMBREE_MAJOR) {
        println!("cargo::error=found Embree {embree:?}, but this program is written for Embree {EMBREE_MAJOR}");
    }
    println!("cargo::rustc-env=BISMAR_EMBREE_HEADER_VERSION={embree}");
    println!("cargo::rustc-env=BISMAR_ISA_BASELINE={}", isa_baseline());
    println!("cargo::rustc-env=BISMAR_OBVHS_VERSION={}", locked_version("obvhs"));
}

/// The x86-64 level that rustc may use without asking the CPU.
fn isa_baseline() -> String {
    let features = env::var("CARGO_CFG_TARGET_FEATURE").unwrap_or_default();
    let has = |all: &[&str]| all.iter().all(|one| features.split(',').any(|feature| feature == *one));
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
    let level = match arch.as_str() {
        "x86_64" if has(&["avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"]) => "-v4",
        "x86_64" if has(&["avx2", "bmi1", "bmi2", "f16c", "fma", "lzcnt", "movbe"]) => "-v3",
        "x86_64" if has(&["popcnt", "sse4.2", "ssse3"]) => "-v2",
        _ => "",
    };
    arch.replace('_', "-") + level
}

/// A dependency's version in Cargo.lock.
fn locked_version(name: &str) -> String {
    let path = ["Cargo.lock", "../../Cargo.lock"].into_iter().find(|path| fs::exists(path).unwrap_or(false));
    path.iter().for_each(|path| println!("cargo::rerun-if-changed={path}"));
    let lock = path.and_then(|path| fs::read_to_string(path).ok()).unwrap_or_default();
    let entry = lock.split(&format!("name = \"{name}\"\nversion = \"")).nth(1).unwrap_or("unknown\"");
    entry.split('"').next().unwrap_or("unknown").to_owned()
}
