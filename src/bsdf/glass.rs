//! What lets light through: a dielectric's boundary reflects a part of the light and transmits the rest. Of bodies, rough
//! or smooth, after Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*; of thin walls as
//! KHR_materials_transmission says: what passes leaves as the reflection would, but on the other side.
//!
//! Radiance is not scaled by the squared index of refraction inside of bodies: lights in glass are as bright as their
//! file says, and all that leaves a body has lost the factor again.

use super::{Directions, Draw, Eight, Frames, Lobe, Response, ggx, parameters::lobe};
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
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let fresnel = self.fresnel(n.dot(wo));
        (self.share * (fresnel.reflected.luminance() + fresnel.passed * self.tint.luminance()), F::ONE - self.share)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let below = d.cos_o.simd_gt(F::ZERO) & d.cos_i.simd_lt(F::ZERO);
        let thin = self.thin.simd_gt(F::ZERO);
        // The microfacet's normal. What a draw transmitted points into the surface; where none is known it follows from
        // the directions; one that points out, with `wi` below, is a reflection's that failed.
        let toward = d.n.dot(d.h);
        let mirrored = d.wi - d.n * (F::splat(2.0) * d.cos_i);
        let rebuilt = (d.wo + V3::select(thin, mirrored, d.wi * self.eta)).normalize_or(V3::ZERO);
        let rebuilt = rebuilt * sign(d.n.dot(rebuilt));
        let transmits = V3::select(toward.simd_lt(F::ZERO), d.h * F::splat(-1.0), rebuilt);
        let h = V3::select(d.above, d.h, transmits);

        let (wo_h, wi_h) = (d.wo.dot(h), d.wi.dot(h));
        let passes =
            below & toward.simd_le(F::ZERO) & wo_h.simd_gt(F::ZERO) & thin.select(F::ONE, -wi_h).simd_gt(F::ZERO);
        let alpha2 = self.alpha * self.alpha;
        let cos_h = d.n.dot(h);
        let density = ggx::distribution(d.n.cross(h).length_squared(), cos_h * cos_h, alpha2);
        // Solid angle of the microfacet's normal over that of `wi`, times wo·h.
        let bend = wi_h.mul_add(self.eta, wo_h);
        let refraction = wo_h * wi_h.abs() * self.eta * self.eta / (bend * bend);
        let mirror = d.above | thin;
        let drawn = ggx::masking(d.cos_o, alpha2) * density * mirror.select(F::splat(0.25), refraction) / d.cos_o;

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
        let m = ggx::sample_visible_normal(local, self.alpha, u, v);
        let h = *t * m.x + *b * m.y + *n * m.z;
        let cos = wo.dot(h);
        let reflects = lobe.simd_lt(self.chance_of_reflection(&self.fresnel(cos)));
        let mirror = h * (F::splat(2.0) * cos) - wo;
        let behind = mirror - *n * (F::splat(2.0) * n.dot(mirror));
        let one_over_eta = F::ONE / self.eta;
        let root = ((cos * cos - F::ONE) * one_over_eta).mul_add(one_over_eta, F::ONE).fast_max(F::ZERO).sqrt();
        let refracted = h * (cos * one_over_eta - root) - wo * one_over_eta;
        let passed = V3::select(self.thin.simd_gt(F::ZERO), behind, refracted);
        let wi = V3::select(reflects, mirror, passed);
        // On the other side than it should be, nothing is drawn.
        let good = (n.dot(wi) * reflects.select(F::ONE, -F::ONE)).simd_gt(F::ZERO);
        Draw { wi: V3::select(good, wi, V3::ZERO), h: h * reflects.select(F::ONE, -F::ONE) }
    }
}

/// What becomes of light at a microfacet.
struct Fresnel {
    reflected: V3,
    passed: F,
}

impl Glass<Eight> {
    /// At cosine `cos` between `wo` and a microfacet's normal: the exact reflectance of a dielectric (Walter et al.,
    /// equation 22), stretched between `f0` and `f90` as Schlick's is where nothing is transmitted. Index 1 shows nothing.
    #[inline(always)]
    fn fresnel(&self, cos: F) -> Fresnel {
        let g2 = cos.mul_add(cos, self.eta * self.eta - F::ONE);
        let total = g2.simd_le(F::ZERO);
        let g = g2.fast_max(F::ZERO).sqrt();
        let (less, more) = (g - cos, g + cos);
        let (a, b) = (less / more, cos.mul_sub(more, F::ONE) / cos.mul_add(less, F::ONE));
        let exact = F::splat(0.5) * a * a * b.mul_add(b, F::ONE);
        let normal = (self.eta - F::ONE) / (self.eta + F::ONE);
        let normal = normal * normal;
        let rise = ((exact - normal) / (F::ONE - normal)).fast_max(F::ZERO).fast_min(F::ONE);
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

/// −1 below zero, else 1.
#[inline(always)]
fn sign(x: F) -> F {
    (x & F::splat(-0.0)) | F::ONE
}
