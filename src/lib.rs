//! Bismar: an offline path tracer that estimates, for each pixel and while it renders, the best share of light and BSDF
//! samples (the balance).
//!
//! Data flows one way: [`scene`] → [`rays`] → [`integrator`] (with [`balance`]) → [`render`](mod@render) → [`film`]. A [`RenderRequest`] is what
//! the command line asks for; [`balance::Method`] finds light shares, and [`integrator::PathEvents`] learns of paths.
//!
//! Load, render, save (`examples/` has more: progress and AOVs, resuming from a file, balances compared, a method, a client of paths):
//!
//! ```
//! use std::path::Path;
//! use std::sync::Arc;
//! use std::sync::atomic::AtomicBool;
//!
//! use bismar::film::{Aov, exr_file};
//! use bismar::integrator::PreparedScene;
//! use bismar::rays::Backend;
//! use bismar::scene::import;
//! use bismar::{RenderSettings, render};
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

pub mod job;
pub mod render;

pub use bismar_scene::{Error, Result, film, scene};
pub use bismar_transport::{balance, integrator, rays};
pub use film::Picture;
pub use job::RenderRequest;
pub use render::{RenderSettings, Rendered, render};
pub use scene::Scene;

// What the programs, the Python package and tests use. It may change with any version.
#[doc(hidden)]
pub mod batch;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod console;
#[doc(hidden)]
pub mod farm;
#[doc(hidden)]
pub use bismar_scene::{color, error, guard};
#[doc(hidden)]
pub use bismar_transport::{bsdf, guiding, lanes, light, sampling};
