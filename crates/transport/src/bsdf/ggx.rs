//! The GGX (Trowbridge-Reitz) microfacet distribution with Smith masking, isotropic and anisotropic, in eight lanes.

use std::f32::consts::PI;

use crate::lanes::{F, V3};
use crate::sampling::warp::sin_cos_turns;

/// Smallest α. Narrower lobes are not resolved by f32 directions; smoother surfaces are rendered with this α, whose
/// highlight is 0.1° wide.
pub const MIN_ALPHA: f32 = 1e-3;

/// Mask of the smoothest surfaces, those of α [`MIN_ALPHA`] or less: light that thin walls transmit there is a delta.
#[inline(always)]
pub fn is_smooth(alpha: F) -> F {
    alpha.simd_le(F::splat(MIN_ALPHA))
}

/// GGX distribution D(h) for the squared roughness `alpha2`, from the squared sine and cosine between microfacet and surface
/// normal. Callers compute the sine by a cross product, not as 1 − cos², which would cancel for narrow lobes.
#[inline(always)]
pub fn distribution(sin2: F, cos2: F, alpha2: F) -> F {
    let k = sin2 / alpha2 + cos2;
    F::ONE / (F::splat(PI) * alpha2 * k * k)
}

/// Smith masking G₁ of a direction at cosine `cos` > 0 to the normal: the fraction of visible microfacets, in (0, 1].
#[inline(always)]
pub(crate) fn masking(cos: F, alpha2: F) -> F {
    let cos2 = cos * cos;
    let sin2 = (F::ONE - cos2).fast_max(F::ZERO);
    F::splat(2.0) * cos / (cos + alpha2.mul_add(sin2, cos2).sqrt())
}

/// Height-correlated Smith shadowing given masking, G₂/G₁(wo), from [`masking`] of both directions: with G₁ = 1/(1 + Λ),
/// G₂ = 1/(1 + Λ(wo) + Λ(wi)) (Heitz 2014, *Understanding the Masking-Shadowing Function*, equation 99; glTF 2.0, appendix B).
#[inline(always)]
pub(crate) fn shadowing(masking_o: F, masking_i: F) -> F {
    masking_i / (masking_o + masking_i - masking_o * masking_i)
}

/// Anisotropic GGX distribution D(h) of a microfacet normal in the local frame, with the roughnesses `alphas` along x and
/// y.
#[inline(always)]
pub(crate) fn distribution_along(h: V3, alphas: [F; 2]) -> F {
    let (x, y) = (h.x / alphas[0], h.y / alphas[1]);
    let k = x.mul_add(x, y.mul_add(y, h.z * h.z));
    F::ONE / (F::splat(PI) * alphas[0] * alphas[1] * k * k)
}

/// Anisotropic Smith masking G₁ of a direction in the local frame, |w.z| > 0.
#[inline(always)]
pub(crate) fn masking_along(w: V3, alphas: [F; 2]) -> F {
    let (x, y, cos) = (w.x * alphas[0], w.y * alphas[1], w.z.abs());
    F::splat(2.0) * cos / (cos + x.mul_add(x, y.mul_add(y, cos * cos)).sqrt())
}

/// Samples a microfacet normal that is visible from `wo` (local frame, wo.z > 0) with density G₁(wo) D(h) (wo·h)/wo.z
/// (Dupuy and Benyoub 2023, *Sampling Visible GGX Normals with Spherical Caps*).
#[inline(always)]
pub(crate) fn sample_visible_normal(wo: V3, alphas: [F; 2], u: F, v: F) -> V3 {
    // Stretch to the unit hemisphere, sample the spherical cap, transform back.
    let up = V3 { x: F::ZERO, y: F::ZERO, z: F::ONE };
    let stretched = V3 { x: wo.x * alphas[0], y: wo.y * alphas[1], z: wo.z }.normalize_or(up);
    let z = (F::ONE - v) * (F::ONE + stretched.z) - stretched.z;
    let sin = (F::ONE - z * z).fast_max(F::ZERO).sqrt();
    let (s, c) = sin_cos_turns(u);
    let h = V3 { x: sin * c, y: sin * s, z } + stretched;
    let positive = h.z.simd_gt(F::ZERO);
    V3 { x: h.x * alphas[0], y: h.y * alphas[1], z: positive & h.z }.normalize_or(up)
}
