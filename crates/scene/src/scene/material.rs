//! glTF materials as plain data.

use std::ops::{Index, IndexMut};
use std::sync::Arc;

use glam::{Affine2, Vec3, Vec4};

/// Encoding of a texture's stored values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// RGB is sRGB-encoded, alpha is linear.
    Srgb,
    /// All channels are linear.
    Linear,
}

/// A use of a texture by a material.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureRef {
    /// Index into [`super::Scene::textures`].
    pub texture: u32,
    /// Which texture coordinate set.
    pub set: u8,
    /// KHR_texture_transform, applied to the coordinates.
    pub transform: Option<Affine2>,
    /// How stored values are decoded.
    pub encoding: Encoding,
}

impl TextureRef {
    /// The element of `sets`, those of TEXCOORD_0 and TEXCOORD_1, that this texture reads; `None` if it reads a higher set
    /// ([`Mesh::texcoord`](super::Mesh::texcoord) then has the coordinates).
    #[inline(always)]
    pub fn select<'a, T>(&self, sets: &'a [T; 2]) -> Option<&'a T> {
        sets.get(usize::from(self.set))
    }
}

/// Parameter that a texture of a material drives. Each texture multiplies the factor of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureSlot {
    /// Base colour and alpha.
    BaseColor,
    /// Roughness in green, metalness in blue.
    MetallicRoughness,
    /// Tangent-space normal map.
    Normal,
    Emissive,
    /// KHR_materials_specular: strength in alpha.
    Specular,
    /// KHR_materials_specular: colour.
    SpecularColor,
    /// KHR_materials_transmission: transmitted fraction in red.
    Transmission,
    /// KHR_materials_clearcoat: strength in red.
    Clearcoat,
    /// KHR_materials_clearcoat: roughness in green.
    ClearcoatRoughness,
    /// KHR_materials_clearcoat: tangent-space normal map of the coat.
    ClearcoatNormal,
    /// KHR_materials_sheen: colour.
    SheenColor,
    /// KHR_materials_sheen: roughness in alpha.
    SheenRoughness,
    /// KHR_materials_pbrSpecularGlossiness: specular colour, and glossiness in alpha.
    SpecularGlossiness,
    /// KHR_materials_diffuse_transmission: transmitted fraction in alpha.
    DiffuseTransmission,
    /// KHR_materials_diffuse_transmission: colour.
    DiffuseTransmissionColor,
    /// KHR_materials_anisotropy: direction in red and green, strength in blue.
    Anisotropy,
    /// KHR_materials_iridescence: strength in red.
    Iridescence,
    /// KHR_materials_iridescence: position of the film's thickness between its minimum and maximum, in green.
    IridescenceThickness,
}

impl TextureSlot {
    /// All slots, in the order of their numbers.
    pub const ALL: [Self; 18] = [
        Self::BaseColor,
        Self::MetallicRoughness,
        Self::Normal,
        Self::Emissive,
        Self::Specular,
        Self::SpecularColor,
        Self::Transmission,
        Self::Clearcoat,
        Self::ClearcoatRoughness,
        Self::ClearcoatNormal,
        Self::SheenColor,
        Self::SheenRoughness,
        Self::SpecularGlossiness,
        Self::DiffuseTransmission,
        Self::DiffuseTransmissionColor,
        Self::Anisotropy,
        Self::Iridescence,
        Self::IridescenceThickness,
    ];

    /// Encoding of the slot's textures.
    pub fn encoding(self) -> Encoding {
        match self {
            Self::BaseColor
            | Self::Emissive
            | Self::SpecularColor
            | Self::SheenColor
            | Self::SpecularGlossiness
            | Self::DiffuseTransmissionColor => Encoding::Srgb,
            _ => Encoding::Linear,
        }
    }
}

/// A material's textures by slot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Textures([Option<TextureRef>; TextureSlot::ALL.len()]);

impl Textures {
    /// The textures that are present.
    pub fn iter(&self) -> impl Iterator<Item = &TextureRef> {
        self.0.iter().flatten()
    }
}

impl Index<TextureSlot> for Textures {
    type Output = Option<TextureRef>;

    fn index(&self, slot: TextureSlot) -> &Option<TextureRef> {
        &self.0[slot as usize]
    }
}

impl IndexMut<TextureSlot> for Textures {
    fn index_mut(&mut self, slot: TextureSlot) -> &mut Option<TextureRef> {
        &mut self.0[slot as usize]
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Present where alpha is at least the cutoff.
    Mask(f32),
    /// Present with probability alpha.
    Blend,
}

/// glTF 2.0 metallic-roughness with its KHR_materials extensions.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name for messages.
    pub name: String,
    /// Group of lights: `extras.light_group`.
    pub light_group: Option<Arc<str>>,
    /// Linear base colour and alpha, each in [0, 1].
    pub base_color: Vec4,
    /// 0 dielectric to 1 metal.
    pub metallic: f32,
    /// Perceptual roughness in [0, 1]; the microfacet alpha is its square.
    pub roughness: f32,
    /// Scales the normal map's x and y.
    pub normal_scale: f32,
    /// Emitted radiance, linear RGB, with KHR_materials_emissive_strength applied; ≥ 0.
    pub emissive: Vec3,
    /// KHR_materials_specular: strength in [0, 1].
    pub specular: f32,
    /// KHR_materials_specular: colour of the dielectric's normal reflectance, ≥ 0.
    pub specular_color: Vec3,
    /// KHR_materials_ior: index of refraction, ≥ 1 (0 means infinite).
    pub ior: f32,
    /// KHR_materials_transmission: fraction of the dielectric's base that transmits light, in [0, 1].
    pub transmission: f32,
    /// KHR_materials_volume: the surface bounds a medium, with front faces outside. If false, it is a thin wall.
    pub bounds_medium: bool,
    /// KHR_materials_volume: absorption coefficient of the medium, linear RGB per metre, ≥ 0.
    pub absorption: Vec3,
    /// KHR_materials_diffuse_transmission: fraction of the diffuse base that transmits, in [0, 1].
    pub diffuse_transmission: f32,
    /// KHR_materials_diffuse_transmission: linear RGB colour, in [0, 1].
    pub diffuse_transmission_color: Vec3,
    /// KHR_materials_sheen: linear RGB colour, in [0, 1].
    pub sheen_color: Vec3,
    /// KHR_materials_sheen: perceptual roughness, in [0, 1].
    pub sheen_roughness: f32,
    /// KHR_materials_clearcoat: strength, in [0, 1].
    pub clearcoat: f32,
    /// KHR_materials_clearcoat: perceptual roughness, in [0, 1].
    pub clearcoat_roughness: f32,
    /// Scales x and y of the clear coat's normal map.
    pub clearcoat_normal_scale: f32,
    /// KHR_materials_anisotropy: strength, in [0, 1].
    pub anisotropy: f32,
    /// KHR_materials_anisotropy: rotation from the tangent, counter-clockwise, in radians.
    pub anisotropy_rotation: f32,
    /// KHR_materials_iridescence: strength, in [0, 1].
    pub iridescence: f32,
    /// KHR_materials_iridescence: index of refraction of the thin film, ≥ 1.
    pub iridescence_ior: f32,
    /// KHR_materials_iridescence: thickness of the film in nanometres where its texture is 0 and where it is 1 or absent.
    pub iridescence_thickness: [f32; 2],
    /// KHR_materials_dispersion: 20 over the Abbe number, ≥ 0.
    pub dispersion: f32,
    /// KHR_materials_pbrSpecularGlossiness: specular colour, in [0, 1]. `base_color` is then the diffuse colour and
    /// `roughness` is 1 − glossiness.
    pub specular_glossiness: Option<Vec3>,
    pub alpha_mode: AlphaMode,
    /// Emit on both sides. Single-sided surfaces are shaded on both sides and emit on the front only.
    pub double_sided: bool,
    /// Compensate the energy that single scattering loses between microfacets? Else the letter of glTF 2.0, appendix B.
    pub energy_compensation: bool,
    /// KHR_materials_unlit: shows its base colour without lighting and does not scatter.
    pub unlit: bool,
    pub textures: Textures,
}

impl Default for Material {
    /// The glTF default material.
    fn default() -> Self {
        Self {
            name: "default".into(),
            light_group: None,
            base_color: Vec4::ONE,
            metallic: 1.0,
            roughness: 1.0,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            specular: 1.0,
            specular_color: Vec3::ONE,
            ior: 1.5,
            transmission: 0.0,
            bounds_medium: false,
            absorption: Vec3::ZERO,
            diffuse_transmission: 0.0,
            diffuse_transmission_color: Vec3::ONE,
            sheen_color: Vec3::ZERO,
            sheen_roughness: 0.0,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            clearcoat_normal_scale: 1.0,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            iridescence: 0.0,
            iridescence_ior: 1.3,
            iridescence_thickness: [100.0, 400.0],
            dispersion: 0.0,
            specular_glossiness: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            energy_compensation: true,
            unlit: false,
            textures: Textures::default(),
        }
    }
}

impl Material {
    /// Can the material emit? Textures are not considered.
    #[inline]
    pub fn is_emissive(&self) -> bool {
        self.emissive.max_element() > 0.0 && !self.unlit
    }

    /// Can there be a surface where texture and vertex colour have this alpha?
    #[inline]
    pub fn shows(&self, alpha: f32) -> bool {
        match self.alpha_mode {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => self.base_color.w * alpha >= cutoff,
            AlphaMode::Blend => self.base_color.w * alpha > 0.0,
        }
    }

    /// Can a part of the surface be dielectric? Values of textures are not considered.
    #[inline]
    pub fn has_dielectric(&self) -> bool {
        !self.unlit && (self.metallic < 1.0 || self.textures[TextureSlot::MetallicRoughness].is_some())
    }

    /// The texture coordinate set that the mesh's tangents follow, if the material needs tangents: the normal map's, else the
    /// anisotropy's, else the clear coat's normal map's; and that of the latter where it is another one.
    pub fn tangent_sets(&self) -> [Option<u8>; 2] {
        let set = |slot: TextureSlot| self.textures[slot].as_ref().map(|texture| texture.set);
        let (normals, coat) = (set(TextureSlot::Normal), set(TextureSlot::ClearcoatNormal));
        let brushed = || (self.anisotropy > 0.0).then(|| set(TextureSlot::Anisotropy).unwrap_or(0));
        let own = normals.or_else(brushed).or(coat);
        [own, coat.filter(|_| coat != own)]
    }

    /// Does refraction depend on wavelength?
    #[inline]
    pub fn disperses(&self) -> bool {
        self.dispersion > 0.0 && self.bounds_medium && self.transmission > 0.0 && self.has_dielectric()
    }

    /// Does the surface have a front only, and let no light through?
    #[inline]
    pub fn is_single_sided(&self) -> bool {
        !self.double_sided && !self.transmits()
    }

    /// Can light pass through the surface?
    #[inline]
    pub fn transmits(&self) -> bool {
        self.has_dielectric() && (self.transmission > 0.0 || self.diffuse_transmission > 0.0)
    }

    /// Is its surface the boundary of a medium that light enters?
    #[inline]
    pub fn bounds_body(&self) -> bool {
        self.bounds_medium && self.transmits()
    }
}
