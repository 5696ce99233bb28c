//! Materials of the document.

use glam::Vec3;
use gltf::json::material::AlphaMode as Alpha;
use gltf::json::validation::Checked;

use super::extensions::{Support, support};
use super::json::{Json, extra};
use super::lobes::{self, Factors, UNIT};
use super::texture_info::{TextureInfo, TextureInfos};
use super::typed::read;
use crate::error::Result;
use crate::scene::{self, AlphaMode, TextureSlot};

#[derive(Debug)]
pub struct Material {
    /// The scene's material, without textures.
    pub plain: scene::Material,
    pub textures: TextureInfos,
    pub has_occlusion: bool,
    /// Paths of factors outside of 0 to 1.
    pub clamped: Vec<String>,
    pub extensions: Vec<String>,
    /// JSON path of the texture that requires tangents in the file.
    pub needs_tangents: Option<String>,
    pub at: String,
}

impl Material {
    pub fn parse(json: &Json) -> Result<Self> {
        let from: gltf::json::Material = read(json)?;
        let extensions = from.extensions.unwrap_or_default();
        let mut factors = Factors::default();
        let texture = TextureInfo::parse;
        let mut plain =
            scene::Material { name: json.name()?, light_group: extra(json, "light_group"), ..Default::default() };
        let mut textures = [const { None }; TextureSlot::ALL.len()];
        if let Some(pbr) = json.get("pbrMetallicRoughness")? {
            plain.metallic = factors.number(&pbr, "metallicFactor", UNIT, 1.0)?;
            plain.roughness = factors.number(&pbr, "roughnessFactor", UNIT, 1.0)?;
            plain.base_color = factors.color(&pbr, "baseColorFactor", [1.0; 4])?.into();
            textures[TextureSlot::BaseColor as usize] = texture(&pbr, "baseColorTexture")?;
            textures[TextureSlot::MetallicRoughness as usize] = texture(&pbr, "metallicRoughnessTexture")?;
        }
        textures[TextureSlot::Normal as usize] = texture(json, "normalTexture")?;
        plain.normal_scale = from.normal_texture.map_or(1.0, |normal| normal.scale);
        let has_occlusion = texture(json, "occlusionTexture")?.is_some();
        textures[TextureSlot::Emissive as usize] = texture(json, "emissiveTexture")?;
        let (factor, strength) =
            (from.emissive_factor.0, extensions.emissive_strength.as_ref().map_or(1.0, |e| e.emissive_strength.0));
        plain.emissive = Vec3::from(factor) * strength;
        if !plain.emissive.is_finite() || plain.emissive.min_element() < 0.0 || strength < 0.0 {
            return Err(json.bad("emissiveFactor", "finite numbers of at least 0", format!("{factor:?} · {strength}")));
        }
        if let Some(ior) = &extensions.ior {
            plain.ior = ior.ior.0;
            if plain.ior != 0.0 && plain.ior < 1.0 {
                return Err(json.bad("extensions.KHR_materials_ior.ior", "0, or at least 1", plain.ior));
            }
        }
        if let (Some(specular), Some(json)) = (&extensions.specular, json.extension("KHR_materials_specular")?) {
            plain.specular = factors.number(&json, "specularFactor", UNIT, 1.0)?;
            plain.specular_color = Vec3::from(specular.specular_color_factor.0);
            if plain.specular_color.min_element() < 0.0 {
                return Err(json.bad("specularColorFactor", "numbers of at least 0", plain.specular_color));
            }
            textures[TextureSlot::Specular as usize] = texture(&json, "specularTexture")?;
            textures[TextureSlot::SpecularColor as usize] = texture(&json, "specularColorTexture")?;
        }
        lobes::parse(json, &mut plain, &mut textures, &mut factors)?;
        plain.unlit = extensions.unlit.is_some();
        plain.double_sided = from.double_sided;
        let cutoff = from.alpha_cutoff.map_or(0.5, |cutoff| cutoff.0);
        plain.alpha_mode = match from.alpha_mode {
            Checked::Valid(Alpha::Opaque) => AlphaMode::Opaque,
            Checked::Valid(Alpha::Mask) if cutoff >= 0.0 => AlphaMode::Mask(cutoff),
            Checked::Valid(Alpha::Mask) => return Err(json.bad("alphaCutoff", "at least 0", cutoff)),
            Checked::Valid(Alpha::Blend) => AlphaMode::Blend,
            Checked::Invalid => {
                let found = json.string("alphaMode")?.unwrap_or_default();
                return Err(json.bad("alphaMode", "OPAQUE, MASK or BLEND", found));
            }
        };
        // Tangents are generated for a normal map of the base layer only.
        let needs_tangents =
            match (&textures[TextureSlot::Normal as usize], &textures[TextureSlot::ClearcoatNormal as usize]) {
                (None, Some(map)) => Some(map.at.clone()),
                _ => None,
            };
        let extensions = check_other_extensions(json)?;
        let clamped = factors.clamped;
        Ok(Self { plain, textures, has_occlusion, clamped, extensions, needs_tangents, at: json.at.clone() })
    }
}

/// Checks the texture indices of ignored extensions; returns the names of all.
fn check_other_extensions(json: &Json) -> Result<Vec<String>> {
    let names = json.extension_names()?;
    for name in &names {
        let (Some(extension), Support::Ignored(_)) = (json.extension(name)?, support(name)) else { continue };
        for (key, value) in extension.object()? {
            if key.ends_with("Texture") && value.is_object() {
                TextureInfo::parse(&extension, key)?;
            }
        }
    }
    Ok(names)
}
