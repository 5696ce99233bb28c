//! KHR_materials_clearcoat: a clear layer over all others, with a normal and a roughness of its own. Its Fresnel term is
//! Schlick's of index 1.5 at the coat's normal, as the extension has it, so that it takes from the layers beneath exactly
//! what it reflects where it is smooth.

use super::{
    Directions, Draw, Eight, Frames, Lobe, Response, diffuseness, ggx, microfacet::schlick_weight, parameters::lobe,
};
use crate::lanes::{F, V3};
use crate::sampling::warp;

lobe! {
    /// A coat of varnish.
    Clearcoat {
        /// How much of it there is, in [0, 1].
        coat: Scalar,
        /// Its unit normal; zero for the shading normal.
        normal: Vector,
        /// Microfacet roughness, ≥ [`ggx::MIN_ALPHA`].
        alpha: Scalar,
    }
}

/// Reflectance of index 1.5 at normal incidence.
const F0: f32 = 0.04;
/// Lowest cosine between eye and coat's normal.
const MIN_COS: f32 = 1e-3;

impl Lobe for Clearcoat<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.coat.simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn diffuseness(&self) -> F {
        diffuseness(self.coat * F::splat(0.04), self.alpha)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let reflected = self.reflected(self.facing(n, wo).dot(wo));
        (reflected, F::ONE - reflected)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let n = self.facing(d.n, d.wo);
        let (cos_o, cos_i, cos_h) = (n.dot(d.wo), n.dot(d.wi), n.dot(d.h));
        let alpha2 = self.alpha * self.alpha;
        let density = ggx::distribution(n.cross(d.h).length_squared(), cos_h * cos_h, alpha2);
        let seen = d.above & cos_i.simd_gt(F::ZERO);
        let pdf = (ggx::masking(cos_o, alpha2) * density / (F::splat(4.0) * cos_o)) & seen;
        let reflected = self.reflected(cos_o);
        let value = (pdf * ggx::masking(cos_i, alpha2) * reflected * light) & seen;
        Response { value: V3 { x: value, y: value, z: value }, pdf, through: light * (F::ONE - reflected) }
    }

    #[inline(always)]
    fn draw(&self, frames: &Frames, wo: V3, [_, u, v]: [F; 3]) -> Draw {
        let n = self.facing(frames.n, wo);
        let (t, b) = warp::frames(n);
        let m = ggx::sample_visible_normal(V3 { x: t.dot(wo), y: b.dot(wo), z: n.dot(wo) }, [self.alpha; 2], u, v);
        let h = t * m.x + b * m.y + n * m.z;
        let wi = h * (F::splat(2.0) * wo.dot(h)) - wo;
        // Below the coat or the surface, nothing is drawn.
        let above = frames.n.dot(wi).simd_gt(F::ZERO) & n.dot(wi).simd_gt(F::ZERO);
        Draw { wi: V3::select(above, wi, V3::ZERO), h }
    }
}

impl Clearcoat<Eight> {
    /// The coat's normal, the eye just above its horizon at least.
    #[inline(always)]
    fn facing(&self, n: V3, wo: V3) -> V3 {
        let own = V3::select(self.normal.length_squared().simd_gt(F::ZERO), self.normal, n);
        let cos = own.dot(wo);
        let low = F::splat(MIN_COS);
        V3::select(cos.simd_lt(low), (own + wo * (low - cos)).normalize_or(n), own)
    }

    /// What it reflects at cosine `cos` between its normal and the eye, at most.
    #[inline(always)]
    fn reflected(&self, cos: F) -> F {
        self.coat * F::splat(1.0 - F0).mul_add(schlick_weight(cos), F::splat(F0))
    }
}
