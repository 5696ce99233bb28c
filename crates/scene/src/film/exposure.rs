//! Exposure of displayed pictures.

use std::fmt::{self, Display};
use std::str::FromStr;

use glam::Vec3;

use crate::color::luminance;

/// The value of `--exposure`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exposure {
    /// [`automatic`], rounded to a hundredth of a stop, so that the printed value reproduces the picture.
    Auto,
    /// Stops: 0 keeps the radiance, 1 doubles it.
    Stops(f32),
}

impl Exposure {
    /// The exposure in stops for a picture of this width with these colours (linear RGB), row by row.
    pub fn of(self, colors: (usize, impl Iterator<Item = [f32; 3]>)) -> f32 {
        match self {
            // Adding 0 makes -0 a 0.
            Exposure::Auto => (automatic(colors) * 100.0).round() / 100.0 + 0.0,
            Exposure::Stops(stops) => stops,
        }
    }
}

impl FromStr for Exposure {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let stops = || text.parse().ok().filter(|x: &f32| x.is_finite()).map(Exposure::Stops);
        if text == "auto" { Ok(Exposure::Auto) } else { stops().ok_or("neither `auto` nor a number of stops".into()) }
    }
}

impl Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Exposure::Auto => write!(f, "auto"),
            Exposure::Stops(stops) => write!(f, "{stops}"),
        }
    }
}

/// Side of a block in pixels.
const BLOCK: usize = 8;

/// The exposure in stops that maps the log-mean luminance of what is not dark to middle grey (0.18); 0 for a black picture. Pixels
/// count by the means of blocks of 8 x 8, whose noise is an eighth of theirs: logarithms of noisy pixels are too low in the mean,
/// and in a dark picture it is noise that tells which are dark. Dark blocks have less than a twentieth of the mean luminance. For
/// this mean, luminances are clamped to the 99th percentile, so that a small sun has no influence. Pixels without a finite
/// luminance of 0 or more are left out.
pub fn automatic((width, mut colors): (usize, impl Iterator<Item = [f32; 3]>)) -> f32 {
    // Mean luminance and number of pixels of each block.
    let (mut all, mut more) = (Vec::<(f64, f64)>::new(), true);
    while more {
        let mut row = vec![(0.0, 0.0); width.div_ceil(BLOCK)];
        let mut pixels = 0;
        for color in colors.by_ref().take(BLOCK * width) {
            let l = luminance(Vec3::from_array(color));
            if l.is_finite() && l >= 0.0 {
                let block: &mut (f64, f64) = &mut row[pixels % width / BLOCK];
                *block = (block.0 + f64::from(l), block.1 + 1.0);
            }
            pixels += 1;
        }
        more = pixels > 0;
        all.extend(row.into_iter().filter(|block| block.1 > 0.0).map(|(sum, n)| (sum / n, n)));
    }
    if all.is_empty() {
        return 0.0;
    }
    let ninety_nine = (all.len() - 1) * 99 / 100;
    let percentile = all.select_nth_unstable_by(ninety_nine, |a, b| a.0.total_cmp(&b.0)).1.0;
    let weighted = |of: &dyn Fn(f64) -> Option<f64>| {
        let found = all.iter().filter_map(|(l, n)| of(*l).map(|x| (n * x, *n)));
        let (sum, n) = found.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        (n > 0.0).then(|| sum / n)
    };
    let mean = weighted(&|l| Some(l.min(percentile))).unwrap_or(0.0);
    let log_mean = weighted(&|l| (l > 0.05 * mean).then(|| l.ln()));
    log_mean.map_or(0.0, |log_mean| ((0.18_f64.ln() - log_mean) / std::f64::consts::LN_2) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn greys(values: impl IntoIterator<Item = f32>) -> f32 {
        automatic((1, values.into_iter().flat_map(|x| [[x; 3]; BLOCK])))
    }

    #[test]
    fn what_is_not_dark_becomes_middle_grey_on_the_logarithmic_mean() {
        assert!((greys([0.18; 10]) - 0.0).abs() < 1e-5);
        assert!((greys([0.09, 0.36]) - 0.0).abs() < 1e-5);
        assert!((greys([720.0; 4]) + 4000_f32.log2()).abs() < 1e-4);
        // A black background does not count, nor does a speck of sun, nor what is no light.
        assert!((greys([0.36; 60].into_iter().chain([0.0; 940])) + 1.0).abs() < 1e-5);
        let sun = greys([0.18; 995].into_iter().chain([1e6; 5]));
        assert!((-0.2..0.0).contains(&sun), "{sun}");
        assert!((greys([0.18, f32::NAN, f32::INFINITY, -1.0]) - 0.0).abs() < 1e-5);
        for black in [vec![], vec![0.0; 7], vec![f32::NAN]] {
            assert_eq!(greys(black), 0.0);
        }
    }

    #[test]
    fn noise_does_not_move_it() {
        // One path of two or of eight finds the light. The variance of a block is then at most 7/64 of its squared mean, and the
        // logarithm too low by half of that: 0.08 stops.
        for rare in [2, 8] {
            let finds = |i: u32| (i.wrapping_mul(0x9E37_79B1) >> 16).is_multiple_of(rare);
            let pixels = (0..256 * 256).map(|i| [if finds(i) { 0.18 * rare as f32 } else { 0.0 }; 3]);
            let found = automatic((256, pixels));
            assert!(found.abs() < 0.1, "{rare}: {found}");
        }
    }

    #[test]
    fn it_is_a_number_or_auto() {
        assert_eq!("auto".parse(), Ok(Exposure::Auto));
        assert_eq!("-10.25".parse(), Ok(Exposure::Stops(-10.25)));
        for bad in ["", "Auto", "nan", "inf", "1EV"] {
            assert!(bad.parse::<Exposure>().is_err(), "{bad}");
        }
        let ev = Exposure::Auto.of((1, [[720.0; 3]].into_iter()));
        assert_eq!(ev.to_string(), "-11.97");
    }
}
