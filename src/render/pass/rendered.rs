//! A finished or stopped render: its tiles, counts and noise.

use rayon::prelude::*;
use serde::Serialize;

use super::pixels::TilePixels;
use super::stats::{RenderStats, StopReason};
use super::tile::Tile;
use crate::film::compare::relative_to;
use crate::film::{Background, Film};
use crate::integrator::clients::MeanVariance;
use crate::integrator::clients::mean_variance::mean_variance;
use crate::render::pass::goal::Goal;
use crate::render::settings::part::grid_positions;
use crate::render::settings::{RenderSettings, StudyOptions};

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

    /// The variance of the picture's mean; `None` where pixels have less than two paths, or no variance.
    pub fn mean_variance(&self) -> Option<MeanVariance> {
        let one_set = !self.settings.balance.method().scrambles_passes();
        mean_variance(self.tiles.iter().map(Tile::variance), one_set)
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
    let all = grid_positions(settings.window()).collect();
    match settings.part {
        Some(part) => part.select(all),
        None => all,
    }
}

/// The tiles that a render with these study options begins with.
pub(in crate::render) fn study_tiles(settings: &RenderSettings, study: &StudyOptions) -> Vec<Tile> {
    let positions = study.tiles.as_ref().map_or_else(|| tile_positions(settings), |tiles| tiles.to_vec());
    let fresh = |position| Tile::new(position, settings.width, settings.height, settings.columns());
    // By all threads: what pre-passes have freed lies in their arenas, and is not given back to the system.
    positions.into_par_iter().map(fresh).collect()
}

/// Minimum and maximum paths of these tiles.
pub(in crate::render) fn paths_range<'a>(tiles: impl IntoIterator<Item = &'a Tile>) -> (u32, u32) {
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

/// Sample counts of a picture.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Samples {
    /// Total paths.
    pub paths: u64,
    /// Passes completed.
    pub passes: u32,
    /// Pixels of the window.
    pub pixels: u64,
    /// Minimum paths of a pixel.
    pub pixel_min: u32,
    /// Mean paths of a pixel.
    pub pixel_mean: f64,
    /// Maximum paths of a pixel.
    pub pixel_max: u32,
}

impl Samples {
    /// Counts the samples of a render.
    pub fn of(rendered: &Rendered) -> Self {
        let Rendered { tiles, stats, settings, .. } = rendered;
        let inside =
            || tiles.iter().flat_map(|tile| tile.inside(settings.window()).map(|(.., i)| tile.stats[i].samples));
        let (pixel_min, pixel_max) = (inside().min().unwrap_or(0), inside().max().unwrap_or(0));
        let pixels = tiles.iter().map(|t| t.inside(settings.window()).count() as u64).sum();
        // Tiles at the border of the window are traced whole.
        let traced: usize = tiles.iter().map(Tile::pixels).sum();
        let pixel_mean = stats.paths as f64 / traced.max(1) as f64;
        Self { paths: stats.paths, passes: stats.passes, pixels, pixel_min, pixel_mean, pixel_max }
    }
}
