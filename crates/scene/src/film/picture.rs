//! Pictures of any origin, to be compared and developed.

use std::io::Cursor;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageFormat, ImageReader};

use super::exr_file;
use crate::{Error, Result};

/// A picture that was read.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The data window: x0, y0, x1, y1, the last two exclusive.
    pub window: [i64; 4],
    /// The display window, as `window`: the whole picture of which `window` has pixels.
    pub display: [i64; 4],
    /// Linear RGB, row-major over `window`.
    pub rgb: Vec<[f32; 3]>,
    /// Variance of each value of `rgb` from the layer `variance`, if the file has one.
    pub variance: Option<Vec<[f32; 3]>>,
    /// Coverage of each pixel from the channel A, if the file has one. `rgb` is premultiplied by it.
    pub alpha: Option<Vec<f32>>,
    /// Are its values those of a screen, at most 1, as in a PNG?
    pub displayed: bool,
}

impl Picture {
    /// Reads OpenEXR, Radiance HDR, PNG or JPEG, by content. `layer`, of OpenEXR alone: another layer than the beauty, or a
    /// single channel, as in `albedo` or `depth.Z`.
    ///
    /// # Errors
    /// Missing, forbidden or failing files as [`Error::reading`]; [`Error::Data`] for what is no such picture or lacks
    /// the layer.
    pub fn open(path: &Path, layer: Option<&str>) -> Result<Self> {
        let bytes = exr_file::bytes_of(path)?;
        let refused = |why: String| Error::Data(format!("{}: {why}", path.display()));
        let format = match bytes.get(..4) {
            Some([0x76, 0x2F, 0x31, 0x01]) => {
                return exr_file::layer(&bytes, layer)
                    .map_err(|why| refused(format!("cannot use this OpenEXR file: {why}")));
            }
            Some([b'#', b'?', ..]) => ImageFormat::Hdr,
            Some([0x89, b'P', b'N', b'G']) => ImageFormat::Png,
            Some([0xFF, 0xD8, 0xFF, _]) => ImageFormat::Jpeg,
            _ => return Err(refused("cannot use this OpenEXR file: it is none, nor Radiance HDR, PNG or JPEG".into())),
        };
        if let Some(layer) = layer {
            return Err(refused(format!("has no layers, so no '{layer}': only OpenEXR files have")));
        }
        let decoded = ImageReader::with_format(Cursor::new(&bytes), format).decode();
        let image = decoded.map_err(|e| refused(format!("cannot use this picture: {e}")))?;
        Ok(Self::of_image(image))
    }

    fn of_image(image: DynamicImage) -> Self {
        let displayed = !matches!(image.color(), ColorType::Rgb32F | ColorType::Rgba32F);
        let has_alpha = image.color().has_alpha();
        let (width, height) = (i64::from(image.width()), i64::from(image.height()));
        let pixels = image.into_rgba32f();
        let pixels = pixels.as_raw().as_chunks::<4>().0;
        let linear = |x: f32| if displayed { srgb_decode(x) } else { x };
        let rgb = pixels.iter().map(|&[r, g, b, a]| {
            // PNG's colours are not premultiplied.
            [r, g, b].map(|x| if has_alpha { linear(x) * a } else { linear(x) })
        });
        let window = [0, 0, width, height];
        Self {
            window,
            display: window,
            rgb: rgb.collect(),
            variance: None,
            alpha: has_alpha.then(|| pixels.iter().map(|p| p[3]).collect()),
            displayed,
        }
    }

    /// What it shows of a window that lies in its own.
    pub fn within(&self, window: [i64; 4]) -> Self {
        let [x0, y0, x1, y1] = window;
        let [width, _] = self.size();
        let places: Vec<usize> = (y0..y1)
            .flat_map(|y| (x0..x1).map(move |x| (x, y)))
            .map(|(x, y)| (y - self.window[1]) as usize * width + (x - self.window[0]) as usize)
            .collect();
        let colors = |all: &[[f32; 3]]| places.iter().map(|i| all[*i]).collect();
        Self {
            window,
            display: self.display,
            rgb: colors(&self.rgb),
            variance: self.variance.as_deref().map(colors),
            alpha: self.alpha.as_ref().map(|all| places.iter().map(|i| all[*i]).collect()),
            displayed: self.displayed,
        }
    }

    /// Pixels a row, and rows.
    pub fn size(&self) -> [usize; 2] {
        let [x0, y0, x1, y1] = self.window;
        [(x1 - x0) as usize, (y1 - y0) as usize]
    }
}

/// The inverse of [`srgb_encode`](super::view::srgb_encode), on [0, 1].
fn srgb_decode(x: f32) -> f32 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}
