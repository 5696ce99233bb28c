//! Rays, lights, scattering, sampling and the path integrator.
//!
//! A part of [bismar](https://docs.rs/bismar), which shows all of it by the same paths; a crate of its own only so that it is
//! compiled in parallel with the others.
#![allow(missing_docs, reason = "a name that says all needs no line")]

// rustdoc does not read the flags that rustc is given.
#[cfg(all(
    target_arch = "x86_64",
    not(all(target_feature = "avx2", target_feature = "fma")),
    not(any(doc, doctest, docsrs))
))]
compile_error!(
    "bismar is written for AVX2 and FMA: without them it is a third slower and its pictures have other bits. Cargo does not \
     take flags over from a dependency: write into the .cargo/config.toml of your own workspace\n\n    \
     [target.x86_64-unknown-linux-gnu]\n    rustflags = [\"-C\", \"target-cpu=x86-64-v3\"]\n\nand unset RUSTFLAGS, \
     which replaces them, or name the CPU in it"
);

pub mod balance;
pub mod bsdf;
pub mod guiding;
pub mod integrator;
pub mod lanes;
pub mod light;
pub mod rays;
pub mod sampling;

pub use bismar_scene::{Error, Result, color, error, film, guard, scene};
