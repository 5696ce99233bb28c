//! Traces the paths of one pixel again, one by one, to find out where a value comes from.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::camera::lens;
use super::prepass::Prepasses;
use super::tile::{Columns, TILE, Tile};
use super::transport::{pass_seed, transport};
use super::{RenderSettings, scheduler};
use crate::color::luminance;
use crate::integrator::clients::ScatteredSums;
use crate::integrator::scalar::{self, Event};
use crate::integrator::{Loan, PixelTask, PreparedScene, Transport, Wave};
use crate::{Error, Result};

/// One path of a pixel.
#[derive(Debug)]
pub struct Replayed {
    /// Its number in the pixel.
    pub path: u32,
    /// Linear RGB radiance, weighted by the sample counts known when the path was traced: paths of a second-order pilot are
    /// reweighted later.
    pub radiance: Vec3,
    /// What of it paths of the tile have lent ([`Technique::PathReuse`](super::Technique::PathReuse)), the brightest first.
    pub borrowed: Vec<Loan>,
    /// What happens to the path without path re-use.
    pub events: Vec<Event>,
}

/// Traces the passes of the tile around pixel (`x`, `y`) until all samples of `settings` are taken, and passes each path of
/// that pixel, or path number `only`, to `report`: its events as the scalar integrator traces it, and what the wave shares.
///
/// # Errors
/// [`Error::Usage`] for settings that [`RenderSettings::validate`] or [`lens`] refuses, and for a pixel outside of the
/// picture.
pub fn replay(
    scene: &PreparedScene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    only: Option<u32>,
    report: &mut dyn FnMut(Replayed),
) -> Result<()> {
    settings.validate(&scene.scene)?;
    lens(scene, settings)?;
    if x >= settings.width || y >= settings.height {
        let (width, height) = (settings.width, settings.height);
        return Err(Error::Usage(format!("pixel {x},{y} is not inside the picture of {width}x{height} pixels")));
    }
    let never = AtomicBool::new(false);
    let prepasses = Prepasses::run(scene, settings, &never);
    let mut transport = prepasses.apply(transport(scene, settings));
    let columns = Columns { groups: 0, ..settings.columns() };
    let mut tile = Tile::new([x / TILE, y / TILE], settings.width, settings.height, columns);
    let planned = |tile: &Tile| match &prepasses.allocation {
        Some(allocation) => allocation.next_pass(settings, tile),
        None => scheduler::planned(settings, tile.paths_before_pass(settings.noise_goal().as_ref())),
    };
    while let Some(pass) = planned(&tile) {
        transport.seed = pass_seed(settings, tile.paths());
        tile.pass_watched(&transport, settings, pass, &mut |tasks: &[PixelTask]| {
            let Some(pixel) = tasks.iter().position(|task| [task.x, task.y] == [x, y]) else { return };
            let task = &tasks[pixel];
            let first: u32 = tasks[..pixel].iter().map(|task| task.counts.paths).sum();
            for path in (0..task.counts.paths).filter(|path| only.is_none_or(|only| only == task.first_path + path)) {
                let mut events = Vec::new();
                let radiance = scalar::trace(&transport, task, path, &mut |event| events.push(event));
                let (radiance, borrowed) = match transport.proposal.reuse {
                    Some(_) => shared(&transport, tasks, first + path),
                    None => (radiance, Vec::new()),
                };
                report(Replayed { path: task.first_path + path, radiance, borrowed, events });
            }
        });
        let is_finished = settings.noise_goal().is_some_and(|goal| tile.tile_stats().open_paths(&goal).is_none());
        if is_finished || only.is_some_and(|only| only < tile.fewest_paths()) {
            break;
        }
    }
    Ok(())
}

/// Traces a wave whose paths share what they find: the radiance of the path of this index, and what it borrows.
fn shared(transport: &Transport, tasks: &[PixelTask], index: u32) -> (Vec3, Vec<Loan>) {
    let mut wave = Wave::default();
    wave.watch(index);
    wave.run(transport, tasks, &mut ScatteredSums(&mut vec![Vec3::ZERO; tasks.len()]));
    let (radiance, loans) = wave.watched().expect("a path is watched");
    let mut borrowed: Vec<_> = loans.iter().copied().filter(|loan| loan.radiance != Vec3::ZERO).collect();
    borrowed.sort_by(|a, b| luminance(b.radiance).total_cmp(&luminance(a.radiance)));
    (radiance, borrowed)
}
