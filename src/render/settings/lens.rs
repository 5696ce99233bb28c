//! Lens settings.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A thin lens: surfaces out of focus are blurred.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LensSettings {
    /// Size of the opening.
    pub aperture: Aperture,
    /// What is in focus.
    pub focus: Focus,
    /// Sides of the opening: 0 for a circle, or 3 to 32.
    pub blades: u32,
}

/// The size of a lens's opening.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aperture {
    /// f-number: the focal length over the diameter of the opening, > 0. The focal length follows from the camera's field of
    /// view and a film height of 24 mm.
    Stop(f64),
    /// The opening's radius in metres, > 0.
    Radius(f64),
}

/// Where a lens is focused.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Focus {
    /// On the surface in the middle of the picture.
    Auto,
    /// On a plane at this distance from the camera in metres, > 0.
    Distance(f64),
}

/// Is this a size in metres or an f-number that is positive and finite as a 32-bit float too?
pub(in crate::render) fn is_optical(x: f64) -> bool {
    (1e-9..1e9).contains(&x)
}

fn positive(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| is_optical(*x))
}

impl FromStr for Aperture {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let aperture = match text.trim().strip_prefix(['f', 'F']) {
            Some(stop) => positive(stop.strip_prefix('/').unwrap_or(stop)).map(Self::Stop),
            None => positive(text).map(Self::Radius),
        };
        aperture.ok_or("neither an f-stop, as in f/2.8, nor a radius above 0 in metres, as in 0.01".into())
    }
}

impl FromStr for Focus {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            _ => positive(text).map(Self::Distance).ok_or("neither a distance above 0 in metres nor auto".into()),
        }
    }
}

impl fmt::Display for Aperture {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Stop(stop) => write!(f, "f/{stop}"),
            Self::Radius(radius) => write!(f, "{radius}"),
        }
    }
}

impl fmt::Display for Focus {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Auto => write!(f, "auto"),
            Self::Distance(distance) => write!(f, "{distance}"),
        }
    }
}

impl fmt::Display for LensSettings {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}, focus {}, {} blades", self.aperture, self.focus, self.blades)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_radii_and_distances_are_read_or_refused() {
        assert_eq!(["f/2.8", "f2.8", "F/16"].map(str::parse), [2.8, 2.8, 16.0].map(|n| Ok(Aperture::Stop(n))));
        assert_eq!("0.01".parse(), Ok(Aperture::Radius(0.01)));
        assert_eq!(["auto", "2.5"].map(str::parse), [Ok(Focus::Auto), Ok(Focus::Distance(2.5))]);
        for bad in ["", "f/", "f/0", "-1", "0", "nan", "inf", "f/nan", "1e-60", "2.8f", "auto"] {
            assert!(bad.parse::<Aperture>().is_err(), "{bad}");
        }
        for bad in ["", "0", "-2", "nan", "1e40", "far"] {
            assert!(bad.parse::<Focus>().is_err(), "{bad}");
        }
    }
}
