//! A tile of pixels: what it has collected, and how it takes a pass.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::RenderSettings;
use super::adaptive::Seen;
use super::sampler::{self, TileSampler};
use crate::balance::{Learned, Moments, Share};
use crate::film::{AovSums, ExtraSums, Peak, PixelStats};
use crate::integrator::{PixelTask, Transport, WaveCounts};

/// Pixels along a side. Tiles lie on the whole picture's grid.
pub const TILE: u32 = 16;

/// A tile's pixels: all of it that is inside the picture, also where a window shows less. A tile is the unit of
/// repetition: packets of rays are filled tile by tile, and on the edge of a triangle the same ray can hit in one packet
/// and miss in another.
///
/// All that later passes depend on is serialised: a tile that was saved and read goes on as if nothing had happened.
#[derive(Debug, Serialize, Deserialize)]
pub struct Tile {
    pub(super) pixels: Vec<TilePixel>,
    /// Radiance statistics, one a pixel, in the pixels' order.
    pub stats: Vec<PixelStats>,
    /// Balance moments, one a pixel, or none for methods that keep none.
    pub moments: Vec<Moments>,
    /// AOV sums, one a pixel, or none when no AOV needs them.
    pub aovs: Vec<AovSums>,
    /// More sums, one a pixel, or none when no AOV needs them.
    pub extras: Vec<ExtraSums>,
    /// Brightest paths, one a pixel.
    pub peaks: Vec<Peak>,
}

/// Which columns tiles have besides the statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    /// [`Tile::moments`].
    pub moments: bool,
    /// [`Tile::aovs`].
    pub aovs: bool,
    /// [`Tile::extras`].
    pub extras: bool,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct TilePixel {
    pub x: u32,
    pub y: u32,
    /// Light and BSDF samples taken at first surfaces, and how many of the light samples were toward the environment by
    /// count.
    pub light: u32,
    pub environment: u32,
    pub bsdf: u32,
    /// The part of light samples that goes to the environment; `None` until that is chosen.
    pub environment_share: Option<f32>,
}

/// What a pass over a tile took.
#[derive(Debug, Clone, Copy, Default)]
pub struct TileWork {
    /// Rays by kind and query time.
    pub counts: WaveCounts,
    /// Wall seconds on its thread.
    pub seconds: f64,
    /// Paths traced.
    pub paths: u64,
}

impl Tile {
    /// All tiles of a picture of `width` by `height` that a window (x0, y0, x1, y1; the last two exclusive) touches, row
    /// by row.
    pub fn cover(width: u32, height: u32, [x0, y0, x1, y1]: [u32; 4], columns: Columns) -> Vec<Tile> {
        let mut tiles = Vec::new();
        for ty in y0 / TILE..y1.div_ceil(TILE) {
            for tx in x0 / TILE..x1.div_ceil(TILE) {
                // Grown, it would leave holes in memory: a tenth of what pixels take.
                let mut pixels = Vec::with_capacity((TILE * TILE) as usize);
                for y in ty * TILE..((ty + 1) * TILE).min(height) {
                    for x in tx * TILE..((tx + 1) * TILE).min(width) {
                        pixels.push(TilePixel { x, y, light: 0, environment: 0, bsdf: 0, environment_share: None });
                    }
                }
                let n = pixels.len();
                tiles.push(Tile {
                    pixels,
                    stats: vec![PixelStats { balance: 0.5, ..Default::default() }; n],
                    moments: vec![Moments::default(); if columns.moments { n } else { 0 }],
                    aovs: vec![AovSums::default(); if columns.aovs { n } else { 0 }],
                    extras: vec![ExtraSums::default(); if columns.extras { n } else { 0 }],
                    peaks: vec![Peak::default(); n],
                });
            }
        }
        tiles
    }

    /// Sets the pixels' shares of light samples for the first pass, from those of the whole picture, `width` pixels a row.
    pub fn set_light_shares(&mut self, shares: &[f32], width: u32) {
        for (pixel, stats) in self.pixels.iter().zip(&mut self.stats) {
            stats.balance = shares[(pixel.y * width + pixel.x) as usize];
        }
    }

    /// Takes a pass of `paths` paths a pixel, or fewer where a noise goal has it so, as the balance's method has it.
    pub fn pass(&mut self, transport: &Transport, settings: &RenderSettings, paths: u32) -> TileWork {
        self.pass_watched(transport, settings, paths, &mut |_| ())
    }

    /// [`pass`](Self::pass), and `watch` is told what each pixel takes, wave by wave.
    pub fn pass_watched(
        &mut self,
        transport: &Transport,
        settings: &RenderSettings,
        paths: u32,
        watch: &mut dyn FnMut(&PixelTask),
    ) -> TileWork {
        let start = Instant::now();
        let (done, before) = (self.paths(), self.all_paths());
        let both = self.pixels.iter().zip(&self.stats);
        let mut shares: Vec<_> =
            both.map(|(pixel, s)| Share { light: s.balance, environment: pixel.environment_share }).collect();
        let mut moments = std::mem::take(&mut self.moments);
        let counts = sampler::with_buffers(|buffers| {
            let mut sampler = TileSampler::new(self, transport, buffers, settings.noise_goal(), watch);
            let mut learned = Learned { shares: &mut shares, moments: &mut moments };
            settings.balance.method().pass(&mut learned, &mut sampler, done, paths);
            sampler.counts()
        });
        self.moments = moments;
        for ((pixel, stats), share) in self.pixels.iter_mut().zip(&mut self.stats).zip(shares) {
            (stats.balance, pixel.environment_share) = (share.light, share.environment);
        }
        TileWork { counts, seconds: start.elapsed().as_secs_f64(), paths: self.all_paths() - before }
    }

    /// Pixels a row.
    pub(super) fn width(&self) -> usize {
        self.pixels.iter().take_while(|p| p.y == self.pixels[0].y).count()
    }

    /// The pixels inside a window: position in the whole picture and place in the columns.
    pub fn inside(&self, [x0, y0, x1, y1]: [u32; 4]) -> impl Iterator<Item = (u32, u32, usize)> {
        let all = self.pixels.iter().enumerate();
        all.filter(move |(_, p)| (x0..x1).contains(&p.x) && (y0..y1).contains(&p.y)).map(|(i, p)| (p.x, p.y, i))
    }

    /// What its pixel number `i` has collected, row by row. Without sums for AOVs, zeros.
    pub fn at(&self, i: usize) -> (PixelStats, AovSums) {
        (self.stats[i], self.aovs.get(i).copied().unwrap_or_default())
    }

    /// Adds independent paths of the same pixels.
    pub fn join(&mut self, other: &Tile) {
        self.stats.iter_mut().zip(&other.stats).for_each(|(own, more)| own.join(more));
        self.aovs.iter_mut().zip(&other.aovs).for_each(|(own, more)| own.join(more));
        self.extras.iter_mut().zip(&other.extras).for_each(|(own, more)| own.join(more));
        self.peaks.iter_mut().zip(&other.peaks).for_each(|(own, more)| own.add(more.luminance, more.path));
    }

    /// Bytes of memory that a pixel takes with these columns.
    pub fn bytes_a_pixel(columns: Columns) -> usize {
        let column = |there: bool, bytes: usize| if there { bytes } else { 0 };
        size_of::<TilePixel>()
            + size_of::<PixelStats>()
            + size_of::<Peak>()
            + column(columns.moments, size_of::<Moments>())
            + column(columns.aovs, size_of::<AovSums>())
            + column(columns.extras, size_of::<ExtraSums>())
    }

    /// Its place in the picture's grid of tiles: column and row.
    pub fn grid_position(&self) -> [u32; 2] {
        self.pixels.first().map_or([0; 2], |p| [p.x / TILE, p.y / TILE])
    }

    /// What its pixels have seen.
    pub(super) fn seen(&self) -> Seen<'_> {
        Seen { stats: &self.stats, width: self.width() }
    }

    /// Most paths of its pixels: they differ by a noise goal alone.
    pub fn paths(&self) -> u32 {
        self.seen().paths()
    }

    /// Paths of all its pixels.
    fn all_paths(&self) -> u64 {
        self.stats.iter().map(|s| u64::from(s.samples)).sum()
    }

    /// Fewest paths of a pixel.
    pub fn fewest_paths(&self) -> u32 {
        self.stats.iter().map(|s| s.samples).min().unwrap_or(0)
    }

    /// Is it as clean as these settings ask, so that it takes no more passes?
    pub fn is_clean(&self, settings: &RenderSettings) -> bool {
        settings.noise_goal().is_some_and(|goal| self.seen().is_clean(&goal))
    }

    /// Has it the pixels and columns of the other, all whole?
    pub fn covers(&self, other: &Tile) -> bool {
        let same = |(a, b): (&TilePixel, &TilePixel)| (a.x, a.y) == (b.x, b.y);
        let sizes =
            |t: &Tile| [t.pixels.len(), t.stats.len(), t.moments.len(), t.aovs.len(), t.extras.len(), t.peaks.len()];
        sizes(self) == sizes(other) && self.pixels.iter().zip(&other.pixels).all(same) && self.seen().is_whole()
    }

    /// Its pixels' sums of velocities; `None` if nothing moves.
    pub(super) fn velocities(&self) -> Option<Vec<[f32; 4]>> {
        let some = self.extras.iter().any(|extras| extras.velocity != [0.0; 4]);
        some.then(|| self.extras.iter().map(|extras| extras.velocity).collect())
    }

    /// With these; `None` if they are not as many as it has sums.
    pub(super) fn with_velocities(mut self, velocities: Vec<[f32; 4]>) -> Option<Self> {
        let fits = velocities.len() == self.extras.len();
        self.extras.iter_mut().zip(velocities).for_each(|(extras, velocity)| extras.velocity = velocity);
        fits.then_some(self)
    }

    /// How many pixels it has.
    pub fn pixels(&self) -> usize {
        self.pixels.len()
    }
}
