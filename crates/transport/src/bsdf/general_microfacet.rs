//! KHR_materials_anisotropy and KHR_materials_iridescence: the surface of a material that is rougher one way than the other,
//! or lies under a thin film. It stands in for both [`Microfacet`](super::Microfacet) and [`Glass`](super::Glass), which know
//! nothing of either and are as fast as ever.

use super::refraction::{self, Facet};
use super::{
    Directions, Draw, Eight, Frames, Lobe, Response, diffuseness, film, ggx, microfacet::schlick_weight,
    parameters::lobe,
};
use crate::lanes::{F, V3};

lobe! {
    /// Specular reflection and transmission over a diffuse base.
    GeneralMicrofacet {
        /// Unit direction along the surface in which it is rougher; zero where it is as rough every way.
        tangent: Vector,
        /// Microfacet roughness along the tangent, ≥ [`ggx::MIN_ALPHA`].
        alpha_t: Scalar,
        /// Across.
        alpha_b: Scalar,
        /// The dielectric's reflectance at normal incidence.
        f0: Vector,
        /// The same at grazing.
        f90: Scalar,
        /// Share of metal, in [0, 1].
        metal: Scalar,
        /// The metal's reflectance at normal incidence; 1 at grazing.
        metal0: Vector,
        /// Share of the dielectric's base that is glass, in [0, 1].
        share: Scalar,
        /// Colour of what is transmitted.
        tint: Vector,
        /// As in [`Glass`](super::Glass).
        eta: Scalar,
        /// As in [`Glass`](super::Glass); 1 where there is no glass.
        thin: Scalar,
        /// How much of the surface lies under the film, in [0, 1].
        film: Scalar,
        /// The film's index of refraction, ≥ 1.
        film_ior: Scalar,
        /// The film's thickness in nanometres.
        thickness: Scalar,
    }
}

impl Lobe for GeneralMicrofacet<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        (self.f90 + self.metal + self.film + self.share).simd_gt(F::ZERO) | self.f0.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.share.simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn diffuseness(&self) -> F {
        diffuseness(self.f0.luminance() + self.metal + self.share, self.alpha_t.fast_min(self.alpha_b))
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let fresnel = self.fresnel(n.dot(wo));
        (fresnel.reflected.luminance() + fresnel.passed * self.tint.luminance(), fresnel.through)
    }

    #[inline(never)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let Facet { h, wo_h, passes, jacobian } = refraction::facet(d, self.eta, self.thin.simd_gt(F::ZERO));
        let (local, alphas) = (self.local(d.n), self.alphas());
        let density = ggx::distribution_along(local.of(h), alphas);
        let drawn = ggx::masking_along(local.of(d.wo), alphas) * density * jacobian / d.cos_o;

        let fresnel = self.fresnel(wo_h);
        let p = self.chance_of_reflection(&fresnel);
        let seen = d.above | (passes & self.transmits());
        let pdf = (drawn * d.above.select(p, F::ONE - p)) & seen;
        let color = V3::select(d.above, fresnel.reflected, self.tint * fresnel.passed);
        let value = color * ((drawn * ggx::masking_along(local.of(d.wi), alphas) * light) & seen);
        Response { value, pdf, through: light * fresnel.through }
    }

    #[inline(never)]
    fn draw(&self, Frames { n, .. }: &Frames, wo: V3, [lobe, u, v]: [F; 3]) -> Draw {
        let local = self.local(*n);
        let m = ggx::sample_visible_normal(local.of(wo), self.alphas(), u, v);
        let h = local.t * m.x + local.b * m.y + *n * m.z;
        let reflects = lobe.simd_lt(self.chance_of_reflection(&self.fresnel(wo.dot(h))));
        refraction::follow(*n, wo, h, self.eta, self.thin.simd_gt(F::ZERO), reflects)
    }
}

/// Tangent, bitangent and normal.
struct Local {
    t: V3,
    b: V3,
    n: V3,
}

impl Local {
    #[inline(always)]
    fn of(&self, v: V3) -> V3 {
        V3 { x: self.t.dot(v), y: self.b.dot(v), z: self.n.dot(v) }
    }
}

/// What becomes of light at a microfacet.
struct Fresnel {
    reflected: V3,
    /// Through the glass.
    passed: F,
    /// To the dielectric's base.
    through: F,
}

impl GeneralMicrofacet<Eight> {
    #[inline(always)]
    fn alphas(&self) -> [F; 2] {
        [self.alpha_t, self.alpha_b]
    }

    #[inline(always)]
    fn local(&self, n: V3) -> Local {
        let t = (self.tangent - n * n.dot(self.tangent)).normalize_or(crate::sampling::warp::frames(n).0);
        Local { t, b: n.cross(t), n }
    }

    /// At cosine `cos` between `wo` and a microfacet's normal: Schlick's term, the exact one where something is transmitted,
    /// and the film's where there is one.
    #[inline(always)]
    fn fresnel(&self, cos: F) -> Fresnel {
        let cos = cos.fast_max(F::ZERO).fast_min(F::ONE);
        let (one, transmits) = (V3 { x: F::ONE, y: F::ONE, z: F::ONE }, self.transmits());
        let (exact, total) = refraction::rise(cos, self.eta);
        let (schlick, total) = (schlick_weight(cos), total & transmits);
        let rise = transmits.select(exact, schlick);
        let mut dielectric = self.f0 + (one * self.f90 - self.f0) * rise;
        let mut metal = self.metal0 + (one - self.metal0) * schlick;
        if self.film.simd_gt(F::ZERO).any() {
            // The film is outside: seen from within a body, where light leaves it.
            let sin2 = (F::ONE - cos * cos) / (self.eta * self.eta);
            let leaving = (F::ONE - sin2).fast_max(F::ZERO).sqrt();
            let outside = self.eta.simd_lt(F::ONE).select(leaving, cos);
            let under = |base: V3| film::reflectance(outside, base, self.film_ior, self.thickness);
            let mixed = |plain: V3, film: V3| plain + (film - plain) * self.film;
            if self.metal.simd_lt(F::ONE).any() {
                let scale = self.f90.simd_gt(F::ZERO).select(F::ONE / self.f90, F::ZERO);
                dielectric = mixed(dielectric, under(self.f0 * scale) * self.f90);
            }
            if self.metal.simd_gt(F::ZERO).any() {
                metal = mixed(metal, under(self.metal0));
            }
        }
        let dielectric = V3::select(total, one, dielectric);
        let through = F::ONE - dielectric.max_element();
        let rest = F::ONE - self.metal;
        Fresnel { reflected: dielectric * rest + metal * self.metal, passed: through * rest * self.share, through }
    }

    #[inline(always)]
    fn chance_of_reflection(&self, fresnel: &Fresnel) -> F {
        let reflected = fresnel.reflected.luminance();
        let sum = reflected + fresnel.passed * self.tint.luminance();
        sum.simd_gt(F::ZERO).select(reflected / sum, F::ONE)
    }
}
