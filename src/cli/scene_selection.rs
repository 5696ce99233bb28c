//! Flags that select what of a glTF file is rendered; `render`, `inspect` and `look` share them.

use clap::Args;

use crate::console::args::{not_negative, positive};
use crate::job::SceneSelection;
use crate::scene::motion::MAX_STEPS;

/// Scene, variant, time and shutter.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "View")]
pub struct SelectionArgs {
    /// The file's scene, by name or index [default: the file's default scene].
    #[arg(long = "scene-name", visible_alias = "scene", value_name = "NAME|INDEX")]
    scene_name: Option<String>,
    /// Material variant (KHR_materials_variants), by name or index [default: the default materials].
    #[arg(long, value_name = "NAME|INDEX")]
    variant: Option<String>,
    /// Time of the animations, in seconds [default: the rest pose, without animations].
    #[arg(long, value_name = "SECONDS", value_parser = not_negative, conflicts_with = "frame")]
    pose: Option<f64>,
    /// Time of the animations, in frames of --fps from 0.
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub frame: Option<f64>,
    /// Frames per second, for --frame, --frames and --shutter.
    #[arg(long, value_name = "F", value_parser = positive, default_value_t = 24.0)]
    fps: f64,
    /// Animation to play, by name or index, or all: every animation at once [default: all].
    #[arg(long, value_name = "NAME|INDEX|all")]
    animation: Option<String>,
    /// Motion blur: shutter opening and closing time in frames of --fps, relative to the time shown, as in -0.25,0.25
    /// [default: no motion blur].
    #[arg(long, value_name = "OPEN,CLOSE", value_parser = shutter, allow_hyphen_values = true)]
    shutter: Option<[f64; 2]>,
    /// Number of linear motion segments while the shutter is open, 1 to 128 [default: chosen by the motion's curvature].
    #[arg(long, value_name = "N", requires = "shutter",
        value_parser = clap::value_parser!(u32).range(1..=MAX_STEPS as i64))]
    motion_steps: Option<u32>,
}

/// Opening and closing time in frames.
fn shutter(text: &str) -> std::result::Result<[f64; 2], String> {
    let times: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match times[..] {
        [open, close] if open < close && text.matches(',').count() == 1 && open.abs().max(close.abs()) <= 1e6 => {
            Ok([open, close])
        }
        _ => Err("not OPEN,CLOSE in frames with OPEN before CLOSE, as in -0.25,0.25".into()),
    }
}

impl SelectionArgs {
    /// The selection.
    pub fn selection(&self) -> SceneSelection {
        let Self { scene_name, variant, pose, frame, fps, animation, shutter, motion_steps } = self.clone();
        SceneSelection { scene_name, variant, pose, frame, fps, animation, shutter, motion_steps }
    }
}
