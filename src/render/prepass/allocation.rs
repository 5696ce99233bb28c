//! The allocation of a picture's paths to its tiles (`--adaptive`). Paths are proportional to the square root of a path's
//! relative variance in the tile over its cost, which minimises the mean of variance / paths at a given total cost.
//!
//! A pre-pass estimates variance and cost from a few pixels of each tile, with other scrambles of the sequence than the
//! picture's. The picture therefore stays unbiased, and every part, crop and session computes the same allocation. The
//! variance of emission that the camera sees directly is estimated from all pixels (`visible_emission`); where it is large, camera
//! rays for emission alone reduce it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use tracing::debug;

use super::effort::{
    self, ALLOCATION_PIXELS, ALLOCATION_PIXELS_PER_TILE, CAMERA_RAY_COST, FIRST_ALLOCATION_PIXELS_PER_TILE,
    MAX_REMAINING_ALLOCATED,
};
use super::visible_emission::VisibleEmission;
use crate::balance::method::MAX_PASS_PATHS;
use crate::color::luminance;
use crate::film::compare::relative_to;
use crate::integrator::clients::ScatteredSums;
use crate::integrator::{EmissionRayCounts, PixelTask, Proposal, Transport, Wave, WaveCounts};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::pass::sampler::with_buffers;
use crate::render::pass::scheduler::planned_to;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, MIN_AUTO_PATHS, Technique};
use crate::render::{pass::tile::Tile, settings::part::TILE};
use crate::sampling::hash;

/// Paths per pixel of the pre-pass in each of its two scrambles, in the first and the second step. The difference of two scrambles
/// is the error that remains with fixed sample counts and stratified points. It falls faster than by the number of paths where
/// light is smooth: few paths make easy tiles look too noisy.
const PATHS_PER_SCRAMBLE: [u32; 2] = [4, 8];
/// Sampled paths of a scramble at which a tile's own estimate has the same weight as that of the tiles around it.
const SMOOTHING_PATHS: f64 = 160.0;
/// An allocation is judged by pixels that had no part in it: each fold of the sampled ones by all others (cross-validation).
const FOLDS: usize = 4;
/// Minimum and maximum doublings of the mean number of paths. Powers of two suit low-discrepancy points, by a few per
/// cent.
const DOUBLINGS: [i32; 2] = [-2, 2];
/// Steps of the iteration that finds the price of a camera ray for emission.
const PRICE_STEPS: u32 = 2;
/// Maximum paths of a pixel, over the mean of the picture.
pub const MAX_PATHS_OVER_MEAN: u32 = 1 << DOUBLINGS[1];

/// The paths of each tile, relative to the mean.
#[derive(Debug)]
pub struct Allocation {
    /// Doublings of the mean, row by row.
    doublings: Vec<i32>,
    columns: u32,
    emission_rays: Option<EmissionRayCounts>,
    stats: TechniqueStats,
}

/// What the pre-pass measures in a tile.
#[derive(Debug, Clone, Copy, Default)]
struct Survey {
    /// Pixels.
    pixels: f64,
    /// Sum of the relative variance of a path over each fold of the sampled pixels.
    variance: [f64; FOLDS],
    /// Sampled pixels in each fold.
    sampled: [usize; FOLDS],
    /// Paths of a sampled pixel in each scramble.
    paths: u32,
    /// Mean cost of a path over the sampled pixels, > 0: each has a camera ray.
    cost: f64,
    /// Mean luminance over the sampled pixels, without emission that the camera sees directly.
    scattered: f64,
    /// Mean over all pixels of the relative variance of that emission, by the path's camera ray alone, and by as many rays as
    /// each pixel has.
    visible: [f64; 2],
    /// Mean number per path, over all pixels, of camera rays for that emission.
    emission_rays: f64,
}

impl Survey {
    /// Relative variance of a path, by the sampled pixels of some folds.
    fn variance(&self, is_in: impl Fn(usize) -> bool) -> f64 {
        let add = |(sum, n), fold: usize| (sum + self.variance[fold], n + self.sampled[fold]);
        let (sum, n) = (0..FOLDS).filter(|fold| is_in(*fold)).fold((0.0, 0), add);
        sum / n.max(1) as f64
    }

    /// The same, by all sampled pixels.
    fn by_all(&self) -> f64 {
        self.variance(|_| true)
    }

    /// Cost of a path with its camera rays for emission.
    fn cost_with_emission_rays(&self) -> f64 {
        self.cost + CAMERA_RAY_COST * self.emission_rays
    }
}

impl Allocation {
    /// Allocates the paths of the whole picture, whatever part of it is rendered. `None` where `settings` are not adaptive,
    /// and soon after `stop` is raised.
    pub fn new(transport: &Transport, settings: &RenderSettings, stop: &AtomicBool) -> Option<Self> {
        if !settings.asks_for(Technique::Adaptive) {
            return None;
        }
        let began = Instant::now();
        // The pixels that are sampled here have few neighbours to share with.
        let transport = &Transport { proposal: Proposal { reuse: None, ..transport.proposal }, ..transport.clone() };
        // Pictures against the clock have no reproducible number of paths.
        let is_late = || effort::is_late(settings, began);
        let [columns, rows] = [settings.width, settings.height].map(|n| n.div_ceil(TILE));
        // Alpha is that of the paths' own camera rays, and the colour that it multiplies must be too.
        let visible = (!settings.transparent)
            .then(|| VisibleEmission::new(transport, [settings.width, settings.height], stop))
            .flatten();
        let step = |sampled: usize, paths: u32| -> Option<Vec<Survey>> {
            let of_tile = |tile| {
                let at = [tile % columns, tile / columns];
                let survey = |wave: &mut Wave| survey(wave, transport, settings, visible.as_ref(), at, sampled, paths);
                (!stop.load(Ordering::Relaxed) && !is_late()).then(|| with_buffers(|buffers| survey(buffers.wave())))
            };
            (0..columns * rows).into_par_iter().map(of_tile).collect()
        };
        let of = |mut surveys: Vec<Survey>| {
            let visible = visible.as_ref().map(|visible| Visible { visible, settings, columns });
            let emission_rays = visible.and_then(|visible| visible.choose(&mut surveys));
            let Allocated { doublings, by_counts, stats } = allocated(&surveys, columns as usize);
            let stats = TechniqueStats { seconds: began.elapsed().as_secs_f64(), ..stats };
            (Self { doublings, columns, emission_rays, stats }, by_counts)
        };
        let [few, more] = PATHS_PER_SCRAMBLE;
        let (found, by_counts) = of(step(FIRST_ALLOCATION_PIXELS_PER_TILE, few)?);
        debug!("the first step of the allocation leaves {by_counts:.3}");
        if settings.techniques[Technique::Adaptive] == Choice::Auto && by_counts > 1.0 {
            return Some(found);
        }
        Some(of(step(pixels_per_tile(settings), more)?).0)
    }

    /// What was found.
    pub fn stats(&self) -> &TechniqueStats {
        &self.stats
    }

    /// Camera rays for emission; `None` if no pixel has more than its paths'.
    pub fn emission_rays(&self) -> Option<&EmissionRayCounts> {
        self.emission_rays.as_ref()
    }

    /// Paths per pixel of a tile, where the mean over all tiles is at most `mean`.
    pub fn paths(&self, tile: &Tile, mean: u32) -> u32 {
        let [column, row] = tile.grid_position();
        let own = f64::from(mean) * f64::exp2(f64::from(self.doublings[(row * self.columns + column) as usize]));
        if mean < MIN_AUTO_PATHS { mean } else { own as u32 }
    }

    /// Paths per pixel of the next pass of a tile, where `settings` have a goal; `None` if the tile has reached its own.
    pub fn next_pass(&self, settings: &RenderSettings, tile: &Tile) -> Option<u32> {
        let goal = settings.spp.map(|mean| self.paths(tile, mean));
        let pass = planned_to(settings, goal, tile.paths())?;
        // Renders of 128 and of 256 paths then begin alike in tiles with a fraction of the mean.
        let longest = self.paths(tile, MAX_PASS_PATHS).min(MAX_PASS_PATHS);
        Some(if settings.balance.method().uses_prepasses() { pass.min(longest) } else { pass })
    }

    /// Renders with equal keys, and other settings alike, have the same allocation and begin with the same passes. `None`
    /// where all tiles get the same number of paths.
    pub fn key(settings: &RenderSettings) -> Option<u32> {
        let spp = settings.spp.filter(|_| settings.asks_for(Technique::Adaptive))?;
        Some(if spp.is_multiple_of(MAX_PASS_PATHS) { MAX_PASS_PATHS } else { spp })
    }

    /// Does a render to the goal of `settings` begin with all passes of one to the smaller goal of `shorter`? Those end with a
    /// whole pass of every tile.
    pub fn begins_as(shorter: &RenderSettings, settings: &RenderSettings) -> bool {
        Self::key(shorter) == Some(MAX_PASS_PATHS)
            && settings.asks_for(Technique::Adaptive)
            && settings.spp > shorter.spp
    }
}

/// Sampled pixels of a whole tile in the second step. They do not follow the number of paths: an unguided picture that goes on to
/// more of them keeps its allocation.
fn pixels_per_tile(settings: &RenderSettings) -> usize {
    let tiles = settings.width.div_ceil(TILE) as usize * settings.height.div_ceil(TILE) as usize;
    let [least, most] = ALLOCATION_PIXELS_PER_TILE;
    (ALLOCATION_PIXELS / tiles).clamp(least, most)
}

/// Traces some of the pixels of a tile's pre-pass, of which there are at most as many as half of its pixels.
fn survey(
    wave: &mut Wave,
    transport: &Transport,
    settings: &RenderSettings,
    visible: Option<&VisibleEmission>,
    [column, row]: [u32; 2],
    sampled: usize,
    paths: u32,
) -> Survey {
    let (x0, y0) = (column * TILE, row * TILE);
    let (width, height) = (TILE.min(settings.width - x0), TILE.min(settings.height - y0));
    let pixels = (width * height) as usize;
    let counts = transport.half(paths);
    // 97 is prime, and no tile has a side of that: no pixel comes twice.
    let mut places: Vec<_> = (0..sampled.min(pixels.div_ceil(2))).map(|i| (i * 97 % pixels) as u32).collect();
    places.sort_unstable();
    let place = |i: u32| [x0 + i % width, y0 + i / width];
    let tasks: Vec<_> = places.into_iter().map(|i| PixelTask::first(place(i), counts, 0)).collect();
    wave.counts = WaveCounts::default();
    let [a, b] = [0, 1].map(|scramble| {
        let transport = Transport { seed: hash(transport.seed ^ hash(0x616c_6c6f + scramble)), ..transport.clone() };
        let [mut scattered, mut emitted] = [(); 2].map(|_| vec![Vec3::ZERO; tasks.len()]);
        wave.run(&transport, &tasks, &mut ScatteredSums { scattered: &mut scattered, emitted: &mut emitted });
        scattered.into_iter().map(|sum| sum / paths as f32).collect::<Vec<_>>()
    });
    let n = tasks.len();
    let mean = a.iter().chain(&b).filter(|color| color.is_finite()).sum::<Vec3>() / (2 * n) as f32;
    let mut variance = [0.0; FOLDS];
    for (i, (a, b)) in a.iter().zip(&b).enumerate() {
        let emitted = visible.map_or(0.0, |visible| visible.at([tasks[i].x, tasks[i].y]).mean);
        let found = 0.5 * (*a + *b);
        // A rare bright path raises the pixel's own mean too, which hides its variance; the tile's alone hides dark pixels.
        let divisor = |mean: f32| relative_to(f64::from(mean) + emitted).sqrt();
        let of = |c: usize| f64::from(a[c] - b[c]).powi(2) / (2.0 * divisor(found[c]) * divisor(found[c].min(mean[c])));
        let own = f64::from(paths) * (of(0) + of(1) + of(2)) / 3.0;
        variance[i % FOLDS] += if own.is_finite() { own } else { 0.0 };
    }
    Survey {
        pixels: pixels as f64,
        variance,
        sampled: std::array::from_fn(|fold| (n + FOLDS - 1 - fold) / FOLDS),
        paths,
        cost: effort::cost(&wave.counts, &transport.proposal) / (f64::from(2 * paths) * n as f64),
        scattered: f64::from(luminance(mean).max(0.0)),
        ..Default::default()
    }
}

/// Directly visible emission in the pixels of a picture of `columns` tiles a row.
#[derive(Clone, Copy)]
struct Visible<'a> {
    visible: &'a VisibleEmission,
    settings: &'a RenderSettings,
    columns: u32,
}

impl Visible<'_> {
    /// Chooses each pixel's camera rays for emission, and completes the surveys. `None` if they would not pay.
    fn choose(&self, surveys: &mut [Survey]) -> Option<EmissionRayCounts> {
        self.complete(surveys, f64::INFINITY);
        // The price falls as rays reduce the variance.
        let mut price = 0.0;
        for _ in 0..PRICE_STEPS {
            let variance = sum(surveys, |s| s.by_all() + s.visible[1]);
            price = CAMERA_RAY_COST * variance / sum(surveys, Survey::cost_with_emission_rays);
            self.complete(surveys, price);
        }
        if remaining_by_emission_rays(surveys) > MAX_REMAINING_ALLOCATED {
            self.complete(surveys, f64::INFINITY);
            return None;
        }
        let RenderSettings { width, height, .. } = *self.settings;
        let rays = (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| [x, y])).map(|[x, y]| {
            let tile = (y / TILE * self.columns + x / TILE) as usize;
            self.visible.at([x, y]).rays_per_path(surveys[tile].scattered, price) as u8
        });
        Some(EmissionRayCounts::new(width, rays.collect()))
    }

    /// Fills what surveys have of directly visible emission, where a camera ray has this price.
    fn complete(&self, surveys: &mut [Survey], price: f64) {
        let RenderSettings { width, height, .. } = *self.settings;
        surveys.par_iter_mut().enumerate().for_each(|(tile, survey)| {
            let [x0, y0] = [tile as u32 % self.columns, tile as u32 / self.columns].map(|at| at * TILE);
            let scattered = survey.scattered;
            (survey.visible, survey.emission_rays) = ([0.0; 2], 0.0);
            for at in (y0..height.min(y0 + TILE)).flat_map(|y| (x0..width.min(x0 + TILE)).map(move |x| [x, y])) {
                let seen = self.visible.at(at);
                let rays = seen.rays_per_path(scattered, price);
                let variance = [1, rays].map(|rays| seen.relative_variance(scattered, rays));
                (0..2).for_each(|i| survey.visible[i] += variance[i] / survey.pixels);
                survey.emission_rays += f64::from(if rays > 1 { rays } else { 0 }) / survey.pixels;
            }
        });
    }
}

/// Sum over pixels, in tiles where each contributes so much.
fn sum(surveys: &[Survey], of: impl Fn(&Survey) -> f64) -> f64 {
    surveys.iter().map(|s| s.pixels * of(s)).sum()
}

/// Error times cost with the camera rays for emission, over that without.
fn remaining_by_emission_rays(surveys: &[Survey]) -> f64 {
    let [without, with] = [0, 1].map(|i| sum(surveys, |s| s.by_all() + s.visible[i]));
    let error = if without > 0.0 { with / without } else { 1.0 };
    error * sum(surveys, Survey::cost_with_emission_rays) / sum(surveys, |s| s.cost)
}

/// What [`allocated`] finds.
struct Allocated {
    /// Doublings of tiles, row by row.
    doublings: Vec<i32>,
    /// Error times cost with these, over that of equal counts with the same camera rays for emission. Above
    /// [`MAX_REMAINING_ALLOCATED`] all counts are equal.
    by_counts: f64,
    /// Fraction of error times cost that remains, and what led to it.
    stats: TechniqueStats,
}

/// Allocates paths to tiles, and estimates the efficiency.
fn allocated(surveys: &[Survey], columns: usize) -> Allocated {
    let by = |of: &dyn Fn(&Survey) -> f64| {
        doublings(surveys, &smoothed(surveys, &surveys.iter().map(of).collect::<Vec<_>>(), columns))
    };
    let factor = |doubled: &i32| f64::exp2(f64::from(*doubled));
    let (mut error, mut cost) = ([0.0; 2], [0.0; 2]);
    for fold in 0..FOLDS {
        let found = by(&|s| s.variance(|other| other != fold));
        for (s, factor) in surveys.iter().zip(found.iter().map(factor)) {
            let variance = s.variance(|own| own == fold) + s.visible[1];
            let [v, c] = [s.pixels * variance, s.pixels * s.cost_with_emission_rays()];
            error = [error[0] + v / factor, error[1] + v];
            cost = [cost[0] + c * factor, cost[1] + c];
        }
    }
    let by_counts = if error[1] > 0.0 { error[0] / error[1] * cost[0] / cost[1] } else { 1.0 };
    let found = if by_counts < MAX_REMAINING_ALLOCATED { by(&Survey::by_all) } else { vec![0; surveys.len()] };
    let range = found.iter().map(factor).fold([1.0; 2], |[low, high]: [f64; 2], f| [low.min(f), high.max(f)]);
    let emission_rays = sum(surveys, |s| s.emission_rays) / sum(surveys, |_| 1.0);
    let by_rays = remaining_by_emission_rays(surveys);
    // Equal counts gain nothing, whatever others were estimated to.
    let only_rays = range == [1.0; 2] && emission_rays > 0.0;
    let remaining = if only_rays { by_rays } else { by_counts * by_rays };
    let stats = TechniqueStats {
        on: range != [1.0; 2] || emission_rays > 0.0,
        remaining: Some(remaining),
        range: Some(range),
        emission_rays: Some(emission_rays),
        ..Default::default()
    };
    Allocated { doublings: found, by_counts, stats }
}

/// Each tile's variance. That by sampled pixels is mixed with the mean of the tiles around it: the fewer there are, the more.
fn smoothed(surveys: &[Survey], variance: &[f64], columns: usize) -> Vec<f64> {
    let rows = surveys.len() / columns;
    let near = |i: usize, most: usize| i.saturating_sub(1)..(i + 2).min(most);
    let of = |i: usize| {
        let (column, row) = (i % columns, i / columns);
        let around = || near(row, rows).flat_map(|r| near(column, columns).map(move |c| r * columns + c));
        let mean = around().map(|j| variance[j]).sum::<f64>() / around().count() as f64;
        let sampled = surveys[i].sampled.iter().sum::<usize>() as f64 * f64::from(surveys[i].paths);
        let trust = sampled / (sampled + SMOOTHING_PATHS);
        trust * variance[i] + (1.0 - trust) * mean + surveys[i].visible[1]
    };
    (0..surveys.len()).map(of).collect()
}

/// Doublings of the mean for each tile, within [`DOUBLINGS`]. Paths are doubled where that reduces the error most for its
/// cost, until the mean is reached.
fn doublings(surveys: &[Survey], variance: &[f64]) -> Vec<i32> {
    let [least, most] = DOUBLINGS;
    // A tile's error falls by variance / 2n, its cost rises by n: the root of their ratio.
    let steps = surveys.iter().zip(variance).enumerate().flat_map(|(tile, (s, v))| {
        (least..most).map(move |doubled| {
            (tile, doubled, (v / s.cost_with_emission_rays()).sqrt() / f64::exp2(f64::from(doubled)))
        })
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

    fn tile(variance: [f64; FOLDS], cost: f64) -> Survey {
        Survey {
            pixels: 256.0,
            variance: variance.map(|v| 32.0 * v),
            sampled: [32; FOLDS],
            paths: 4,
            cost,
            ..Default::default()
        }
    }

    #[test]
    fn paths_double_where_that_takes_most_error_away() {
        let surveys = [1.0, 1.0, 16.0, 0.0625].map(|cost| tile([1.0; FOLDS], cost));
        assert_eq!(doublings(&surveys, &[1.0, 16.0, 16.0, 1.0]), [-1, 1, -1, 0]);
        // As many as it may have, and what is left to the others.
        let many = [tile([1.0; FOLDS], 1.0); 8];
        assert_eq!(doublings(&many, &[1e-9, 1e-9, 1.0, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9]), [0, -1, 2, -1, -1, -1, -1, -1]);
        assert_eq!(doublings(&many, &[3.0; 8]), [0; 8]);
    }

    #[test]
    fn tiles_are_alike_where_no_fold_confirms_that_they_differ() {
        let bright = |fold: usize| std::array::from_fn(|i| if i == fold { 100.0 } else { 1.0 });
        let even = [0, 1, 2, 3, 0, 1, 2, 3].map(|fold| tile(bright(fold), 1.0));
        let Allocated { doublings: found, stats, .. } = allocated(&even, 1);
        assert!(found == [0; 8] && stats.remaining > Some(1.0) && !stats.on, "{found:?} {stats:?}");
        let differ = [[1.0, 1.1], [1.0, 0.9], [36.0, 33.0], [36.0, 40.0]].map(|[a, b]| tile([a, b, a, b], 1.0));
        let Allocated { doublings: found, stats, .. } = allocated(&differ, 1);
        assert!(found == [-1, -1, 0, 1] && stats.remaining < Some(0.8) && stats.on, "{found:?} {stats:?}");
        let Allocated { doublings: black, stats, .. } = allocated(&[tile([0.0; FOLDS], 1.0); 4], 2);
        assert!(black == [0; 4] && stats.remaining == Some(1.0));
    }
}
