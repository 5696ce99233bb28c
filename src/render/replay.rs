//! Traces the paths of one pixel again, one by one, to find out where a value comes from.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::camera::lens;
use super::prepass::Prepasses;
use super::prepass::allocation::Allocation;
use super::tile::{Columns, TILE, Tile};
use super::transport::{pass_seed, transport};
use super::{RenderSettings, scheduler};
use crate::integrator::scalar::{self, Event};
use crate::integrator::{PixelTask, PreparedScene};
use crate::{Error, Result};

/// One path of a pixel.
#[derive(Debug)]
pub struct Replayed {
    /// Its number in the pixel.
    pub path: u32,
    /// Linear RGB radiance, weighted by the sample counts known when the path was traced: paths of a second-order pilot are
    /// reweighted later.
    pub radiance: Vec3,
    /// What happened.
    pub events: Vec<Event>,
}

/// Traces the passes of the tile around pixel (`x`, `y`) until all samples of `settings` are taken, and passes each path of
/// that pixel, or path number `only`, to `report`, as the scalar integrator traces it.
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
    if transport.proposal.reuse.is_some() {
        let why =
            "paths of this picture find light for other pixels too, and cannot be replayed: give --path-reuse off";
        return Err(Error::Usage(why.into()));
    }
    let columns = Columns { groups: 0, ..settings.columns() };
    let mut tile = Tile::new([x / TILE, y / TILE], settings.width, settings.height, columns);
    let deals = prepasses.allocation.as_ref().is_some_and(Allocation::deals);
    let planned = |tile: &Tile| match &prepasses.allocation {
        Some(allocation) => allocation.next_pass(settings, tile),
        None => scheduler::planned(settings, tile.paths()),
    };
    while let Some(pass) = planned(&tile) {
        transport.seed = pass_seed(settings, tile.paths());
        tile.pass_watched(&transport, settings, (pass, deals), &mut |task: &PixelTask| {
            if [task.x, task.y] != [x, y] {
                return;
            }
            for path in (0..task.counts.paths).filter(|path| only.is_none_or(|only| only == task.first_path + path)) {
                let mut events = Vec::new();
                let radiance = scalar::trace(&transport, task, path, &mut |event| events.push(event));
                report(Replayed { path: task.first_path + path, radiance, events });
            }
        });
        let is_clean = settings.noise_goal().is_some_and(|goal| tile.is_clean(&goal));
        if is_clean || only.is_some_and(|only| only < tile.fewest_paths()) {
            break;
        }
    }
    Ok(())
}
