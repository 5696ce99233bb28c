//! Lens settings, and the thin lens that follows from them for a scene.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::validate::is_optical;
use super::{RenderSettings, camera};
use crate::integrator::PreparedScene;
use crate::integrator::camera::Lens;
use crate::lanes::{F, U};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::scene::Projection;
use crate::{Error, Result};

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

/// Height of the film in metres: that of 35 mm stills.
const FILM_HEIGHT: f64 = 0.024;

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

impl fmt::Display for LensSettings {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.aperture {
            Aperture::Stop(stop) => write!(f, "f/{stop}")?,
            Aperture::Radius(radius) => write!(f, "radius {radius}")?,
        }
        match self.focus {
            Focus::Auto => write!(f, ", focus auto")?,
            Focus::Distance(distance) => write!(f, ", focus {distance}")?,
        }
        write!(f, ", {} blades", self.blades)
    }
}

/// The lens of a render with these settings; `None` for a pinhole.
///
/// # Errors
/// [`Error::Usage`] for an f-stop of an orthographic camera, which has no focal length, and for automatic focus where the
/// middle of the picture shows nothing.
pub fn lens(scene: &PreparedScene, settings: &RenderSettings) -> Result<Option<Lens>> {
    let Some(requested) = settings.lens else { return Ok(None) };
    let RenderSettings { camera: index, width, height, .. } = *settings;
    let radius = match (requested.aperture, scene.scene.camera(index, width, height).projection) {
        (Aperture::Radius(radius), _) => radius,
        (Aperture::Stop(stop), Projection::Perspective { yfov }) => {
            0.5 * FILM_HEIGHT / (0.5 * f64::from(yfov)).tan() / (2.0 * stop)
        }
        (Aperture::Stop(_), Projection::Orthographic { .. }) => {
            let why =
                "--aperture: an orthographic camera has no focal length, and so no f-stop: give a radius in metres";
            return Err(Error::Usage(why.into()));
        }
    };
    let focus = match requested.focus {
        Focus::Distance(distance) => distance as f32,
        Focus::Auto => {
            let [x, y] = [width, height].map(|size| F::splat(0.5 * size as f32));
            let middle = F::splat(0.5);
            let ray = camera(&scene.scene, settings).rays(x, y, middle);
            let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
            rays.open(1, scene.geometry.moves);
            rays.put(0, ray, F::splat(f32::INFINITY), U::ZERO, middle);
            rays.close(1);
            scene.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
            if hits.instance[0] == MISS {
                let why =
                    "--focus auto: the middle of the picture shows nothing to focus on: give a distance in metres";
                return Err(Error::Usage(why.into()));
            }
            hits.t[0]
        }
    };
    Ok(Some(Lens { radius: radius as f32, focus, blades: requested.blades }))
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
