//! The interface of lobes, [`Lobe`], and the types of its arguments and results.

use super::lobe_set::LobeSet;
use crate::lanes::{F, V3};
use crate::sampling::warp;

/// Maximum levels of a stack: lobes on top of the innermost one. That of materials has six.
pub(crate) const MAX_LEVELS: usize = 8;

/// Probabilities with which sampling chooses the top lobe of each level of a stack, from the innermost level on.
pub type TopProbabilities = [F; MAX_LEVELS];

/// A lobe, or a stack of lobes, at eight points.
pub trait Lobe: Copy {
    const LEVELS: usize = 0;

    /// Mask of the lanes where the lobe is not zero.
    fn present(&self) -> F;

    /// The lobes of the stack that are present in at least one lane.
    fn lobes(&self) -> LobeSet {
        LobeSet::single(self.present().any())
    }

    /// Mask of the lanes where the lobe also scatters to the other side of the surface.
    #[inline(always)]
    fn transmits(&self) -> F {
        F::ZERO
    }

    /// Approximate luminances of the albedos of rough and of sharp lobes, which are divided by [`MIN_ROUGH_ALPHA`]. Path
    /// guiding is used where the first is not smaller; elsewhere the BSDF alone says which directions matter.
    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        [F::ZERO; 2]
    }

    /// Estimates, for uniform white illumination, of the luminance that the lobe scatters toward `wo`, and of the fraction of
    /// light that reaches the layers beneath. Sampling chooses among lobes by them. `n` is the shading normal.
    fn weight(&self, n: V3, wo: V3) -> (F, F);

    /// [`weight`](Self::weight), with the probabilities of all levels of the stack.
    #[inline(always)]
    fn weigh(&self, n: V3, wo: V3, _top: &mut TopProbabilities) -> (F, F) {
        self.weight(n, wo)
    }

    /// Light that goes straight on: the delta part of the lobe, which [`eval`](Self::eval) and sampling leave out. `light` is
    /// the fraction of light that the layers above transmit. With `bodies` also what smooth boundaries of media transmit, as
    /// if it were not bent; that is no part of the BSDF.
    #[inline(always)]
    fn straight(&self, n: V3, wo: V3, light: F, _bodies: bool) -> Straight {
        Straight { weight: V3::ZERO, transmittance: light * self.weight(n, wo).1 }
    }

    /// Value and density for given directions; `light` is the fraction of light that the layers above transmit.
    fn eval(&self, d: &Directions, light: F) -> Response;

    /// Samples a direction from three uniform numbers in [0, 1); the first one chooses among the parts of a lobe, and among lobes by
    /// their probabilities. By default above the surface, with density cos θ/π.
    #[inline(always)]
    fn sample_direction(&self, frames: &Frames, wo: V3, [_, u, v]: [F; 3], _top: &TopProbabilities) -> DirectionSample {
        let wi = frames.to_world(warp::cosine_hemispheres(u, v));
        DirectionSample { wi, h: (wo + wi).normalize_or(frames.n) }
    }

    /// f(wo, wi) · |n·wi|, and the density per solid angle with which [`sample`](Self::sample) draws `wi`. Both are zero
    /// where `wo` is below the surface with shading normal `n`, or where `wi` is and no lobe transmits.
    #[inline(always)]
    fn eval_pdf(&self, n: V3, wo: V3, wi: V3) -> (V3, F) {
        self.eval_pdf_above(n, wo, wi, F::ZERO)
    }

    /// The part of [`eval_pdf`](Self::eval_pdf) that is due to lobes whose α is at least `min_alpha`, of reflection: smaller
    /// ones attenuate the layers beneath, but scatter nothing.
    #[inline(always)]
    fn eval_pdf_above(&self, n: V3, wo: V3, wi: V3, min_alpha: F) -> (V3, F) {
        match is_large::<Self>() {
            true => eval_large(self, n, wo, wi, min_alpha),
            false => eval(self, n, wo, wi, min_alpha),
        }
    }

    /// Samples `wi` from three uniform numbers in [0, 1).
    #[inline(always)]
    fn sample(&self, n: V3, wo: V3, numbers: [F; 3]) -> BsdfSample {
        self.sample_or(n, wo, numbers, (F::ZERO, V3::ZERO))
    }

    /// Samples `wi` from three uniform numbers in [0, 1), but takes `other` in lanes of the mask `given`. Value and density
    /// are those of the BSDF in all lanes.
    #[inline(always)]
    fn sample_or(&self, n: V3, wo: V3, numbers: [F; 3], given: (F, V3)) -> BsdfSample {
        match is_large::<Self>() {
            true => sample_large(self, n, wo, numbers, given),
            false => sample(self, n, wo, numbers, given),
        }
    }
}

/// Is the code of a stack so large that it is compiled once, and not wherever it is called?
pub(super) const fn is_large<L: Lobe>() -> bool {
    L::LEVELS > 1
}

#[inline(never)]
fn eval_large(lobe: &impl Lobe, n: V3, wo: V3, wi: V3, min_alpha: F) -> (V3, F) {
    eval(lobe, n, wo, wi, min_alpha)
}

#[inline(never)]
fn sample_large(lobe: &impl Lobe, n: V3, wo: V3, numbers: [F; 3], given: (F, V3)) -> BsdfSample {
    sample(lobe, n, wo, numbers, given)
}

/// [`Lobe::eval_pdf_above`].
#[inline(always)]
fn eval(lobe: &impl Lobe, n: V3, wo: V3, wi: V3, min_alpha: F) -> (V3, F) {
    let half = (wo + wi).normalize_or(n);
    let sample = DirectionSample { wi, h: V3::select(n.dot(wi).simd_gt(F::ZERO), half, V3::ZERO) };
    let mut top = [F::ZERO; MAX_LEVELS];
    lobe.weigh(n, wo, &mut top);
    let response = respond(lobe, n, wo, sample, min_alpha, top);
    (response.value, response.pdf)
}

/// [`Lobe::sample_or`].
#[inline(always)]
fn sample(lobe: &impl Lobe, n: V3, wo: V3, numbers: [F; 3], (given, other): (F, V3)) -> BsdfSample {
    let mut top = [F::ZERO; MAX_LEVELS];
    lobe.weigh(n, wo, &mut top);
    let mut drawn = lobe.sample_direction(&Frames::new(n), wo, numbers, &top);
    if given.any() {
        let half = (wo + other).normalize_or(n);
        let h = V3::select(n.dot(other).simd_gt(F::ZERO), half, V3::ZERO);
        drawn = DirectionSample { wi: V3::select(given, other, drawn.wi), h: V3::select(given, h, drawn.h) };
    }
    let Response { value, pdf, .. } = respond(lobe, n, wo, drawn, F::ZERO, top);
    BsdfSample { wi: drawn.wi, value, pdf }
}

/// Evaluates a lobe for a sampled direction.
#[inline(always)]
fn respond(
    lobe: &impl Lobe,
    n: V3,
    wo: V3,
    DirectionSample { wi, h }: DirectionSample,
    min_alpha: F,
    top: TopProbabilities,
) -> Response {
    let (cos_o, cos_i) = (n.dot(wo), n.dot(wi));
    let above = cos_o.simd_gt(F::ZERO) & cos_i.simd_gt(F::ZERO);
    lobe.eval(&Directions { n, wo, wi, h, cos_o, cos_i, above, min_alpha, top }, F::ONE)
}

/// The directions for which a lobe is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Directions {
    pub n: V3,
    /// Unit, toward the camera.
    pub wo: V3,
    /// Unit, toward the light.
    pub wi: V3,
    /// Unit half vector; where `wi` is below the surface, [`DirectionSample::h`], or zero if it is not known.
    pub h: V3,
    /// n · wo.
    pub cos_o: F,
    /// n · wi.
    pub cos_i: F,
    /// Mask: `wo` and `wi` are both above the surface.
    pub above: F,
    /// Microfacet lobes of a smaller α reflect nothing.
    pub min_alpha: F,
    /// Probabilities of the lobes.
    pub top: TopProbabilities,
}

/// Orthonormal frames around shading normals.
#[derive(Debug, Clone, Copy)]
pub struct Frames {
    pub t: V3,
    pub b: V3,
    pub n: V3,
}

impl Frames {
    /// Frames around unit normals.
    #[inline(always)]
    pub fn new(n: V3) -> Self {
        let (t, b) = warp::frames(n);
        Self { t, b, n }
    }

    /// World-space vectors in the frames.
    #[inline(always)]
    pub(crate) fn to_local(self, v: V3) -> V3 {
        V3 { x: self.t.dot(v), y: self.b.dot(v), z: self.n.dot(v) }
    }

    /// Vectors in the frames in world space.
    #[inline(always)]
    pub fn to_world(self, v: V3) -> V3 {
        self.t * v.x + self.b * v.y + self.n * v.z
    }
}

/// A lobe evaluated for given directions.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// f · |n·wi|.
    pub value: V3,
    /// Density per solid angle with which the lobe samples `wi`.
    pub pdf: F,
    /// Fraction of the light that reaches the layers beneath.
    pub transmittance: F,
}

/// The delta part of a lobe: what arrives at `wo` of light from −`wo`, whose direction it does not change.
#[derive(Debug, Clone, Copy)]
pub struct Straight {
    /// Linear RGB fraction of the radiance.
    pub weight: V3,
    /// Fraction of the light that reaches the layers beneath.
    pub transmittance: F,
}

/// A direction sampled from a lobe.
#[derive(Debug, Clone, Copy)]
pub struct DirectionSample {
    /// Unit, toward the light; zero where sampling failed.
    pub wi: V3,
    /// The sampled microfacet normal, negated where light is transmitted; for diffuse lobes the half vector of `wo` and
    /// `wi`, or zero below the surface.
    pub h: V3,
}

/// Directions sampled from BSDFs, with their values.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Unit, world space, toward the light.
    pub wi: V3,
    /// f · |n·wi|.
    pub value: V3,
    /// Density per solid angle; zero where sampling failed (a direction on the wrong side, no lobe present). A failed sample
    /// counts as a sample of value zero.
    pub pdf: F,
}

/// Microfacet lobes of at least this α are rough, those of a smaller one are sharp.
pub const MIN_ROUGH_ALPHA: f32 = 0.1;

/// [`Lobe::albedos`] of a microfacet lobe of roughness `alpha` and albedo `weight`.
#[inline(always)]
pub(super) fn albedos(weight: F, alpha: F) -> [F; 2] {
    let sharp = alpha.simd_lt(F::splat(MIN_ROUGH_ALPHA));
    [!sharp & weight, sharp & weight]
}
