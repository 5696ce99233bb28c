//! `bismar render --replay-pixel X,Y[,N]`

use super::values::PixelPath;
use crate::console::{Verdict, print};
use crate::integrator::Loan;
use crate::job::{Inputs, Loaded, RenderRequest, settings};
use crate::render::prepass::allocation::MAX_PATHS_OVER_MEAN;
use crate::render::{RenderSettings, Technique, replay};
use crate::{Error, Result};

/// Prints the paths of a pixel.
/// Errors: [`Error::Usage`] for a pixel or path outside of the picture; those of loading the scene.
pub fn run(request: &RenderRequest, pixel_path: PixelPath) -> Result<Verdict> {
    let inputs = Inputs::read(request)?;
    let loaded = Loaded::load(request, &inputs, &|_, _| true)?;
    let loaded = loaded.placed(request)?.unwrap_or(loaded);
    let settings: RenderSettings = settings(request, &loaded.prepared.scene)?;
    let PixelPath { pixel: [x, y], path } = pixel_path;
    let Some(spp) = settings.spp else {
        return Err(Error::Usage("--replay-pixel needs --spp, which sets the number of paths".into()));
    };
    let paths = if settings.asks_for(Technique::Adaptive) { spp.saturating_mul(MAX_PATHS_OVER_MEAN) } else { spp };
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
        if !replayed.borrowed.is_empty() {
            text += "\n  of that, borrowed (path re-use):";
        }
        for Loan { from: [x, y, path], radiance, .. } in &replayed.borrowed {
            text += &format!("\n    {radiance} from pixel {x},{y} path {path}");
        }
        for event in &replayed.events {
            text += &format!("\n  {event}");
        }
        printed = print(text);
    })?;
    printed.map(|()| Verdict::Done)
}
