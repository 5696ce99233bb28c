//! Import options: scene, variant, pose and shutter.

#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Make everything that would be approximated or ignored (including a missing texture) an error that lists it.
    pub strict: bool,
    /// Time of the animations; `None` for the rest pose.
    pub pose: Option<Pose>,
    /// Scene of the document, by name or index; `None` for its default.
    pub scene: Option<String>,
    /// Material variant (KHR_materials_variants), by name or index; `None` for the default materials.
    pub variant: Option<String>,
}

/// A time in a document's animations.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Seconds since the animations' start. Channels are constant before their first key and after their last one.
    pub seconds: f64,
    /// Animation by name or index; `None` or `all` plays all at once.
    pub animation: Option<String>,
    /// Shutter interval around the time; `None` for an instantaneous exposure.
    pub shutter: Option<Shutter>,
    /// Frame duration in seconds, for velocities; `None` if velocities are not requested.
    pub frame: Option<f64>,
}

/// Interval during which the shutter is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Opening time in seconds relative to the pose's time; may be negative.
    pub opens: f64,
    /// Closing time in seconds relative to the pose's time, > `opens`.
    pub closes: f64,
    /// Number of motion steps, at most [`MAX_STEPS`](crate::scene::motion::MAX_STEPS); `None` to choose it by the curvature of the
    /// motion.
    pub steps: Option<u32>,
}
