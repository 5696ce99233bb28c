//! Cost of samples.

/// Cost of a path, in rays.
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    /// The part that does not depend on the light share.
    pub fixed: f32,
    /// One light sample at the first surface.
    pub light: f32,
    /// One BSDF sample at the first surface, with the rest of the path.
    pub bsdf: f32,
}

impl Cost {
    /// Cost of a path with two samples at its first surface, of which a fraction `light_share` are light samples.
    pub fn at(&self, light_share: f32) -> f32 {
        self.fixed + 2.0 * (light_share * self.light + (1.0 - light_share) * self.bsdf)
    }
}
