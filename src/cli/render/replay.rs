//! `bismar render --replay-pixel X,Y[,N]`

use std::str::FromStr;

use super::args::RenderArgs;
use super::choose::settings;
use super::identity::Inputs;
use super::loaded::Loaded;
use crate::console::{Verdict, print};
use crate::render::prepass::allocation::MAX_PATHS_OVER_MEAN;
use crate::render::{RenderSettings, replay};
use crate::{Error, Result};

/// `X,Y[,N]`: a pixel of the full picture from the top left, and the index of one of its paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelPath {
    pixel: [u32; 2],
    path: Option<u32>,
}

impl FromStr for PixelPath {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y]) => Ok(PixelPath { pixel: [x, y], path: None }),
            Some(&[x, y, n]) => Ok(PixelPath { pixel: [x, y], path: Some(n) }),
            _ => Err("not X,Y or X,Y,N: a pixel from the top left and the index of a path, as in 17,4,3".into()),
        }
    }
}

/// Prints the paths of a pixel.
///
/// # Errors
/// [`Error::Usage`] for a pixel or path outside of the picture; those of loading the scene.
pub fn run(args: &RenderArgs, pixel_path: PixelPath) -> Result<Verdict> {
    let inputs = Inputs::read(args)?;
    let loaded = Loaded::load(args, &inputs, &|_, _| true)?;
    let loaded = loaded.placed(args)?.unwrap_or(loaded);
    let settings: RenderSettings = settings(args, &loaded.prepared.scene)?;
    let PixelPath { pixel: [x, y], path } = pixel_path;
    if x >= settings.width || y >= settings.height {
        return Err(Error::Usage(format!(
            "--replay-pixel {x},{y} is not inside the picture of {}x{} pixels",
            settings.width, settings.height
        )));
    }
    let Some(spp) = settings.spp else {
        return Err(Error::Usage("--replay-pixel needs --spp, which sets the number of paths".into()));
    };
    let paths = if settings.allocates() { spp.saturating_mul(MAX_PATHS_OVER_MEAN) } else { spp };
    if let Some(n) = path.filter(|n| *n >= paths) {
        return Err(Error::Usage(format!(
            "--replay-pixel {x},{y},{n}: with --spp {spp} the last path is {}",
            paths - 1
        )));
    }
    let mut printed = Ok(());
    replay(&loaded.prepared, &settings, [x, y], path, &mut |replayed| {
        if printed.is_err() {
            return;
        }
        let mut text = format!("pixel {x},{y} path {}: {}", replayed.path, replayed.radiance);
        for event in &replayed.events {
            text += &format!("\n  {event}");
        }
        printed = print(text);
    })?;
    printed.map(|()| Verdict::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_or_refused() {
        assert_eq!("17,4".parse(), Ok(PixelPath { pixel: [17, 4], path: None }));
        assert_eq!("0, 0,12".parse(), Ok(PixelPath { pixel: [0, 0], path: Some(12) }));
        for bad in ["", "1", "1,", "-1,2", "1,2,3,4", "a,b", "1.5,2", "99999999999,1"] {
            assert!(bad.parse::<PixelPath>().is_err(), "{bad}");
        }
    }
}
