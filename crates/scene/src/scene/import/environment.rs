//! Equirectangular environment pictures: Radiance `.hdr` and OpenEXR.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::source::read_regular;
use crate::error::{Error, Result};
use crate::film::{exr_file, radiance};
use crate::scene::Environment;

/// 16384x8192.
const MAX_PIXELS: u64 = 1 << 27;
const MAX_FILE_BYTES: u64 = 4 << 30;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EnvironmentSize {
    pub width: u64,
    pub height: u64,
    pub file_bytes: u64,
}

impl EnvironmentSize {
    /// Memory in bytes of the picture and its tables for sampling, one of which has a power of two of entries in each row.
    pub fn bytes(self) -> u64 {
        // Larger pictures are refused.
        let pixels = self.width.saturating_mul(self.height).min(MAX_PIXELS);
        self.file_bytes + 54 * pixels
    }
}

/// An environment's file, opened once, so that the data that is hashed is the data that is rendered.
#[derive(Debug)]
pub struct EnvironmentFile {
    path: PathBuf,
    bytes: Vec<u8>,
    decoded: Mutex<Option<Decoded>>,
}

/// Width and height in pixels, and linear RGB pixels.
type Decoded = (u32, u32, Arc<[[f32; 3]]>);

impl EnvironmentFile {
    /// Reads the file.
    ///
    /// # Errors
    /// The file is missing, not permitted or not regular.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self { path: path.into(), bytes: read_regular(path, MAX_FILE_BYTES)?, decoded: Mutex::default() })
    }

    /// BLAKE3 of the file, hexadecimal.
    pub fn hash(&self) -> String {
        blake3::hash(&self.bytes).to_hex().to_string()
    }

    /// Size of the picture, by the file's header.
    pub fn size(&self) -> EnvironmentSize {
        // Without a readable header decoding reports the fault.
        let size = radiance::size(&self.bytes).filter(|_| self.bytes.starts_with(b"#?"));
        let (width, height) = size.or_else(|| exr_file::size(&self.bytes)).unwrap_or_default();
        EnvironmentSize { width, height, file_bytes: self.bytes.len() as u64 }
    }

    /// Decodes the equirectangular picture; later calls reuse the pixels. `rotation_degrees` rotates it about +y, `strength`
    /// multiplies the radiance.
    ///
    /// NaN and negative values become 0, large and infinite values 65504 (the largest half float), with a warning.
    ///
    /// # Errors
    /// [`Error::Usage`] for a rotation that is not finite, or a strength out of its range; [`Error::Data`] for a picture
    /// that cannot be decoded or has more than 2^27 pixels.
    pub fn decode(&self, rotation_degrees: f32, strength: f32) -> Result<Environment> {
        check_flags(rotation_degrees, strength)?;
        let mut decoded = self.decoded.lock().unwrap_or_else(PoisonError::into_inner);
        let (width, height, pixels) = match &*decoded {
            Some(decoded) => decoded.clone(),
            None => decoded.insert(self.decode_pixels()?).clone(),
        };
        Ok(Environment {
            name: self.path.display().to_string(),
            width,
            height,
            pixels,
            rotation: rotation_degrees.to_radians(),
            strength,
        })
    }

    fn decode_pixels(&self) -> Result<Decoded> {
        let (path, bytes) = (&self.path, &self.bytes);
        let picture = match bytes.as_slice() {
            [b'#', b'?', ..] => read_hdr(bytes),
            [0x76, 0x2F, 0x31, 0x01, ..] => read_exr(bytes),
            _ => Err("neither a Radiance .hdr nor an OpenEXR picture".into()),
        };
        let (width, height, mut pixels) = picture.map_err(|text| {
            let help = "an environment is an equirectangular .hdr or .exr picture with R, G and B";
            Error::Data(format!("{}: {text}; {help}", path.display()))
        })?;
        let Cleaned { invalid, dimmed, brightest } = clean(&mut pixels);
        if invalid > 0 {
            tracing::warn!("{}: {invalid} pixels were NaN, infinite or negative and are changed", path.display());
        }
        if dimmed > 0 {
            tracing::warn!(
                "{}: {dimmed} pixels were brighter than {MAX_RADIANCE}, the largest radiance of an environment, and are dimmed \
                 to it (the brightest had {brightest:e}): scale the picture down and raise --env-strength by as much, or show \
                 a sun as a light of the scene",
                path.display()
            );
        }
        if u64::from(width) != 2 * u64::from(height) {
            tracing::warn!("{}: {width}x{height} is not twice as wide as high; it is stretched", path.display());
        }
        Ok((width, height, pixels.into()))
    }
}

/// Opens and decodes an equirectangular picture ([`EnvironmentFile::decode`]).
///
/// # Errors
/// [`Error::Usage`] for a rotation that is not finite, or a strength out of its range, [`Error::Missing`] for a missing
/// file, [`Error::Data`] for a picture that cannot be decoded or has more than 2^27 pixels.
pub fn environment(path: &Path, rotation_degrees: f32, strength: f32) -> Result<Environment> {
    check_flags(rotation_degrees, strength)?;
    EnvironmentFile::open(path)?.decode(rotation_degrees, strength)
}

fn check_flags(rotation_degrees: f32, strength: f32) -> Result<()> {
    if !rotation_degrees.is_finite() {
        return Err(Error::Usage(format!(
            "environment rotation {rotation_degrees}: wanted degrees as a finite number"
        )));
    }
    let most = Environment::MAX_STRENGTH;
    if !(0.0..=most).contains(&strength) {
        return Err(Error::Usage(format!("environment strength {strength}: wanted a number from 0 to {most:e}")));
    }
    Ok(())
}

type Picture = std::result::Result<(u32, u32, Vec<[f32; 3]>), String>;

fn check_size(width: u64, height: u64, file_bytes: usize) -> std::result::Result<(), String> {
    // The proportion is that of textures: flat colours compress a thousandfold, small pictures always pass.
    let pixels = width.saturating_mul(height);
    let fits = pixels.saturating_mul(12) <= (1 << 30) + 256 * file_bytes as u64;
    if width == 0 || height == 0 || pixels > MAX_PIXELS || !fits {
        return Err(format!("{width}x{height} pixels in {file_bytes} bytes; at most {MAX_PIXELS} can be used"));
    }
    Ok(())
}

fn read_hdr(bytes: &[u8]) -> Picture {
    radiance::decode(bytes, |width, height| check_size(width, height, bytes.len()))
        .map_err(|e| format!("a Radiance picture that cannot be read: {e}"))
}

/// Reads the display window: what lies outside of the data window is black.
fn read_exr(bytes: &[u8]) -> Picture {
    let check = |width, height| check_size(width, height, bytes.len());
    let picture = exr_file::picture(bytes, &check).and_then(|picture| {
        let [x0, y0, x1, y1] = picture.display;
        let (width, height) = ((x1 - x0).max(0) as u64, (y1 - y0).max(0) as u64);
        check(width, height)?;
        let pixels = if picture.window == picture.display { picture.rgb } else { picture.shown() };
        Ok((width as u32, height as u32, pixels))
    });
    picture.map_err(|e| format!("an OpenEXR picture that cannot be read: {e}"))
}

/// What [`clean`] has changed.
#[derive(Debug, Default, PartialEq)]
struct Cleaned {
    /// Pixels with a value that was NaN, infinite or negative.
    invalid: usize,
    /// Other pixels with a value above [`MAX_RADIANCE`].
    dimmed: usize,
    /// The largest value of those.
    brightest: f32,
}

/// Makes every value finite and ≥ 0, and at most [`MAX_RADIANCE`].
fn clean(pixels: &mut [[f32; 3]]) -> Cleaned {
    let mut cleaned = Cleaned::default();
    for pixel in pixels {
        let before = *pixel;
        for x in pixel.iter_mut() {
            *x = if x.is_nan() { 0.0 } else { x.clamp(0.0, MAX_RADIANCE) };
        }
        if before.iter().any(|x| !x.is_finite() || *x < 0.0) {
            cleaned.invalid += 1;
        } else if before.iter().any(|x| *x > MAX_RADIANCE) {
            cleaned.dimmed += 1;
            cleaned.brightest = before.into_iter().fold(cleaned.brightest, f32::max);
        }
    }
    cleaned
}

/// Largest half float: sums over a map of such pixels stay finite.
const MAX_RADIANCE: f32 = 65504.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cleaning_leaves_light_alone_and_counts_the_rest() {
        let mut pixels = [[1.0, 0.0, 2.5], [f32::NAN, 1.0, 1.0], [-1.0, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0]];
        assert_eq!(clean(&mut pixels), Cleaned { invalid: 3, ..Default::default() });
        assert_eq!(pixels, [[1.0, 0.0, 2.5], [0.0, 1.0, 1.0], [0.0; 3], [65504.0, 0.0, 0.0]]);
        let mut suns = [[1e5, 2.0, 0.0], [1e7, 1.0, 1.0], [65504.0; 3], [-1.0, 1e9, 0.0]];
        assert_eq!(clean(&mut suns), Cleaned { invalid: 1, dimmed: 2, brightest: 1e7 });
        assert_eq!(suns, [[65504.0, 2.0, 0.0], [65504.0, 1.0, 1.0], [65504.0; 3], [0.0, 65504.0, 0.0]]);
    }
}
