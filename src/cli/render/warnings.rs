//! What a render warns of that no flag is wrong about.

use std::path::Path;

use tracing::warn;

use crate::film::colors;
use crate::rays::BackendInfo;
use crate::render::checkpoint::Host;
use crate::render::tile::Tile;
use crate::render::{BuildInfo, Guiding, Record, RenderSettings, Rendered, Saved};

/// Why a render that goes on, on `backend` and with `settings`, does not come to the bits of one in one go.
pub fn of_another_making(
    output: &Path,
    before: &Record,
    saved: &Saved,
    backend: &BackendInfo,
    settings: &RenderSettings,
) {
    let output = output.display();
    let (there, here) = (&before.host, Host::of(backend));
    if *there != here {
        warn!(
            "{output} began with {} {} ({}) and goes on with {} ({}): the picture is as right as ever, but not to the last \
             bit the one of a single host",
            backend.name, there.version, there.isa, here.version, here.isa
        );
    }
    let build = BuildInfo::here().differences(&before.build);
    if !build.is_empty() {
        warn!(
            "{output} was begun by another build of bismar, {build}: the picture is as right as ever, but perhaps not to \
             the last bit the one of a single build"
        );
    }
    let [goal, theirs] = [settings, &before.identity.settings].map(RenderSettings::noise_goal);
    let looked = |tile: &Tile| goal.or(theirs).is_some_and(|goal| tile.paths() > goal.min_paths);
    // Tiles with goals of their own have taken passes that these end, and guiding has learned for as many paths.
    let own = |s: &RenderSettings| {
        (s.spp.filter(|_| s.adaptive), Some(s.expected_spp()).filter(|_| s.guiding != Guiding::Off))
    };
    let [ours, before] = [settings, &before.identity.settings].map(own);
    if (goal != theirs && saved.tiles.iter().any(looked)) || ours != before || !saved.has_passes_of(settings) {
        warn!(
            "{output} was begun with another goal and took other passes, or learned another field, than this command from \
             the beginning: the picture is as right as ever, but not bit for bit that of a render in one go"
        );
    }
}

/// A picture, or a part of one, that is black.
pub fn of_darkness(output: &Path, rendered: &Rendered, part: bool) {
    let lit = colors(&rendered.pixels()).filter(|color| color.iter().any(|x| *x > 0.0)).count();
    // A lamp that lights nothing but itself is as good as none; of a part, most pixels are others' to light.
    let few = if part { 0 } else { colors(&rendered.pixels()).count() / 50 };
    if lit <= few {
        let how = if lit == 0 { "everywhere" } else { "almost everywhere" };
        warn!(
            "{} is black {how}: no light reaches what the camera sees. Does a lamp face away (a surface shines from its \
             front alone, unless it is double-sided), or the camera? --sky gives light from all around, --camera framed \
             shows all of the scene",
            output.display()
        );
    }
}
