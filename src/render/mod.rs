//! Rendering: from a scene and settings to pixels and files.
//!
//! [`driver`] renders tiles pass by pass, in the order that [`scheduler`] decides. [`checkpoint`] stores a render in its
//! picture's file, [`merge`] combines parts and seeds, and [`identity`] lists what a picture's bits depend on.

pub mod adaptive;
mod build_info;
pub mod camera;
pub mod checkpoint;
mod choice;
pub mod deal;
pub mod default_light;
pub mod driver;
pub mod fireflies;
pub mod goals;
pub mod identity;
pub mod lens;
pub mod merge;
pub mod part;
mod pixels;
pub mod prepass;
pub mod progress;
pub mod replay;
pub mod sampler;
pub mod scheduler;
pub mod settings;
pub mod stats;
pub mod techniques;
pub mod tile;
pub mod transport;
mod validate;

use rayon::prelude::*;

use crate::film::compare::relative_to;
use crate::film::{Background, Film};
pub use build_info::BuildInfo;
pub use camera::camera;
pub use checkpoint::{Record, Saved};
pub use choice::Choice;
/// Whether paths are guided.
pub use choice::Choice as Guiding;
pub use driver::{Pause, RunOptions, render, run};
pub use fireflies::Fireflies;
pub use goals::Goal;
pub use identity::Identity;
pub use part::Part;
pub use pixels::TilePixels;
pub use progress::Progress;
pub use replay::replay;
pub use settings::{
    BackFaces, Balance, CustomMethod, GlassShadows, Ground, Integrator, PixelFilter, RenderSettings, StudyOptions,
};
pub use stats::{RenderStats, StopReason};
pub use techniques::{Decision, Decisions, TechniqueStats};
use tile::Tile;
pub use transport::transport;

/// A finished or stopped render.
#[derive(Debug)]
pub struct Rendered {
    /// The requested settings.
    pub settings: RenderSettings,
    /// The tiles, row by row, with all that a resumed render needs.
    pub tiles: Vec<Tile>,
    /// Counts and times.
    pub stats: RenderStats,
    /// The goals that it was begun and continued with, in order.
    pub goals: Vec<Goal>,
    /// Why it ended.
    pub stop: StopReason,
    /// What the picture shows behind all surfaces.
    pub background: Background,
}

impl Rendered {
    /// A view of the window's pixels, without a copy. Files are written from it.
    pub fn pixels(&self) -> TilePixels<'_> {
        TilePixels::new(&self.tiles, &self.settings, self.background)
    }

    /// A copy of the window's pixels, row by row.
    pub fn film(&self) -> Film {
        Film::of(&self.pixels())
    }

    /// The window's pixels without paths, and all its pixels.
    pub fn pixels_without_paths(&self) -> (usize, usize) {
        let count = |tile: &Tile| tile.inside(self.settings.window()).count();
        let empty = self.tiles.iter().filter(|tile| tile.paths() == 0).map(count).sum();
        (empty, self.tiles.iter().map(count).sum())
    }

    /// Minimum and maximum paths of its tiles ([`Tile::paths`]).
    pub fn paths_range(&self) -> (u32, u32) {
        paths_range(&self.tiles)
    }

    /// Noise of the noisiest tile; 0 without tiles.
    pub fn worst_noise(&self) -> f64 {
        let (window, tiles) = (self.settings.window(), self.tiles.iter());
        tiles.map(|tile| noise(std::slice::from_ref(tile), window)).fold(0.0, f64::max)
    }
}

/// The tiles that a render of these settings begins with, row by row.
pub fn fresh_tiles(settings: &RenderSettings) -> Vec<Tile> {
    study_tiles(settings, &StudyOptions::default())
}

/// Grid positions (column, row) of the tiles that a render with these settings has, row by row.
pub fn tile_positions(settings: &RenderSettings) -> Vec<[u32; 2]> {
    let all = Tile::grid_positions(settings.window()).collect();
    match settings.part {
        Some(part) => part.select(all),
        None => all,
    }
}

/// The tiles that a render with these study options begins with.
fn study_tiles(settings: &RenderSettings, study: &StudyOptions) -> Vec<Tile> {
    let positions = study.tiles.as_ref().map_or_else(|| tile_positions(settings), |tiles| tiles.to_vec());
    let fresh = |position| Tile::new(position, settings.width, settings.height, settings.columns());
    // By all threads: what pre-passes have freed lies in their arenas, and is not given back to the system.
    let mut tiles: Vec<_> = positions.into_par_iter().map(fresh).collect();
    if let Some(shares) = &study.light_shares {
        tiles.iter_mut().for_each(|tile| tile.set_light_shares(shares, settings.width));
    }
    tiles
}

/// Minimum and maximum paths of these tiles.
fn paths_range<'a>(tiles: impl IntoIterator<Item = &'a Tile>) -> (u32, u32) {
    let range = |(low, high): (u32, u32), n: u32| (low.min(n), high.max(n));
    tiles.into_iter().map(Tile::paths).map(|n| (n, n)).reduce(|all, (n, _)| range(all, n)).unwrap_or_default()
}

/// The relative error (square root of relMSE), estimated from the samples: the root of the mean over pixels and channels of
/// variance over [`relative_to`] of the mean. Infinite while a pixel has fewer than two paths.
pub fn noise(tiles: &[Tile], window: [u32; 4]) -> f64 {
    let (mut sum, mut n) = (0.0, 0u64);
    for stats in tiles.iter().flat_map(|tile| tile.inside(window).map(|(.., i)| &tile.stats[i])) {
        let (mean, variance) = (stats.mean(), stats.variance_of_mean());
        for c in 0..3 {
            sum += f64::from(variance[c]) / relative_to(f64::from(mean[c]));
        }
        n += 3;
    }
    (sum / n.max(1) as f64).sqrt()
}
