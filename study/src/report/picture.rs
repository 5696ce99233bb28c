//! Small pictures inside of a page, and false colours.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::png::PngEncoder;
use image::{Rgb, RgbImage};

/// One colour in [0, 1] a pixel, row by row from the top.
pub fn picture([width, height]: [u32; 2], colors: impl Iterator<Item = [f32; 3]>) -> RgbImage {
    let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let mut picture = RgbImage::new(width, height);
    picture.pixels_mut().zip(colors).for_each(|(pixel, color)| *pixel = Rgb(color.map(byte)));
    picture
}

/// Values in false colours.
pub fn mapped(size: [u32; 2], scale: ColorScale, values: impl Iterator<Item = f64>) -> RgbImage {
    picture(size, values.map(|v| scale.color(v)))
}

pub fn data_uri(picture: &RgbImage) -> String {
    let mut png = Vec::new();
    picture.write_with_encoder(PngEncoder::new(&mut png)).expect("memory takes any picture");
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

/// Colours of numbers; steps of equal size look equally large, also to the colour-blind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColorScale {
    /// From `low` to `high` on a logarithmic scale, dark to bright (inferno, by N. Smith and S. van der Walt).
    Amount { low: f64, high: f64 },
    /// From 0 (blue) through ½ (pale) to 1 (red) (RdBu, by C. Brewer).
    Share,
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
            ColorScale::Share => (&RED_BLUE, value),
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
        close(ColorScale::Share.color(0.0), RED_BLUE[0]);
        close(ColorScale::Amount { low: 1e-4, high: 1.0 }.color(1e-2), INFERNO[4]);
        assert_eq!(ratio.color(f64::NAN), [0.5; 3]);
    }
}
