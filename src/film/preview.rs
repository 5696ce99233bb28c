//! PNG pictures for people, 8 bits a channel.

use std::io;
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::{Pixels, View, atomic};
use crate::Result;

/// Writes the beauty through a view transform, over the window that is kept.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, pixels: &dyn Pixels, view: View, exposure_ev: f32) -> Result<()> {
    let [x0, y0, x1, y1] = pixels.window();
    let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
    let bytes =
        places.flat_map(|(x, y)| view.apply(pixels.at(x, y).0.mean(), exposure_ev).map(to_byte)).collect::<Vec<_>>();
    write_rgb8(path, x1 - x0, y1 - y0, &bytes)
}

/// Writes 8-bit RGB, row-major from the top.
///
/// # Errors
/// As [`atomic::write`].
pub fn write_rgb8(path: &Path, width: u32, height: u32, bytes: &[u8]) -> Result<()> {
    atomic::write(path, |file| {
        PngEncoder::new(file).write_image(bytes, width, height, ExtendedColorType::Rgb8).map_err(|e| match e {
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
    use crate::film::Film;

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
}
