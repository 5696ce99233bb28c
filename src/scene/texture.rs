//! Pictures, samplers and texture look-up.

use glam::{Vec2, Vec4};

use super::{Encoding, Scene, TextureRef};

/// What happens outside [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// The edge texel goes on.
    ClampToEdge,
    /// Every second copy is mirrored.
    MirroredRepeat,
    /// Copies.
    Repeat,
}

/// Magnification filter; minification is by supersampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// The texel that the point lies in.
    Nearest,
    /// Bilinear.
    Linear,
}

/// Texels as they were stored, row-major from the top.
#[derive(Debug, Clone)]
pub enum Texels {
    /// 8-bit RGB.
    Rgb8(Vec<[u8; 3]>),
    /// 8-bit RGBA.
    Rgba8(Vec<[u8; 4]>),
    /// 16-bit RGBA.
    Rgba16(Vec<[u16; 4]>),
}

/// A decoded picture.
#[derive(Debug, Clone)]
pub struct Image {
    /// Name or URI, for messages.
    pub name: String,
    /// Pixels a row, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Texels,
}

/// A picture with its sampler.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Index into [`Scene::images`].
    pub image: u32,
    /// Along u.
    pub wrap_s: Wrap,
    /// Along v.
    pub wrap_t: Wrap,
    /// Magnification filter.
    pub filter: Filter,
}

impl Scene {
    /// Linear RGBA in [0, 1] of a texture at coordinates `uv` (already of the set that `texture` names). The
    /// coordinates' transform is applied here. Non-finite coordinates read texel (0, 0).
    pub fn sample_texture(&self, texture: &TextureRef, uv: Vec2) -> Vec4 {
        let _ = (texture, uv, Encoding::Srgb);
        todo!("texture look-up")
    }
}
