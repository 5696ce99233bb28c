//! KHR_materials_diffuse_transmission: light that leaves the other side as bright in every direction; leaves, paper.

use std::f32::consts::{FRAC_1_PI, PI};

use super::{Directions, Draw, Eight, Frames, Lobe, Response, microfacet::schlick_weight, parameters::lobe};
use crate::lanes::{F, V3};
use crate::sampling::warp;

lobe! {
    /// Diffuse transmission beneath a dielectric's Fresnel layer, beside the lobes that reflect.
    DiffuseTransmission {
        /// Share of the light that is transmitted, / π.
        diffuse: Vector,
        /// What the layer keeps, at normal incidence.
        layer0: Scalar,
        /// The same at grazing.
        layer90: Scalar,
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
    fn diffuseness(&self) -> F {
        self.diffuse.luminance() * F::splat(PI)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        (self.diffuse.luminance() * F::splat(PI) * self.below_layer(n.dot(wo)), F::ONE)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        // A half vector that points out, with `wi` below, is a reflection's that failed.
        let below =
            d.cos_o.simd_gt(F::ZERO) & d.cos_i.simd_lt(F::ZERO) & d.n.dot(d.h).simd_le(F::ZERO) & self.present();
        let pdf = (d.cos_i.abs() * F::splat(FRAC_1_PI)) & below;
        // The layer sees the light as if it came from the eye's side.
        let mirrored = d.wi - d.n * (F::splat(2.0) * d.cos_i);
        let h = (d.wo + mirrored).normalize_or(d.n);
        let value = self.diffuse * ((d.cos_i.abs() * light * self.below_layer(d.wo.dot(h))) & below);
        Response { value, pdf, through: light }
    }

    #[inline(always)]
    fn draw(&self, Frames { t, b, n }: &Frames, _: V3, [_, u, v]: [F; 3]) -> Draw {
        let cosine = warp::cosine_hemispheres(u, v);
        Draw { wi: *t * cosine.x + *b * cosine.y - *n * cosine.z, h: V3::ZERO }
    }
}

impl DiffuseTransmission<Eight> {
    #[inline(always)]
    fn below_layer(&self, cos: F) -> F {
        F::ONE - (self.layer90 - self.layer0).mul_add(schlick_weight(cos), self.layer0)
    }
}
