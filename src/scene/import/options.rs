//! What to import: scene, variant, pose, shutter.

/// What to import, and how strictly.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Whatever would be approximated or ignored (also a missing texture) is an error that names it.
    pub strict: bool,
    /// A time sample of its animations; else the pose that its nodes and weights have.
    pub pose: Option<Pose>,
    /// The document's scene, by name or index; else the one that it shows by default.
    pub scene: Option<String>,
    /// The material variant (KHR_materials_variants), by name; else the default materials.
    pub variant: Option<String>,
}

/// A time sample of a document's animations.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Since their beginning; before the first key of a channel and after its last one it stands still.
    pub seconds: f64,
    /// By name or index; `None` or `all` for all of them at once, as viewers play them.
    pub animation: Option<String>,
    /// How long light is let in around it; else it is a time sample.
    pub shutter: Option<Shutter>,
    /// Seconds to the frames before and after, for velocities; `None` if nobody asks for them.
    pub frame: Option<f64>,
}

/// For how long a camera's shutter is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Seconds from the pose's to its opening, of either sign.
    pub opens: f64,
    /// To its closing, > `opens`.
    pub closes: f64,
    /// Into how many steps motion is cut, at most [`MAX_STEPS`](crate::scene::motion::MAX_STEPS); `None`: as many as it bends.
    pub steps: Option<u32>,
}
