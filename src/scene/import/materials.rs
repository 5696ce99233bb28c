//! Materials: checked as the document has them, then turned into the scene's own with only the textures that are
//! sampled.

use std::collections::HashMap;

use glam::{Affine2, Vec2, Vec3, Vec4};

use super::document::{Document, Lengths};
use super::extensions::{Support, support};
use super::images::TextureTable;
use super::json::Json;
use super::report::{NoteKind, Notes};
use crate::error::Result;
use crate::scene::{self, AlphaMode, Encoding, TextureRef};

/// A use of a texture, as the document has it.
#[derive(Debug, Clone)]
pub(super) struct TextureInfo {
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
pub(super) struct Material {
    plain: scene::Material,
    base_color: Option<TextureInfo>,
    metallic_roughness: Option<TextureInfo>,
    normal: Option<TextureInfo>,
    emissive: Option<TextureInfo>,
    specular: Option<TextureInfo>,
    specular_color: Option<TextureInfo>,
    has_occlusion: bool,
    clamped: Vec<String>,
    /// Extensions that are not shown exactly: kind, name and reason.
    inexact: Vec<(NoteKind, String, &'static str)>,
    /// What makes tangents in the file necessary.
    pub needs_tangents: Option<String>,
    at: String,
}

impl Material {
    pub fn parse(json: &Json, lengths: &Lengths) -> Result<Self> {
        let mut clamped = Vec::new();
        let mut unit = |json: &Json, key: &str, default: f64| -> Result<f32> {
            let x = json.number(key)?.unwrap_or(default);
            if !(0.0..=1.0).contains(&x) {
                clamped.push(json.path(key));
            }
            Ok(x.clamp(0.0, 1.0) as f32)
        };
        let texture = |json: &Json, key: &str| TextureInfo::parse(json, key, lengths);
        let mut plain = scene::Material { name: json.name()?, ..Default::default() };
        let (mut base_color, mut metallic_roughness, mut specular, mut specular_color) = (None, None, None, None);
        if let Some(pbr) = json.get("pbrMetallicRoughness")? {
            plain.metallic = unit(&pbr, "metallicFactor", 1.0)?;
            plain.roughness = unit(&pbr, "roughnessFactor", 1.0)?;
            if let Some(color) = pbr.vector::<4>("baseColorFactor")? {
                plain.base_color = Vec4::from(color.map(|x| x as f32));
                if plain.base_color != plain.base_color.clamp(Vec4::ZERO, Vec4::ONE) {
                    clamped.push(pbr.path("baseColorFactor"));
                    plain.base_color = plain.base_color.clamp(Vec4::ZERO, Vec4::ONE);
                }
            }
            base_color = texture(&pbr, "baseColorTexture")?;
            metallic_roughness = texture(&pbr, "metallicRoughnessTexture")?;
        }
        let normal = texture(json, "normalTexture")?;
        if let Some(normal) = json.get("normalTexture")? {
            plain.normal_scale = normal.number("scale")?.unwrap_or(1.0) as f32;
        }
        if let Some(occlusion) = json.get("occlusionTexture")? {
            occlusion.number("strength")?;
        }
        let has_occlusion = texture(json, "occlusionTexture")?.is_some();
        let emissive = texture(json, "emissiveTexture")?;
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
            plain.specular = json.number("specularFactor")?.unwrap_or(1.0) as f32;
            if !(0.0..=1.0).contains(&plain.specular) {
                return Err(json.bad("specularFactor", "0 to 1", plain.specular));
            }
            plain.specular_color =
                Vec3::from(json.vector::<3>("specularColorFactor")?.unwrap_or([1.0; 3]).map(|x| x as f32));
            if plain.specular_color.min_element() < 0.0 {
                return Err(json.bad("specularColorFactor", "numbers of at least 0", plain.specular_color));
            }
            specular = texture(&json, "specularTexture")?;
            specular_color = texture(&json, "specularColorTexture")?;
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
        let (inexact, needs_tangents) = check_other_extensions(json, lengths, normal.is_some())?;
        Ok(Self {
            plain,
            base_color,
            metallic_roughness,
            normal,
            emissive,
            specular,
            specular_color,
            has_occlusion,
            clamped,
            inexact,
            needs_tangents,
            at: json.at.clone(),
        })
    }

    /// The scene's material; registers the textures that it samples.
    fn resolve(&self, document: &Document, textures: &mut TextureTable, notes: &mut Notes) -> scene::Material {
        for path in &self.clamped {
            notes.repaired(path, "a factor outside of 0 to 1 is clamped");
        }
        for (kind, name, why) in &self.inexact {
            notes.add(*kind, &format!("{}.extensions.{name}", self.at), format!("{name}: {why}"));
        }
        let mut material = self.plain.clone();
        let mut sample = |info: &Option<TextureInfo>, encoding, needed: bool| -> Option<TextureRef> {
            let info = info.as_ref()?;
            if !needed {
                notes.not_loaded(&info.at, "a texture whose factor is 0, or that the material does not use");
                return None;
            }
            textures.register(document, info, encoding, notes)
        };
        let lit = !material.unlit;
        material.textures[TextureSlot::BaseColor] = sample(&self.base_color, Encoding::Srgb, true);
        let surface = lit && (material.metallic > 0.0 || material.roughness > 0.0);
        material.textures[TextureSlot::MetallicRoughness] = sample(&self.metallic_roughness, Encoding::Linear, surface);
        let bent = lit && material.normal_scale != 0.0;
        material.textures[TextureSlot::Normal] = sample(&self.normal, Encoding::Linear, bent);
        let shines = lit && material.emissive.max_element() > 0.0;
        material.textures[TextureSlot::Emissive] = sample(&self.emissive, Encoding::Srgb, shines);
        // A pure metal without a texture for its metalness has no dielectric part.
        let dielectric = lit && (material.metallic < 1.0 || material.textures[TextureSlot::MetallicRoughness].is_some());
        let specular = dielectric && material.specular > 0.0;
        material.textures[TextureSlot::Specular] = sample(&self.specular, Encoding::Linear, specular);
        let tinted = specular && material.specular_color.max_element() > 0.0;
        material.textures[TextureSlot::SpecularColor] = sample(&self.specular_color, Encoding::Srgb, tinted);
        if self.has_occlusion {
            let text = "occlusion textures are not loaded: light transport computes the occlusion";
            notes.not_loaded(&format!("{}.occlusionTexture", self.at), text);
        }
        if !material.double_sided {
            let text = "doubleSided is false: back faces are shaded, not culled; emission is from the front only";
            notes.convention(&self.at, text);
        }
        material
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

/// The scene's materials, made when a mesh first uses them.
#[derive(Default)]
pub(super) struct MaterialTable {
    pub materials: Vec<scene::Material>,
    by_index: HashMap<Option<usize>, u32>,
}

impl MaterialTable {
    /// The scene's index of a document's material; `None` is the default material.
    pub fn get(
        &mut self,
        document: &Document,
        index: Option<usize>,
        textures: &mut TextureTable,
        notes: &mut Notes,
    ) -> u32 {
        *self.by_index.entry(index).or_insert_with(|| {
            let material = match index {
                Some(index) => document.materials[index].resolve(document, textures, notes),
                None => scene::Material::default(),
            };
            self.materials.push(material);
            (self.materials.len() - 1) as u32
        })
    }

    /// Notes the materials that no mesh uses.
    pub fn note_unused(&self, document: &Document, notes: &mut Notes) {
        for (index, material) in document.materials.iter().enumerate() {
            if !self.by_index.contains_key(&Some(index)) {
                notes.not_loaded(&material.at, "a material that no placed mesh uses");
            }
        }
    }
}
