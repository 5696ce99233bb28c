//! The GGX (Trowbridge-Reitz) microfacet distribution, isotropic, with Smith masking; all in the local frame.

use std::f32::consts::PI;

use glam::Vec3;

/// Below this the lobe is narrower than f32 directions resolve; a smoother surface is rendered as this one, whose
/// highlight is 0.1° wide.
pub const MIN_ALPHA: f32 = 1e-3;

/// Density of microfacet normals `h` per solid angle and projected area, for the squared roughness `alpha2`.
#[inline]
pub fn distribution(h: Vec3, alpha2: f32) -> f32 {
    // (x² + y²)/α² + z² rather than 1 − z²: no cancellation for narrow lobes.
    let k = (h.x * h.x + h.y * h.y) / alpha2 + h.z * h.z;
    1.0 / (PI * alpha2 * k * k)
}

/// Smith's masking of one direction, in (0, 1]: the share of visible microfacets seen from `w`.
#[inline]
pub fn masking(w: Vec3, alpha2: f32) -> f32 {
    let cos = w.z.abs();
    let tan2_alpha2 = alpha2 * (w.x * w.x + w.y * w.y);
    2.0 * cos / (cos + (cos * cos + tan2_alpha2).sqrt())
}

/// Draws a microfacet normal that is visible from `wo` (wo.z > 0), with density
/// G₁(wo) D(h) (wo·h)/wo.z (Dupuy and Benyoub 2023, *Sampling Visible GGX Normals with Spherical Caps*).
#[inline]
pub fn sample_visible_normal(wo: Vec3, alpha: f32, u: f32, v: f32) -> Vec3 {
    // Stretch to the unit hemisphere, draw from the cap that mirrors about wo, go back.
    let stretched = Vec3::new(wo.x * alpha, wo.y * alpha, wo.z).normalize();
    let phi = 2.0 * PI * u;
    let z = (1.0 - v) * (1.0 + stretched.z) - stretched.z;
    let sin = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let (s, c) = phi.sin_cos();
    let h = Vec3::new(sin * c, sin * s, z) + stretched;
    Vec3::new(h.x * alpha, h.y * alpha, h.z.max(0.0)).normalize_or(Vec3::Z)
}

/// Density per solid angle of the reflected direction when `h` comes from [`sample_visible_normal`].
#[inline]
pub fn reflection_pdf(wo: Vec3, h: Vec3, alpha2: f32) -> f32 {
    masking(wo, alpha2) * distribution(h, alpha2) / (4.0 * wo.z)
}
