//! Lambertian reflection.

use std::f32::consts::{FRAC_1_PI, PI};

use super::lobe::{Directions, Lobe, Response};
use super::parameters::{Eight, lobe};
use crate::lanes::{F, V3};

lobe! {
    /// Lambertian reflection.
    Lambert {
        /// Albedo / π, linear RGB.
        diffuse: Vector,
    }
}

impl Lobe for Lambert<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.diffuse.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        [self.diffuse.luminance() * F::splat(PI), F::ZERO]
    }

    #[inline(always)]
    fn weight(&self, _: V3, _: V3) -> (F, F) {
        (self.diffuse.luminance() * F::splat(PI), F::ZERO)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let value = self.diffuse * ((light * d.cos_i) & d.above);
        Response { value, pdf: (d.cos_i * F::splat(FRAC_1_PI)) & d.above, transmittance: F::ZERO }
    }
}
