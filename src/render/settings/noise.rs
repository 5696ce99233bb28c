//! Noise goals.

/// Default paths per pixel before the noise is estimated. Fewer paths give a poor estimate.
pub const NOISE_PATHS: u32 = 32;

/// When the pixels of a tile are finished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseGoal {
    /// Relative error, > 0.
    pub error: f64,
    /// Paths per pixel before the noise is estimated, ≥ 2.
    pub min_paths: u32,
    /// Maximum paths per pixel.
    pub max_paths: u32,
}
