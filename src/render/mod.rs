//! Rendering: from a scene and settings to pixels and files.
//!
//! [`driver`] renders tiles pass by pass. What is needed for it: [`settings`], [`pass`](mod@pass), [`prepass`] and [`record`],
//! each of which sees only those before it.

pub mod driver;
pub mod pass;
pub mod prepass;
pub mod record;
pub mod replay;
pub mod settings;

pub use driver::{Pause, RunOptions, render, run};
pub use pass::decisions::{Decision, Decisions, Found, RuledOut, TechniqueStats};
pub use pass::fireflies::Fireflies;
pub use pass::goal::Goal;
pub use pass::pixels::TilePixels;
pub use pass::progress::Progress;
pub use pass::rendered::{Rendered, Samples, fresh_tiles, noise, tile_positions};
pub use pass::stats::{RenderStats, StopReason};
pub use record::build_info::BuildInfo;
pub use record::checkpoint::{Record, Saved};
pub use record::identity::Identity;
pub use replay::{Replayed, replay};
pub use settings::camera::camera;
pub use settings::light_groups::LightGroups;
pub use settings::part::Part;
pub use settings::techniques::{Choice, Choices, PerTechnique, Technique};
pub use settings::transport::transport;
pub use settings::{
    BackFaces, Balance, CustomMethod, GlassShadows, Ground, Integrator, PixelFilter, RenderSettings, StudyOptions,
};
