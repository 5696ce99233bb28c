//! Warnings about the result of a render.

use std::ops::RangeInclusive;
use std::path::Path;

use tracing::warn;

use super::request::{LightUnit, RenderRequest};
use crate::color::luminance;
use crate::integrator::PreparedScene;
use crate::rays::BackendInfo;
use crate::render::pass::tile::Tile;
use crate::render::record::checkpoint::Host;
use crate::render::record::goals::learned_alike;
use crate::render::settings::clipped::{MIN_HIDDEN_SHARE, hidden_share};
use crate::render::{BuildInfo, Record, RenderSettings, Rendered, Saved};
use crate::scene::{PunctualKind, PunctualLight};

/// Warns if a resumed render, on `backend` and with `settings`, is not bit-identical to an uninterrupted one.
pub(crate) fn resumed_differently(
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
    let learned_alike = learned_alike(&before.identity.settings, settings, saved.learns_by_goal(settings));
    let [stops, earlier_stops] = [goal, earlier_goal].map(|goal| goal.map(|goal| (goal.error, goal.min_paths)));
    let noise_differs = stops != earlier_stops && saved.tiles.iter().any(noise_was_checked);
    if noise_differs || !learned_alike || !saved.has_passes_of(settings) {
        warn!(
            "{output} was begun with another goal and took other passes, or learned something else in its pre-pass: the picture is \
             unbiased, but not bit-identical to an uninterrupted render"
        );
    }
}

/// Radius of a lens over the distance of its focus from which the scene's unit is in doubt: the fastest real lenses have a
/// tenth, at their closest.
const WIDE: f32 = 0.25;

/// Warns of a lens that is wide for the scene before it, as in scenes whose unit is not the metre.
pub(crate) fn wide_lens(request: &RenderRequest, radius: f32, focus: f32) {
    if radius > WIDE * focus {
        warn!(
            "{}: the lens has a radius of {radius:.2e} m and is focused at {focus:.2e} m. Is the scene's unit the metre? --aperture \
             takes a radius in the scene's own unit",
            request.scene.display()
        );
    }
}

/// Warns of a camera whose far clipping plane hides much of what is in its view.
pub(crate) fn clipped(request: &RenderRequest, scene: &PreparedScene, camera: usize) {
    let camera = &scene.scene.cameras[camera];
    let share = hidden_share(scene, camera);
    if share > MIN_HIDDEN_SHARE {
        warn!(
            "{}: zfar of camera '{}' hides {:.0} % of what is in view; --no-clip shows it",
            request.scene.display(),
            camera.name,
            100.0 * share
        );
    }
}

/// Warns of a picture, or a part of one, that is black, and of one so bright or dark that the unit of its lights is in doubt.
pub(crate) fn black_picture(output: &Path, rendered: &Rendered, part: bool, lights: &[PunctualLight], unit: LightUnit) {
    let seen = Seen::of(rendered);
    // A light seen directly that lights nothing else is no illumination. The lit pixels may be in the other parts.
    let few = if part { 0 } else { seen.surfaces / 50 };
    let output = output.display();
    if seen.lit_anywhere == 0 || (seen.surfaces > 0 && !part && seen.lit <= few) {
        let how = match (seen.lit_anywhere, seen.lit) {
            (0, _) => "everywhere",
            (_, 0) => "on all surfaces",
            _ => "almost everywhere",
        };
        warn!(
            "{output} is black {how}: no light reaches the visible surfaces. Does an emissive surface face away (only its front \
             emits, unless it is double-sided), or the camera? --sky adds a uniform environment, --camera framed shows the \
             whole scene, --back-faces show shows single-sided surfaces from behind"
        );
        return;
    }
    let mean = seen.luminance / seen.surfaces.max(1) as f64;
    let is_sun = |light: &PunctualLight| {
        light.kind == PunctualKind::Directional && SUNLIGHT.contains(&light.intensity.max_element())
    };
    match unit {
        _ if lights.is_empty() => {}
        LightUnit::Lumen if mean > BRIGHT && !lights.iter().any(is_sun) => warn!(
            "{output}: surfaces have a mean luminance of {mean:.0}, where white in plain light has 1. If the file's lights were \
             exported from Blender's watts, --light-unit watt divides them by 683"
        ),
        LightUnit::Watt if seen.surfaces > 0 && mean < DARK => warn!(
            "{output}: surfaces have a mean luminance of {mean:.1e}, where white in plain light has 1. --light-unit lumen uses the \
             file's lights undivided"
        ),
        _ => {}
    }
}

/// Mean luminances of surfaces beyond which the unit of the lights is in doubt: the factor is 683.
const BRIGHT: f64 = 20.0;
const DARK: f64 = 2e-3;
/// Lux of the sun through clouds to that above the atmosphere. Blender's usual suns, 1 to 10 W/m^2, are of 683 to 6830.
const SUNLIGHT: RangeInclusive<f32> = 10_000.0..=150_000.0;

/// What a picture shows of its surfaces.
#[derive(Default)]
struct Seen {
    /// Pixels that are not black.
    lit_anywhere: usize,
    /// Pixels that show nothing but surfaces: the background lights the edges of others.
    surfaces: usize,
    /// Those of them that are not black.
    lit: usize,
    /// The sum of their luminances.
    luminance: f64,
}

impl Seen {
    fn of(rendered: &Rendered) -> Self {
        let window = rendered.settings.window();
        let mut seen = Self::default();
        for stats in rendered.tiles.iter().flat_map(|tile| tile.inside(window).map(|(.., i)| &tile.stats[i])) {
            let is_lit = stats.sum.iter().any(|x| *x > 0.0);
            seen.lit_anywhere += usize::from(is_lit);
            if stats.samples > 0 && stats.covered == stats.samples {
                seen.surfaces += 1;
                seen.lit += usize::from(is_lit);
                seen.luminance += f64::from(luminance(stats.mean().into()));
            }
        }
        seen
    }
}

/// Warns of pixels without paths, which are black.
pub(crate) fn empty_pixels(output: &Path, rendered: &Rendered) {
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
