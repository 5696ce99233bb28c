//! Warnings about the result of a render.

use std::path::Path;

use tracing::warn;

use crate::film::colors;
use crate::rays::BackendInfo;
use crate::render::checkpoint::Host;
use crate::render::tile::Tile;
use crate::render::{BuildInfo, Guiding, Record, RenderSettings, Rendered, Saved};

/// Warns if a resumed render, on `backend` and with `settings`, is not bit-identical to an uninterrupted one.
pub fn resumed_differently(
    output: &Path,
    before: &Record,
    saved: &Saved,
    backend: &BackendInfo,
    settings: &RenderSettings,
) {
    let output = output.display();
    let (earlier, here) = (&before.host, Host::of(backend));
    if *earlier != here {
        warn!(
            "{output} was begun with {} {} ({}) and continues with {} ({}): the picture is unbiased, but not bit-identical to \
             a render on one host",
            backend.name, earlier.version, earlier.isa, here.version, here.isa
        );
    }
    let differences = BuildInfo::here().differences(&before.build);
    if !differences.is_empty() {
        warn!(
            "{output} was begun by another build of bismar, {differences}: the picture is unbiased, but may not be bit-identical \
             to a render by one build"
        );
    }
    let [goal, earlier_goal] = [settings, &before.identity.settings].map(RenderSettings::noise_goal);
    let noise_was_checked = |tile: &Tile| goal.or(earlier_goal).is_some_and(|goal| tile.paths() > goal.min_paths);
    // Adaptive sample counts and the guiding pre-pass depend on the number of paths that is aimed for.
    let planned_paths = |s: &RenderSettings| {
        (s.spp.filter(|_| s.adaptive), Some(s.expected_spp()).filter(|_| s.guiding != Guiding::Off))
    };
    let [planned, planned_before] = [settings, &before.identity.settings].map(planned_paths);
    let noise_differs = goal != earlier_goal && saved.tiles.iter().any(noise_was_checked);
    if noise_differs || planned != planned_before || !saved.has_passes_of(settings) {
        warn!(
            "{output} was begun with another goal and took other passes, or learned another guiding field: the picture is \
             unbiased, but not bit-identical to an uninterrupted render"
        );
    }
}

/// Warns of a picture, or a part of one, that is black.
pub fn black_picture(output: &Path, rendered: &Rendered, part: bool) {
    let lit = colors(&rendered.pixels()).filter(|color| color.iter().any(|x| *x > 0.0)).count();
    // A light seen directly that lights nothing else is no illumination. The lit pixels may be in the other parts.
    let few = if part { 0 } else { colors(&rendered.pixels()).count() / 50 };
    if lit <= few {
        let how = if lit == 0 { "everywhere" } else { "almost everywhere" };
        warn!(
            "{} is black {how}: no light reaches the visible surfaces. Does an emissive surface face away (only its front emits, \
             unless it is double-sided), or the camera? --sky adds a uniform environment, --camera framed shows the \
             whole scene",
            output.display()
        );
    }
}

/// Warns of pixels without paths, which are black.
pub fn empty_pixels(output: &Path, rendered: &Rendered) {
    let (empty, all) = rendered.pixels_without_paths();
    if empty > 0 {
        let percent = 100.0 * empty as f64 / all as f64;
        warn!(
            "{}: {empty} of {all} pixels ({percent:.0} %) have no paths and are black: --time ended too early; give it more \
             time, or render a smaller picture",
            output.display()
        );
    }
}
