//! Small pictures inside of a page, and false colours.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bismar::{Error, Result};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

/// 8-bit RGB, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    /// Three bytes a pixel.
    pub bytes: Vec<u8>,
}

impl Picture {
    /// One colour in [0, 1] a pixel.
    pub fn new(width: u32, height: u32, colors: impl Iterator<Item = [f32; 3]>) -> Self {
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        Self { width, height, bytes: colors.flat_map(|c| c.map(byte)).collect() }
    }

    /// Values in false colours.
    pub fn mapped(width: u32, height: u32, scale: ColorScale, values: impl Iterator<Item = f64>) -> Self {
        Self::new(width, height, values.map(|v| scale.color(v)))
    }

    /// The square of `2 * radius + 1` pixels around one; what is beyond the edge repeats it.
    pub fn around(&self, [x, y]: [u32; 2], radius: u32) -> Self {
        let side = 2 * radius + 1;
        let near = |center: u32, i: u32, end: u32| (center + i).saturating_sub(radius).min(end - 1);
        let mut bytes = Vec::with_capacity((3 * side * side) as usize);
        for j in 0..side {
            for i in 0..side {
                let at = 3 * (near(y, j, self.height) * self.width + near(x, i, self.width)) as usize;
                bytes.extend_from_slice(&self.bytes[at..at + 3]);
            }
        }
        Self { width: side, height: side, bytes }
    }

    pub fn data_uri(&self) -> Result<String> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png)
            .write_image(&self.bytes, self.width, self.height, ExtendedColorType::Rgb8)
            .map_err(|e| Error::Bug(format!("PNG: {e}")))?;
        Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
    }
}

/// Colours of numbers; steps of equal size look equally large, also to the colour-blind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColorScale {
    /// From `low` to `high` on a logarithmic scale, dark to bright (inferno, by N. Smith and S. van der Walt).
    Amount { low: f64, high: f64 },
    /// From `-1` (blue) through 0 (pale) to 1 (red) (RdBu, by C. Brewer), of (value − middle)/half-width.
    Difference { middle: f64, half_width: f64 },
    /// From 1/`factor` (blue) through 1 (pale) to `factor` (red), logarithmic.
    Ratio { factor: f64 },
}

const INFERNO: [u32; 9] = [0x000004, 0x1f0c48, 0x550f6d, 0x88226a, 0xba3655, 0xe35933, 0xf98e09, 0xf9cb35, 0xfcffa4];
const RED_BLUE: [u32; 9] = [0x053061, 0x2166ac, 0x5ea3cd, 0xc1ddec, 0xf7f7f7, 0xfbcfb7, 0xe58368, 0xb2182b, 0x67001f];

impl ColorScale {
    /// Colour in [0, 1] of a value; grey for NaN.
    pub fn color(self, value: f64) -> [f32; 3] {
        let (stops, t) = match self {
            ColorScale::Amount { low, high } => (&INFERNO, (value / low).ln() / (high / low).ln()),
            ColorScale::Difference { middle, half_width } => (&RED_BLUE, 0.5 + 0.5 * (value - middle) / half_width),
            ColorScale::Ratio { factor } => (&RED_BLUE, 0.5 + 0.5 * value.ln() / factor.ln()),
        };
        if t.is_nan() && value != 0.0 {
            return [0.5; 3];
        }
        let t = t.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let i = (t as usize).min(stops.len() - 2);
        let channel = |c: u32, shift: u32| (c >> shift & 255) as f32 / 255.0;
        let mix = |shift| {
            let (a, b) = (channel(stops[i], shift), channel(stops[i + 1], shift));
            a + (b - a) * (t - i as f64) as f32
        };
        [mix(16), mix(8), mix(0)]
    }

    /// A CSS gradient from left to right.
    pub fn gradient(self) -> String {
        let stops = if matches!(self, ColorScale::Amount { .. }) { &INFERNO } else { &RED_BLUE };
        let list = stops.iter().map(|c| format!("#{c:06x}")).collect::<Vec<_>>().join(",");
        format!("linear-gradient(to right,{list})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_end_and_turn_where_they_say() {
        let ratio = ColorScale::Ratio { factor: 4.0 };
        let close = |a: [f32; 3], b: u32| {
            let b = [16, 8, 0].map(|s| (b >> s & 255) as f32 / 255.0);
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3), "{a:?} {b:?}");
        };
        close(ratio.color(1.0), RED_BLUE[4]);
        close(ratio.color(4.0), RED_BLUE[8]);
        close(ratio.color(1e9), RED_BLUE[8]);
        close(ratio.color(0.0), RED_BLUE[0]);
        close(ColorScale::Difference { middle: 0.5, half_width: 0.5 }.color(0.0), RED_BLUE[0]);
        close(ColorScale::Amount { low: 1e-4, high: 1.0 }.color(1e-2), INFERNO[4]);
        assert_eq!(ratio.color(f64::NAN), [0.5; 3]);
    }

    #[test]
    fn a_crop_at_the_edge_repeats_it() {
        let picture = Picture::new(3, 2, (0..6).map(|i| [i as f32 / 255.0, 0.0, 0.0]));
        let crop = picture.around([0, 1], 1);
        let red = crop.bytes.iter().step_by(3).copied().collect::<Vec<_>>();
        assert_eq!(red, [0, 0, 1, 3, 3, 4, 3, 3, 4]);
        assert!(crop.data_uri().unwrap().starts_with("data:image/png;base64,iVBOR"));
    }
}
