//! Which pixels show the same surface and may learn from each other.

use glam::Vec3;

/// Features of the surface at a pixel's centre.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelFeatures {
    /// Object index + 1; 0 where the ray hits nothing.
    pub object: u32,
    /// Material index + 1; 0 where the ray hits nothing.
    pub material: u32,
    /// Unit normal in world space, or zero.
    pub normal: Vec3,
    /// Distance from the camera in metres.
    pub depth: f32,
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
}

/// Smallest cosine between the normals of similar pixels: 20°.
const MIN_COS: f32 = 0.94;
/// Largest relative difference of the depths of similar pixels.
const MAX_DEPTH_DIFFERENCE: f32 = 0.05;
/// Largest relative difference of the roughnesses of similar pixels.
const MAX_ROUGHNESS_DIFFERENCE: f32 = 0.2;

impl PixelFeatures {
    /// Whether the two pixels show the same kind of surface. A pixel that shows nothing is similar to none.
    pub fn is_similar(&self, other: &Self) -> bool {
        self.object > 0
            && (self.object, self.material) == (other.object, other.material)
            && self.normal.dot(other.normal) > MIN_COS
            && (self.depth - other.depth).abs() < MAX_DEPTH_DIFFERENCE * self.depth
            && (self.roughness - other.roughness).abs() <= MAX_ROUGHNESS_DIFFERENCE * self.roughness
    }
}
