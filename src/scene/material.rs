//! The glTF metallic-roughness material, as data.

use std::ops::{Index, IndexMut};

use glam::{Affine2, Vec3, Vec4};

/// How a texture's bytes become numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// RGB is sRGB-encoded, alpha is linear.
    Srgb,
    /// All channels are linear.
    Linear,
}

/// A use of a texture by a material.
#[derive(Debug, Clone)]
pub struct TextureRef {
    /// Index into [`super::Scene::textures`].
    pub texture: u32,
    /// Which texture coordinate set: 0 or 1.
    pub set: u8,
    /// KHR_texture_transform, applied to the coordinates.
    pub transform: Option<Affine2>,
    /// How to decode it.
    pub encoding: Encoding,
}

/// What a material's texture is for. Each multiplies the factor of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureSlot {
    /// Base colour and alpha.
    BaseColor,
    /// Roughness in green, metalness in blue.
    MetallicRoughness,
    /// Tangent-space normal map.
    Normal,
    /// Emitted radiance.
    Emissive,
    /// KHR_materials_specular: strength in alpha.
    Specular,
    /// KHR_materials_specular: colour.
    SpecularColor,
}

impl TextureSlot {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 6] =
        [Self::BaseColor, Self::MetallicRoughness, Self::Normal, Self::Emissive, Self::Specular, Self::SpecularColor];

    /// How its bytes become numbers.
    pub fn encoding(self) -> Encoding {
        match self {
            Self::BaseColor | Self::Emissive | Self::SpecularColor => Encoding::Srgb,
            Self::MetallicRoughness | Self::Normal | Self::Specular => Encoding::Linear,
        }
    }
}

/// A material's textures by slot: the only place that holds them, so whoever asks for all of them misses none.
#[derive(Debug, Clone, Default)]
pub struct Textures([Option<TextureRef>; TextureSlot::ALL.len()]);

impl Textures {
    /// Those that there are.
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

/// What alpha means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Present where alpha is at least the cutoff.
    Mask(f32),
    /// Present with probability alpha.
    Blend,
}

/// glTF 2.0 metallic-roughness with KHR_materials_specular, _ior, _emissive_strength and _unlit.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name for messages.
    pub name: String,
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
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// Emission on both sides; single-sided surfaces shade from both sides but shine from the front.
    pub double_sided: bool,
    /// KHR_materials_unlit: shows its base colour, scatters nothing.
    pub unlit: bool,
    /// What it samples.
    pub textures: Textures,
}

impl Default for Material {
    /// The glTF default material.
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Vec4::ONE,
            metallic: 1.0,
            roughness: 1.0,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            specular: 1.0,
            specular_color: Vec3::ONE,
            ior: 1.5,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            textures: Textures::default(),
        }
    }
}

impl Material {
    /// Can it emit at all (before its texture is looked at)?
    pub fn is_emissive(&self) -> bool {
        self.emissive.max_element() > 0.0 && !self.unlit
    }
}
