//! Traces the paths of one pixel again, to find out where a value comes from.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::pass::scheduler::{self, pass_seed};
use super::pass::tile::Tile;
use super::prepass::Prepasses;
use super::settings::RenderSettings;
use super::settings::camera::lens;
use super::settings::transport::transport;
use crate::color::luminance;
use crate::integrator::clients::PathLog;
use crate::integrator::clients::path_log::Event;
use crate::integrator::{Loan, PixelTask, PreparedScene, Wave};
use crate::render::settings::Columns;
use crate::render::settings::part::TILE;
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
    /// What happens to the path.
    pub events: Vec<Event>,
}

/// Traces the passes of the tile around pixel (`x`, `y`) until all samples of `settings` are taken, and passes each path of
/// that pixel, or path number `only`, to `report`, as the picture has it.
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
    let columns = Columns { layers: 0, ..settings.columns() };
    let mut tile = Tile::new([x / TILE, y / TILE], settings.width, settings.height, columns);
    let planned = |tile: &Tile| match &prepasses.allocation {
        Some(allocation) => allocation.next_pass(settings, tile),
        None => scheduler::planned(settings, tile.paths_before_pass(settings.noise_goal().as_ref())),
    };
    let mut wave = Wave::default();
    while let Some(pass) = planned(&tile) {
        transport.seed = pass_seed(settings, tile.paths());
        tile.pass_watched(&transport, settings, pass, &mut |tasks: &[PixelTask]| {
            let Some(pixel) = tasks.iter().position(|task| [task.x, task.y] == [x, y]) else { return };
            let task = &tasks[pixel];
            let numbers = task.first_path..task.first_path + task.counts.paths;
            let numbers =
                only.map_or(numbers.clone(), |only| numbers.start.max(only)..numbers.end.min(only.saturating_add(1)));
            if numbers.is_empty() {
                return;
            }
            let before: u32 = tasks[..pixel].iter().map(|task| task.counts.paths).sum();
            let first = before + numbers.start - task.first_path;
            let watched = first..first + numbers.len() as u32;
            let mut log = PathLog::new(watched.clone());
            wave.watch(watched.clone());
            wave.run(&transport, tasks, &mut log);
            for (index, path) in watched.zip(numbers) {
                let loans = wave.loans().iter().filter(|loan| loan.to == index && loan.radiance != Vec3::ZERO);
                let mut borrowed: Vec<_> = loans.copied().collect();
                borrowed.sort_by(|a, b| luminance(b.radiance).total_cmp(&luminance(a.radiance)));
                report(Replayed { path, radiance: log.radiance(index), borrowed, events: log.events(index) });
            }
        });
        let is_finished = settings.noise_goal().is_some_and(|goal| tile.tile_stats().open_paths(&goal).is_none());
        if is_finished || only.is_some_and(|only| only < tile.fewest_paths()) {
            break;
        }
    }
    Ok(())
}
