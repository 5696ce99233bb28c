//! A render of one picture, from its request to its files: what is asked for, the input files, the scene in memory, the session
//! that renders it (new or resumed), its outputs and its warnings. The command line, batches, farms and the Python package all
//! make a [`RenderRequest`] and hand it over.

mod checkpoints;
mod denoise;
mod in_memory;
mod inputs;
mod loaded;
pub mod memory;
mod output;
mod request;
mod scene;
mod session;
mod settings;
pub mod stats;
mod warnings;

pub use denoise::work as denoise;
pub use in_memory::{CameraInfo, Heuristic, LoadedScene, PixelMoments, RenderedPicture, Values, compare};
pub use inputs::{Files, Inputs};
pub use loaded::{Building, Loaded};
pub use output::{OutputWriter, preview_mark};
pub use request::{
    LightUnit, OnOff, Preset, RenderRequest, SceneSelection, TechniqueOptions, ViewOptions, argument, claim_output,
    value_of,
};
pub use session::{Done, Session};
pub use settings::{DEFAULT_SIZE, settings, size};
pub(crate) use stats::write_json;
