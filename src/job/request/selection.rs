//! What of a glTF file is rendered.

use clap::Args;
use serde::{Deserialize, Serialize};

use crate::console::args::{not_negative, positive};
use crate::rays::Backend;
use crate::scene::import::{ImportOptions, Pose, Shutter};
use crate::scene::motion::MAX_STEPS;
use crate::{Error, Result};

/// Scene, variant, time and shutter: flags that `render`, `inspect` and `look` share.
#[derive(Debug, Clone, Args, Serialize, Deserialize)]
#[command(next_help_heading = "View")]
#[serde(rename_all = "kebab-case", default)]
pub struct SceneSelection {
    /// The file's scene, by name or index [default: the file's default scene].
    #[arg(long = "scene-name", visible_alias = "scene", value_name = "NAME|INDEX")]
    pub scene_name: Option<String>,
    /// Material variant (KHR_materials_variants), by name or index [default: the default materials].
    #[arg(long, value_name = "NAME|INDEX")]
    pub variant: Option<String>,
    /// Time of the animations, in seconds [default: the rest pose, without animations].
    #[arg(long, value_name = "SECONDS", value_parser = not_negative, conflicts_with = "frame")]
    pub pose: Option<f64>,
    /// Time of the animations, in frames of --fps from 0.
    #[arg(long, value_name = "N", value_parser = not_negative)]
    pub frame: Option<f64>,
    /// Frames per second, for --frame, --frames and --shutter.
    #[arg(long, value_name = "F", value_parser = positive, default_value_t = 24.0)]
    pub fps: f64,
    /// Animation to play, by name or index, or all: every animation at once [default: all].
    #[arg(long, value_name = "NAME|INDEX|all")]
    pub animation: Option<String>,
    /// Motion blur: shutter opening and closing time in frames of --fps, relative to the time shown, as in -0.25,0.25
    /// [default: no motion blur].
    #[arg(long, value_name = "OPEN,CLOSE", value_parser = shutter, allow_hyphen_values = true)]
    pub shutter: Option<[f64; 2]>,
    /// Number of linear motion segments while the shutter is open, 1 to 128 [default: chosen by the motion's curvature].
    #[arg(long, value_name = "N", requires = "shutter",
        value_parser = clap::value_parser!(u32).range(1..=MAX_STEPS as i64))]
    pub motion_steps: Option<u32>,
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

impl Default for SceneSelection {
    fn default() -> Self {
        Self {
            scene_name: None,
            variant: None,
            pose: None,
            frame: None,
            fps: 24.0,
            animation: None,
            shutter: None,
            motion_steps: None,
        }
    }
}

impl SceneSelection {
    /// Motion blur and the `velocity` AOV need a time, and motion blur needs Embree.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self, is_posed: bool, velocity: bool, rays: Backend) -> Result<()> {
        let blurs = self.shutter.is_some();
        for (flag, is_given) in [("--shutter", blurs), ("--aov velocity", velocity)] {
            if is_given && !is_posed {
                return Err(Error::Usage(format!("{flag} needs a time: --pose, --frame or --frames")));
            }
        }
        if blurs && rays == Backend::Obvhs {
            return Err(Error::Usage(
                "--rays obvhs does not support motion blur: use --rays embree, or no --shutter".into(),
            ));
        }
        Ok(())
    }

    /// Whether a time of the animations is given.
    pub(crate) fn is_posed(&self) -> bool {
        self.pose.is_some() || self.frame.is_some()
    }

    /// The same scene at rest: without a time of its animations.
    pub fn at_rest(&self) -> Self {
        Self { pose: None, frame: None, shutter: None, ..self.clone() }
    }

    /// Options of the import; with `velocities` it also reads the transforms of the previous and next frame.
    pub fn options(&self, strict: bool, velocities: bool) -> ImportOptions {
        let seconds = self.pose.or(self.frame.map(|frame| frame / self.fps));
        let shutter = self.shutter.map(|[open, close]| Shutter {
            opens: open / self.fps,
            closes: close / self.fps,
            steps: self.motion_steps,
        });
        let frame = velocities.then_some(1.0 / self.fps);
        ImportOptions {
            strict,
            pose: seconds.map(|seconds| Pose { seconds, animation: self.animation.clone(), shutter, frame }),
            scene: self.scene_name.clone(),
            variant: self.variant.clone(),
        }
    }

    /// Text that distinguishes scenes imported from the same file; empty for the default. Stored in pictures.
    pub fn name(&self) -> String {
        let ImportOptions { pose, scene, variant, .. } = self.options(false, false);
        let mut name = String::new();
        for (flag, value) in [("scene", scene), ("variant", variant)] {
            name += &value.map(|value| format!(", {flag} {value}")).unwrap_or_default();
        }
        if let Some(Pose { seconds, animation, shutter, .. }) = pose {
            name += &format!(", {} at {seconds} s", animation.as_deref().unwrap_or("all"));
            if let Some(Shutter { opens, closes, steps }) = shutter {
                let steps = steps.map_or("as many".into(), |steps| steps.to_string());
                name += &format!(", shutter from {opens} to {closes} s in {steps} steps");
            }
        }
        name
    }
}
