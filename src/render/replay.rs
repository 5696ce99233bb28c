//! One pixel's paths again, one by one: for finding out where a value comes from.

use glam::Vec3;

use super::allocation::Allocation;
use super::driver::{pass_seed, transport};
use super::prepass::Prepasses;
use super::tile::Tile;
use super::{RenderSettings, scheduler};
use crate::integrator::scalar::{self, Event};
use crate::integrator::{PixelTask, PreparedScene};

/// One path of a pixel.
#[derive(Debug)]
pub struct Replayed {
    /// Its number in the pixel.
    pub path: u32,
    /// What it found, weighed by the counts known when it was taken: a pilot's paths are reweighted later.
    pub radiance: Vec3,
    /// What happened.
    pub events: Vec<Event>,
}

/// Takes the passes of the tile around pixel (`x`, `y`), which must be inside the picture, until all samples of `settings`
/// are taken, and hands each path of that pixel, or number `only`, to `tell`, as the scalar path finds it.
pub fn replay(
    scene: &PreparedScene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    only: Option<u32>,
    tell: &mut dyn FnMut(Replayed),
) {
    let pilots = Prepasses::send(scene, settings);
    let mut transport = pilots.lead(transport(scene, settings));
    let window = [x, y, x + 1, y + 1];
    let Some(mut tile) = Tile::cover(settings.width, settings.height, window, settings.columns()).pop() else { return };
    let allocation = Allocation::new(&transport, settings);
    let goal = settings.spp.map(|mean| allocation.map_or(mean, |allocation| allocation.paths(&tile, mean)));
    while let Some(pass) = scheduler::planned_to(settings, goal, tile.paths()) {
        transport.seed = pass_seed(settings, tile.paths());
        tile.pass_watched(&transport, settings, pass, &mut |task: &PixelTask| {
            if [task.x, task.y] != [x, y] {
                return;
            }
            for path in (0..task.counts.paths).filter(|path| only.is_none_or(|only| only == task.first_path + path)) {
                let mut events = Vec::new();
                let radiance = scalar::trace(&transport, task, path, &mut |event| events.push(event));
                tell(Replayed { path: task.first_path + path, radiance, events });
            }
        });
        if tile.is_clean(settings) || only.is_some_and(|only| only < tile.fewest_paths()) {
            break;
        }
    }
}
