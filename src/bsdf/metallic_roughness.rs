//! The glTF 2.0 metallic-roughness model (specification, appendix B) with KHR_materials_specular and _ior: a linear
//! mix of a dielectric, whose diffuse base is seen through its Fresnel layer, and a metal. GGX, separable Smith
//! masking-shadowing, Schlick's Fresnel. Single scattering: rough white metal loses energy, as the specification says.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::ggx;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::warp;

/// The material's parameters at one point, textures applied.
#[derive(Debug, Clone, Copy)]
pub struct Surface {
    /// Linear base colour, in [0, 1].
    pub base_color: Vec3,
    /// 0 dielectric to 1 metal.
    pub metallic: f32,
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
    /// KHR_materials_specular strength, in [0, 1].
    pub specular: f32,
    /// KHR_materials_specular colour, ≥ 0.
    pub specular_color: Vec3,
    /// Index of refraction, ≥ 1, or 0 for infinite.
    pub ior: f32,
}

/// The model at one point, ready to be evaluated: what the shading stages keep a vertex.
#[derive(Debug, Clone, Copy)]
pub struct MetallicRoughness {
    /// (1 − metallic) · base colour / π.
    pub diffuse: Vec3,
    /// Fresnel of the mix at normal incidence.
    pub f0: Vec3,
    /// Fresnel of the mix at grazing; linear in Schlick's weight in between.
    pub f90: f32,
    /// Largest channel of the dielectric's Fresnel at normal incidence: what the diffuse base does not get.
    pub layer0: f32,
    /// The same at grazing.
    pub layer90: f32,
    /// Microfacet roughness, ≥ [`ggx::MIN_ALPHA`].
    pub alpha: f32,
}

impl MetallicRoughness {
    /// The model for a surface.
    #[inline]
    pub fn new(s: &Surface) -> Self {
        let m = s.metallic;
        let reflectance = if s.ior == 0.0 { 1.0 } else { ((s.ior - 1.0) / (s.ior + 1.0)).powi(2) };
        let dielectric0 = (reflectance * s.specular_color).min(Vec3::ONE) * s.specular;
        Self {
            diffuse: s.base_color * ((1.0 - m) * FRAC_1_PI),
            f0: dielectric0 * (1.0 - m) + s.base_color * m,
            f90: s.specular * (1.0 - m) + m,
            layer0: dielectric0.max_element(),
            layer90: s.specular,
            alpha: (s.roughness * s.roughness).max(ggx::MIN_ALPHA),
        }
    }

    /// Is there no specular lobe?
    #[inline]
    pub fn is_lambert(&self) -> bool {
        self.f90 <= 0.0 && self.f0.max_element() <= 0.0
    }

    /// Does it scatter at all?
    #[inline]
    pub fn is_black(&self) -> bool {
        self.diffuse.max_element() <= 0.0 && self.f90 <= 0.0 && self.f0.max_element() <= 0.0
    }
}

/// The model at eight points. Directions are in world space, unit; `n` is the shading normal, `wo` points to the eye,
/// `wi` to the light.
#[derive(Debug, Clone, Copy)]
pub struct Lobes {
    /// As in [`MetallicRoughness`], and so on.
    pub diffuse: V3,
    #[allow(missing_docs)]
    pub f0: V3,
    #[allow(missing_docs)]
    pub f90: F,
    #[allow(missing_docs)]
    pub layer0: F,
    #[allow(missing_docs)]
    pub layer90: F,
    #[allow(missing_docs)]
    pub alpha: F,
}

/// Directions drawn from BSDFs.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Unit, world space.
    pub wi: V3,
    /// f · cos θ_i.
    pub value: V3,
    /// Per solid angle; 0 where nothing was drawn (a direction below the surface, nothing to draw from): such a sample
    /// counts, with value zero.
    pub pdf: F,
}

impl Lobes {
    /// Nothing scatters.
    pub const BLACK: Self =
        Self { diffuse: V3::ZERO, f0: V3::ZERO, f90: F::ZERO, layer0: F::ZERO, layer90: F::ZERO, alpha: F::ONE };

    /// A model a lane.
    #[inline(always)]
    pub fn gather(m: [&MetallicRoughness; LANES]) -> Self {
        Self {
            f0: V3::gather(eight(|lane| m[lane].f0)),
            f90: F::from(eight(|lane| m[lane].f90)),
            layer0: F::from(eight(|lane| m[lane].layer0)),
            layer90: F::from(eight(|lane| m[lane].layer90)),
            alpha: F::from(eight(|lane| m[lane].alpha)),
            ..Self::gather_diffuse(m)
        }
    }

    /// The diffuse lobe of a model a lane.
    #[inline(always)]
    pub fn gather_diffuse(m: [&MetallicRoughness; LANES]) -> Self {
        Self { diffuse: V3::gather(eight(|lane| m[lane].diffuse)), ..Self::BLACK }
    }

    /// The same model in every lane.
    pub fn splat(m: &MetallicRoughness) -> Self {
        Self {
            diffuse: V3::splat(m.diffuse),
            f0: V3::splat(m.f0),
            f90: F::splat(m.f90),
            layer0: F::splat(m.layer0),
            layer90: F::splat(m.layer90),
            alpha: F::splat(m.alpha),
        }
    }

    /// f(wo, wi) · cos θ_i, and the density per solid angle with which [`sample`](Self::sample) draws `wi`. Zero unless
    /// both directions are above the surface.
    #[inline(always)]
    pub fn eval_pdf(&self, n: V3, wo: V3, wi: V3) -> (V3, F) {
        self.eval_pdf_half(n, wo, wi, (wo + wi).normalize_or(n))
    }

    #[inline(always)]
    fn eval_pdf_half(&self, n: V3, wo: V3, wi: V3, h: V3) -> (V3, F) {
        let (cos_o, cos_i) = (n.dot(wo), n.dot(wi));
        let above = cos_o.simd_gt(F::ZERO) & cos_i.simd_gt(F::ZERO);
        let cosine_pdf = cos_i * F::splat(FRAC_1_PI);
        if !self.specular().any() {
            // Lambert alone: most of what is out there is worth the branch.
            return (self.diffuse * (cos_i & above), cosine_pdf & above);
        }
        let schlick = schlick_weight(wo.dot(h));
        let alpha2 = self.alpha * self.alpha;
        let cos_h = n.dot(h);
        let d = ggx::distribution(n.cross(h).length_squared(), cos_h * cos_h, alpha2);
        // D G₁(wo)/(4 cos θ_o): the specular pdf, and the specular value but for F and G₁(wi).
        let specular_pdf = ggx::masking(cos_o, alpha2) * d / (F::splat(4.0) * cos_o);
        let fresnel = self.fresnel(schlick);
        let base = (F::ONE - self.layer(schlick)) * cos_i;
        let value = fresnel * (specular_pdf * ggx::masking(cos_i, alpha2)) + self.diffuse * base;
        let p = self.specular_probability(cos_o);
        let pdf = p.mul_add(specular_pdf, (F::ONE - p) * cosine_pdf);
        (V3 { x: value.x & above, y: value.y & above, z: value.z & above }, pdf & above)
    }

    /// Draws `wi` from three numbers in [0, 1).
    #[inline(always)]
    pub fn sample(&self, n: V3, wo: V3, [lobe, u, v]: [F; 3]) -> BsdfSample {
        let (t, b) = warp::frames(n);
        let cosine = warp::cosine_hemispheres(u, v);
        let mut wi = t * cosine.x + b * cosine.y + n * cosine.z;
        let mut h = V3::splat(Vec3::ZERO);
        let specular = lobe.simd_lt(self.specular_probability(n.dot(wo)));
        if specular.any() {
            let local = V3 { x: t.dot(wo), y: b.dot(wo), z: n.dot(wo) };
            let m = ggx::sample_visible_normal(local, self.alpha, u, v);
            // h as drawn, not as rebuilt from wo + wi: exact also for narrow lobes.
            let drawn = t * m.x + b * m.y + n * m.z;
            let mirrored = drawn * (F::splat(2.0) * wo.dot(drawn)) - wo;
            wi = V3::select(specular, mirrored, wi);
            h = drawn;
        }
        h = V3::select(specular, h, (wo + wi).normalize_or(n));
        let (value, pdf) = self.eval_pdf_half(n, wo, wi, h);
        BsdfSample { wi, value, pdf }
    }

    /// Lanes with a specular lobe.
    #[inline(always)]
    fn specular(&self) -> F {
        self.f90.simd_gt(F::ZERO) | self.f0.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn fresnel(&self, schlick: F) -> V3 {
        let rise = |f0: F| (self.f90 - f0).mul_add(schlick, f0);
        V3 { x: rise(self.f0.x), y: rise(self.f0.y), z: rise(self.f0.z) }
    }

    #[inline(always)]
    fn layer(&self, schlick: F) -> F {
        (self.layer90 - self.layer0).mul_add(schlick, self.layer0)
    }

    /// Chance of drawing from the specular lobe: its share of the reflected light, estimated by the Fresnel term at
    /// `wo`'s own angle.
    #[inline(always)]
    fn specular_probability(&self, cos_o: F) -> F {
        let schlick = schlick_weight(cos_o);
        let specular = self.fresnel(schlick).luminance();
        let diffuse = self.diffuse.luminance() * F::splat(PI) * (F::ONE - self.layer(schlick));
        let sum = specular + diffuse;
        let some = sum.simd_gt(F::ZERO);
        // With neither visible at this angle, the one that there is.
        let otherwise = self.specular() & F::ONE;
        some.select(specular / sum, otherwise)
    }
}

/// (1 − cos)⁵.
#[inline(always)]
fn schlick_weight(cos: F) -> F {
    let x = (F::ONE - cos).fast_max(F::ZERO).fast_min(F::ONE);
    let x2 = x * x;
    x2 * x2 * x
}
