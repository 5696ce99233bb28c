//! Uses of textures by materials (glTF's `textureInfo`, with KHR_texture_transform).

use glam::Affine2;
use gltf::json::texture;

use super::json::Json;
use super::typed::read;
use crate::error::Result;
use crate::scene::TextureSlot;

/// A use of a texture by a material.
#[derive(Debug, Clone)]
pub struct TextureInfo {
    pub texture: usize,
    pub set: u32,
    pub transform: Option<Affine2>,
    pub at: String,
}

impl TextureInfo {
    pub fn parse(json: &Json, key: &str) -> Result<Option<Self>> {
        let Some(json) = json.get(key)? else { return Ok(None) };
        // The crate gltf has no transform for normal and occlusion textures; read as plain texture infos they have one.
        let info: texture::Info = read(&json)?;
        let texture = json.need("index", json.index("index", "textures")?)?;
        let own = info.extensions.and_then(|extensions| extensions.texture_transform);
        let set = own.as_ref().and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        let affine = own.map(|t| {
            // The rotation is counter-clockwise in the picture, while v points down (Khronos' TextureTransformTest).
            Affine2::from_scale_angle_translation(t.scale.0.into(), -t.rotation.0, t.offset.0.into())
        });
        Ok(Some(Self { texture, set, transform: affine.filter(|t| *t != Affine2::IDENTITY), at: json.at }))
    }
}

/// Texture uses, indexed by [`TextureSlot`].
pub type TextureInfos = [Option<TextureInfo>; TextureSlot::ALL.len()];
