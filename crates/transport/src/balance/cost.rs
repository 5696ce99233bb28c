//! What samples cost.

/// What a path costs, in rays.
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    /// Whatever the share is.
    pub fixed: f32,
    /// A light sample at the first surface.
    pub light: f32,
    /// A BSDF sample there, and all that follows from it.
    pub bsdf: f32,
}

impl Cost {
    /// Of a path with two samples at its first surface, a share `alpha` of them light samples.
    pub fn at(&self, alpha: f32) -> f32 {
        self.fixed + 2.0 * (alpha * self.light + (1.0 - alpha) * self.bsdf)
    }
}
