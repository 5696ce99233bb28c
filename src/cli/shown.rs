//! Which of the things that a glTF file holds are shown: flags that `render` and `inspect` share.

use clap::Args;

use crate::console::args::{not_negative, positive};
use crate::rays::Backend;
use crate::scene::import::{ImportOptions, Pose, Shutter};
use crate::scene::motion::MAX_STEPS;
use crate::{Error, Result};

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
    /// Leave the shutter open from here to there, in frames of --fps from the shown moment on, as in -0.25,0.25: what moves is
    /// blurred [default: a moment].
    #[arg(long, value_name = "OPEN,CLOSE", value_parser = shutter, allow_hyphen_values = true)]
    shutter: Option<[f64; 2]>,
    /// Cut motion into so many straight steps, 1 to 128, while the shutter is open [default: as many as it bends].
    #[arg(long, value_name = "N", requires = "shutter",
        value_parser = clap::value_parser!(u32).range(1..=MAX_STEPS as i64))]
    motion_steps: Option<u32>,
}

/// Two times in frames, the second one later.
fn shutter(text: &str) -> std::result::Result<[f64; 2], String> {
    let times: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match times[..] {
        [open, close] if open < close && text.matches(',').count() == 1 && open.abs().max(close.abs()) <= 1e6 => {
            Ok([open, close])
        }
        _ => Err("not when it opens and, later, closes, in frames, as in -0.25,0.25".into()),
    }
}

impl Shown {
    /// What clap cannot check of motion blur, of pictures with a `velocity` or without one.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self, is_posed: bool, velocity: bool, rays: Backend) -> Result<()> {
        let blurs = self.shutter.is_some();
        for (flag, asked) in [("--shutter", blurs), ("--aov velocity", velocity)] {
            if asked && !is_posed {
                return Err(Error::Usage(format!("{flag} needs a moment: --pose, --frame or --frames")));
            }
        }
        if blurs && rays == Backend::Obvhs {
            return Err(Error::Usage("--rays obvhs traces no motion blur: take --rays embree, or no --shutter".into()));
        }
        Ok(())
    }

    /// Is a moment of the animations shown?
    pub fn is_posed(&self) -> bool {
        self.pose.is_some() || self.frame.is_some()
    }

    /// What `--frame` says.
    pub fn frame(&self) -> Option<f64> {
        self.frame
    }

    /// As if `--frame` said so.
    pub fn set_frame(&mut self, frame: u32) {
        self.frame = Some(frame.into());
    }

    /// For the import; with `velocities`, of where things are a frame before and after, too.
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

    /// Tells apart scenes that are made of the same file; empty for what it shows by itself.
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
