//! KHR_materials_clearcoat: a dielectric coat over all other layers, with its own normal and roughness.
//!
//! The Fresnel term is Schlick's approximation for index 1.5 at the coat's normal, as the extension specifies; it also
//! attenuates the layers beneath. A smooth coat therefore conserves energy.

use super::lobe::{DirectionSample, Directions, Frames, Lobe, Response, TopProbabilities, albedos};
use super::parameters::{Eight, lobe};
use super::schlick::schlick_weight;
use super::{albedo, ggx};
use crate::lanes::{F, V3};

lobe! {
    /// GGX reflection of the coat.
    Clearcoat {
        /// Strength of the coat, in [0, 1].
        coat: Scalar,
        /// Unit normal of the coat in world space; zero for the shading normal.
        normal: Vector,
        /// Microfacet α, ≥ [`ggx::MIN_ALPHA`].
        alpha: Scalar,
        /// 1: multiple scattering is compensated; 0: it is not. See [`Microfacet`](super::Microfacet).
        compensation: Scalar,
    }
}

/// Reflectance of index 1.5 at normal incidence.
const F0: f32 = 0.04;
/// Lowest cosine between `wo` and the coat's normal.
const MIN_COS: f32 = 1e-3;

impl Lobe for Clearcoat<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.coat.simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn albedos(&self) -> [F; 2] {
        albedos(self.coat * F::splat(0.04), self.alpha)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let reflectance = self.reflectance(self.coat_normal(n, wo).dot(wo));
        (reflectance, F::ONE - reflectance)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let n = self.coat_normal(d.n, d.wo);
        let (cos_o, cos_i, cos_h) = (n.dot(d.wo), n.dot(d.wi), n.dot(d.h));
        let alpha2 = self.alpha * self.alpha;
        let density = ggx::distribution(n.cross(d.h).length_squared(), cos_h * cos_h, alpha2);
        let visible = d.above & cos_i.simd_gt(F::ZERO) & self.alpha.simd_ge(d.min_alpha);
        let masking = ggx::masking(cos_o, alpha2);
        let pdf = (masking * density / (F::splat(4.0) * cos_o)) & visible;
        let reflectance = self.reflectance(cos_o);
        // The Fresnel term does not depend on the microfacet, so all that is lost is compensated.
        let gain = albedo::ggx(cos_o, self.alpha).loss().mul_add(self.compensation, F::ONE);
        let shadowing = ggx::shadowing(masking, ggx::masking(cos_i, alpha2));
        let value = (pdf * shadowing * gain * reflectance * light) & visible;
        Response { value: V3 { x: value, y: value, z: value }, pdf, transmittance: light * (F::ONE - reflectance) }
    }

    #[inline(always)]
    fn sample_direction(&self, frames: &Frames, wo: V3, [_, u, v]: [F; 3], _: &TopProbabilities) -> DirectionSample {
        let coat = Frames::new(self.coat_normal(frames.n, wo));
        let h = coat.to_world(ggx::sample_visible_normal(coat.to_local(wo), [self.alpha; 2], u, v));
        let wi = h * (F::splat(2.0) * wo.dot(h)) - wo;
        // Sampling fails below the coat's or the surface's horizon.
        let above = frames.n.dot(wi).simd_gt(F::ZERO) & coat.n.dot(wi).simd_gt(F::ZERO);
        DirectionSample { wi: V3::select(above, wi, V3::ZERO), h }
    }
}

impl Clearcoat<Eight> {
    /// The coat's normal, tilted toward `wo` until n·wo ≥ [`MIN_COS`].
    #[inline(always)]
    fn coat_normal(&self, n: V3, wo: V3) -> V3 {
        let normal = V3::select(self.normal.length_squared().simd_gt(F::ZERO), self.normal, n);
        let cos = normal.dot(wo);
        let min_cos = F::splat(MIN_COS);
        V3::select(cos.simd_lt(min_cos), (normal + wo * (min_cos - cos)).normalize_or(n), normal)
    }

    /// Reflectance at cosine `cos` between the coat's normal and `wo`.
    #[inline(always)]
    fn reflectance(&self, cos: F) -> F {
        self.coat * F::splat(1.0 - F0).mul_add(schlick_weight(cos), F::splat(F0))
    }
}
