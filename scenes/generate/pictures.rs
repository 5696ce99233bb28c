//! Procedural pictures: textures that repeat, and skies.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, dvec3};
use image::codecs::hdr::HdrEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageBuffer, ImageError, Pixel, PixelWithColorType, Rgb, RgbImage, Rgba, RgbaImage};

use crate::random::{fractal, hash};

pub fn png<P>(picture: &ImageBuffer<P, Vec<u8>>) -> Result<Vec<u8>, ImageError>
where
    P: Pixel<Subpixel = u8> + PixelWithColorType,
{
    let mut bytes = Vec::new();
    picture.write_with_encoder(PngEncoder::new_with_quality(
        &mut bytes,
        CompressionType::Best,
        FilterType::Adaptive,
    ))?;
    Ok(bytes)
}

/// A picture with an alpha of 0 or 1, from a function of (u, v) at the texel centres, v downwards; linear colour.
pub fn masked(width: u32, height: u32, at: impl Fn(f64, f64) -> ([f64; 3], bool)) -> RgbaImage {
    RgbaImage::from_fn(width, height, |x, y| {
        let (color, inside) = at((f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height));
        let [r, g, b] = encode(DVec3::from_array(color)).map(byte);
        Rgba([r, g, b, if inside { 255 } else { 0 }])
    })
}

pub fn jpeg(picture: &RgbImage, quality: u8) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality))?;
    Ok(bytes)
}

/// A picture from a function of (u, v) at the texel centres, v downwards.
pub fn paint(width: u32, height: u32, at: impl Fn(f64, f64) -> [f64; 3]) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb(at((f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height)).map(byte))
    })
}

fn byte(c: f64) -> u8 {
    (c.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// sRGB-encoded.
fn encode(linear: DVec3) -> [f64; 3] {
    linear.to_array().map(|c| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 })
}

/// The normal map of a height field over (u, v) in [0, 1)² that repeats; `depth` is the height's unit in widths of
/// the picture, `aspect` the picture's width over its height.
pub fn normals(width: u32, height: u32, depth: f64, aspect: f64, field: impl Fn(f64, f64) -> f64) -> RgbImage {
    let (du, dv) = (1.0 / f64::from(width), 1.0 / f64::from(height));
    paint(width, height, |u, v| {
        let slope_u = (field(u + du, v) - field(u - du, v)) / (2.0 * du) * depth;
        // v grows downwards, the map's green upwards.
        let slope_v = (field(u, v - dv) - field(u, v + dv)) / (2.0 * dv) * depth * aspect;
        (dvec3(-slope_u, -slope_v, 1.0).normalize() * 0.5 + 0.5).to_array()
    })
}

/// Boards along u, four over v.
pub mod wood {
    use super::*;

    const BOARDS: i64 = 4;

    /// Which board, and how far across it in [0, 1).
    fn board(v: f64) -> (i64, f64) {
        let across = v.rem_euclid(1.0) * BOARDS as f64;
        (across as i64, across.fract())
    }

    /// 1 in the gap between two boards, else 0.
    fn gap(v: f64) -> f64 {
        let (_, across) = board(v);
        (1.0 - across.min(1.0 - across) / 0.012).clamp(0.0, 1.0)
    }

    /// Year rings cut lengthwise, dark lines at 1.
    fn rings(u: f64, v: f64) -> f64 {
        let (index, across) = board(v);
        let shift = hash(index, 7, 3);
        let bend = fractal(u + shift, v, (2, 6), 3, 11);
        let lines = (TAU * (across * 5.0 + shift * 9.0 + bend * 5.5)).sin() * 0.5 + 0.5;
        lines * lines
    }

    /// Fine fibres.
    fn fibres(u: f64, v: f64) -> f64 {
        fractal(u, v, (6, 160), 2, 29)
    }

    pub fn color(width: u32, height: u32) -> RgbImage {
        paint(width, height, |u, v| {
            let (index, _) = board(v);
            let tone = 0.78 + 0.44 * hash(index, 1, 5);
            let patch = fractal(u, v, (3, 8), 3, 41);
            let dark = 0.42 * rings(u, v) + 0.38 * fibres(u, v) + 0.35 * patch;
            let base = dvec3(0.235, 0.118, 0.054).lerp(dvec3(0.062, 0.026, 0.012), dark.min(1.0)) * tone;
            encode(base * (1.0 - 0.85 * gap(v)))
        })
    }

    /// Roughness in green, metalness 0 in blue.
    pub fn roughness(width: u32, height: u32) -> RgbImage {
        paint(width, height, |u, v| {
            let wear = fractal(u, v, (3, 4), 4, 53);
            [0.0, 0.26 + 0.16 * fibres(u, v) + 0.16 * rings(u, v) + 0.22 * (wear - 0.5) + 0.3 * gap(v), 0.0]
        })
    }

    pub fn normal(width: u32, height: u32) -> RgbImage {
        normals(width, height, 0.0011, 2.0, |u, v| 0.5 * fibres(u, v) - 0.35 * rings(u, v) - 2.0 * gap(v))
    }
}

/// Trowelled plaster: brightness, as a picture, and its relief.
pub mod plaster {
    use super::*;

    fn relief(u: f64, v: f64) -> f64 {
        fractal(u, v, (5, 5), 4, 71)
    }

    pub fn color(size: u32) -> RgbImage {
        paint(size, size, |u, v| {
            let stain = fractal(u, v, (3, 3), 4, 97);
            encode(dvec3(0.40, 0.365, 0.30) * (0.78 + 0.34 * stain + 0.14 * (relief(u, v) - 0.5)))
        })
    }

    pub fn normal(size: u32) -> RgbImage {
        normals(size, size, 0.02, 1.0, relief)
    }
}

/// A clear sky with a sun, as an equirectangular Radiance picture: direction (x, y, z) lies at u = 0.5 + atan2(z, x) /
/// 2π, v = acos(y) / π from the top.
pub struct Sky {
    pub sun: DVec3,
    /// Degrees.
    pub sun_radius: f64,
    pub sun_radiance: DVec3,
    pub zenith: DVec3,
    pub horizon: DVec3,
    pub ground: DVec3,
    /// Added towards the sun's side of the horizon.
    pub glow: DVec3,
}

impl Sky {
    pub fn hdr(&self, width: u32, height: u32) -> Result<Vec<u8>, ImageError> {
        let (sun, sun_radius) = (self.sun.normalize(), self.sun_radius.to_radians());
        let direction = |u: f64, v: f64| {
            let ((sin_t, cos_t), (sin_p, cos_p)) = ((v * PI).sin_cos(), ((u - 0.5) * TAU).sin_cos());
            dvec3(sin_t * cos_p, cos_t, sin_t * sin_p)
        };
        let mut pixels = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let d = direction((f64::from(x) + 0.5) / f64::from(width), (f64::from(y) + 0.5) / f64::from(height));
                let up = d.y.max(0.0).sqrt();
                let sky = if d.y >= 0.0 { self.horizon.lerp(self.zenith, up) } else { self.ground };
                let near = d.dot(sun).max(0.0);
                let haze =
                    if d.y >= 0.0 { self.glow * (0.8 * near.powi(6) + 2.5 * near.powi(90)) } else { DVec3::ZERO };
                // How much of the texel the sun covers, by sub-samples.
                let covered = if near > 0.9 {
                    (0..256)
                        .map(|i| (f64::from(i % 16) + 0.5, f64::from(i / 16) + 0.5))
                        .map(|(i, j)| {
                            direction(
                                (f64::from(x) + i / 16.0) / f64::from(width),
                                (f64::from(y) + j / 16.0) / f64::from(height),
                            )
                        })
                        .filter(|d| d.angle_between(sun) < sun_radius)
                        .count() as f64
                        / 256.0
                } else {
                    0.0
                };
                pixels.push(Rgb((sky + haze + self.sun_radiance * covered).as_vec3().to_array()));
            }
        }
        let mut bytes = Vec::new();
        HdrEncoder::new(&mut bytes).encode(&pixels, width as usize, height as usize)?;
        Ok(bytes)
    }
}
