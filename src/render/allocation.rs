//! The allocation of a picture's paths to its tiles (`--adaptive`). Paths are proportional to the square root of a path's
//! relative variance in the tile over its cost, which minimises the mean of variance / paths at a given total cost.
//!
//! A pre-pass estimates variance and cost from a few pixels of each tile, with other scrambles of the sequence than the
//! picture's. The picture therefore stays unbiased, and every part, crop and session computes the same allocation.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use super::RenderSettings;
use super::sampler::with_buffers;
use super::stats::AllocationEfficiency;
use super::tile::{TILE, Tile};
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::film::compare::relative_to;
use crate::integrator::{PixelSums, PixelTask, Transport, Wave, WaveCounts};
use crate::sampling::hash;

/// Paths per pixel of the pre-pass in each of its two scrambles. Their difference is the error that remains with fixed
/// sample counts and stratified points.
const PATHS_PER_SCRAMBLE: u32 = 4;
/// Maximum pixels of a picture in the pre-pass, and the minimum and maximum of a tile. The pre-pass takes at most a
/// thirty-second of the picture's paths.
const MAX_PIXELS: usize = 1 << 14;
const PIXELS_PER_TILE: [usize; 2] = [32, 128];
/// Sampled pixels at which a tile's own estimate has the same weight as that of the tiles around it.
const SMOOTHING_PIXELS: f64 = 40.0;
/// Minimum and maximum doublings of the mean number of paths. Powers of two suit low-discrepancy points, by a few per
/// cent.
const DOUBLINGS: [i32; 2] = [-2, 2];
/// Maximum paths of a tile, over the mean.
pub const MAX_PATHS_OVER_MEAN: u32 = 1 << DOUBLINGS[1];
/// All tiles get the same number of paths where the pre-pass estimates that more than this of the error would remain.
const MAX_REMAINING_ERROR: f64 = 0.97;
/// Below this mean number of paths, all tiles get the same number.
const MIN_MEAN_PATHS: u32 = 16;

/// The paths of each tile, relative to the mean.
#[derive(Debug)]
pub struct Allocation {
    /// Doublings of the mean, row by row.
    doublings: Vec<i32>,
    columns: u32,
    efficiency: AllocationEfficiency,
}

/// What the pre-pass measures in a tile.
#[derive(Debug, Clone, Copy, Default)]
struct Survey {
    /// Pixels.
    pixels: f64,
    /// Relative variance of a path, by each half of the sampled pixels.
    variance: [f64; 2],
    /// Sampled pixels.
    sampled: usize,
    /// Rays of a path.
    cost: f64,
}

impl Allocation {
    /// Allocates the paths of the whole picture, whatever part of it is rendered. `None` where `settings` are not adaptive,
    /// and soon after `stop` is raised.
    pub fn new(transport: &Transport, settings: &RenderSettings, stop: &AtomicBool) -> Option<Self> {
        let few = settings.spp.is_some_and(|spp| spp < MIN_MEAN_PATHS);
        if !settings.adaptive || settings.noise.is_some() || few {
            return None;
        }
        let [columns, rows] = [settings.width, settings.height].map(|n| n.div_ceil(TILE));
        let of_tile = |tile| {
            let survey = |wave: &mut Wave| survey(wave, transport, settings, [tile % columns, tile / columns]);
            (!stop.load(Ordering::Relaxed)).then(|| with_buffers(|buffers| survey(buffers.wave())))
        };
        let surveys: Vec<_> = (0..columns * rows).into_par_iter().map(of_tile).collect::<Option<_>>()?;
        let (doublings, efficiency) = allocated(&surveys, columns as usize);
        Some(Self { doublings, columns, efficiency })
    }

    /// Paths per pixel of a tile, where the mean over all tiles is `mean`.
    pub fn paths(&self, tile: &Tile, mean: u32) -> u32 {
        let [column, row] = tile.grid_position();
        let own = f64::from(mean) * f64::exp2(f64::from(self.doublings[(row * self.columns + column) as usize]));
        if mean < MIN_MEAN_PATHS { mean } else { own.round() as u32 }
    }

    /// Its estimated efficiency.
    pub fn efficiency(&self) -> AllocationEfficiency {
        self.efficiency
    }
}

/// Traces the pre-pass of a tile.
fn survey(wave: &mut Wave, transport: &Transport, settings: &RenderSettings, [column, row]: [u32; 2]) -> Survey {
    let (x0, y0) = (column * TILE, row * TILE);
    let (width, height) = (TILE.min(settings.width - x0), TILE.min(settings.height - y0));
    let pixels = (width * height) as usize;
    let tiles = settings.width.div_ceil(TILE) as usize * settings.height.div_ceil(TILE) as usize;
    let few = settings.spp.map_or(PIXELS_PER_TILE[1], |spp| spp as usize).max(PIXELS_PER_TILE[0]);
    let sampled = (MAX_PIXELS / tiles).clamp(PIXELS_PER_TILE[0], PIXELS_PER_TILE[1]).min(few).min(pixels.div_ceil(2));
    let counts = if transport.lights.has_extent() {
        Counts::half(PATHS_PER_SCRAMBLE)
    } else {
        Counts::bsdf_only(PATHS_PER_SCRAMBLE)
    };
    // 97 is prime, and no tile has a side of that: no pixel comes twice.
    let mut places: Vec<_> = (0..sampled as u32).map(|i| i * 97 % pixels as u32).collect();
    places.sort_unstable();
    let place = |i: u32| [x0 + i % width, y0 + i / width];
    let tasks: Vec<_> = places.into_iter().map(|i| PixelTask::first(place(i), counts, 0)).collect();
    wave.counts = WaveCounts::default();
    let [a, b] = [0, 1].map(|scramble| {
        let transport = Transport { seed: hash(settings.seed ^ hash(0x616c_6c6f + scramble)), ..transport.clone() };
        let mut stats = vec![PixelStats::default(); sampled];
        wave.run(&transport, &tasks, &mut PixelSums::new(&mut stats));
        stats.into_iter().map(|stats| Vec3::from(stats.mean())).collect::<Vec<_>>()
    });
    let mut variance = [0.0; 2];
    for (i, (a, b)) in a.iter().zip(&b).enumerate() {
        let of = |c: usize| {
            let (a, b) = (f64::from(a[c]), f64::from(b[c]));
            (a - b) * (a - b) / (2.0 * relative_to(0.5 * (a + b)))
        };
        let own = f64::from(PATHS_PER_SCRAMBLE) * (of(0) + of(1) + of(2)) / 3.0;
        variance[i % 2] += if own.is_finite() { own } else { 0.0 };
    }
    let halves = [sampled.div_ceil(2), (sampled / 2).max(1)];
    Survey {
        pixels: pixels as f64,
        variance: [0, 1].map(|half| variance[half] / halves[half] as f64),
        sampled,
        cost: (wave.counts.rays() as f64 / (2 * PATHS_PER_SCRAMBLE as usize * sampled) as f64).max(1.0),
    }
}

/// Doublings of tiles, row by row, and their estimated efficiency: an allocation by one half of the pixels is judged by
/// the variance of the other half.
fn allocated(surveys: &[Survey], columns: usize) -> (Vec<i32>, AllocationEfficiency) {
    let variances = |of: &dyn Fn(&Survey) -> f64| surveys.iter().map(of).collect::<Vec<_>>();
    let halves = [variances(&|s| s.variance[0]), variances(&|s| s.variance[1])];
    let both = variances(&|s| 0.5 * (s.variance[0] + s.variance[1]));
    let factor = |doubled: &i32| f64::exp2(f64::from(*doubled));
    let remaining = [(0, 1), (1, 0)].map(|(ours, theirs)| {
        let found = doublings(surveys, &smoothed(surveys, &halves[ours], columns));
        let (mut error, mut cost) = ([0.0; 2], [0.0; 2]);
        for ((s, variance), factor) in surveys.iter().zip(&halves[theirs]).zip(found.iter().map(factor)) {
            let [v, c] = [s.pixels * variance, s.pixels * s.cost];
            error = [error[0] + v / factor, error[1] + v];
            cost = [cost[0] + c * factor, cost[1] + c];
        }
        if error[1] > 0.0 { error[0] / error[1] * cost[0] / cost[1] } else { 1.0 }
    });
    let remaining = (remaining[0] * remaining[1]).sqrt();
    let found = match remaining < MAX_REMAINING_ERROR {
        true => doublings(surveys, &smoothed(surveys, &both, columns)),
        false => vec![0; surveys.len()],
    };
    let range = found.iter().map(factor).fold([1.0; 2], |[low, high]: [f64; 2], f| [low.min(f), high.max(f)]);
    (found, AllocationEfficiency { remaining, range })
}

/// Each tile's variance, mixed with the mean of the tiles around it: the fewer its sampled pixels, the more.
fn smoothed(surveys: &[Survey], variance: &[f64], columns: usize) -> Vec<f64> {
    let rows = surveys.len() / columns;
    let near = |i: usize, most: usize| i.saturating_sub(1)..(i + 2).min(most);
    let of = |i: usize| {
        let (column, row) = (i % columns, i / columns);
        let around = || near(row, rows).flat_map(|r| near(column, columns).map(move |c| r * columns + c));
        let mean = around().map(|j| variance[j]).sum::<f64>() / around().count() as f64;
        let trust = surveys[i].sampled as f64 / (surveys[i].sampled as f64 + SMOOTHING_PIXELS);
        trust * variance[i] + (1.0 - trust) * mean
    };
    (0..surveys.len()).map(of).collect()
}

/// Doublings of the mean for each tile, within [`DOUBLINGS`]. Paths are doubled where that reduces the error most for its
/// cost, until the mean is reached.
fn doublings(surveys: &[Survey], variance: &[f64]) -> Vec<i32> {
    let [least, most] = DOUBLINGS;
    // A tile's error falls by variance / 2n, its cost rises by n: the root of their ratio.
    let steps = surveys.iter().zip(variance).enumerate().flat_map(|(tile, (s, v))| {
        (least..most).map(move |doubled| (tile, doubled, (v / s.cost).sqrt() / f64::exp2(f64::from(doubled))))
    });
    let mut steps: Vec<_> = steps.collect();
    steps.sort_by(|(a, i, gain), (b, j, other)| other.total_cmp(gain).then((i, a).cmp(&(j, b))));
    let mut found = vec![least; surveys.len()];
    let mut left: f64 = surveys.iter().map(|s| s.pixels * (1.0 - f64::exp2(f64::from(least)))).sum();
    for (tile, doubled, _) in steps {
        let more = surveys[tile].pixels * f64::exp2(f64::from(doubled));
        if found[tile] == doubled && more <= left {
            found[tile] += 1;
            left -= more;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(variance: [f64; 2], cost: f64) -> Survey {
        Survey { pixels: 256.0, variance, sampled: 128, cost }
    }

    #[test]
    fn paths_double_where_that_takes_most_error_away() {
        let surveys = [1.0, 1.0, 16.0, 0.0625].map(|cost| tile([1.0; 2], cost));
        assert_eq!(doublings(&surveys, &[1.0, 16.0, 16.0, 1.0]), [-1, 1, -1, 0]);
        // As many as it may have, and what is left to the others.
        let many = [tile([1.0; 2], 1.0); 8];
        assert_eq!(doublings(&many, &[1e-9, 1e-9, 1.0, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9]), [0, -1, 2, -1, -1, -1, -1, -1]);
        assert_eq!(doublings(&many, &[3.0; 8]), [0; 8]);
    }

    #[test]
    fn tiles_are_alike_where_the_halves_do_not_agree_that_they_differ() {
        let even = [[1.0, 100.0], [100.0, 1.0], [1.0, 100.0], [100.0, 1.0]].map(|variance| tile(variance, 1.0));
        let (found, efficiency) = allocated(&even, 1);
        assert!(
            found == [0; 4] && efficiency.remaining > 1.0 && efficiency.range == [1.0; 2],
            "{found:?} {efficiency:?}"
        );
        let differ = [tile([1.0, 1.1], 1.0), tile([1.0, 0.9], 1.0), tile([36.0, 33.0], 1.0), tile([36.0, 40.0], 1.0)];
        let (found, efficiency) = allocated(&differ, 1);
        assert!(found == [-1, -1, 0, 1] && efficiency.remaining < 0.8, "{found:?} {efficiency:?}");
        let (black, efficiency) = allocated(&[tile([0.0; 2], 1.0); 4], 2);
        assert!(black == [0; 4] && efficiency.remaining == 1.0);
    }
}
