//! The glTF 2.0 metallic-roughness model (specification, appendix B) with KHR_materials_specular, _ior, _transmission,
//! _diffuse_transmission, _sheen, _clearcoat, _anisotropy and _iridescence: a linear mix of a dielectric, whose base is seen through its Fresnel layer,
//! and a metal. The dielectric's base is a mix in its turn: of a diffuse one, which reflects and transmits, and of glass.
//! KHR_materials_pbrSpecularGlossiness is the same with other names for what the lobes are made of.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::{
    Bsdf, Clearcoat, Core, DiffuseTransmission, GeneralMicrofacet, Glass, Lambert, Layered, Microfacet, Sheen, ggx,
    glass, sheen,
};

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
    /// KHR_materials_pbrSpecularGlossiness: reflectance at normal incidence. Base colour and roughness are its diffuse
    /// colour and one less its glossiness; metalness, specular and index do not count.
    pub specular_glossiness: Option<Vec3>,
    /// KHR_materials_transmission: share of the dielectric that is glass, in [0, 1].
    pub transmission: f32,
    /// KHR_materials_diffuse_transmission: share of the diffuse base that transmits, in [0, 1].
    pub diffuse_transmission: f32,
    /// Its colour.
    pub diffuse_transmission_color: Vec3,
    /// The surface bounds a body (KHR_materials_volume); else it is a thin wall.
    pub bounds_medium: bool,
    /// It is seen from behind: the eye is inside of the body.
    pub behind: bool,
    /// KHR_materials_sheen: colour, in [0, 1].
    pub sheen_color: Vec3,
    /// Perceptual roughness of the sheen in [0, 1].
    pub sheen_roughness: f32,
    /// KHR_materials_clearcoat: strength, in [0, 1].
    pub clearcoat: f32,
    /// Perceptual roughness of the coat in [0, 1].
    pub clearcoat_roughness: f32,
    /// Unit normal of the coat on the eye's side, or zero for the shading normal.
    pub clearcoat_normal: Vec3,
    /// KHR_materials_anisotropy, if the material has it.
    pub anisotropy: Option<Anisotropy>,
    /// KHR_materials_iridescence, if the material has it.
    pub iridescence: Option<Iridescence>,
}

/// KHR_materials_anisotropy: a surface that is rougher one way than the other.
#[derive(Debug, Clone, Copy)]
pub struct Anisotropy {
    /// In [0, 1].
    pub strength: f32,
    /// Unit direction along the surface in which it is rougher; zero if none is known: then it is as rough every way.
    pub tangent: Vec3,
}

/// KHR_materials_iridescence: a thin film.
#[derive(Debug, Clone, Copy)]
pub struct Iridescence {
    /// In [0, 1].
    pub factor: f32,
    /// Index of refraction of the film, ≥ 1.
    pub ior: f32,
    /// In nanometres, ≥ 0.
    pub thickness: f32,
}

impl Default for Surface {
    /// A white diffuse one of glTF's default index of refraction.
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
            behind: false,
            sheen_color: Vec3::ZERO,
            sheen_roughness: 0.0,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal: Vec3::ZERO,
            anisotropy: None,
            iridescence: None,
        }
    }
}

impl Surface {
    /// The model with these parameters.
    #[inline]
    pub fn bsdf(&self) -> Bsdf {
        // Lobes that are missing keep parameters with which nothing is undefined: other lanes may have them.
        let coat =
            Clearcoat { coat: self.clearcoat, normal: self.clearcoat_normal, alpha: alpha(self.clearcoat_roughness) };
        let sheen = Sheen { color: self.sheen_color, roughness: self.sheen_roughness.max(sheen::MIN_ROUGHNESS) };
        let finished = (self.anisotropy.is_some() || self.iridescence.is_some()) && self.specular_glossiness.is_none();
        let (glass, reflection) = if finished { self.finished() } else { self.plain() };
        Layered { top: coat, base: Layered { top: sheen, base: Layered { top: glass, base: reflection } } }
    }

    /// The model, where nothing but the core one's parameters is set.
    #[inline(always)]
    pub fn core(&self) -> Core {
        self.reflection(0.0).base
    }

    /// A surface as rough every way, without a film.
    #[inline]
    fn plain(&self) -> (Glass, super::Reflection<super::One>) {
        let share = self.transmission * (1.0 - self.metallic);
        let glass = if share > 0.0 { self.glass(share) } else { NO_GLASS };
        (glass, Layered { top: NO_GENERAL_MICROFACET, base: self.reflection(share) })
    }

    /// What has [`GeneralMicrofacet`] in place of glass and microfacets.
    fn finished(&self) -> (Glass, super::Reflection<super::One>) {
        let glass = self.glass(self.transmission);
        let no_glass = self.transmission == 0.0;
        let alpha_b = if no_glass { alpha(self.roughness) } else { glass.alpha };
        let Anisotropy { strength, tangent } =
            self.anisotropy.unwrap_or(Anisotropy { strength: 0.0, tangent: Vec3::ZERO });
        let strength = if tangent == Vec3::ZERO { 0.0 } else { strength };
        let mut finish = GeneralMicrofacet {
            tangent,
            alpha_t: alpha_b + (1.0 - alpha_b) * strength * strength,
            alpha_b,
            f0: glass.f0,
            f90: glass.f90,
            metal: self.metallic,
            metal0: self.base_color,
            share: if self.metallic < 1.0 { self.transmission } else { 0.0 },
            tint: glass.tint,
            eta: if no_glass { NO_GENERAL_MICROFACET.eta } else { glass.eta },
            thin: if no_glass { 1.0 } else { glass.thin },
            ..NO_GENERAL_MICROFACET
        };
        if let Some(Iridescence { factor, ior, thickness }) = self.iridescence {
            // What is thinner than an atom is no film.
            let there = (thickness / 0.03).clamp(0.0, 1.0);
            let there = there * there * (3.0 - 2.0 * there);
            (finish.film, finish.film_ior, finish.thickness) = (factor * there, ior, thickness);
        }
        let base = (1.0 - self.metallic) * (1.0 - self.transmission) * FRAC_1_PI;
        let share = self.diffuse_transmission;
        let transmitted =
            DiffuseTransmission { diffuse: self.diffuse_transmission_color * (base * share), ..Default::default() };
        let lambert = Lambert { diffuse: self.base_color * (base * (1.0 - share)) };
        let top = Microfacet { alpha: 1.0, ..Default::default() };
        (NO_GLASS, Layered { top: finish, base: Layered { top: transmitted, base: Layered { top, base: lambert } } })
    }

    /// What is not glass, of which the surface has this share.
    #[inline(always)]
    fn reflection(&self, glass: f32) -> super::Unfinished<super::One> {
        let alpha = alpha(self.roughness);
        if glass >= 1.0 {
            let top = Microfacet { alpha, ..Default::default() };
            return Layered { top: DiffuseTransmission::default(), base: Layered { top, base: Lambert::default() } };
        }
        if let Some(f0) = self.specular_glossiness {
            let layer0 = f0.max_element();
            let diffuse = self.base_color * ((1.0 - layer0) * FRAC_1_PI);
            let top = Microfacet { f0, f90: 1.0, layer0, layer90: 1.0, alpha };
            return Layered { top: DiffuseTransmission::default(), base: Layered { top, base: Lambert { diffuse } } };
        }
        let m = if glass > 0.0 { self.metallic / (1.0 - glass) } else { self.metallic };
        let dielectric0 = self.dielectric0();
        let (layer0, layer90) = (dielectric0.max_element(), self.specular);
        let mut diffuse = self.base_color * ((1.0 - m) * FRAC_1_PI);
        let mut transmitted = DiffuseTransmission { diffuse: Vec3::ZERO, layer0, layer90 };
        if self.diffuse_transmission > 0.0 {
            let share = self.diffuse_transmission;
            transmitted.diffuse = self.diffuse_transmission_color * ((1.0 - m) * share * FRAC_1_PI);
            diffuse *= 1.0 - share;
        }
        let f0 = dielectric0 * (1.0 - m) + self.base_color * m;
        let top = Microfacet { f0, f90: self.specular * (1.0 - m) + m, layer0, layer90, alpha };
        Layered { top: transmitted, base: Layered { top, base: Lambert { diffuse } } }
    }

    /// The dielectric's reflectance at normal incidence.
    fn dielectric0(&self) -> Vec3 {
        let reflectance = if self.ior == 0.0 { 1.0 } else { ((self.ior - 1.0) / (self.ior + 1.0)).powi(2) };
        (reflectance * self.specular_color).min(Vec3::ONE) * self.specular
    }

    fn glass(&self, share: f32) -> Glass {
        // An infinite index passes nothing whatever its value here; index 1 is no surface, and so not a rough one.
        let ior = if self.ior == 0.0 { f32::from(u8::MAX) } else { self.ior.max(1.0 + glass::MIN_BEND) };
        let rough = if ior > 1.0 + glass::MIN_BEND { alpha(self.roughness) } else { ggx::MIN_ALPHA };
        Glass {
            share,
            tint: self.base_color,
            f0: self.dielectric0(),
            f90: self.specular,
            eta: if self.bounds_medium && self.behind { 1.0 / ior } else { ior },
            thin: f32::from(u8::from(!self.bounds_medium)),
            alpha: rough,
        }
    }
}

/// No glass, for lanes beside others with it.
const NO_GLASS: Glass =
    Glass { share: 0.0, tint: Vec3::ZERO, f0: Vec3::ZERO, f90: 0.0, eta: 1.5, thin: 0.0, alpha: 1.0 };

/// No finish, for lanes beside others with it.
const NO_GENERAL_MICROFACET: GeneralMicrofacet = GeneralMicrofacet {
    tangent: Vec3::ZERO,
    alpha_t: 1.0,
    alpha_b: 1.0,
    f0: Vec3::ZERO,
    f90: 0.0,
    metal: 0.0,
    metal0: Vec3::ZERO,
    share: 0.0,
    tint: Vec3::ZERO,
    eta: 1.5,
    thin: 1.0,
    film: 0.0,
    film_ior: 1.0,
    thickness: 0.0,
};

/// The microfacet α of a perceptual roughness.
fn alpha(roughness: f32) -> f32 {
    (roughness * roughness).max(ggx::MIN_ALPHA)
}
