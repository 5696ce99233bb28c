//! PNG pictures for people, 8 bits a channel.

use std::io;
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::{Background, Pixels, View, atomic};
use crate::Result;

/// Writes the beauty through a view transform, over the window that is kept; with alpha, not premultiplied as PNG has it,
/// where the background is transparent.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, pixels: &dyn Pixels, view: View, exposure_ev: f32) -> Result<()> {
    let [x0, y0, x1, y1] = pixels.window();
    let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
    let stats = places.map(|(x, y)| pixels.at(x, y).0);
    let (width, height) = (x1 - x0, y1 - y0);
    if pixels.background() == Background::Transparent {
        let bytes = stats.flat_map(|p| {
            let alpha = p.coverage();
            let [r, g, b] = view.apply(p.mean().map(|c| c / alpha.max(f32::MIN_POSITIVE)), exposure_ev).map(to_byte);
            [r, g, b, to_byte(alpha)]
        });
        return write_bytes(path, width, height, &bytes.collect::<Vec<_>>(), ExtendedColorType::Rgba8);
    }
    let bytes = stats.flat_map(|p| view.apply(p.mean(), exposure_ev).map(to_byte)).collect::<Vec<_>>();
    write_rgb8(path, width, height, &bytes)
}

/// Writes 8-bit RGB, row-major from the top.
///
/// # Errors
/// As [`atomic::write`].
pub fn write_rgb8(path: &Path, width: u32, height: u32, bytes: &[u8]) -> Result<()> {
    write_bytes(path, width, height, bytes, ExtendedColorType::Rgb8)
}

fn write_bytes(path: &Path, width: u32, height: u32, bytes: &[u8], kind: ExtendedColorType) -> Result<()> {
    atomic::write(path, |file| {
        PngEncoder::new(file).write_image(bytes, width, height, kind).map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })?;
        Ok(Ok(()))
    })
}

/// The byte nearest to a value of [0, 1].
pub fn to_byte(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Film, PixelStats};

    #[test]
    fn a_preview_has_the_windows_size_and_the_views_colours() {
        let mut film = Film::new(10, 10, [2, 3, 5, 5], false);
        for pixel in &mut film.pixels {
            pixel.samples = 2;
            pixel.sum = [2.0, 0.36, f64::NAN];
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write(&path, &film, View::Srgb, 0.0).unwrap();
        let picture = image::open(&path).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (3, 2));
        assert!(picture.pixels().all(|p| p.0 == [255, 118, 0]));
    }

    #[test]
    fn a_transparent_preview_has_the_surfaces_own_colour_and_their_share() {
        let mut film = Film::new(2, 1, [0, 0, 2, 1], false);
        film.background = Background::Transparent;
        film.pixels[0] = PixelStats { samples: 4, covered: 1, sum: [1.0, 0.5, 0.0], ..PixelStats::EMPTY };
        film.pixels[1] = PixelStats { samples: 4, ..PixelStats::EMPTY };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write(&path, &film, View::Srgb, 0.0).unwrap();
        let picture = image::open(&path).unwrap();
        assert_eq!(picture.color(), image::ColorType::Rgba8);
        assert_eq!(picture.into_rgba8().into_raw(), [255, 188, 0, 64, 0, 0, 0, 0]);
    }
}
