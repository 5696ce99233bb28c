//! What of a glTF file is rendered.

use crate::rays::Backend;
use crate::scene::import::{ImportOptions, Pose, Shutter};
use crate::{Error, Result};

/// Scene, variant, time and shutter.
#[derive(Debug, Clone)]
pub struct SceneSelection {
    /// The file's scene, by name or index; `None`: its default scene.
    pub scene_name: Option<String>,
    /// Material variant, by name or index.
    pub variant: Option<String>,
    /// Time of the animations in seconds; `None`, without `frame`: the rest pose.
    pub pose: Option<f64>,
    /// Time of the animations in frames.
    pub frame: Option<f64>,
    /// Frames per second.
    pub fps: f64,
    /// Animation to play, by name or index, or `all`.
    pub animation: Option<String>,
    /// Shutter opening and closing time in frames, relative to the time shown; `None`: no motion blur.
    pub shutter: Option<[f64; 2]>,
    /// Number of linear motion segments while the shutter is open; `None`: by the motion's curvature.
    pub motion_steps: Option<u32>,
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
    pub fn is_posed(&self) -> bool {
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
