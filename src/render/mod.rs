//! Tiles, passes, stopping, saving: from a scene and settings to pixels and files.
//!
//! [`scheduler`] says what is next, [`driver`] does it tile by tile, [`checkpoint`] keeps it in files, [`merge`] puts
//! parts together. What makes a picture's bits is said in [`identity`].

pub mod adaptive;
pub mod allocation;
mod build_info;
pub mod checkpoint;
pub mod driver;
pub mod fireflies;
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
pub mod tile;
mod validate;

use crate::film::compare::relative_to;
use crate::film::{Background, Film};
pub use crate::guiding::Guiding;
pub use build_info::BuildInfo;
pub use checkpoint::{Record, Saved};
pub use driver::{Pause, RunOptions, camera, render, run, transport};
pub use fireflies::Fireflies;
pub use identity::Identity;
pub use part::Part;
pub use pixels::TilePixels;
pub use progress::Progress;
pub use replay::replay;
pub use settings::{Balance, Integrator, PixelFilter, RenderSettings, StudyOptions};
pub use stats::{RenderStats, StopReason};
use tile::{TILE, Tile};

/// A finished or stopped render.
#[derive(Debug)]
pub struct Rendered {
    /// What was asked for.
    pub settings: RenderSettings,
    /// What was collected, tile by tile, row by row, with all that is needed to go on.
    pub tiles: Vec<Tile>,
    /// What it took.
    pub stats: RenderStats,
    /// Why it ended.
    pub stop: StopReason,
    /// What is behind everything.
    pub background: Background,
}

impl Rendered {
    /// The window's pixels as they are: what files are written from.
    pub fn pixels(&self) -> TilePixels<'_> {
        TilePixels::new(&self.tiles, &self.settings, self.background)
    }

    /// The window's pixels, copied row by row: for those who compute with them.
    pub fn film(&self) -> Film {
        Film::of(&self.pixels())
    }

    /// How many of the window's pixels have no path, and how many pixels it has.
    pub fn pixels_without_paths(&self) -> (usize, usize) {
        let count = |tile: &Tile| tile.inside(self.settings.window()).count();
        let empty = self.tiles.iter().filter(|tile| tile.paths() == 0).map(count).sum();
        (empty, self.tiles.iter().map(count).sum())
    }

    /// Fewest and most paths of its tiles ([`Tile::paths`]).
    pub fn paths_range(&self) -> (u32, u32) {
        paths_range(&self.tiles)
    }

    /// Noise of its noisiest tile; 0 without tiles.
    pub fn worst_noise(&self) -> f64 {
        let (window, tiles) = (self.settings.window(), self.tiles.iter());
        tiles.map(|tile| noise(std::slice::from_ref(tile), window)).fold(0.0, f64::max)
    }
}

/// The tiles that a render of these settings begins with, row by row.
pub fn fresh_tiles(settings: &RenderSettings) -> Vec<Tile> {
    study_tiles(settings, &StudyOptions::default())
}

/// The tiles that a render with these study options begins with.
fn study_tiles(settings: &RenderSettings, study: &StudyOptions) -> Vec<Tile> {
    let cover = |window| Tile::cover(settings.width, settings.height, window, settings.columns());
    let corner = |tile: &[u32; 2]| tile.map(|n| n * TILE);
    let mut tiles = match &study.tiles {
        None => cover(settings.window()),
        Some(some) => some.iter().map(corner).flat_map(|[x, y]| cover([x, y, x + 1, y + 1])).collect(),
    };
    if let Some(shares) = &study.light_shares {
        tiles.iter_mut().for_each(|tile| tile.set_light_shares(shares, settings.width));
    }
    match settings.part {
        Some(part) => part.select(tiles),
        None => tiles,
    }
}

/// Fewest and most paths of these tiles.
fn paths_range<'a>(tiles: impl IntoIterator<Item = &'a Tile>) -> (u32, u32) {
    let range = |(low, high): (u32, u32), n: u32| (low.min(n), high.max(n));
    tiles.into_iter().map(Tile::paths).map(|n| (n, n)).reduce(|all, (n, _)| range(all, n)).unwrap_or_default()
}

/// Root of the mean over pixels and channels of variance over [`relative_to`] the mean: the relative error that relMSE
/// will find, as estimated from the samples themselves. Infinite while a pixel has less than two paths.
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
