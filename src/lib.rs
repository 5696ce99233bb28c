//! Bismar: an offline renderer that finds, for each pixel and while it renders, the balance between light and
//! BSDF sampling.
//!
//! Data flows one way: [`scene`] → [`rays`] → [`integrator`] (with [`bsdf`], [`light`], [`sampling`],
//! [`balance`]) → [`render`] → [`film`]. Only [`cli`] sees everything. Studies of the program are a crate of their own,
//! `bismar-study`.
//!
//! Load, render, save (`examples/` has more: progress and AOVs, going on from a file, balances compared):
//!
//! ```
//! use std::path::Path;
//! use std::sync::Arc;
//! use std::sync::atomic::AtomicBool;
//!
//! use bismar::film::{Aov, exr_file};
//! use bismar::integrator::PreparedScene;
//! use bismar::rays::Backend;
//! use bismar::render::{RenderSettings, render};
//! use bismar::scene::import;
//!
//! # fn main() -> bismar::Result<()> {
//! let scene = import::import(Path::new("scenes/cornell.glb"), &Default::default())?.scene;
//! let scene = PreparedScene::build(Arc::new(scene), Backend::Embree)?;
//! let settings = RenderSettings { width: 48, height: 32, spp: Some(16), ..Default::default() };
//! let rendered = render(&scene, &settings, &AtomicBool::new(false), &|_| ());
//! # let folder = tempfile::tempdir().unwrap();
//! # std::env::set_current_dir(&folder).unwrap();
//! exr_file::write(Path::new("cornell.exr"), &rendered.pixels(), &Aov::DEFAULT, &Vec::new(), None)?;
//! # Ok(())
//! # }
//! ```

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
pub mod batch;
pub mod bsdf;
pub mod cli;
pub mod color;
pub mod console;
pub mod error;
pub mod farm;
pub mod film;
pub mod guard;
pub mod guiding;
pub mod integrator;
pub mod lanes;
pub mod light;
pub mod rays;
pub mod render;
pub mod sampling;
pub mod scene;

pub use error::{Error, Result};
