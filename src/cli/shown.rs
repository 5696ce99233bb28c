//! Which of the things that a glTF file holds are shown: flags that `render` and `inspect` share.

use clap::Args;

use crate::console::args::{not_negative, positive};
use crate::scene::import::{ImportOptions, Pose};

/// What of a file is shown.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "View")]
pub struct Shown {
    /// The document's scene to show, by name or index [default: the file's own].
    #[arg(long = "scene-name", visible_alias = "scene", value_name = "NAME|INDEX")]
    scene_name: Option<String>,
    /// The material variant to show (KHR_materials_variants), by name or index [default: the default materials].
    #[arg(long, value_name = "NAME|INDEX")]
    variant: Option<String>,
    /// Show the animations' pose at this time [default: the pose that the file rests in].
    #[arg(long, value_name = "SECONDS", value_parser = not_negative, conflicts_with = "frame")]
    pose: Option<f64>,
    /// As --pose, in frames of --fps; the first one is 0.
    #[arg(long, value_name = "N", value_parser = not_negative)]
    frame: Option<f64>,
    /// Frames a second, for --frame.
    #[arg(long, value_name = "F", value_parser = positive, default_value_t = 24.0)]
    fps: f64,
    /// The animation to play, by name or index, or all of them at once [default: all].
    #[arg(long, value_name = "NAME|INDEX|all")]
    animation: Option<String>,
}

impl Shown {
    /// What `--frame` says.
    pub fn frame(&self) -> Option<f64> {
        self.frame
    }

    /// As if `--frame` said so.
    pub fn set_frame(&mut self, frame: u32) {
        self.frame = Some(frame.into());
    }

    /// For the import.
    pub fn options(&self, strict: bool) -> ImportOptions {
        let seconds = self.pose.or(self.frame.map(|frame| frame / self.fps));
        ImportOptions {
            strict,
            pose: seconds.map(|seconds| Pose { seconds, animation: self.animation.clone() }),
            scene: self.scene_name.clone(),
            variant: self.variant.clone(),
        }
    }

    /// Tells apart scenes that are made of the same file; empty for what it shows by itself.
    pub fn name(&self) -> String {
        let ImportOptions { pose, scene, variant, .. } = self.options(false);
        let mut name = String::new();
        for (flag, value) in [("scene", scene), ("variant", variant)] {
            name += &value.map(|value| format!(", {flag} {value}")).unwrap_or_default();
        }
        if let Some(Pose { seconds, animation }) = pose {
            name += &format!(", {} at {seconds} s", animation.as_deref().unwrap_or("all"));
        }
        name
    }
}
