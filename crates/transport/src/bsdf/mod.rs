//! Scattering at a surface point: `sample`, `eval`, `pdf`. Directions point away from the surface, `wo` toward the eye
//! and `wi` toward the light, both in world space and unit.
//!
//! A model is lobes in layers, and [`Bsdf`] lists them. A lobe is a file: it declares its parameters once, from which
//! follow those of eight points and the columns of a batch ([`parameters`]), and answers [`Lobe`].

pub mod clearcoat;
pub mod diffuse_transmission;
pub mod film;
pub mod general_microfacet;
pub mod ggx;
pub mod glass;
pub mod lambert;
pub mod layered;
pub mod metallic_roughness;
pub mod microfacet;
pub mod parameters;
mod refraction;
pub mod sheen;

pub use clearcoat::Clearcoat;
pub use diffuse_transmission::DiffuseTransmission;
pub use general_microfacet::GeneralMicrofacet;
pub use glass::Glass;
pub use lambert::Lambert;
pub use layered::{Layered, LobeSet};
pub use metallic_roughness::{Anisotropy, Iridescence, Surface};
pub use microfacet::Microfacet;
pub use parameters::{Columns, Eight, One, Parameters, Width};
pub use sheen::Sheen;

use crate::lanes::{F, LANES, V3};
use crate::sampling::warp;

/// The lobes of all materials, from the outermost in: the one list of them. What follows from it takes no columns and
/// no time for lobes that a scene does not use.
pub type Bsdf<W = One> = Layered<Clearcoat<W>, Layered<Sheen<W>, Layered<Glass<W>, Reflection<W>>>>;

/// What is left of a surface besides its glass.
type Reflection<W> = Layered<GeneralMicrofacet<W>, Unfinished<W>>;

/// And without a finish.
type Unfinished<W> = Layered<DiffuseTransmission<W>, Core<W>>;

/// glTF's core model, which most surfaces have and nothing more: what is compiled once more, without the rest.
pub type Core<W = One> = Layered<Microfacet<W>, Lambert<W>>;

/// A part of a model at eight points.
pub trait Lobe: Copy {
    /// Lanes that have it, as a mask.
    fn present(&self) -> F;

    /// Which lobes it is made of that any lane has.
    fn lobes(&self) -> LobeSet {
        LobeSet::of_one(self.present().any())
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
    fn draw(&self, frames: &Frames, wo: V3, numbers: [F; 3]) -> Draw;

    /// f(wo, wi) · |cos θ_i|, and the density per solid angle with which [`sample`](Self::sample) draws `wi`. Zero unless
    /// both directions are above the surface with shading normal `n`, or `wi` is below it and a lobe transmits.
    #[inline(always)]
    fn eval_pdf(&self, n: V3, wo: V3, wi: V3) -> (V3, F) {
        let half = (wo + wi).normalize_or(n);
        let found = respond(self, n, wo, Draw { wi, h: V3::select(n.dot(wi).simd_gt(F::ZERO), half, V3::ZERO) });
        (found.value, found.pdf)
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
        let mut draw = self.draw(&Frames { t, b, n }, wo, numbers);
        if given.any() {
            let half = (wo + other).normalize_or(n);
            let h = V3::select(n.dot(other).simd_gt(F::ZERO), half, V3::ZERO);
            draw = Draw { wi: V3::select(given, other, draw.wi), h: V3::select(given, h, draw.h) };
        }
        let Response { value, pdf, .. } = respond(self, n, wo, draw);
        BsdfSample { wi: draw.wi, value, pdf }
    }
}

/// What a model answers for a drawn direction.
#[inline(always)]
fn respond(lobe: &impl Lobe, n: V3, wo: V3, Draw { wi, h }: Draw) -> Response {
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
    /// Half vector of the two; with `wi` below the surface, [`Draw::h`] or zero.
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
    pub through: F,
}

/// A direction that a lobe drew.
#[derive(Debug, Clone, Copy)]
pub struct Draw {
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

impl Bsdf {
    /// Which lobes it has.
    pub fn lobes(&self) -> LobeSet {
        Self::gather([self; LANES]).lobes()
    }

    /// A batch's columns of the core model.
    pub fn core_mut(columns: &mut <Self as Parameters>::Columns) -> &mut <Core as Parameters>::Columns {
        &mut columns.base.base.base.base.base
    }

    /// A batch's columns of the core model, where it has no others.
    pub fn core(columns: &<Self as Parameters>::Columns) -> Option<&<Core as Parameters>::Columns> {
        let Layered { top: None, base: Layered { top: None, base: Layered { top: None, base } } } = columns else {
            return None;
        };
        match base {
            Layered { top: None, base: Layered { top: None, base } } => Some(base),
            _ => None,
        }
    }
}

/// The least microfacet α of what scatters widely.
const DIFFUSE_ALPHA: f32 = 0.1;

/// A lobe's [`Lobe::diffuseness`]: the share of light that it scatters, with microfacets of `alpha`.
#[inline(always)]
fn diffuseness(share: F, alpha: F) -> F {
    alpha.simd_lt(F::splat(DIFFUSE_ALPHA)).select(F::ZERO - share, share)
}
