//! What a field learns from.

use glam::Vec3;

/// A direction that a pre-pass sampled at a surface, and the radiance that it found.
#[derive(Debug, Clone, Copy)]
pub struct TrainingSample {
    /// Position of the surface in world space.
    pub position: Vec3,
    /// Unit geometric normal on the side of the incident ray.
    pub normal: Vec3,
    /// Unit direction in world space.
    pub wi: Vec3,
    /// Luminance of f·L/p, > 0, where L excludes the part that MIS leaves to light samples.
    pub contribution: f32,
    /// Square of the sample's contribution to its pixel, divided by the pixel's divisor of relMSE.
    pub weight: f32,
    /// Density p with which the direction was sampled.
    pub pdf: f32,
    pub bsdf_pdf: f32,
    /// Density of the earlier field; 0 without one.
    pub field_pdf: f32,
    /// Density of light samples if the direction ends at a light that MIS shares with them, otherwise 0.
    pub light_pdf: f32,
    /// Distance in metres to the surface that the direction meets; infinite without one.
    pub distance: f32,
}
