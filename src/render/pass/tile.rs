//! A tile of pixels and its statistics. [`sampler`](super::sampler) traces its passes.

use crate::render::settings::Columns;
use crate::render::settings::part::TILE;
use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::adaptive::TileStats;
use crate::balance::{Moments, Shares};
use crate::film::stats::accumulate;
use crate::film::{AovSums, ExtraSums, GroundSums, Peak, PixelStats};
use crate::integrator::WaveCounts;
use crate::integrator::clients::BlockSums;
use crate::integrator::clients::mean_variance::TileVariance;
use crate::render::settings::noise::NoiseGoal;

/// All pixels of a tile that are inside the picture, even where a crop window shows fewer. Tiles are always traced whole, as
/// packets of rays are filled tile by tile: at the edge of a triangle the same ray can hit in one packet and miss in
/// another.
///
/// All that later passes depend on is serialised, so that a resumed render has the bits of an uninterrupted one.
#[derive(Debug, Serialize, Deserialize)]
pub struct Tile {
    pub(in crate::render) pixels: Vec<TilePixel>,
    /// Radiance statistics, one per pixel, in the order of the pixels.
    pub stats: Vec<PixelStats>,
    /// Shares of the samples of the next pass, one per pixel.
    pub shares: Vec<Shares>,
    /// Balance moments, one per pixel; empty for methods that need none.
    pub moments: Vec<Moments>,
    /// AOV sums, one per pixel; empty if no AOV needs them.
    pub aovs: Vec<AovSums>,
    /// Extra sums, one per pixel; empty if no AOV needs them.
    pub extras: Vec<ExtraSums>,
    /// Brightest paths, one per pixel.
    pub peaks: Vec<Peak>,
    /// Sums of the ground that catches shadows, one per pixel; empty without one.
    pub ground: Vec<GroundSums>,
    /// What the variance of the picture's mean follows from.
    pub(in crate::render) blocks: BlockSums,
    /// By pixel and then by layer, light of the layers that are asked for; empty without them.
    pub layers: Vec<[f32; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(in crate::render) struct TilePixel {
    pub x: u32,
    pub y: u32,
    /// Light samples, light samples of the environment and BSDF samples that were taken at first surfaces.
    pub light: u32,
    pub environment: u32,
    pub bsdf: u32,
}

/// Counts and times of a pass over a tile.
#[derive(Debug, Clone, Copy, Default)]
pub struct TileWork {
    /// Rays by kind and query time.
    pub counts: WaveCounts,
    /// Wall seconds of the thread.
    pub seconds: f64,
    /// Paths traced.
    pub paths: u64,
}

impl Tile {
    /// The tile at a grid position of a picture of `width` by `height` pixels, without samples.
    pub fn new([column, row]: [u32; 2], width: u32, height: u32, columns: Columns) -> Self {
        // Growing vectors would waste a tenth of the pixels' memory.
        let mut pixels = Vec::with_capacity((TILE * TILE) as usize);
        for y in row * TILE..((row + 1) * TILE).min(height) {
            for x in column * TILE..((column + 1) * TILE).min(width) {
                pixels.push(TilePixel { x, y, light: 0, environment: 0, bsdf: 0 });
            }
        }
        let n = pixels.len();
        Self {
            pixels,
            stats: vec![PixelStats::EMPTY; n],
            shares: vec![Shares { light_share: 0.5, environment_share: None }; n],
            moments: vec![Moments::default(); if columns.moments { n } else { 0 }],
            aovs: vec![AovSums::default(); if columns.aovs { n } else { 0 }],
            extras: vec![ExtraSums::default(); if columns.extras { n } else { 0 }],
            peaks: vec![Peak::default(); n],
            ground: vec![GroundSums::default(); if columns.ground { n } else { 0 }],
            blocks: BlockSums::default(),
            layers: vec![[0.0; 3]; n * columns.layers],
        }
    }

    /// Pixels a row.
    pub(in crate::render) fn width(&self) -> usize {
        self.pixels.iter().take_while(|p| p.y == self.pixels[0].y).count()
    }

    /// The pixels inside a window: column and row in the whole picture, and index in the tile.
    pub fn inside(&self, [x0, y0, x1, y1]: [u32; 4]) -> impl Iterator<Item = (u32, u32, usize)> {
        let all = self.pixels.iter().enumerate();
        all.filter(move |(_, p)| (x0..x1).contains(&p.x) && (y0..y1).contains(&p.y)).map(|(i, p)| (p.x, p.y, i))
    }

    /// Statistics and AOV sums of pixel `i`, row by row. AOV sums are 0 where the tile has none.
    pub fn at(&self, i: usize) -> (PixelStats, AovSums) {
        let shadow = self.ground.get(i).map_or(0.0, |ground| ground.alpha(self.stats[i].samples));
        (self.stats[i], AovSums { shadow, ..self.aovs.get(i).copied().unwrap_or_default() })
    }

    /// Adds the sums of independent paths of the same pixels. Light shares become their mean by paths.
    pub fn join(&mut self, other: &Tile) {
        let shares = self.shares.iter_mut().zip(&other.shares);
        for ((own, other), (before, more)) in shares.zip(self.stats.iter().zip(&other.stats)) {
            let fraction = f64::from(more.samples) / f64::from((before.samples + more.samples).max(1));
            own.light_share += (f64::from(other.light_share - own.light_share) * fraction) as f32;
        }
        self.stats.iter_mut().zip(&other.stats).for_each(|(own, more)| own.join(more));
        self.aovs.iter_mut().zip(&other.aovs).for_each(|(own, more)| own.join(more));
        self.extras.iter_mut().zip(&other.extras).for_each(|(own, more)| own.join(more));
        self.layers.iter_mut().zip(&other.layers).for_each(|(own, more)| accumulate(own, *more));
        self.ground.iter_mut().zip(&other.ground).for_each(|(own, more)| own.join(more));
        self.peaks.iter_mut().zip(&other.peaks).for_each(|(own, more)| own.add(more.luminance, more.path));
        self.blocks.join(&other.blocks);
    }

    /// Estimated bytes of memory of the tiles of so many pixels with these columns.
    pub fn memory_bytes(pixels: u64, columns: Columns) -> u64 {
        /// Memory per byte of tile data: 1.104 and 1.073 as measured between pictures of 0.5, 2 and 8 million pixels.
        const OVERHEAD: f64 = 1.085;
        let column = |there: bool, bytes: usize| if there { bytes } else { 0 };
        let per_pixel = size_of::<TilePixel>()
            + size_of::<PixelStats>()
            + size_of::<Shares>()
            + size_of::<Peak>()
            + column(columns.moments, size_of::<Moments>())
            + column(columns.aovs, size_of::<AovSums>())
            + column(columns.extras, size_of::<ExtraSums>())
            + column(columns.ground, size_of::<GroundSums>())
            + columns.layers * size_of::<[f32; 3]>();
        (pixels as f64 * per_pixel as f64 * OVERHEAD) as u64
    }

    /// Its column and row in the picture's grid of tiles.
    pub fn grid_position(&self) -> [u32; 2] {
        self.pixels.first().map_or([0; 2], |p| [p.x / TILE, p.y / TILE])
    }

    /// What the variance of the picture's mean follows from.
    pub(in crate::render) fn variance(&self) -> TileVariance<'_> {
        TileVariance {
            sums: &self.blocks,
            pixels: self.pixels(),
            paths: self.all_paths() as f64 / self.pixels() as f64,
            independent: self.stats.iter().map(|stats| Vec3::from(stats.variance_of_mean()).as_dvec3()).sum(),
        }
    }

    /// Its pixels' statistics.
    pub(in crate::render) fn tile_stats(&self) -> TileStats<'_> {
        TileStats { stats: &self.stats, width: self.width() }
    }

    /// Maximum paths of a pixel: pixels differ only with a noise goal.
    pub fn paths(&self) -> u32 {
        self.tile_stats().paths()
    }

    /// Paths of all its pixels.
    pub(in crate::render) fn all_paths(&self) -> u64 {
        self.stats.iter().map(|s| u64::from(s.samples)).sum()
    }

    /// Minimum paths of a pixel.
    pub fn fewest_paths(&self) -> u32 {
        self.stats.iter().map(|s| s.samples).min().unwrap_or(0)
    }

    /// Paths after which its next pass begins: with a noise goal, the fewest of pixels that go on.
    pub fn paths_before_pass(&self, goal: Option<&NoiseGoal>) -> u32 {
        goal.and_then(|goal| self.tile_stats().open_paths(goal)).unwrap_or(self.paths())
    }

    /// Have all its pixels reached this noise goal?
    pub fn is_clean(&self, goal: &NoiseGoal) -> bool {
        self.tile_stats().is_clean(goal)
    }

    /// Has it the pixels and columns of the other, all complete?
    pub fn covers(&self, other: &Tile) -> bool {
        let same = |(a, b): (&TilePixel, &TilePixel)| (a.x, a.y) == (b.x, b.y);
        let sizes = |t: &Tile| {
            [
                t.pixels.len(),
                t.stats.len(),
                t.shares.len(),
                t.moments.len(),
                t.aovs.len(),
                t.extras.len(),
                t.peaks.len(),
                t.ground.len(),
                t.layers.len(),
            ]
        };
        sizes(self) == sizes(other) && self.pixels.iter().zip(&other.pixels).all(same) && self.tile_stats().is_whole()
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.pixels.len()
    }
}
