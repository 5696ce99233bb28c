//! KHR_materials_diffuse_transmission: Lambertian transmission, as of leaves and paper.

use std::f32::consts::{FRAC_1_PI, PI};

use super::albedo;
use super::lobe::{DirectionSample, Directions, Frames, Lobe, Response, TopProbabilities};
use super::parameters::{Eight, lobe};
use super::schlick::schlick_weight;
use crate::lanes::{F, V3};
use crate::sampling::warp;

lobe! {
    /// Diffuse transmission beneath a dielectric Fresnel layer. It attenuates no lobe beneath it.
    DiffuseTransmission {
        /// Transmission albedo / π, linear RGB.
        diffuse: Vector,
        /// Reflectance of the Fresnel layer at normal incidence.
        layer0: Scalar,
        /// Reflectance of the Fresnel layer at grazing incidence.
        layer90: Scalar,
        /// Microfacet α of the layer, ≥ [`MIN_ALPHA`](super::ggx::MIN_ALPHA).
        alpha: Scalar,
        /// 1: multiple scattering is compensated; 0: it is not. See [`Microfacet`](super::Microfacet).
        compensation: Scalar,
    }
}

impl Lobe for DiffuseTransmission<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.diffuse.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.present()
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        [self.diffuse.luminance() * F::splat(PI), F::ZERO]
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        (self.diffuse.luminance() * F::splat(PI) * self.layer_transmittance(n.dot(wo)), F::ONE)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        // n·h > 0 with `wi` below the surface marks a reflection sample that failed.
        let below =
            d.cos_o.simd_gt(F::ZERO) & d.cos_i.simd_lt(F::ZERO) & d.n.dot(d.h).simd_le(F::ZERO) & self.present();
        let pdf = (d.cos_i.abs() * F::splat(FRAC_1_PI)) & below;
        // The Fresnel layer is evaluated with wi mirrored to the side of wo.
        let mirrored = d.wi - d.n * (F::splat(2.0) * d.cos_i);
        let h = (d.wo + mirrored).normalize_or(d.n);
        let value = self.diffuse * ((d.cos_i.abs() * light * self.transmittance(d.cos_o, d.wo.dot(h))) & below);
        Response { value, pdf, transmittance: light }
    }

    #[inline(always)]
    fn sample_direction(
        &self,
        Frames { t, b, n }: &Frames,
        _: V3,
        [_, u, v]: [F; 3],
        _: &TopProbabilities,
    ) -> DirectionSample {
        let cosine = warp::cosine_hemispheres(u, v);
        DirectionSample { wi: *t * cosine.x + *b * cosine.y - *n * cosine.z, h: V3::ZERO }
    }
}

impl DiffuseTransmission<Eight> {
    /// What the layer transmits: what its albedo leaves, or with no compensation what its Fresnel term at the half vector leaves.
    #[inline(always)]
    fn transmittance(&self, cos_o: F, wo_h: F) -> F {
        let (compensates, single) = (self.compensation.simd_gt(F::ZERO), self.layer_transmittance(wo_h));
        if !compensates.any() {
            return single;
        }
        compensates.select(F::ONE - albedo::ggx(cos_o, self.alpha).layer(self.layer0, self.layer90), single)
    }

    #[inline(always)]
    fn layer_transmittance(&self, cos: F) -> F {
        F::ONE - (self.layer90 - self.layer0).mul_add(schlick_weight(cos), self.layer0)
    }
}
