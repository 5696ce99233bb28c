//! The glTF 2.0 metallic-roughness model (appendix B) with KHR_materials_specular, _ior, _transmission, _volume,
//! _diffuse_transmission, _sheen, _clearcoat, _anisotropy and _iridescence.
//!
//! The surface is a linear mix of a metal and a dielectric. The dielectric's base, under its Fresnel layer, is a mix of a
//! diffuse base, which reflects and transmits, and of glass. KHR_materials_pbrSpecularGlossiness uses the same lobes.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::clearcoat::Clearcoat;
use super::diffuse_transmission::DiffuseTransmission;
use super::general_microfacet::GeneralMicrofacet;
use super::ggx;
use super::glass::{Glass, MIN_BEND};
use super::lambert::Lambert;
use super::layered::Layered;
use super::microfacet::Microfacet;
use super::model::{BelowGeneralMicrofacet, BelowGlass, Bsdf, Core};
use super::parameters::One;
use super::sheen::{MIN_ROUGHNESS, Sheen};

/// Material parameters at one point, textures applied. Colours are linear RGB.
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
    /// KHR_materials_pbrSpecularGlossiness: reflectance at normal incidence. `base_color` is then the diffuse colour and
    /// `roughness` is 1 − glossiness; `metallic`, `specular` and `ior` are ignored.
    pub specular_glossiness: Option<Vec3>,
    /// KHR_materials_transmission: fraction of the dielectric that is glass, in [0, 1].
    pub transmission: f32,
    /// KHR_materials_diffuse_transmission: fraction of the diffuse base that transmits, in [0, 1].
    pub diffuse_transmission: f32,
    /// KHR_materials_diffuse_transmission colour, in [0, 1].
    pub diffuse_transmission_color: Vec3,
    /// Does the surface bound a medium (KHR_materials_volume)? Else it is a thin wall.
    pub bounds_medium: bool,
    /// Is the surface seen from its back? Then `wo` is inside the medium.
    pub back_facing: bool,
    /// KHR_materials_sheen: colour, in [0, 1].
    pub sheen_color: Vec3,
    /// Perceptual roughness of the sheen in [0, 1].
    pub sheen_roughness: f32,
    /// KHR_materials_clearcoat: strength, in [0, 1].
    pub clearcoat: f32,
    /// Perceptual roughness of the coat in [0, 1].
    pub clearcoat_roughness: f32,
    /// Unit normal of the coat on the side of `wo`, in world space; zero for the shading normal.
    pub clearcoat_normal: Vec3,
    /// KHR_materials_anisotropy, if the material uses it.
    pub anisotropy: Option<Anisotropy>,
    /// KHR_materials_iridescence, if the material uses it.
    pub iridescence: Option<Iridescence>,
    /// Compensate the energy that single scattering loses between microfacets? Else the letter of glTF's appendix B.
    pub energy_compensation: bool,
}

/// KHR_materials_anisotropy: roughness that depends on the direction.
#[derive(Debug, Clone, Copy)]
pub struct Anisotropy {
    /// Strength, in [0, 1].
    pub strength: f32,
    /// Unit direction of the higher roughness in world space; zero if there are no tangents: roughness is then isotropic.
    pub tangent: Vec3,
}

/// KHR_materials_iridescence: a thin film.
#[derive(Debug, Clone, Copy)]
pub struct Iridescence {
    /// Strength, in [0, 1].
    pub factor: f32,
    /// Index of refraction of the film, ≥ 1.
    pub ior: f32,
    /// Thickness of the film in nanometres, ≥ 0.
    pub thickness: f32,
}

impl Default for Surface {
    /// The default material of glTF, but dielectric: white, fully rough, of index 1.5.
    #[inline(always)]
    fn default() -> Self {
        Self {
            base_color: Vec3::ONE,
            metallic: 0.0,
            roughness: 1.0,
            specular: 1.0,
            specular_color: Vec3::ONE,
            ior: 1.5,
            specular_glossiness: None,
            transmission: 0.0,
            diffuse_transmission: 0.0,
            diffuse_transmission_color: Vec3::ONE,
            bounds_medium: false,
            back_facing: false,
            sheen_color: Vec3::ZERO,
            sheen_roughness: 0.0,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal: Vec3::ZERO,
            anisotropy: None,
            iridescence: None,
            energy_compensation: true,
        }
    }
}

impl Surface {
    /// The BSDF with these parameters.
    #[inline]
    pub fn bsdf(&self) -> Bsdf {
        // Absent lobes keep parameters that compute to finite values, because other lanes may have the lobe.
        let coat = Clearcoat {
            coat: self.clearcoat,
            normal: self.clearcoat_normal,
            alpha: alpha(self.clearcoat_roughness),
            compensation: self.compensation(),
        };
        let sheen = Sheen { color: self.sheen_color, roughness: self.sheen_roughness.max(MIN_ROUGHNESS) };
        let general = (self.anisotropy.is_some() || self.iridescence.is_some()) && self.specular_glossiness.is_none();
        let (glass, reflection) = if general { self.general() } else { self.isotropic() };
        Layered { top: coat, base: Layered { top: sheen, base: Layered { top: glass, base: reflection } } }
    }

    /// Is it a thin wall that transmits light straight on?
    pub(crate) fn is_smooth_wall(&self) -> bool {
        !self.bounds_medium && self.is_smooth_glass()
    }

    /// Is it smooth glass, a thin wall or the boundary of a medium?
    pub(crate) fn is_smooth_glass(&self) -> bool {
        let glass = self.glass(self.transmission);
        glass.fraction > 0.0 && self.metallic < 1.0 && glass.alpha <= ggx::MIN_ALPHA
    }

    /// The core model's BSDF with these parameters; the extensions' are ignored.
    #[inline(always)]
    pub fn core(&self) -> Core {
        self.below_general_microfacet(0.0).base
    }

    /// The lobes of a surface with isotropic roughness and without a film.
    #[inline]
    fn isotropic(&self) -> (Glass, BelowGlass<One>) {
        let fraction = self.transmission * (1.0 - self.metallic);
        let glass = if fraction > 0.0 { self.glass(fraction) } else { no_glass() };
        (glass, Layered { top: no_general_microfacet(), base: self.below_general_microfacet(fraction) })
    }

    /// The lobes of an anisotropic or iridescent surface: [`GeneralMicrofacet`] replaces glass and microfacets.
    fn general(&self) -> (Glass, BelowGlass<One>) {
        let glass = self.glass(self.transmission);
        let (opaque, absent) = (self.transmission == 0.0, no_general_microfacet());
        let alpha_b = if opaque { alpha(self.roughness) } else { glass.alpha };
        let Anisotropy { strength, tangent } =
            self.anisotropy.unwrap_or(Anisotropy { strength: 0.0, tangent: Vec3::ZERO });
        let strength = if tangent == Vec3::ZERO { 0.0 } else { strength };
        let mut general_microfacet = GeneralMicrofacet {
            tangent,
            alpha_t: alpha_b + (1.0 - alpha_b) * strength * strength,
            alpha_b,
            f0: glass.f0,
            f90: glass.f90,
            metallic: self.metallic,
            metallic_f0: self.base_color,
            transmission: if self.metallic < 1.0 { self.transmission } else { 0.0 },
            tint: glass.tint,
            eta: if opaque { absent.eta } else { glass.eta },
            thin: if opaque { absent.thin } else { glass.thin },
            compensation: self.compensation(),
            ..absent
        };
        if let Some(Iridescence { factor, ior, thickness }) = self.iridescence {
            // The film fades out below 0.03 nm, less than an atom.
            let presence = (thickness / 0.03).clamp(0.0, 1.0);
            let presence = presence * presence * (3.0 - 2.0 * presence);
            (general_microfacet.iridescence, general_microfacet.film_ior, general_microfacet.film_thickness) =
                (factor * presence, ior, thickness);
        }
        let base = (1.0 - self.metallic) * (1.0 - self.transmission) * FRAC_1_PI;
        let fraction = self.diffuse_transmission;
        let diffuse_transmission =
            DiffuseTransmission { diffuse: self.diffuse_transmission_color * (base * fraction), ..Default::default() };
        let lambert = Lambert { diffuse: self.base_color * (base * (1.0 - fraction)) };
        let top = Microfacet { alpha: 1.0, ..Default::default() };
        (
            no_glass(),
            Layered {
                top: general_microfacet,
                base: Layered { top: diffuse_transmission, base: Layered { top, base: lambert } },
            },
        )
    }

    /// The lobes of the part of the surface that is not glass; `glass` is the fraction that is.
    #[inline(always)]
    fn below_general_microfacet(&self, glass: f32) -> BelowGeneralMicrofacet<One> {
        let (alpha, compensation) = (alpha(self.roughness), self.compensation());
        if glass >= 1.0 {
            let top = Microfacet { alpha, compensation, ..Default::default() };
            return Layered { top: DiffuseTransmission::default(), base: Layered { top, base: Lambert::default() } };
        }
        if let Some(f0) = self.specular_glossiness {
            let layer0 = f0.max_element();
            let diffuse = self.base_color * ((1.0 - layer0) * FRAC_1_PI);
            let top = Microfacet { f0, f90: 1.0, layer0, layer90: 1.0, alpha, metallic: 0.0, compensation };
            return Layered { top: DiffuseTransmission::default(), base: Layered { top, base: Lambert { diffuse } } };
        }
        let m = if glass > 0.0 { self.metallic / (1.0 - glass) } else { self.metallic };
        let dielectric0 = self.dielectric0();
        let (layer0, layer90) = (dielectric0.max_element(), self.specular);
        let mut diffuse = self.base_color * ((1.0 - m) * FRAC_1_PI);
        let mut diffuse_transmission =
            DiffuseTransmission { diffuse: Vec3::ZERO, layer0, layer90, alpha, compensation };
        if self.diffuse_transmission > 0.0 {
            let fraction = self.diffuse_transmission;
            diffuse_transmission.diffuse = self.diffuse_transmission_color * ((1.0 - m) * fraction * FRAC_1_PI);
            diffuse *= 1.0 - fraction;
        }
        let f0 = dielectric0 * (1.0 - m) + self.base_color * m;
        let top =
            Microfacet { f0, f90: self.specular * (1.0 - m) + m, layer0, layer90, alpha, metallic: m, compensation };
        Layered { top: diffuse_transmission, base: Layered { top, base: Lambert { diffuse } } }
    }

    fn compensation(&self) -> f32 {
        f32::from(u8::from(self.energy_compensation))
    }

    /// The dielectric's reflectance at normal incidence.
    fn dielectric0(&self) -> Vec3 {
        let reflectance = if self.ior == 0.0 { 1.0 } else { ((self.ior - 1.0) / (self.ior + 1.0)).powi(2) };
        (reflectance * self.specular_color).min(Vec3::ONE) * self.specular
    }

    fn glass(&self, fraction: f32) -> Glass {
        // Index 1 is no boundary, hence not a rough one.
        let ior = refraction_index(self.ior);
        let rough = if ior > 1.0 + MIN_BEND { alpha(self.roughness) } else { ggx::MIN_ALPHA };
        Glass {
            fraction,
            tint: self.base_color,
            f0: self.dielectric0(),
            f90: self.specular,
            eta: if self.bounds_medium && self.back_facing { 1.0 / ior } else { ior },
            thin: f32::from(u8::from(!self.bounds_medium)),
            alpha: rough,
            compensation: self.compensation(),
        }
    }
}

/// The index by which boundaries of a material with this `ior` refract. 0 means infinite: nothing is transmitted, as by any
/// large index.
pub fn refraction_index(ior: f32) -> f32 {
    if ior == 0.0 { f32::from(u8::MAX) } else { ior.max(1.0 + MIN_BEND) }
}

/// An absent glass lobe, for lanes next to others that have it.
#[inline(always)]
fn no_glass() -> Glass {
    Glass { eta: 1.5, alpha: 1.0, ..Default::default() }
}

/// An absent general microfacet lobe, for lanes next to others that have it.
#[inline(always)]
fn no_general_microfacet() -> GeneralMicrofacet {
    GeneralMicrofacet { alpha_t: 1.0, alpha_b: 1.0, eta: 1.5, thin: 1.0, film_ior: 1.0, ..Default::default() }
}

/// The microfacet α of a perceptual roughness.
fn alpha(roughness: f32) -> f32 {
    (roughness * roughness).max(ggx::MIN_ALPHA)
}
