//! Uses of textures by materials (glTF's `textureInfo`, with KHR_texture_transform).

use glam::Affine2;
use gltf::json::texture;

use super::json::Json;
use super::lengths::Lengths;
use super::typed::read;
use crate::error::Result;
use crate::scene::TextureSlot;

/// A use of a texture, as the document has it.
#[derive(Debug, Clone)]
pub struct TextureInfo {
    pub texture: usize,
    pub set: u32,
    pub transform: Option<Affine2>,
    pub at: String,
}

impl TextureInfo {
    pub fn parse(json: &Json, key: &str, lengths: &Lengths) -> Result<Option<Self>> {
        let Some(json) = json.get(key)? else { return Ok(None) };
        // The crate knows no transform of normal and occlusion textures; as plain textures they have one.
        let info: texture::Info = read(&json)?;
        let texture = json.need("index", json.index("index", lengths.textures, "textures")?)?;
        let own = info.extensions.and_then(|extensions| extensions.texture_transform);
        let set = own.as_ref().and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        let affine = own.map(|t| {
            // The rotation is counter-clockwise as seen, and v runs down; Khronos' TextureTransformTest agrees.
            Affine2::from_scale_angle_translation(t.scale.0.into(), -t.rotation.0, t.offset.0.into())
        });
        Ok(Some(Self { texture, set, transform: affine.filter(|t| *t != Affine2::IDENTITY), at: json.at }))
    }
}

/// By [`TextureSlot`].
pub type TextureInfos = [Option<TextureInfo>; TextureSlot::ALL.len()];
