//! KHR_materials_anisotropy and KHR_materials_iridescence: microfacet reflection and refraction with anisotropic roughness
//! or a thin film. It replaces both [`Microfacet`](super::Microfacet) and [`Glass`](super::Glass) on materials that have one
//! of the extensions, so that the two stay simple and fast.

use super::lobe::{DirectionSample, Directions, Frames, Lobe, Response, Straight, TopProbabilities, albedos};
use super::parameters::{Eight, lobe};
use super::refraction::{self, Facet, Fresnel};
use super::schlick::schlick_weight;
use super::{albedo, ggx, thin_film};
use crate::lanes::{F, V3};
use crate::sampling::warp;

lobe! {
    /// Anisotropic GGX reflection and transmission, with or without a thin film, over a diffuse base.
    GeneralMicrofacet {
        /// Unit direction of the higher roughness in world space; zero where roughness is isotropic.
        tangent: Vector,
        /// Microfacet α along the tangent, ≥ [`ggx::MIN_ALPHA`].
        alpha_t: Scalar,
        /// Microfacet α along the bitangent, ≥ [`ggx::MIN_ALPHA`].
        alpha_b: Scalar,
        /// Reflectance of the dielectric at normal incidence.
        f0: Vector,
        /// Reflectance of the dielectric at grazing incidence.
        f90: Scalar,
        /// Metalness, in [0, 1].
        metallic: Scalar,
        /// Reflectance of the metal at normal incidence; at grazing incidence it is 1.
        metallic_f0: Vector,
        /// Fraction of the dielectric's base that transmits specularly, in [0, 1].
        transmission: Scalar,
        /// Linear RGB tint of transmitted light.
        tint: Vector,
        /// Relative index of refraction, see [`Glass::eta`](super::Glass::eta).
        eta: Scalar,
        /// 1 for a thin wall and where nothing is transmitted, 0 for a medium boundary.
        thin: Scalar,
        /// Strength of the film, in [0, 1].
        iridescence: Scalar,
        /// The film's index of refraction, ≥ 1.
        film_ior: Scalar,
        /// The film's thickness in nanometres.
        film_thickness: Scalar,
        /// 1: multiple scattering is compensated; 0: it is not. See [`Microfacet`](super::Microfacet).
        compensation: Scalar,
    }
}

impl Lobe for GeneralMicrofacet<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        (self.f90 + self.metallic + self.iridescence + self.transmission).simd_gt(F::ZERO)
            | self.f0.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.is_glass() & !self.is_straight()
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        albedos(self.f0.luminance() + self.metallic + self.transmission, self.alpha_t.fast_min(self.alpha_b))
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let (fresnel, transmittance) = self.scattering(n.dot(wo));
        (fresnel.luminance(self.tint), transmittance)
    }

    #[inline(never)]
    fn straight(&self, n: V3, wo: V3, light: F, bodies: bool) -> Straight {
        let passes = if bodies { self.is_glass() & self.is_smooth() } else { self.is_straight() };
        let outside = Self { eta: self.eta.fast_max(F::ONE / self.eta), ..*self };
        let weight = self.tint * ((outside.fresnel(n.dot(wo)).0.transmitted * light) & passes);
        Straight { weight, transmittance: light * self.fresnel(n.dot(wo)).1 }
    }

    #[inline(never)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let thin = self.thin.simd_gt(F::ZERO);
        let Facet { h, wo_h, transmits, jacobian } = refraction::facet(d, self.eta, thin);
        let (frame, alphas) = (self.frame(d.n), self.alphas());
        let density = ggx::distribution_along(frame.to_local(h), alphas);
        let masking = ggx::masking_along(frame.to_local(d.wo), alphas);
        let drawn = masking * density * jacobian / d.cos_o;

        let (fresnel, transmittance) = self.scattering(wo_h);
        let p = fresnel.reflection_probability(self.tint);
        let is_rough = self.alpha_t.fast_min(self.alpha_b).simd_ge(d.min_alpha);
        let visible = (d.above & is_rough) | (transmits & self.transmits());
        let pdf = (drawn * d.above.select(p, F::ONE - p)) & visible;
        let color = V3::select(d.above, fresnel.reflected, self.tint * fresnel.transmitted);
        let shadowing = ggx::shadowing(masking, ggx::masking_along(frame.to_local(d.wi), alphas));
        let value = color * ((drawn * shadowing * light) & visible);
        if !self.compensation.simd_gt(F::ZERO).any() {
            return Response { value, pdf, transmittance: light * transmittance };
        }
        let (gain, compensated) = self.compensation(d.cos_o, thin);
        let transmittance = self.compensation.simd_gt(F::ZERO).select(compensated, transmittance);
        Response { value: value * gain, pdf, transmittance: light * transmittance }
    }

    #[inline(never)]
    fn sample_direction(
        &self,
        Frames { n, .. }: &Frames,
        wo: V3,
        [lobe, u, v]: [F; 3],
        _: &TopProbabilities,
    ) -> DirectionSample {
        let frame = self.frame(*n);
        let h = frame.to_world(ggx::sample_visible_normal(frame.to_local(wo), self.alphas(), u, v));
        let reflects = lobe.simd_lt(self.scattering(wo.dot(h)).0.reflection_probability(self.tint));
        refraction::reflect_or_refract(*n, wo, h, self.eta, self.thin.simd_gt(F::ZERO), reflects)
    }
}

impl GeneralMicrofacet<Eight> {
    #[inline(always)]
    fn alphas(&self) -> [F; 2] {
        [self.alpha_t, self.alpha_b]
    }

    /// Frames with the tangent, projected onto the surface.
    #[inline(always)]
    fn frame(&self, n: V3) -> Frames {
        let t = (self.tangent - n * n.dot(self.tangent)).normalize_or(warp::frames(n).0);
        Frames { t, b: n.cross(t), n }
    }

    /// The Fresnel terms at cosine `cos` between `wo` and the microfacet normal: exact for dielectrics that transmit, else
    /// Schlick's approximation; modified by the film where there is one. Also the fraction that reaches the dielectric's diffuse
    /// base.
    #[inline(always)]
    fn fresnel(&self, cos: F) -> (Fresnel, F) {
        let cos = cos.fast_max(F::ZERO).fast_min(F::ONE);
        let (one, transmits) = (V3 { x: F::ONE, y: F::ONE, z: F::ONE }, self.is_glass());
        let (exact, total) = refraction::fresnel_rise(cos, self.eta);
        let (schlick, total) = (schlick_weight(cos), total & transmits);
        let fresnel_rise = transmits.select(exact, schlick);
        let mut dielectric = self.f0 + (one * self.f90 - self.f0) * fresnel_rise;
        let mut metallic = self.metallic_f0 + (one - self.metallic_f0) * schlick;
        if self.iridescence.simd_gt(F::ZERO).any() {
            // The film lies on the outside: from within the medium, the cosine is that of the refracted direction.
            let sin2 = (F::ONE - cos * cos) / (self.eta * self.eta);
            let leaving = (F::ONE - sin2).fast_max(F::ZERO).sqrt();
            let outside = self.eta.simd_lt(F::ONE).select(leaving, cos);
            let under = |base: V3| thin_film::reflectance(outside, base, self.film_ior, self.film_thickness);
            let mixed = |plain: V3, film: V3| plain + (film - plain) * self.iridescence;
            if self.metallic.simd_lt(F::ONE).any() {
                let scale = self.f90.simd_gt(F::ZERO).select(F::ONE / self.f90, F::ZERO);
                dielectric = mixed(dielectric, under(self.f0 * scale) * self.f90);
            }
            if self.metallic.simd_gt(F::ZERO).any() {
                metallic = mixed(metallic, under(self.metallic_f0));
            }
        }
        let dielectric = V3::select(total, one, dielectric);
        let transmittance = F::ONE - dielectric.max_element();
        let rest = F::ONE - self.metallic;
        let reflected = dielectric * rest + metallic * self.metallic;
        (Fresnel { reflected, transmitted: transmittance * rest * self.transmission }, transmittance)
    }

    /// The Fresnel terms less the light that goes straight on.
    #[inline(always)]
    fn scattering(&self, cos: F) -> (Fresnel, F) {
        let (fresnel, transmittance) = self.fresnel(cos);
        (fresnel.without(self.is_straight()), transmittance)
    }

    /// Mask of the surfaces that transmit, straight on or not.
    #[inline(always)]
    fn is_glass(&self) -> F {
        self.transmission.simd_gt(F::ZERO)
    }

    /// Mask of the thin walls that are smooth.
    #[inline(always)]
    fn is_straight(&self) -> F {
        self.thin.simd_gt(F::ZERO) & self.is_glass() & self.is_smooth()
    }

    #[inline(always)]
    fn is_smooth(&self) -> F {
        ggx::is_smooth(self.alpha_t.fast_max(self.alpha_b))
    }

    /// The factor of the value that compensates multiple scattering, and the transmittance to the dielectric's base. The albedo is
    /// that of the mean of the two roughnesses: for strongly anisotropic surfaces it is 0.07 too low at most, and up to 0.4 too high.
    fn compensation(&self, cos_o: F, thin: F) -> (V3, F) {
        let alpha = F::splat(0.5) * (self.alpha_t + self.alpha_b);
        let albedo = albedo::ggx(cos_o, alpha);
        let transmits = self.is_glass();
        let boundary = if transmits.any() { albedo::boundary_loss(cos_o, alpha, self.eta, thin) } else { F::ZERO };
        let rest = F::ONE - self.metallic;
        let dielectric = albedo::mean_fresnel(self.f0, self.f90);
        let glass = self.tint * ((F::ONE - dielectric.max_element()) * self.transmission);
        let color = (dielectric + glass) * rest + albedo::mean_fresnel(self.metallic_f0, F::ONE) * self.metallic;
        let gain = albedo::gain(color, transmits.select(boundary, albedo.loss()), self.compensation);
        (gain, F::ONE - albedo.layer(self.f0.max_element(), self.f90))
    }
}
