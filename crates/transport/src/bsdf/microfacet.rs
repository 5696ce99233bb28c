//! GGX reflection of metals and dielectrics, with height-correlated Smith masking-shadowing and Schlick's Fresnel term
//! (glTF 2.0, appendix B), and compensation of the energy that single scattering loses (`albedo.rs`).

use super::lobe::{DirectionSample, Directions, Frames, Lobe, Response, TopProbabilities, albedos};
use super::parameters::{Eight, lobe};
use super::schlick::schlick_weight;
use super::{albedo, ggx};
use crate::lanes::{F, V3};

lobe! {
    /// GGX reflection. Fresnel terms interpolate between normal and grazing incidence by Schlick's weight (1 − cos)⁵.
    Microfacet {
        /// Reflectance at normal incidence.
        f0: Vector,
        /// Reflectance at grazing incidence.
        f90: Scalar,
        /// Fraction of light that the lobes beneath do not receive, at normal incidence.
        layer0: Scalar,
        /// The same fraction at grazing incidence.
        layer90: Scalar,
        /// Microfacet α, ≥ [`ggx::MIN_ALPHA`].
        alpha: Scalar,
        /// Metalness, in [0, 1].
        metallic: Scalar,
        /// 1: the energy that single scattering loses is compensated, and the lobes beneath receive what the albedo of the layer
        /// leaves. 0: the letter of glTF's appendix B.
        compensation: Scalar,
    }
}

impl Lobe for Microfacet<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.f90.simd_gt(F::ZERO) | self.f0.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        albedos(self.f0.luminance(), self.alpha)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        // Fresnel terms at the surface normal.
        let schlick = schlick_weight(n.dot(wo));
        (self.fresnel(schlick).luminance(), F::ONE - self.layer(schlick))
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let schlick = schlick_weight(d.wo.dot(d.h));
        let above = d.above & self.alpha.simd_ge(d.min_alpha);
        let alpha2 = self.alpha * self.alpha;
        let cos_h = d.n.dot(d.h);
        let density = ggx::distribution(d.n.cross(d.h).length_squared(), cos_h * cos_h, alpha2);
        // pdf = D G₁(wo)/(4 cos θ_o); value = pdf F G₂/G₁(wo).
        let masking = ggx::masking(d.cos_o, alpha2);
        let pdf = masking * density / (F::splat(4.0) * d.cos_o);
        let shadowing = ggx::shadowing(masking, ggx::masking(d.cos_i, alpha2));
        let value = self.fresnel(schlick) * ((pdf * shadowing * light) & above);
        let transmittance = F::ONE - self.layer(schlick);
        if !self.compensation.simd_gt(F::ZERO).any() {
            return Response { value, pdf: pdf & above, transmittance: light * transmittance };
        }
        let albedo = albedo::ggx(d.cos_o, self.alpha);
        let color = albedo::mean_fresnel(self.f0, self.f90);
        let color = albedo::mixture_color(color, self.metallic, albedo::mean_schlick(self.layer0, self.layer90));
        let value = value * albedo::gain(color, albedo.loss(), self.compensation);
        let compensated = F::ONE - albedo.layer(self.layer0, self.layer90);
        let transmittance = self.compensation.simd_gt(F::ZERO).select(compensated, transmittance);
        Response { value, pdf: pdf & above, transmittance: light * transmittance }
    }

    #[inline(always)]
    fn sample_direction(&self, frames: &Frames, wo: V3, [_, u, v]: [F; 3], _: &TopProbabilities) -> DirectionSample {
        // h as sampled, not normalize(wo + wi), which is inexact for narrow lobes.
        let h = frames.to_world(ggx::sample_visible_normal(frames.to_local(wo), [self.alpha; 2], u, v));
        DirectionSample { wi: h * (F::splat(2.0) * wo.dot(h)) - wo, h }
    }
}

impl Microfacet<Eight> {
    #[inline(always)]
    fn fresnel(&self, schlick: F) -> V3 {
        let rise = |f0: F| (self.f90 - f0).mul_add(schlick, f0);
        V3 { x: rise(self.f0.x), y: rise(self.f0.y), z: rise(self.f0.z) }
    }

    #[inline(always)]
    fn layer(&self, schlick: F) -> F {
        (self.layer90 - self.layer0).mul_add(schlick, self.layer0)
    }
}
