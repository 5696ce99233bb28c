//! Bismar: an offline path tracer that estimates, for each pixel and while it renders, the best share of light and BSDF
//! samples (the balance).
//!
//! Data flows one way: [`scene`] → [`rays`] → [`integrator`] (with [`bsdf`], [`light`], [`sampling`],
//! [`balance`]) → [`render`] → [`film`]. Only [`cli`] depends on everything. Studies of the renderer are in the crate
//! `bismar-study`.
//!
//! Load, render, save (`examples/` has more: progress and AOVs, resuming from a file, balances compared):
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
//! let rendered = render(&scene, &settings, &AtomicBool::new(false), &|_| ())?;
//! # let folder = tempfile::tempdir().unwrap();
//! # std::env::set_current_dir(&folder).unwrap();
//! exr_file::write(Path::new("cornell.exr"), &rendered.pixels(), &Aov::DEFAULT, &Vec::new(), None)?;
//! # Ok(())
//! # }
//! ```

pub mod batch;
pub mod cli;
pub mod console;
pub mod farm;
pub mod job;
pub mod render;

pub use bismar_scene::{Error, Result, color, error, film, guard, scene};
pub use bismar_transport::{balance, bsdf, guiding, integrator, lanes, light, rays, sampling};
