//! The glTF 2.0 metallic-roughness model (specification, appendix B) with KHR_materials_specular and _ior: a linear
//! mix of a dielectric, whose diffuse base is seen through its Fresnel layer, and a metal. GGX, separable Smith
//! masking-shadowing, Schlick's Fresnel. Single scattering: rough white metal loses energy, as the specification says.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::ggx;
use crate::color::luminance;
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

/// The model at one point.
#[derive(Debug, Clone, Copy)]
pub struct MetallicRoughness {
    /// (1 − metallic) · base colour / π.
    diffuse: Vec3,
    /// Fresnel of the mix at normal incidence and at grazing: both linear in Schlick's weight.
    f0: Vec3,
    f90: f32,
    /// Largest channel of the dielectric's Fresnel at the two ends: what the diffuse base does not get.
    layer0: f32,
    layer90: f32,
    alpha: f32,
    /// Has it a specular lobe, a diffuse one?
    lobes: Lobes,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lobes {
    Diffuse,
    Specular,
    Both,
    Neither,
}

/// A direction drawn from a BSDF.
#[derive(Debug, Clone, Copy)]
pub struct BsdfSample {
    /// Unit, local, wi.z > 0.
    pub wi: Vec3,
    /// f · cos θ_i.
    pub value: Vec3,
    /// Per solid angle, > 0.
    pub pdf: f32,
}

impl MetallicRoughness {
    /// The model for a surface.
    #[inline]
    pub fn new(s: &Surface) -> Self {
        let m = s.metallic;
        let reflectance = if s.ior == 0.0 { 1.0 } else { ((s.ior - 1.0) / (s.ior + 1.0)).powi(2) };
        let dielectric0 = (reflectance * s.specular_color).min(Vec3::ONE) * s.specular;
        let alpha = (s.roughness * s.roughness).max(ggx::MIN_ALPHA);
        let diffuse = s.base_color * ((1.0 - m) * FRAC_1_PI);
        let f0 = dielectric0 * (1.0 - m) + s.base_color * m;
        let f90 = s.specular * (1.0 - m) + m;
        let lobes = match (diffuse.max_element() > 0.0, f90 > 0.0 || f0.max_element() > 0.0) {
            (true, true) => Lobes::Both,
            (true, false) => Lobes::Diffuse,
            (false, true) => Lobes::Specular,
            (false, false) => Lobes::Neither,
        };
        Self { diffuse, f0, f90, layer0: dielectric0.max_element(), layer90: s.specular, alpha, lobes }
    }

    /// Does it scatter at all?
    #[inline]
    pub fn is_black(&self) -> bool {
        self.lobes == Lobes::Neither
    }

    /// f(wo, wi) · cos θ_i, and the density per solid angle with which [`sample`](Self::sample) draws `wi`. Zero unless
    /// both directions are above the surface.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let cosine_pdf = wi.z * FRAC_1_PI;
        if self.lobes == Lobes::Diffuse {
            return (self.diffuse * wi.z, cosine_pdf);
        }
        let h = (wo + wi).normalize_or(Vec3::Z);
        self.eval_pdf_half(wo, wi, h, cosine_pdf)
    }

    #[inline]
    fn eval_pdf_half(&self, wo: Vec3, wi: Vec3, h: Vec3, cosine_pdf: f32) -> (Vec3, f32) {
        let schlick = schlick_weight(wo.dot(h));
        let alpha2 = self.alpha * self.alpha;
        let masking_o = ggx::masking(wo, alpha2);
        // D G₁(wo)/(4 cos θ_o): the specular pdf, and the specular value but for F and G₁(wi).
        let specular_pdf = masking_o * ggx::distribution(h, alpha2) / (4.0 * wo.z);
        let fresnel = self.f0 + (Vec3::splat(self.f90) - self.f0) * schlick;
        let layer = self.layer0 + (self.layer90 - self.layer0) * schlick;
        let value = fresnel * (specular_pdf * ggx::masking(wi, alpha2)) + self.diffuse * ((1.0 - layer) * wi.z);
        let p = self.specular_probability(wo);
        (value, p * specular_pdf + (1.0 - p) * cosine_pdf)
    }

    /// Draws `wi` from three numbers in [0, 1); `None` when the direction falls below the surface or there is nothing
    /// to draw from (then the sample counts with value zero).
    #[inline]
    pub fn sample(&self, wo: Vec3, lobe: f32, u: f32, v: f32) -> Option<BsdfSample> {
        if wo.z <= 0.0 || self.lobes == Lobes::Neither {
            return None;
        }
        let p = self.specular_probability(wo);
        if lobe < p {
            let h = ggx::sample_visible_normal(wo, self.alpha, u, v);
            let wi = 2.0 * wo.dot(h) * h - wo;
            if wi.z <= 0.0 {
                return None;
            }
            // h as drawn, not as rebuilt from wo + wi: exact also for narrow lobes.
            let (value, pdf) = self.eval_pdf_half(wo, wi, h, wi.z * FRAC_1_PI);
            (pdf > 0.0).then_some(BsdfSample { wi, value, pdf })
        } else {
            let wi = warp::cosine_hemisphere(u, v);
            let (value, pdf) = self.eval_pdf(wo, wi);
            (pdf > 0.0).then_some(BsdfSample { wi, value, pdf })
        }
    }

    /// Chance of drawing from the specular lobe: its share of the reflected light, estimated by the Fresnel term at
    /// `wo`'s own angle.
    #[inline]
    fn specular_probability(&self, wo: Vec3) -> f32 {
        match self.lobes {
            Lobes::Diffuse | Lobes::Neither => 0.0,
            Lobes::Specular => 1.0,
            Lobes::Both => {
                let schlick = schlick_weight(wo.z);
                let specular = luminance(self.f0 + (Vec3::splat(self.f90) - self.f0) * schlick);
                let layer = self.layer0 + (self.layer90 - self.layer0) * schlick;
                let diffuse = luminance(self.diffuse) * PI * (1.0 - layer);
                let sum = specular + diffuse;
                if sum > 0.0 { specular / sum } else { 0.5 }
            }
        }
    }
}

/// (1 − cos)⁵.
#[inline]
fn schlick_weight(cos: f32) -> f32 {
    let x = (1.0 - cos).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}
