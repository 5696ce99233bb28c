//! Rendering: from a scene and settings to pixels and files.
//!
//! [`driver`] renders tiles pass by pass, in the order that [`scheduler`] decides. [`checkpoint`] stores a render in its
//! picture's file, [`merge`] combines parts and seeds, and [`identity`] lists what a picture's bits depend on.

pub mod adaptive;
mod build_info;
pub mod camera;
pub mod checkpoint;
pub mod clipped;
pub mod decisions;
pub mod default_light;
pub mod driver;
pub mod fireflies;
pub mod goals;
pub mod identity;
pub mod lens;
pub mod light_groups;
pub mod merge;
pub mod part;
mod pixels;
pub mod prepass;
pub mod progress;
mod rendered;
pub mod replay;
pub mod sampler;
pub mod scheduler;
pub mod settings;
pub mod stats;
pub mod techniques;
pub mod tile;
pub mod transport;
mod validate;

pub use build_info::BuildInfo;
pub use camera::camera;
pub use checkpoint::{Record, Saved};
pub use decisions::{Decision, Decisions, Found, TechniqueStats};
pub use driver::{Pause, RunOptions, render, run};
pub use fireflies::Fireflies;
pub use goals::Goal;
pub use identity::Identity;
pub use light_groups::LightGroups;
pub use part::Part;
pub use pixels::TilePixels;
pub use progress::Progress;
pub use rendered::{Rendered, Samples, fresh_tiles, noise, tile_positions};
pub use replay::{Replayed, replay};
pub use settings::{
    BackFaces, Balance, CustomMethod, GlassShadows, Ground, Integrator, PixelFilter, RenderSettings, StudyOptions,
};
pub use stats::{RenderStats, StopReason};
pub use techniques::{Choice, Choices, PerTechnique, Technique};
pub use transport::transport;
