//! Light at a dielectric's boundary, whatever the distribution of its microfacets: after Walter et al. 2007, *Microfacet
//! Models for Refraction through Rough Surfaces*. `eta` is the index of refraction beyond the surface over that on the eye's
//! side; in lanes of the mask `thin` the surface is a thin wall, which light leaves as its reflection would, on the other
//! side.

use super::{Directions, Draw};
use crate::lanes::{F, V3};

/// A microfacet that sends light from `wi` to `wo`.
pub(super) struct Facet {
    /// Its normal, on the eye's side.
    pub h: V3,
    /// wo · h.
    pub wo_h: F,
    /// Mask: it transmits.
    pub passes: F,
    /// Solid angle of its normal over that of `wi`, times wo·h.
    pub jacobian: F,
}

/// The microfacet. What a draw transmitted points into the surface; where none is known it follows from the directions; one
/// that points out, with `wi` below, is a reflection's that failed.
#[inline(always)]
pub(super) fn facet(d: &Directions, eta: F, thin: F) -> Facet {
    let below = d.cos_o.simd_gt(F::ZERO) & d.cos_i.simd_lt(F::ZERO);
    let toward = d.n.dot(d.h);
    let mirrored = d.wi - d.n * (F::splat(2.0) * d.cos_i);
    let rebuilt = (d.wo + V3::select(thin, mirrored, d.wi * eta)).normalize_or(V3::ZERO);
    let rebuilt = rebuilt * sign(d.n.dot(rebuilt));
    let transmits = V3::select(toward.simd_lt(F::ZERO), d.h * F::splat(-1.0), rebuilt);
    let h = V3::select(d.above, d.h, transmits);

    let (wo_h, wi_h) = (d.wo.dot(h), d.wi.dot(h));
    let passes = below & toward.simd_le(F::ZERO) & wo_h.simd_gt(F::ZERO) & thin.select(F::ONE, -wi_h).simd_gt(F::ZERO);
    let bend = wi_h.mul_add(eta, wo_h);
    let refraction = wo_h * wi_h.abs() * eta * eta / (bend * bend);
    Facet { h, wo_h, passes, jacobian: (d.above | thin).select(F::splat(0.25), refraction) }
}

/// What a microfacet of normal `h` makes of light: it is reflected in lanes of `reflects`, transmitted in others.
#[inline(always)]
pub(super) fn follow(n: V3, wo: V3, h: V3, eta: F, thin: F, reflects: F) -> Draw {
    let cos = wo.dot(h);
    let mirror = h * (F::splat(2.0) * cos) - wo;
    let behind = mirror - n * (F::splat(2.0) * n.dot(mirror));
    let one_over_eta = F::ONE / eta;
    let root = ((cos * cos - F::ONE) * one_over_eta).mul_add(one_over_eta, F::ONE).fast_max(F::ZERO).sqrt();
    let refracted = h * (cos * one_over_eta - root) - wo * one_over_eta;
    let wi = V3::select(reflects, mirror, V3::select(thin, behind, refracted));
    // On the other side than it should be, nothing is drawn.
    let good = (n.dot(wi) * reflects.select(F::ONE, -F::ONE)).simd_gt(F::ZERO);
    Draw { wi: V3::select(good, wi, V3::ZERO), h: h * reflects.select(F::ONE, -F::ONE) }
}

/// How far the exact reflectance of a dielectric (equation 22) has risen at cosine `cos` to the microfacet's normal, from 0 at
/// normal incidence to 1 at grazing; and a mask: all is reflected.
#[inline(always)]
pub(super) fn rise(cos: F, eta: F) -> (F, F) {
    let g2 = cos.mul_add(cos, eta * eta - F::ONE);
    let total = g2.simd_le(F::ZERO);
    let g = g2.fast_max(F::ZERO).sqrt();
    let (less, more) = (g - cos, g + cos);
    let (a, b) = (less / more, cos.mul_sub(more, F::ONE) / cos.mul_add(less, F::ONE));
    let exact = F::splat(0.5) * a * a * b.mul_add(b, F::ONE);
    let normal = (eta - F::ONE) / (eta + F::ONE);
    let normal = normal * normal;
    (((exact - normal) / (F::ONE - normal)).fast_max(F::ZERO).fast_min(F::ONE), total)
}

/// −1 below zero, else 1.
#[inline(always)]
fn sign(x: F) -> F {
    (x & F::splat(-0.0)) | F::ONE
}
