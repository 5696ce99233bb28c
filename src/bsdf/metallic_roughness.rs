//! The glTF 2.0 metallic-roughness model (specification, appendix B) with KHR_materials_specular and _ior: a linear
//! mix of a dielectric, whose diffuse base is seen through its Fresnel layer, and a metal.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::{Bsdf, Lambert, Layered, Microfacet, ggx};

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

impl Surface {
    /// The model with these parameters.
    #[inline]
    pub fn bsdf(&self) -> Bsdf {
        let m = self.metallic;
        let reflectance = if self.ior == 0.0 { 1.0 } else { ((self.ior - 1.0) / (self.ior + 1.0)).powi(2) };
        let dielectric0 = (reflectance * self.specular_color).min(Vec3::ONE) * self.specular;
        Layered {
            top: Microfacet {
                f0: dielectric0 * (1.0 - m) + self.base_color * m,
                f90: self.specular * (1.0 - m) + m,
                layer0: dielectric0.max_element(),
                layer90: self.specular,
                alpha: (self.roughness * self.roughness).max(ggx::MIN_ALPHA),
            },
            base: Lambert { diffuse: self.base_color * ((1.0 - m) * FRAC_1_PI) },
        }
    }
}
