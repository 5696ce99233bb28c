//! Pictures with 8 bits per channel: PNG, JPEG and WebP.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder};
use png::{BitDepth, ColorType, Compression, DecodeOptions, Decoder, Encoder};

use super::atomic;
use super::picture::Picture;
use super::pixels::{Background, Pixels, positions};
use super::view::ViewTransform;
use crate::Result;

/// How a picture is converted for display.
#[derive(Debug, Clone)]
pub struct Look {
    pub view: ViewTransform,
    /// Exposure in stops.
    pub exposure: f32,
}

/// The pixels of a window, before the view transform.
struct Raster<I> {
    /// The window's upper left corner in the whole picture, in pixels.
    corner: [i64; 2],
    size: [u32; 2],
    /// Linear RGB, premultiplied, and alpha, row by row.
    pixels: I,
    transparent: bool,
}

/// Endings of the names of files that can be written. WebP is lossless. JPEG has no alpha: pictures are over black.
pub const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];
/// Quality of JPEG, of 100.
const JPEG_QUALITY: u8 = 92;

/// Can a file of this name be written?
pub fn has_ending(path: &Path) -> bool {
    path.extension().is_some_and(|end| ENDINGS.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

/// Keyword of the text chunk in a PNG that identifies its source.
const KEYWORD: &str = "bismar";

/// Writes the beauty of a window through a view transform. If the background is transparent the PNG has an alpha channel and
/// colours that are not premultiplied. The name's ending chooses the format. [`mark`] reads `mark` back from a PNG.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write(path: &Path, pixels: &dyn Pixels, look: &Look, mark: &str) -> Result<()> {
    let [x0, y0, x1, y1] = pixels.window();
    let raster = Raster {
        corner: [x0.into(), y0.into()],
        size: [x1 - x0, y1 - y0],
        pixels: positions(pixels).map(|(x, y)| pixels.at(x, y)).map(|(p, sums)| (p.mean(), p.coverage() + sums.shadow)),
        transparent: pixels.background() == Background::Transparent,
    };
    let (size, (bytes, kind)) = (raster.size, raster.develop(look));
    write_bytes(path, size, &bytes, kind, mark)
}

/// Writes a picture that was read from a file through a view transform; with an alpha channel if it has one and `opaque` is not
/// set. [`mark`] reads `mark` back from a PNG.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write_picture(path: &Path, picture: &Picture, opaque: bool, look: &Look, mark: &str) -> Result<()> {
    let (bytes, kind) = developed(picture, opaque, look);
    write_bytes(path, picture.size().map(|n| n as u32), &bytes, kind, mark)
}

/// Encodes a picture as an opaque PNG.
///
/// # Errors
/// [`Error::Bug`](crate::Error::Bug) if the encoder fails.
pub fn encoded_picture(picture: &Picture, look: &Look) -> Result<Vec<u8>> {
    let [width, height] = picture.size().map(|n| n as u32);
    encoded(width, height, &developed(picture, true, look).0)
}

/// Encodes 8-bit RGB, row-major from the top, as a PNG.
///
/// # Errors
/// [`Error::Bug`](crate::Error::Bug) if the encoder fails.
pub fn encoded(width: u32, height: u32, bytes: &[u8]) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    match encode(&mut file, [width, height], bytes, (ColorType::Rgb, BitDepth::Eight), "") {
        Ok(()) => Ok(file),
        Err(e) => Err(crate::Error::Bug(format!("a PNG: {e}"))),
    }
}

fn developed(picture: &Picture, opaque: bool, look: &Look) -> (Vec<u8>, ColorType) {
    let alpha = picture.alpha.as_deref().filter(|alpha| !opaque && alpha.iter().any(|a| *a < 1.0));
    let alpha_of = |i: usize| alpha.map_or(1.0, |alpha| alpha[i]);
    let raster = Raster {
        corner: [picture.window[0], picture.window[1]],
        size: picture.size().map(|n| n as u32),
        pixels: picture.rgb.iter().enumerate().map(|(i, color)| (*color, alpha_of(i))),
        transparent: alpha.is_some(),
    };
    raster.develop(look)
}

impl<I: Iterator<Item = ([f32; 3], f32)>> Raster<I> {
    /// The display-encoded bytes of the pixels, row by row, and their colour type.
    fn develop(self, look: &Look) -> (Vec<u8>, ColorType) {
        let [width, height] = self.size;
        let mut bytes = Vec::with_capacity(width as usize * height as usize * if self.transparent { 4 } else { 3 });
        for (i, (color, alpha)) in (0_i64..).zip(self.pixels) {
            let at = [self.corner[0] + i % i64::from(width), self.corner[1] + i / i64::from(width)];
            let shown = |color| look.view.apply(color, look.exposure).map(|x| dithered(x, at));
            if self.transparent {
                bytes.extend(shown(color.map(|c| c / alpha.max(f32::MIN_POSITIVE))));
                bytes.push(to_byte(alpha));
            } else {
                bytes.extend(shown(color));
            }
        }
        (bytes, if self.transparent { ColorType::Rgba } else { ColorType::Rgb })
    }
}

/// Writes 8-bit RGB, row-major from the top.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write_rgb8(path: &Path, width: u32, height: u32, bytes: &[u8]) -> Result<()> {
    write_bytes(path, [width, height], bytes, ColorType::Rgb, "")
}

/// Writes 16-bit values as a PNG, row-major from the top: grey, or RGB if there are three for each pixel.
///
/// # Errors
/// The errors of [`atomic::write`].
pub fn write_png16(path: &Path, [width, height]: [u32; 2], values: &[u16]) -> Result<()> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    let grey = values.len() == width as usize * height as usize;
    let kind = (if grey { ColorType::Grayscale } else { ColorType::Rgb }, BitDepth::Sixteen);
    atomic::write(path, |file| encode(file, [width, height], &bytes, kind, "").map(Ok))
}

fn write_bytes(path: &Path, size: [u32; 2], bytes: &[u8], kind: ColorType, mark: &str) -> Result<()> {
    let ending = path.extension().map(|end| end.to_ascii_lowercase()).unwrap_or_default();
    atomic::write(path, |file| {
        match ending.to_str() {
            Some("jpg" | "jpeg") => encode_jpeg(file, size, bytes, kind)?,
            Some("webp") => encode_webp(file, size, bytes, kind)?,
            _ => encode(file, size, bytes, (kind, BitDepth::Eight), mark)?,
        }
        Ok(Ok(()))
    })
}

fn encode_jpeg(file: impl io::Write, [width, height]: [u32; 2], bytes: &[u8], kind: ColorType) -> io::Result<()> {
    let over_black = |pixel: &[u8]| -> [u8; 3] {
        std::array::from_fn(|c| ((u16::from(pixel[c]) * u16::from(pixel[3]) + 127) / 255) as u8)
    };
    let flat: Vec<u8>;
    let opaque = match kind {
        ColorType::Rgba => {
            flat = bytes.chunks_exact(4).flat_map(over_black).collect();
            &flat
        }
        _ => bytes,
    };
    let encoder = JpegEncoder::new_with_quality(file, JPEG_QUALITY);
    encoder.write_image(opaque, width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)
}

fn encode_webp(file: &mut impl io::Write, [width, height]: [u32; 2], bytes: &[u8], kind: ColorType) -> io::Result<()> {
    let (own, flags) =
        if kind == ColorType::Rgba { (ExtendedColorType::Rgba8, 0x10) } else { (ExtendedColorType::Rgb8, 0) };
    let mut plain = Vec::new();
    WebPEncoder::new_lossless(&mut plain).write_image(bytes, width, height, own).map_err(io::Error::other)?;
    // Only the extended format may have chunks besides the picture: the mark.
    let sides = [width, height].map(|side| (side - 1).to_le_bytes());
    file.write_all(b"RIFF")?;
    file.write_all(&(plain.len() as u32 - 8 + 18).to_le_bytes())?;
    file.write_all(b"WEBPVP8X\x0a\0\0\0")?;
    file.write_all(&[flags, 0, 0, 0])?;
    sides.iter().try_for_each(|side| file.write_all(&side[..3]))?;
    file.write_all(&plain[12..])
}

fn encode(
    file: impl io::Write,
    [width, height]: [u32; 2],
    bytes: &[u8],
    (kind, depth): (ColorType, BitDepth),
    mark: &str,
) -> io::Result<()> {
    let mut encoder = Encoder::new(file, width, height);
    encoder.set_color(kind);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Balanced);
    match mark {
        "" => encoder.add_text_chunk("Software".into(), "bismar".into())?,
        mark => encoder.add_text_chunk(KEYWORD.into(), mark.into())?,
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    Ok(writer.finish()?)
}

/// The mark with which a PNG was written; `None` if it has none, cannot be read, or is damaged: every byte is checked.
pub fn mark(path: &Path) -> Option<String> {
    let mut options = DecodeOptions::default();
    options.set_ignore_checksums(false);
    options.set_skip_ancillary_crc_failures(false);
    let mut file = BufReader::new(File::open(path).ok()?);
    let mut reader = Decoder::new_with_options(&mut file, options).read_info().ok()?;
    while reader.next_row().ok()?.is_some() {}
    // All rows may be there before the end of the file, and of its last checksum.
    reader.finish().ok()?;
    let text = &reader.info().uncompressed_latin1_text;
    let mark = text.iter().find(|chunk| chunk.keyword == KEYWORD).map(|chunk| chunk.text.clone());
    drop(reader);
    // Nothing may follow.
    file.read(&mut [0]).ok().filter(|more| *more == 0).and(mark)
}

/// The byte nearest to a value in [0, 1].
pub fn to_byte(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}

/// Dithers a value in [0, 1] to one of the two nearest bytes, so that smooth gradients show no bands. Exact bytes do not change.
/// The noise is interleaved gradient noise (Jimenez, "Next Generation Post Processing in Call of Duty", SIGGRAPH 2014) by the
/// position in the whole picture, so that a crop has the same bytes.
fn dithered(x: f32, at: [i64; 2]) -> u8 {
    let along = 0.067_110_56 * at[0] as f64 + 0.005_837_15 * at[1] as f64;
    let noise = (52.982_918_9 * along.rem_euclid(1.0)).rem_euclid(1.0) as f32;
    (x * 255.0 + noise.clamp(0.001, 0.999)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Film, PixelStats, View};

    const LOOK: Look = Look { view: ViewTransform::Named(View::Srgb), exposure: 0.0 };

    #[test]
    fn a_preview_has_the_windows_size_and_the_views_colours() {
        let mut film = Film::new(300, 300, [2, 3, 102, 102], false);
        for pixel in &mut film.pixels {
            pixel.samples = 2;
            pixel.sum = [2.0, 0.36, f64::NAN];
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write(&path, &film, &LOOK, "of a film").unwrap();
        assert_eq!(mark(&path).as_deref(), Some("of a film"));
        let picture = image::open(&path).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (100, 99));
        // 0.18 is 117.65 of 255: that in the mean, and nothing but its neighbours.
        assert!(picture.pixels().all(|p| [p.0[0], p.0[2]] == [255, 0] && [117, 118].contains(&p.0[1])));
        let mean = picture.pixels().map(|p| f64::from(p.0[1])).sum::<f64>() / 9900.0;
        assert!((mean - 117.646).abs() < 0.01, "{mean}");
        // A crop has the whole's bytes.
        film.window = [2, 3, 101, 103];
        film.pixels.truncate(9900);
        write(&path, &film, &LOOK, "").unwrap();
        let crop = image::open(&path).unwrap().into_rgb8();
        assert!((0..99).all(|y| (0..99).all(|x| picture[(x, y)] == crop[(x, y)])));
        assert_eq!(mark(&path), None);
    }

    #[test]
    fn a_damaged_preview_has_no_mark() {
        let mut film = Film::new(9, 7, [0, 0, 9, 7], false);
        (0..).zip(&mut film.pixels).for_each(|(i, pixel)| (pixel.samples, pixel.sum) = (1, [0.01 * f64::from(i); 3]));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write(&path, &film, &LOOK, "of a film").unwrap();
        let whole = std::fs::read(&path).unwrap();
        let believed = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            mark(&path).is_some_and(|mark| mark == "of a film")
        };
        assert!(believed(&whole));
        for (at, bit) in (0..whole.len()).flat_map(|at| [0, 3, 7].map(|bit| (at, bit))) {
            let mut flipped = whole.clone();
            flipped[at] ^= 1 << bit;
            assert!(!believed(&flipped), "bit {bit} of byte {at} of {}", whole.len());
        }
        (0..whole.len()).for_each(|length| assert!(!believed(&whole[..length]), "{length} of {}", whole.len()));
        assert!(!believed(&[&whole[..], b"x"].concat()));
    }

    #[test]
    fn a_transparent_preview_has_the_surfaces_own_colour_and_their_share() {
        let mut film = Film::new(2, 1, [0, 0, 2, 1], false);
        film.background = Background::Transparent;
        film.pixels[0] = PixelStats { samples: 4, covered: 1, sum: [1.0, 0.0, 0.0], ..PixelStats::EMPTY };
        film.pixels[1] = PixelStats { samples: 4, ..PixelStats::EMPTY };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write(&path, &film, &LOOK, "").unwrap();
        let picture = image::open(&path).unwrap();
        assert_eq!(picture.color(), image::ColorType::Rgba8);
        assert_eq!(picture.into_rgba8().into_raw(), [255, 0, 0, 64, 0, 0, 0, 0]);
    }
}
