//! Materials, as the document has them.

use glam::{Affine2, Vec2, Vec3, Vec4};

use super::Lengths;
use super::extensions::{Support, support};
use super::json::Json;
use crate::error::Result;
use crate::scene::import::report::NoteKind;
use crate::scene::{self, AlphaMode, TextureSlot};

/// A use of a texture, as the document has it.
#[derive(Debug, Clone)]
pub struct TextureInfo {
    pub texture: usize,
    pub set: u64,
    pub transform: Option<Affine2>,
    pub at: String,
}

impl TextureInfo {
    fn parse(json: &Json, key: &str, lengths: &Lengths) -> Result<Option<Self>> {
        let Some(info) = json.get(key)? else { return Ok(None) };
        let texture = info.need("index", info.index("index", lengths.textures, "textures")?)?;
        let mut set = info.integer("texCoord")?.unwrap_or(0);
        let mut transform = None;
        if let Some(t) = info.extension("KHR_texture_transform")? {
            let vector = |key: &str, default: f64| -> Result<Vec2> {
                Ok(Vec2::from(t.vector::<2>(key)?.unwrap_or([default; 2]).map(|x| x as f32)))
            };
            let (offset, scale) = (vector("offset", 0.0)?, vector("scale", 1.0)?);
            let rotation = t.number("rotation")?.unwrap_or(0.0) as f32;
            set = t.integer("texCoord")?.unwrap_or(set);
            // The rotation is counter-clockwise as seen, and v runs down; Khronos' TextureTransformTest agrees.
            let affine = Affine2::from_scale_angle_translation(scale, -rotation, offset);
            transform = Some(affine).filter(|t| *t != Affine2::IDENTITY);
        }
        Ok(Some(Self { texture, set, transform, at: info.at }))
    }
}

/// A checked material.
#[derive(Debug)]
pub struct Material {
    /// The scene's, without textures.
    pub plain: scene::Material,
    /// By [`TextureSlot`].
    pub textures: [Option<TextureInfo>; TextureSlot::ALL.len()],
    pub has_occlusion: bool,
    /// Paths of factors outside of 0 to 1.
    pub clamped: Vec<String>,
    /// Extensions that are not shown exactly: kind, name and reason.
    pub inexact: Vec<(NoteKind, String, &'static str)>,
    /// What makes tangents in the file necessary.
    pub needs_tangents: Option<String>,
    pub at: String,
}

impl Material {
    pub fn parse(json: &Json, lengths: &Lengths) -> Result<Self> {
        let mut clamped = Vec::new();
        let unit = |json: &Json, key: &str, clamped: &mut Vec<String>| -> Result<f32> {
            let x = json.number(key)?.unwrap_or(1.0);
            if !(0.0..=1.0).contains(&x) {
                clamped.push(json.path(key));
            }
            Ok(x.clamp(0.0, 1.0) as f32)
        };
        let texture = |json: &Json, key: &str| TextureInfo::parse(json, key, lengths);
        let mut plain = scene::Material { name: json.name()?, ..Default::default() };
        let mut textures = [const { None }; TextureSlot::ALL.len()];
        if let Some(pbr) = json.get("pbrMetallicRoughness")? {
            plain.metallic = unit(&pbr, "metallicFactor", &mut clamped)?;
            plain.roughness = unit(&pbr, "roughnessFactor", &mut clamped)?;
            if let Some(color) = pbr.vector::<4>("baseColorFactor")? {
                plain.base_color = Vec4::from(color.map(|x| x as f32));
                if plain.base_color != plain.base_color.clamp(Vec4::ZERO, Vec4::ONE) {
                    clamped.push(pbr.path("baseColorFactor"));
                    plain.base_color = plain.base_color.clamp(Vec4::ZERO, Vec4::ONE);
                }
            }
            textures[TextureSlot::BaseColor as usize] = texture(&pbr, "baseColorTexture")?;
            textures[TextureSlot::MetallicRoughness as usize] = texture(&pbr, "metallicRoughnessTexture")?;
        }
        textures[TextureSlot::Normal as usize] = texture(json, "normalTexture")?;
        if let Some(normal) = json.get("normalTexture")? {
            plain.normal_scale = normal.number("scale")?.unwrap_or(1.0) as f32;
        }
        if let Some(occlusion) = json.get("occlusionTexture")? {
            occlusion.number("strength")?;
        }
        let has_occlusion = texture(json, "occlusionTexture")?.is_some();
        textures[TextureSlot::Emissive as usize] = texture(json, "emissiveTexture")?;
        let factor = json.vector::<3>("emissiveFactor")?.unwrap_or([0.0; 3]).map(|x| x as f32);
        let strength = match json.extension("KHR_materials_emissive_strength")? {
            Some(json) => json.number("emissiveStrength")?.unwrap_or(1.0) as f32,
            None => 1.0,
        };
        plain.emissive = Vec3::from(factor) * strength;
        if !plain.emissive.is_finite() || plain.emissive.min_element() < 0.0 || strength < 0.0 {
            return Err(json.bad("emissiveFactor", "finite numbers of at least 0", format!("{factor:?} · {strength}")));
        }
        if let Some(json) = json.extension("KHR_materials_ior")? {
            plain.ior = json.number("ior")?.unwrap_or(1.5) as f32;
            if plain.ior != 0.0 && plain.ior < 1.0 {
                return Err(json.bad("ior", "0, or at least 1", plain.ior));
            }
        }
        if let Some(json) = json.extension("KHR_materials_specular")? {
            plain.specular = unit(&json, "specularFactor", &mut clamped)?;
            plain.specular_color =
                Vec3::from(json.vector::<3>("specularColorFactor")?.unwrap_or([1.0; 3]).map(|x| x as f32));
            if plain.specular_color.min_element() < 0.0 {
                return Err(json.bad("specularColorFactor", "numbers of at least 0", plain.specular_color));
            }
            textures[TextureSlot::Specular as usize] = texture(&json, "specularTexture")?;
            textures[TextureSlot::SpecularColor as usize] = texture(&json, "specularColorTexture")?;
        }
        plain.unlit = json.extension("KHR_materials_unlit")?.is_some();
        plain.double_sided = json.boolean("doubleSided", false)?;
        let cutoff = json.number("alphaCutoff")?.unwrap_or(0.5) as f32;
        plain.alpha_mode = match json.string("alphaMode")?.unwrap_or("OPAQUE") {
            "OPAQUE" => AlphaMode::Opaque,
            "MASK" if cutoff >= 0.0 => AlphaMode::Mask(cutoff),
            "MASK" => return Err(json.bad("alphaCutoff", "at least 0", cutoff)),
            "BLEND" => AlphaMode::Blend,
            other => return Err(json.bad("alphaMode", "OPAQUE, MASK or BLEND", other)),
        };
        let (inexact, needs_tangents) =
            check_other_extensions(json, lengths, textures[TextureSlot::Normal as usize].is_some())?;
        Ok(Self { plain, textures, has_occlusion, clamped, inexact, needs_tangents, at: json.at.clone() })
    }
}

/// Checks the texture indices of extensions that are not shaded; says which of them change the picture.
#[allow(clippy::type_complexity)]
fn check_other_extensions(
    json: &Json,
    lengths: &Lengths,
    has_normal_map: bool,
) -> Result<(Vec<(NoteKind, String, &'static str)>, Option<String>)> {
    let (mut inexact, mut needs_tangents) = (Vec::new(), None);
    for name in json.extension_names()? {
        let Some(extension) = json.extension(name)? else { continue };
        let (kind, why, factor) = match support(name) {
            Support::Ignored { why, factor } => (NoteKind::Ignored, why, factor),
            Support::Approximated(why) => (NoteKind::Approximated, why, None),
            Support::Full | Support::NoEffect => continue,
        };
        for (key, value) in extension.object()? {
            if key.ends_with("Texture") && value.is_object() {
                TextureInfo::parse(&extension, key, lengths)?;
            }
        }
        // Only a normal map of the base layer tells how to make tangents.
        if name == "KHR_materials_clearcoat" && extension.get("clearcoatNormalTexture")?.is_some() && !has_normal_map {
            needs_tangents = Some(extension.path("clearcoatNormalTexture"));
        }
        let matters = factor.is_none_or(|key| match extension.object() {
            Ok(members) => members.get(key).is_some_and(|v| {
                v.as_f64().is_some_and(|x| x != 0.0)
                    || v.as_array().is_some_and(|a| a.iter().any(|x| x.as_f64() != Some(0.0)))
            }),
            Err(_) => true,
        });
        if matters {
            inexact.push((kind, name.into(), why));
        }
    }
    Ok((inexact, needs_tangents))
}
