//! What every lobe answers: [`Lobe`].

use super::lobe_set::LobeSet;
use crate::lanes::{F, V3};
use crate::sampling::warp;

/// A part of a model at eight points.
pub trait Lobe: Copy {
    /// Lanes that have it, as a mask.
    fn present(&self) -> F;

    /// Which lobes it is made of that any lane has.
    fn lobes(&self) -> LobeSet {
        LobeSet::single(self.present().any())
    }

    /// Lanes in which it answers below the surface too, as a mask.
    #[inline(always)]
    fn transmits(&self) -> F {
        F::ZERO
    }

    /// By how much more light, about, it scatters widely than sharply. Where that is negative, light from one side matters or
    /// none does, and the BSDF alone knows which.
    #[inline(always)]
    fn diffuseness(&self) -> F {
        F::ZERO
    }

    /// An estimate of the luminance of what it reflects toward `wo` of uniform white light, by which samples choose
    /// among lobes, and the share of that light that reaches what is beneath. `n` is the shading normal.
    fn weight(&self, n: V3, wo: V3) -> (F, F);

    /// What it makes of the share `light` that reaches it from above.
    fn eval(&self, d: &Directions, light: F) -> Response;

    /// Draws a direction from three numbers in [0, 1), the first of which may choose among parts.
    fn sample_direction(&self, frames: &Frames, wo: V3, numbers: [F; 3]) -> DirectionSample;

    /// f(wo, wi) · |cos θ_i|, and the density per solid angle with which [`sample`](Self::sample) draws `wi`. Zero unless
    /// both directions are above the surface with shading normal `n`, or `wi` is below it and a lobe transmits.
    #[inline(always)]
    fn eval_pdf(&self, n: V3, wo: V3, wi: V3) -> (V3, F) {
        let half = (wo + wi).normalize_or(n);
        let response =
            evaluate(self, n, wo, DirectionSample { wi, h: V3::select(n.dot(wi).simd_gt(F::ZERO), half, V3::ZERO) });
        (response.value, response.pdf)
    }

    /// Draws `wi` from three numbers in [0, 1).
    #[inline(always)]
    fn sample(&self, n: V3, wo: V3, numbers: [F; 3]) -> BsdfSample {
        self.sample_or(n, wo, numbers, (F::ZERO, V3::ZERO))
    }

    /// As [`sample`](Self::sample), but in lanes of a mask given directions in place of those drawn; of these too with the
    /// density of drawing them.
    #[inline(always)]
    fn sample_or(&self, n: V3, wo: V3, numbers: [F; 3], (given, other): (F, V3)) -> BsdfSample {
        let (t, b) = warp::frames(n);
        let mut drawn = self.sample_direction(&Frames { t, b, n }, wo, numbers);
        if given.any() {
            let half = (wo + other).normalize_or(n);
            let h = V3::select(n.dot(other).simd_gt(F::ZERO), half, V3::ZERO);
            drawn = DirectionSample { wi: V3::select(given, other, drawn.wi), h: V3::select(given, h, drawn.h) };
        }
        let Response { value, pdf, .. } = evaluate(self, n, wo, drawn);
        BsdfSample { wi: drawn.wi, value, pdf }
    }
}

/// What a model answers for a drawn direction.
#[inline(always)]
fn evaluate(lobe: &impl Lobe, n: V3, wo: V3, DirectionSample { wi, h }: DirectionSample) -> Response {
    let (cos_o, cos_i) = (n.dot(wo), n.dot(wi));
    let above = cos_o.simd_gt(F::ZERO) & cos_i.simd_gt(F::ZERO);
    lobe.eval(&Directions { n, wo, wi, h, cos_o, cos_i, above }, F::ONE)
}

/// For what lobes are evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Directions {
    /// Shading normal.
    pub n: V3,
    /// Toward the eye.
    pub wo: V3,
    /// Toward the light.
    pub wi: V3,
    /// Half vector of the two; with `wi` below the surface, [`DirectionSample::h`] or zero.
    pub h: V3,
    /// n · wo.
    pub cos_o: F,
    /// n · wi.
    pub cos_i: F,
    /// Both are above the surface: a mask.
    pub above: F,
}

/// Orthonormal frames about shading normals.
#[derive(Debug, Clone, Copy)]
pub struct Frames {
    /// A tangent.
    pub t: V3,
    /// The other.
    pub b: V3,
    /// The normal.
    pub n: V3,
}

/// What a lobe answers.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// f · |cos θ_i|.
    pub value: V3,
    /// Density per solid angle with which it draws `wi`.
    pub pdf: F,
    /// Share of the light that reaches what is beneath.
    pub transmittance: F,
}

/// A direction that a lobe drew.
#[derive(Debug, Clone, Copy)]
pub struct DirectionSample {
    /// Toward the light.
    pub wi: V3,
    /// The normal of the microfacet that made it, toward the surface where light is transmitted; else the half vector of
    /// `wo` and `wi`.
    pub h: V3,
}

/// Directions drawn from BSDFs.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Unit, world space.
    pub wi: V3,
    /// f · |cos θ_i|.
    pub value: V3,
    /// Per solid angle; 0 where nothing was drawn (a direction below the surface, nothing to draw from): such a sample
    /// counts, with value zero.
    pub pdf: F,
}

/// The least microfacet α of what scatters widely.
const MIN_DIFFUSE_ALPHA: f32 = 0.1;

/// A lobe's [`Lobe::diffuseness`]: the share of light that it scatters, with microfacets of `alpha`.
#[inline(always)]
pub(super) fn diffuseness(weight: F, alpha: F) -> F {
    alpha.simd_lt(F::splat(MIN_DIFFUSE_ALPHA)).select(F::ZERO - weight, weight)
}
