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
    /// The exposure in stops for a picture with these colours (linear RGB).
    pub fn of(self, colors: impl Iterator<Item = [f32; 3]>) -> f32 {
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

/// The exposure in stops that maps the log-mean luminance of the pixels that are not dark to middle grey (0.18); 0 for a black
/// picture. Dark pixels have less than a twentieth of the mean luminance. For this mean, luminances are clamped to the 99th
/// percentile, so that a small sun has no influence.
pub fn automatic(colors: impl Iterator<Item = [f32; 3]>) -> f32 {
    let pixel_luminance = |color| luminance(Vec3::from_array(color));
    let mut all: Vec<f32> = colors.map(pixel_luminance).filter(|l| l.is_finite() && *l >= 0.0).collect();
    if all.is_empty() {
        return 0.0;
    }
    let ninety_nine = (all.len() - 1) * 99 / 100;
    let percentile = *all.select_nth_unstable_by(ninety_nine, f32::total_cmp).1;
    let mean = all.iter().map(|l| f64::from(l.min(percentile))).sum::<f64>() / all.len() as f64;
    let shown = all.iter().filter(|l| f64::from(**l) > 0.05 * mean);
    let (sum, n) = shown.fold((0.0, 0.0), |(sum, n), l| (sum + f64::from(l.ln()), n + 1.0));
    if n > 0.0 { ((0.18_f64.ln() - sum / n) / std::f64::consts::LN_2) as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn greys(values: impl IntoIterator<Item = f32>) -> f32 {
        automatic(values.into_iter().map(|x| [x; 3]))
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
    fn it_is_a_number_or_auto() {
        assert_eq!("auto".parse(), Ok(Exposure::Auto));
        assert_eq!("-10.25".parse(), Ok(Exposure::Stops(-10.25)));
        for bad in ["", "Auto", "nan", "inf", "1EV"] {
            assert!(bad.parse::<Exposure>().is_err(), "{bad}");
        }
        let ev = Exposure::Auto.of([[720.0; 3]].into_iter());
        assert_eq!(ev.to_string(), "-11.97");
    }
}
