//! One square of pixels: what it has collected, and how it takes a pass.

use std::cell::RefCell;
use std::time::Instant;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::balance::efficiency;
use crate::balance::pilot::{Candidates, Caution, Spreads};
use crate::balance::{Balance, Cost, Counts, Share, Technique};
use crate::integrator::{PixelPlan, PixelSum, Transport, Wave, WaveCounts, guides};
use crate::rays::embree::set_flush_to_zero;

/// Pixels along a side. Tiles lie on the whole picture's grid.
pub const TILE: u32 = 16;
/// Paths that are traced together: their buffers stay in the second-level cache.
const WAVE_PATHS: u32 = 2048;

thread_local! {
    /// A thread's buffers, kept over tiles and passes.
    static WAVE: RefCell<Wave> = RefCell::default();
}

/// A tile's pixels: all of it that is inside the picture, also where a window shows less. A tile is the unit of
/// repetition: packets of rays are filled tile by tile, and on the edge of a triangle the same ray can hit in one packet
/// and miss in another.
///
/// All that later passes depend on is serialised: a tile that was saved and read goes on as if nothing had happened.
#[derive(Debug, Serialize, Deserialize)]
pub struct Tile {
    pixels: Vec<TilePixel>,
    #[serde(skip)]
    plan: Vec<PixelPlan>,
    /// One a pixel, in the pixels' order.
    pub sums: Vec<PixelSum>,
}

#[derive(Debug, Serialize, Deserialize)]
struct TilePixel {
    x: u32,
    y: u32,
    /// Light and BSDF samples taken at first surfaces, and how many of the light samples were toward the environment by
    /// count.
    light: u32,
    sky: u32,
    bsdf: u32,
    /// The part of light samples that goes to the environment; `None` until that is chosen.
    sky_share: Option<f32>,
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
    pub fn cover(width: u32, height: u32, [x0, y0, x1, y1]: [u32; 4]) -> Vec<Tile> {
        let mut tiles = Vec::new();
        for ty in y0 / TILE..y1.div_ceil(TILE) {
            for tx in x0 / TILE..x1.div_ceil(TILE) {
                let mut pixels = Vec::new();
                for y in ty * TILE..((ty + 1) * TILE).min(height) {
                    for x in tx * TILE..((tx + 1) * TILE).min(width) {
                        pixels.push(TilePixel { x, y, light: 0, sky: 0, bsdf: 0, sky_share: None });
                    }
                }
                let mut sums = vec![PixelSum::default(); pixels.len()];
                sums.iter_mut().for_each(|s| s.stats.balance = 0.5);
                tiles.push(Tile { pixels, plan: Vec::new(), sums });
            }
        }
        tiles
    }

    /// Sets the pixels' shares for the first pass, from those of the whole picture of `width` pixels a row.
    pub fn begin_with(&mut self, shares: &[f32], width: u32) {
        for (pixel, sum) in self.pixels.iter().zip(&mut self.sums) {
            sum.stats.balance = shares[(pixel.y * width + pixel.x) as usize];
        }
    }

    /// Takes a pass of `paths` paths a pixel. The balance of each pixel follows from its own tile's earlier passes, or
    /// from its neighbours' parts of this pass's pilot.
    pub fn pass(&mut self, transport: &Transport, balance: Balance, paths: u32) -> TileWork {
        let start = Instant::now();
        set_flush_to_zero();
        let two_techniques = transport.lights.has_extent();
        let before_pass = self.sums.first().map_or(0, |s| s.stats.samples);
        // Once, in the first pass: what it chooses holds for all passes.
        let chooses = balance == Balance::Progressive && two_techniques && before_pass == 0;
        let candidates = chooses.then(|| candidates(transport));
        if let Some(candidates) = &candidates {
            self.pixels.iter_mut().for_each(|p| p.sky_share = candidates.usual().sky);
        }
        let counts = WAVE.with_borrow_mut(|wave| {
            wave.counts = WaveCounts::default();
            match candidates.as_ref().zip(balance.pilot(before_pass, paths)) {
                Some((candidates, pilot)) => self.with_pilot(transport, wave, candidates, [pilot, paths]),
                _ if two_techniques && balance.learns_at_once(before_pass) => {
                    self.alone(transport, wave, paths);
                }
                _ => self.at_once(transport, wave, paths),
            }
            wave.counts
        });
        if transport.moments && two_techniques {
            for sum in &mut self.sums {
                sum.stats.balance = balance.share(&sum.moments).unwrap_or(sum.stats.balance);
            }
        }
        let paths = u64::from(paths) * self.pixels.len() as u64;
        TileWork { counts, seconds: start.elapsed().as_secs_f64(), paths }
    }

    /// A pass at the shares that the pixels have.
    fn at_once(&mut self, transport: &Transport, wave: &mut Wave, paths: u32) {
        // A long pass goes in parts with the same balance, so that buffers stay small.
        let mut left = paths;
        while left > 0 {
            let part = left.min(WAVE_PATHS);
            let both = self.pixels.iter().zip(&self.sums);
            let shares = both.map(|(pixel, sum)| Share { light: sum.stats.balance, sky: pixel.sky_share });
            let counts: Vec<_> = match transport.lights.has_extent() {
                true => shares.map(|share| Counts::of(share, part)).collect(),
                false => vec![Counts::bsdf_only(part); self.pixels.len()],
            };
            self.trace(transport, wave, part, &counts, |_, counts| counts);
            left -= part;
        }
    }

    /// A pass of `paths` paths that begins with `pilot` paths at equal counts; all are then weighed by the total counts.
    fn with_pilot(
        &mut self,
        transport: &Transport,
        wave: &mut Wave,
        candidates: &Candidates,
        [pilot, paths]: [u32; 2],
    ) {
        let n = self.pixels.len();
        let pilot = candidates.pilot(pilot);
        self.record(transport, wave, pilot);
        let (width, cost) = (self.width(), cost(&wave.counts));
        let spreads = Spreads::new(candidates, &wave.findings, n, pilot.paths);
        let places: Vec<_> = self.pixels.iter().map(|p| [p.x, p.y]).collect();
        let guides = guides(transport, &places);
        let shares: Vec<_> = (0..n).map(|i| spreads.choose(i, width, &guides, cost)).collect();
        let total: Vec<_> = shares.iter().map(|share| Counts::of(*share, paths)).collect();
        self.weigh_again(wave, pilot, &total);
        let rest: Vec<_> = total.iter().map(|total| total.after(pilot)).collect();
        self.trace(transport, wave, paths - pilot.paths, &rest, |i, _| total[i]);
        for ((pixel, sum), share) in self.pixels.iter_mut().zip(&mut self.sums).zip(shares) {
            (sum.stats.balance, pixel.sky_share) = (share.light, share.sky);
        }
    }

    /// A pass of equal counts from which the later passes' shares follow by cost and second moment.
    fn alone(&mut self, transport: &Transport, wave: &mut Wave, paths: u32) {
        let n = self.pixels.len();
        self.record(transport, wave, Counts::half(paths));
        let cost = cost(&wave.counts);
        let shares = efficiency::shares(&wave.findings, n, self.width(), cost);
        self.sums.iter_mut().zip(shares).for_each(|(sum, share)| sum.stats.balance = share);
    }

    /// Pixels a row.
    fn width(&self) -> usize {
        self.pixels.iter().take_while(|p| p.y == self.pixels[0].y).count()
    }

    /// Takes the same counts for each pixel and records what they find.
    fn record(&mut self, transport: &Transport, wave: &mut Wave, counts: Counts) {
        wave.findings.clear();
        wave.recorded.clear();
        wave.record = true;
        self.trace(transport, wave, counts.paths, &vec![counts; self.pixels.len()], |_, counts| counts);
        wave.record = false;
    }

    /// Weighs a pilot with one light and one BSDF sample a path again, by each pixel's `total` counts.
    fn weigh_again(&mut self, wave: &Wave, pilot: Counts, total: &[Counts]) {
        // Samples a path, over the pilot's.
        let rates: Vec<_> = total.iter().map(|total| total.over(pilot)).collect();
        let pilot = pilot.paths as usize;
        let mut changes = vec![Vec3::ZERO; wave.recorded.len()];
        for finding in &wave.findings {
            let pixel = finding.pixel as usize;
            let change = finding.at(rates[pixel]) - finding.radiance;
            changes[pixel * pilot + finding.path(pilot as u32) as usize] += change;
            let aovs = &mut self.sums[pixel].aovs;
            let of_kind = match finding.technique {
                Technique::Indirect => &mut aovs.indirect,
                _ => &mut aovs.direct,
            };
            for c in 0..3 {
                of_kind[c] += change[c];
            }
        }
        let of_pixels = changes.chunks(pilot).zip(wave.recorded.chunks(pilot));
        for (sum, (changes, recorded)) in self.sums.iter_mut().zip(of_pixels) {
            for (change, before) in changes.iter().zip(recorded).filter(|(change, _)| **change != Vec3::ZERO) {
                for c in 0..3 {
                    let (change, before) = (f64::from(change[c]), f64::from(before[c]));
                    sum.stats.sum[c] += change;
                    sum.stats.sum_squared[c] += change * (2.0 * before + change);
                }
            }
        }
    }

    /// Traces `paths` paths a pixel, dealt by `counts` and weighed by `weighed`'s answer to a pixel and its counts.
    fn trace(
        &mut self,
        transport: &Transport,
        wave: &mut Wave,
        paths: u32,
        counts: &[Counts],
        weighed: impl Fn(usize, Counts) -> Counts,
    ) {
        let first_path = self.sums.first().map_or(0, |s| s.stats.samples);
        let at_once = (WAVE_PATHS / paths).max(1) as usize;
        for start in (0..self.pixels.len()).step_by(at_once) {
            let end = (start + at_once).min(self.pixels.len());
            self.plan.clear();
            for (place, pixel) in (start..end).zip(&mut self.pixels[start..end]) {
                let counts = counts[place];
                let weighed = weighed(place, counts);
                self.plan.push(PixelPlan {
                    x: pixel.x,
                    y: pixel.y,
                    first_path,
                    first_light: pixel.light,
                    first_sky: pixel.sky,
                    first_bsdf: pixel.bsdf,
                    counts,
                    weighed,
                    place: place as u32,
                });
                pixel.light += counts.light;
                pixel.sky += counts.sky.unwrap_or(0);
                pixel.bsdf += counts.bsdf;
            }
            wave.run(transport, &self.plan, paths, &mut self.sums[start..end]);
        }
    }

    /// The pixels inside a window: position in the whole picture and what was collected.
    pub fn inside(&self, [x0, y0, x1, y1]: [u32; 4]) -> impl Iterator<Item = (u32, u32, &PixelSum)> {
        let all = self.pixels.iter().zip(&self.sums);
        all.filter(move |(p, _)| (x0..x1).contains(&p.x) && (y0..y1).contains(&p.y)).map(|(p, sum)| (p.x, p.y, sum))
    }

    /// Its place in the picture's grid of tiles: column and row.
    pub fn place(&self) -> [u32; 2] {
        self.pixels.first().map_or([0; 2], |p| [p.x / TILE, p.y / TILE])
    }

    /// Paths that each of its pixels has taken.
    pub fn paths(&self) -> u32 {
        self.sums.first().map_or(0, |s| s.stats.samples)
    }

    /// Has it the pixels of the other, and sums for all of them?
    pub fn covers(&self, other: &Tile) -> bool {
        let same = |(a, b): (&TilePixel, &TilePixel)| (a.x, a.y) == (b.x, b.y);
        self.pixels.len() == other.pixels.len()
            && self.sums.len() == self.pixels.len()
            && self.pixels.iter().zip(&other.pixels).all(same)
            && self.sums.iter().all(|s| s.stats.samples == self.paths())
    }

    /// How many pixels it has.
    pub fn pixels(&self) -> usize {
        self.pixels.len()
    }
}

/// The shares that a pixel may have by what shines and how far light may go.
fn candidates(transport: &Transport) -> Candidates {
    let caution = if transport.max_depth > 2 { Caution::INDIRECT } else { Caution::DIRECT };
    match transport.lights.two_kinds() {
        true => Candidates::three(transport.lights.sky_chance, caution),
        false => Candidates::two(caution),
    }
}

/// What paths with one sample of each technique at the first surface cost, by the rays that they took.
fn cost(rays: &WaveCounts) -> Cost {
    // A first surface's light sample is a shadow ray at most; all others follow from BSDF samples.
    let light = rays.shadow_rays.min(rays.camera_rays);
    let bsdf = rays.first_bounce_rays + rays.later_bounce_rays + rays.shadow_rays - light;
    let all = rays.camera_rays.max(1) as f32;
    Cost { fixed: 1.0, light: light as f32 / all, bsdf: bsdf as f32 / all }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::Finding;

    #[test]
    fn a_pilot_weighed_again_has_the_sums_of_paths_that_were_weighed_so_at_once() {
        let mut tile = Tile::cover(2, 1, [0, 0, 2, 1]).remove(0);
        let mut wave = Wave::default();
        let finding = |pixel, technique, index, r, y| Finding {
            pixel,
            technique,
            lamp: false,
            index,
            r,
            radiance: Vec3::splat(y),
        };
        wave.findings = vec![
            finding(0, Technique::Light, 0, 0.5, 1.0),
            finding(0, Technique::Bsdf, 0, -0.5, 2.0),
            finding(1, Technique::Indirect, 1, -1.0, 3.0),
        ];
        // Pixel by pixel, two paths each; one saw a lamp besides.
        wave.recorded = [3.0, 5.0, 0.0, 3.0].map(Vec3::splat).to_vec();
        for (sum, paths) in tile.sums.iter_mut().zip(wave.recorded.chunks(2)) {
            sum.stats.sum = [f64::from(paths[0].x + paths[1].x); 3];
            sum.stats.sum_squared = [f64::from(paths[0].x.powi(2) + paths[1].x.powi(2)); 3];
        }
        tile.weigh_again(&wave, Counts::half(2), &[Counts::new(0.75, 4), Counts::new(0.25, 4)]);
        // At α = ¾, r = ±½: 1/1.25 and 2/0.75. At α = ¼, r = −1: 3/1.5.
        let expected = [[1.0 / 1.25 + 2.0 / 0.75, 5.0], [0.0, 2.0]];
        for (sum, paths) in tile.sums.iter().zip(expected) {
            assert!((sum.stats.sum[0] - (paths[0] + paths[1])).abs() < 1e-6);
            assert!((sum.stats.sum_squared[0] - (paths[0] * paths[0] + paths[1] * paths[1])).abs() < 1e-5);
        }
        assert_eq!(tile.sums[1].aovs.indirect, [-1.0; 3]);
    }
}
