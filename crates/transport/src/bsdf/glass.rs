//! What lets light through: a dielectric's boundary, of a body or as a thin wall, reflects a part of the light and transmits
//! the rest (`refraction.rs`).
//!
//! Radiance is not scaled by the squared index of refraction inside of bodies: lights in glass are as bright as their
//! file says, and all that leaves a body has lost the factor again.

use super::refraction::{self, Facet};
use super::{Directions, Draw, Eight, Frames, Lobe, Response, diffuseness, ggx, parameters::lobe};
use crate::lanes::{F, V3};

/// Indices of refraction nearer to 1 than this are taken as this: where nothing is bent, no half vector says how much.
pub const MIN_BEND: f32 = 1e-4;

lobe! {
    /// Reflection and transmission of a part of the surface, beside the lobes beneath, which have the rest of it.
    Glass {
        /// Which part, in [0, 1].
        share: Scalar,
        /// Colour of what is transmitted.
        tint: Vector,
        /// Reflectance at normal incidence.
        f0: Vector,
        /// The same at grazing.
        f90: Scalar,
        /// Index of refraction beyond the surface over that on the eye's side; of thin walls, of their inside.
        eta: Scalar,
        /// 1 for a thin wall, 0 for a body's boundary.
        thin: Scalar,
        /// Microfacet roughness, ≥ [`ggx::MIN_ALPHA`].
        alpha: Scalar,
    }
}

impl Lobe for Glass<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.share.simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.present()
    }

    #[inline(always)]
    fn diffuseness(&self) -> F {
        diffuseness(self.share, self.alpha)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let fresnel = self.fresnel(n.dot(wo));
        (self.share * (fresnel.reflected.luminance() + fresnel.passed * self.tint.luminance()), F::ONE - self.share)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let Facet { h, wo_h, passes, jacobian } = refraction::facet(d, self.eta, self.thin.simd_gt(F::ZERO));
        let alpha2 = self.alpha * self.alpha;
        let cos_h = d.n.dot(h);
        let density = ggx::distribution(d.n.cross(h).length_squared(), cos_h * cos_h, alpha2);
        let drawn = ggx::masking(d.cos_o, alpha2) * density * jacobian / d.cos_o;

        let fresnel = self.fresnel(wo_h);
        let p = self.chance_of_reflection(&fresnel);
        let seen = d.above | passes;
        let pdf = (drawn * d.above.select(p, F::ONE - p)) & seen;
        let color = V3::select(d.above, fresnel.reflected, self.tint * fresnel.passed);
        let value = color * ((drawn * ggx::masking(d.cos_i.abs(), alpha2) * self.share * light) & seen);
        Response { value, pdf, through: light * (F::ONE - self.share) }
    }

    #[inline(always)]
    fn draw(&self, Frames { t, b, n }: &Frames, wo: V3, [lobe, u, v]: [F; 3]) -> Draw {
        let local = V3 { x: t.dot(wo), y: b.dot(wo), z: n.dot(wo) };
        let m = ggx::sample_visible_normal(local, [self.alpha; 2], u, v);
        let h = *t * m.x + *b * m.y + *n * m.z;
        let reflects = lobe.simd_lt(self.chance_of_reflection(&self.fresnel(wo.dot(h))));
        refraction::follow(*n, wo, h, self.eta, self.thin.simd_gt(F::ZERO), reflects)
    }
}

/// What becomes of light at a microfacet.
struct Fresnel {
    reflected: V3,
    passed: F,
}

impl Glass<Eight> {
    /// At cosine `cos` between `wo` and a microfacet's normal: the exact reflectance of a dielectric, stretched between `f0`
    /// and `f90` as Schlick's is where nothing is transmitted. Index 1 shows nothing.
    #[inline(always)]
    fn fresnel(&self, cos: F) -> Fresnel {
        let (rise, total) = refraction::rise(cos, self.eta);
        let between = |f0: F| (self.f90 - f0).mul_add(rise, f0);
        let reflected = V3 { x: between(self.f0.x), y: between(self.f0.y), z: between(self.f0.z) };
        let one = V3 { x: F::ONE, y: F::ONE, z: F::ONE };
        let passed = F::ONE - between(self.f0.max_element());
        Fresnel { reflected: V3::select(total, one, reflected), passed: total.select(F::ZERO, passed) }
    }

    #[inline(always)]
    fn chance_of_reflection(&self, fresnel: &Fresnel) -> F {
        let reflected = fresnel.reflected.luminance();
        let sum = reflected + fresnel.passed * self.tint.luminance();
        sum.simd_gt(F::ZERO).select(reflected / sum, F::ONE)
    }
}
