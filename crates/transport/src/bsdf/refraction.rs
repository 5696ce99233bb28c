//! Reflection and refraction by the microfacets of a dielectric boundary, for any microfacet distribution (Walter et al.
//! 2007, *Microfacet Models for Refraction through Rough Surfaces*).
//!
//! `eta` is the index of refraction beyond the surface over that on the side of `wo`. In lanes of the mask `thin` the surface
//! is a thin wall: transmitted light leaves in the direction of its reflection, mirrored to the other side.

use super::lobe::{DirectionSample, Directions};
use super::schlick::normal_incidence;
use crate::lanes::{F, V3, sign};

/// Where light goes at a microfacet.
pub(super) struct Fresnel {
    pub reflected: V3,
    /// Fraction that is refracted.
    pub transmitted: F,
}

impl Fresnel {
    /// Luminance of all of it, where `tint` colours what is transmitted.
    #[inline(always)]
    pub fn luminance(&self, tint: V3) -> F {
        self.reflected.luminance() + self.transmitted * tint.luminance()
    }

    /// The part of the luminance that is reflected.
    #[inline(always)]
    pub(crate) fn reflection_probability(&self, tint: V3) -> F {
        let sum = self.luminance(tint);
        sum.simd_gt(F::ZERO).select(self.reflected.luminance() / sum, F::ONE)
    }

    /// Without what is transmitted in lanes of a mask.
    #[inline(always)]
    pub fn without(self, mask: F) -> Self {
        Self { transmitted: mask.select(F::ZERO, self.transmitted), ..self }
    }
}

/// The microfacet that scatters light from `wi` to `wo`.
pub(super) struct Facet {
    /// Unit normal, on the side of `wo`.
    pub h: V3,
    /// wo · h.
    pub wo_h: F,
    /// Mask: light is transmitted.
    pub transmits: F,
    /// |∂ω_h / ∂ω_i| · wo·h (equations 14 and 17).
    pub jacobian: F,
}

/// The microfacet of a pair of directions. A half vector that points into the surface is that of a transmission sample; where
/// it is zero, the microfacet is computed from the directions; n·h > 0 with `wi` below the surface marks a reflection sample
/// that failed.
#[inline(always)]
pub(super) fn facet(d: &Directions, eta: F, thin: F) -> Facet {
    let below = d.cos_o.simd_gt(F::ZERO) & d.cos_i.simd_lt(F::ZERO);
    let n_dot_h = d.n.dot(d.h);
    let mirrored = d.wi - d.n * (F::splat(2.0) * d.cos_i);
    let rebuilt = (d.wo + V3::select(thin, mirrored, d.wi * eta)).normalize_or(V3::ZERO);
    let rebuilt = rebuilt * sign(d.n.dot(rebuilt));
    let transmitting = V3::select(n_dot_h.simd_lt(F::ZERO), d.h * F::splat(-1.0), rebuilt);
    let h = V3::select(d.above, d.h, transmitting);

    let (wo_h, wi_h) = (d.wo.dot(h), d.wi.dot(h));
    let transmits =
        below & n_dot_h.simd_le(F::ZERO) & wo_h.simd_gt(F::ZERO) & thin.select(F::ONE, -wi_h).simd_gt(F::ZERO);
    let bend = wi_h.mul_add(eta, wo_h);
    let refraction = wo_h * wi_h.abs() * eta * eta / (bend * bend);
    Facet { h, wo_h, transmits, jacobian: (d.above | thin).select(F::splat(0.25), refraction) }
}

/// Scatters `wo` by the microfacet normal `h`: reflects in lanes of the mask `reflects`, transmits in the others.
#[inline(always)]
pub(super) fn reflect_or_refract(n: V3, wo: V3, h: V3, eta: F, thin: F, reflects: F) -> DirectionSample {
    let cos = wo.dot(h);
    let mirror = h * (F::splat(2.0) * cos) - wo;
    let through_wall = mirror - n * (F::splat(2.0) * n.dot(mirror));
    let one_over_eta = F::ONE / eta;
    let root = ((cos * cos - F::ONE) * one_over_eta).mul_add(one_over_eta, F::ONE).fast_max(F::ZERO).sqrt();
    let refracted = h * (cos * one_over_eta - root) - wo * one_over_eta;
    let wi = V3::select(reflects, mirror, V3::select(thin, through_wall, refracted));
    // Sampling fails where wi is on the wrong side of the surface.
    let valid = (n.dot(wi) * reflects.select(F::ONE, -F::ONE)).simd_gt(F::ZERO);
    DirectionSample { wi: V3::select(valid, wi, V3::ZERO), h: h * reflects.select(F::ONE, -F::ONE) }
}

/// The exact Fresnel reflectance of a dielectric (equation 22) at cosine `cos` to the microfacet normal, rescaled to 0 at
/// normal and 1 at grazing incidence; and the mask of total internal reflection.
#[inline(always)]
pub(super) fn fresnel_rise(cos: F, eta: F) -> (F, F) {
    let g2 = cos.mul_add(cos, eta * eta - F::ONE);
    let total = g2.simd_le(F::ZERO);
    let g = g2.fast_max(F::ZERO).sqrt();
    let (less, more) = (g - cos, g + cos);
    let (a, b) = (less / more, cos.mul_sub(more, F::ONE) / cos.mul_add(less, F::ONE));
    let exact = F::splat(0.5) * a * a * b.mul_add(b, F::ONE);
    let normal = normal_incidence(eta);
    (((exact - normal) / (F::ONE - normal)).fast_max(F::ZERO).fast_min(F::ONE), total)
}

/// The reflectance of a dielectric at cosine `cos` to the microfacet's normal.
pub(super) fn reflectance(cos: F, eta: F) -> F {
    let (rise, total) = fresnel_rise(cos, eta);
    let normal = normal_incidence(eta);
    total.select(F::ONE, (F::ONE - normal).mul_add(rise, normal))
}
