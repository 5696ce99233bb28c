//! Rough dielectric boundaries that reflect and refract (KHR_materials_transmission, KHR_materials_volume): of closed media
//! or thin walls. `refraction.rs` has the geometry. What a smooth thin wall transmits goes straight on, see [`Lobe::straight`].
//!
//! Radiance inside media is not scaled by the squared index of refraction: emitters in glass have the radiance that the
//! file says, and the factor cancels for light that leaves a medium.

use super::lobe::{DirectionSample, Directions, Frames, Lobe, Response, Straight, TopProbabilities, albedos};
use super::parameters::{Eight, lobe};
use super::refraction::{self, Facet, Fresnel};
use super::{albedo, ggx};
use crate::lanes::{F, V3};

/// Smallest difference of an index of refraction from 1: without refraction there is no half vector.
pub(crate) const MIN_BEND: f32 = 1e-4;

lobe! {
    /// GGX reflection and refraction of a fraction of the surface; the lobes beneath have the rest.
    Glass {
        /// The fraction, in [0, 1].
        fraction: Scalar,
        /// Linear RGB tint of transmitted light.
        tint: Vector,
        /// Reflectance at normal incidence.
        f0: Vector,
        /// Reflectance at grazing incidence.
        f90: Scalar,
        /// Index of refraction beyond the surface over that on the side of `wo`; for thin walls, that of the wall.
        eta: Scalar,
        /// 1 for a thin wall, 0 for a medium boundary.
        thin: Scalar,
        /// Microfacet α, ≥ [`ggx::MIN_ALPHA`].
        alpha: Scalar,
        /// 1: multiple scattering is compensated; 0: it is not. See [`Microfacet`](super::Microfacet).
        compensation: Scalar,
    }
}

impl Lobe for Glass<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.fraction.simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.present() & !self.is_straight()
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        albedos(self.fraction, self.alpha)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        (self.fraction * self.scattering(n.dot(wo)).luminance(self.tint), F::ONE - self.fraction)
    }

    #[inline(always)]
    fn straight(&self, n: V3, wo: V3, light: F, bodies: bool) -> Straight {
        let passes = if bodies { ggx::is_smooth(self.alpha) } else { self.is_straight() };
        // From within, the reflectance is that from outside at the refracted angle, which the ray has where it entered.
        let outside = Self { eta: self.eta.fast_max(F::ONE / self.eta), ..*self };
        let transmitted = outside.fresnel(n.dot(wo)).transmitted & passes;
        Straight {
            weight: self.tint * (transmitted * self.fraction * light),
            transmittance: light * (F::ONE - self.fraction),
        }
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let thin = self.thin.simd_gt(F::ZERO);
        let Facet { h, wo_h, transmits, jacobian } = refraction::facet(d, self.eta, thin);
        let alpha2 = self.alpha * self.alpha;
        let cos_h = d.n.dot(h);
        let density = ggx::distribution(d.n.cross(h).length_squared(), cos_h * cos_h, alpha2);
        let masking = ggx::masking(d.cos_o, alpha2);
        let drawn = masking * density * jacobian / d.cos_o;

        let fresnel = self.scattering(wo_h);
        let p = fresnel.reflection_probability(self.tint);
        let visible = d.above | transmits;
        let pdf = (drawn * d.above.select(p, F::ONE - p)) & visible;
        let color = V3::select(d.above, fresnel.reflected, self.tint * fresnel.transmitted);
        let shadowing = ggx::shadowing(masking, ggx::masking(d.cos_i.abs(), alpha2));
        let mut value = color * ((drawn * shadowing * self.fraction * light) & visible);
        if self.compensation.simd_gt(F::ZERO).any() {
            let loss = albedo::boundary_loss(d.cos_o, self.alpha, self.eta, thin);
            value = value * albedo::gain(albedo::boundary_color(self.f0, self.f90, self.tint), loss, self.compensation);
        }
        Response { value, pdf, transmittance: light * (F::ONE - self.fraction) }
    }

    #[inline(always)]
    fn sample_direction(&self, frames: &Frames, wo: V3, [lobe, u, v]: [F; 3], _: &TopProbabilities) -> DirectionSample {
        let h = frames.to_world(ggx::sample_visible_normal(frames.to_local(wo), [self.alpha; 2], u, v));
        let reflects = lobe.simd_lt(self.scattering(wo.dot(h)).reflection_probability(self.tint));
        refraction::reflect_or_refract(frames.n, wo, h, self.eta, self.thin.simd_gt(F::ZERO), reflects)
    }
}

impl Glass<Eight> {
    /// The Fresnel terms at cosine `cos` between `wo` and the microfacet normal: the exact dielectric curve, rescaled to run
    /// from `f0` to `f90`. An index of 1 reflects nothing.
    #[inline(always)]
    fn fresnel(&self, cos: F) -> Fresnel {
        let (fresnel_rise, total) = refraction::fresnel_rise(cos, self.eta);
        let between = |f0: F| (self.f90 - f0).mul_add(fresnel_rise, f0);
        let reflected = V3 { x: between(self.f0.x), y: between(self.f0.y), z: between(self.f0.z) };
        let one = V3 { x: F::ONE, y: F::ONE, z: F::ONE };
        let transmitted = F::ONE - between(self.f0.max_element());
        Fresnel { reflected: V3::select(total, one, reflected), transmitted: total.select(F::ZERO, transmitted) }
    }

    /// The Fresnel terms less the light that goes straight on.
    #[inline(always)]
    fn scattering(&self, cos: F) -> Fresnel {
        self.fresnel(cos).without(self.is_straight())
    }

    /// Mask of the thin walls that are smooth.
    #[inline(always)]
    fn is_straight(&self) -> F {
        self.thin.simd_gt(F::ZERO) & ggx::is_smooth(self.alpha)
    }
}
