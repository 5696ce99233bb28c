//! Reads pictures of any supported format.

use std::io::Cursor;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageFormat, ImageReader};

use super::picture::Picture;
use super::view::srgb_decode;
use super::{exr_file, radiance};
use crate::{Error, Result};

impl Picture {
    /// Reads an OpenEXR, Radiance HDR, PNG or JPEG file; the format follows from its content. `layer` chooses a layer or a
    /// single channel of an OpenEXR file instead of the beauty, for example `albedo` or `depth.Z`.
    ///
    /// # Errors
    /// [`Error::reading`] for a file that cannot be read; [`Error::Data`] for one that is no such picture or lacks the layer.
    pub fn open(path: &Path, layer: Option<&str>) -> Result<Self> {
        Self::open_all(path, &[layer]).map(|mut all| all.remove(0))
    }

    /// Reads layers of a file as [`open`](Self::open) reads one.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn open_all(path: &Path, layers: &[Option<&str>]) -> Result<Vec<Self>> {
        let bytes = exr_file::bytes_of(path)?;
        let refused = |why: String| Error::Data(format!("{}: {why}", path.display()));
        let format = match bytes.get(..4) {
            Some([0x76, 0x2F, 0x31, 0x01]) => {
                return exr_file::layers(&bytes, layers).map_err(|why| exr_file::cannot_use(path, &why));
            }
            Some([b'#', b'?', ..]) => None,
            Some([0x89, b'P', b'N', b'G']) => Some(ImageFormat::Png),
            Some([0xFF, 0xD8, 0xFF, _]) => Some(ImageFormat::Jpeg),
            _ => return Err(exr_file::cannot_use(path, "it is none, nor Radiance HDR, PNG or JPEG")),
        };
        if let Some(layer) = layers.iter().flatten().next() {
            return Err(refused(format!("has no layers, so no '{layer}': only OpenEXR files have")));
        }
        let picture = match format {
            None => Self::of_radiance(&bytes),
            Some(format) => ImageReader::with_format(Cursor::new(&bytes), format)
                .decode()
                .map(Self::of_image)
                .map_err(|e| e.to_string()),
        };
        let picture = picture.map_err(|e| refused(format!("cannot use this picture: {e}")))?;
        Ok(vec![picture; layers.len()])
    }

    fn of_radiance(bytes: &[u8]) -> std::result::Result<Self, String> {
        let (width, height, rgb) = radiance::decode(bytes, |_, _| Ok(()))?;
        let window = [0, 0, width.into(), height.into()];
        let (variance, alpha) = (None, None);
        Ok(Self { window, display: window, rgb, variance, alpha, displayed: false, mean_variance: [1.0; 3] })
    }

    fn of_image(image: DynamicImage) -> Self {
        let displayed = !matches!(image.color(), ColorType::Rgb32F | ColorType::Rgba32F);
        let has_alpha = image.color().has_alpha();
        let (width, height) = (i64::from(image.width()), i64::from(image.height()));
        let pixels = image.into_rgba32f();
        let pixels = pixels.as_raw().as_chunks::<4>().0;
        let linear = |x: f32| if displayed { srgb_decode(x) } else { x };
        let rgb = pixels.iter().map(|&[r, g, b, a]| {
            // The colours of PNG are not premultiplied.
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
            mean_variance: [1.0; 3],
        }
    }
}
