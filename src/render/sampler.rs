//! A tile's pixels as a [`Sampler`]: the paths that a method of the balance asks for, traced in waves.

use std::cell::RefCell;

use glam::Vec3;

use super::adaptive::NoiseGoal;
use super::tile::{Tile, TilePixel};
use crate::balance::sampler::Lights;
use crate::balance::spread::Guide;
use crate::balance::{Contribution, Cost, Counts, Observer, Sampler, Technique};
use crate::integrator::{PixelBatch, PixelTask, Transport, Wave, WaveCounts, guides};

/// Paths that are traced together: their buffers stay in the second-level cache.
const WAVE_PATHS: u32 = 2048;
/// What a level of the light tree costs, in rays, as CPU times of scenes with 6 to 16 000 emissive triangles have it.
const LEVEL: f32 = 0.1;

thread_local! {
    static BUFFERS: RefCell<Buffers> = RefCell::default();
}

/// A thread's buffers, kept over tiles and passes.
#[derive(Debug, Default)]
pub struct Buffers {
    wave: Wave,
    tasks: Vec<PixelTask>,
    pilot: Pilot,
}

impl Buffers {
    /// The wave of the current thread.
    pub fn wave(&mut self) -> &mut Wave {
        &mut self.wave
    }
}

/// Hands out the buffers of the current thread.
pub fn with_buffers<T>(work: impl FnOnce(&mut Buffers) -> T) -> T {
    BUFFERS.with_borrow_mut(work)
}

/// What a pilot's samples found, and its paths' radiance, pixel by pixel.
#[derive(Debug, Default)]
struct Pilot {
    counts: Option<Counts>,
    found: Vec<Contribution>,
    paths: Vec<Vec3>,
}

impl Observer for Pilot {
    fn contribution(&mut self, found: &Contribution) {
        self.found.push(*found);
    }

    fn path(&mut self, _pixel: u32, radiance: Vec3) {
        self.paths.push(radiance);
    }
}

/// A tile under way in a pass.
pub struct TileSampler<'a> {
    tile: &'a mut Tile,
    transport: &'a Transport<'a>,
    buffers: &'a mut Buffers,
    goal: Option<NoiseGoal>,
    watch: &'a mut dyn FnMut(&PixelTask),
}

impl<'a> TileSampler<'a> {
    /// Begins a pass; `watch` is told what each pixel takes, wave by wave.
    pub fn new(
        tile: &'a mut Tile,
        transport: &'a Transport<'a>,
        buffers: &'a mut Buffers,
        goal: Option<NoiseGoal>,
        watch: &'a mut dyn FnMut(&PixelTask),
    ) -> Self {
        buffers.wave.counts = WaveCounts::default();
        Self { tile, transport, buffers, goal, watch }
    }

    /// Rays and time of the pass so far.
    pub fn counts(&self) -> WaveCounts {
        self.buffers.wave.counts
    }
}

impl Sampler for TileSampler<'_> {
    fn pixels(&self) -> usize {
        self.tile.pixels()
    }

    fn width(&self) -> usize {
        self.tile.width()
    }

    fn lights(&self) -> Option<Lights> {
        let lights = self.transport.lights;
        let environment = lights.two_kinds().then_some(lights.environment_probability);
        let choice = lights.area.as_ref().map_or(0.0, |area| LEVEL * area.levels());
        lights.has_extent().then_some(Lights { environment, indirect: self.transport.max_depth > 2, choice })
    }

    fn longest(&self) -> u32 {
        WAVE_PATHS
    }

    fn paths(&mut self, paths: u32) -> Vec<u32> {
        let stats = self.tile.tile_stats();
        stats.deal(stats.paths_for(paths, self.goal.as_ref()))
    }

    fn take(&mut self, counts: &[Counts], weighed: &[Counts], observer: Option<&mut dyn Observer>) {
        let Buffers { wave, tasks, .. } = self.buffers;
        trace(self.tile, self.transport, wave, tasks, (counts, weighed), observer, self.watch);
    }

    fn pilot(&mut self, counts: Counts) -> &[Contribution] {
        let Buffers { wave, tasks, pilot } = self.buffers;
        pilot.counts = Some(counts);
        pilot.found.clear();
        pilot.paths.clear();
        let all = vec![counts; self.tile.pixels()];
        // Light samples toward the environment, toward area lights where these are divided, and BSDF samples so far.
        let first = |p: &TilePixel| match counts.environment {
            Some(_) => [p.environment, p.light - p.environment, p.bsdf],
            None => [p.light, 0, p.bsdf],
        };
        let first: Vec<_> = self.tile.pixels.iter().map(first).collect();
        trace(self.tile, self.transport, wave, tasks, (&all, &all), Some(pilot), self.watch);
        // Who learns from it counts the pilot's samples from 0.
        for found in &mut pilot.found {
            let technique = if found.technique == Technique::Light { usize::from(found.area) } else { 2 };
            found.index -= first[found.pixel as usize][technique];
        }
        &pilot.found
    }

    fn reweight(&mut self, total: &[Counts]) {
        reweight(self.tile, &self.buffers.pilot, total);
    }

    fn guides(&mut self) -> Vec<Guide> {
        let places: Vec<_> = self.tile.pixels.iter().map(|p| [p.x, p.y]).collect();
        guides(self.transport, &places)
    }

    fn cost(&self) -> Cost {
        cost(&self.buffers.wave.counts)
    }
}

/// Traces paths, dealt by `counts` and weighed by `weighed`.
fn trace(
    tile: &mut Tile,
    transport: &Transport,
    wave: &mut Wave,
    tasks: &mut Vec<PixelTask>,
    (counts, weighed): (&[Counts], &[Counts]),
    mut observer: Option<&mut dyn Observer>,
    watch: &mut dyn FnMut(&PixelTask),
) {
    let mut start = 0;
    while start < counts.len() {
        // Whole pixels, as many as fit, at least one.
        let mut paths = 0;
        let fits = |c: &&Counts| {
            paths += c.paths;
            paths <= WAVE_PATHS
        };
        let end = start + counts[start..].iter().take_while(fits).count().max(1);
        tasks.clear();
        let pixels = tile.pixels[start..end].iter_mut().zip(&tile.stats[start..end]);
        for (i, (pixel, stats)) in (start..end).zip(pixels) {
            let counts = counts[i];
            tasks.push(PixelTask {
                x: pixel.x,
                y: pixel.y,
                first_path: stats.samples,
                first_light: pixel.light,
                first_environment: pixel.environment,
                first_bsdf: pixel.bsdf,
                counts,
                weighed: weighed[i],
                number: i as u32,
            });
            pixel.light += counts.light;
            pixel.environment += counts.environment.unwrap_or(0);
            pixel.bsdf += counts.bsdf;
        }
        tasks.iter().for_each(&mut *watch);
        let mut batch = PixelBatch {
            tasks,
            stats: &mut tile.stats[start..end],
            peaks: &mut tile.peaks[start..end],
            aovs: tile.aovs.get_mut(start..end).unwrap_or_default(),
            extras: tile.extras.get_mut(start..end).unwrap_or_default(),
            observer: match &mut observer {
                Some(observer) => Some(&mut **observer),
                None => None,
            },
        };
        wave.run(transport, &mut batch);
        start = end;
    }
}

/// Weighs a pilot with one light and one BSDF sample a path by each pixel's `total` counts.
fn reweight(tile: &mut Tile, pilot: &Pilot, total: &[Counts]) {
    let Some(counts) = pilot.counts else { return };
    // Samples a path, over the pilot's.
    let rates: Vec<_> = total.iter().map(|total| total.over(counts)).collect();
    let n = counts.paths as usize;
    let mut changes = vec![Vec3::ZERO; pilot.paths.len()];
    for found in &pilot.found {
        let pixel = found.pixel as usize;
        let change = found.at(rates[pixel]) - found.radiance;
        changes[pixel * n + found.path(counts.paths) as usize] += change;
        if let Some(aovs) = tile.aovs.get_mut(pixel) {
            match found.technique {
                Technique::Indirect => aovs.add_light(Vec3::ZERO, change),
                _ => aovs.add_light(change, Vec3::ZERO),
            }
        }
    }
    // Where the pilot's light came from is forgotten: groups share what changes as they share the pixel.
    for (extras, changes) in tile.extras.iter_mut().zip(changes.chunks(n)) {
        extras.share_light(changes.iter().sum());
    }
    let of_pixels = changes.chunks(n).zip(pilot.paths.chunks(n));
    for (stats, (changes, paths)) in tile.stats.iter_mut().zip(of_pixels) {
        for (change, before) in changes.iter().zip(paths).filter(|(change, _)| **change != Vec3::ZERO) {
            for c in 0..3 {
                let (change, before) = (f64::from(change[c]), f64::from(before[c]));
                stats.sum[c] += change;
                stats.sum_squared[c] += change * (2.0 * before + change);
            }
        }
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
    use crate::render::tile::Columns;

    #[test]
    fn a_pilot_weighed_again_has_the_sums_of_paths_that_were_weighed_so_at_once() {
        let mut tile = Tile::cover(2, 1, [0, 0, 2, 1], Columns { moments: false, aovs: true, extras: false }).remove(0);
        let mut pilot = Pilot { counts: Some(Counts::half(2)), ..Default::default() };
        let contribution = |pixel, technique, index, r, y| Contribution {
            pixel,
            technique,
            area: false,
            index,
            r,
            w: 0.0,
            radiance: Vec3::splat(y),
        };
        pilot.found = vec![
            contribution(0, Technique::Light, 0, 0.5, 1.0),
            contribution(0, Technique::Bsdf, 0, -0.5, 2.0),
            contribution(1, Technique::Indirect, 1, -1.0, 3.0),
        ];
        // Pixel by pixel, two paths each; one saw an area light besides.
        pilot.paths = [3.0, 5.0, 0.0, 3.0].map(Vec3::splat).to_vec();
        for (sum, paths) in tile.stats.iter_mut().zip(pilot.paths.chunks(2)) {
            sum.sum = [f64::from(paths[0].x + paths[1].x); 3];
            sum.sum_squared = [f64::from(paths[0].x.powi(2) + paths[1].x.powi(2)); 3];
        }
        reweight(&mut tile, &pilot, &[Counts::new(0.75, 4), Counts::new(0.25, 4)]);
        // At α = ¾, r = ±½: 1/1.25 and 2/0.75. At α = ¼, r = −1: 3/1.5.
        let expected = [[1.0 / 1.25 + 2.0 / 0.75, 5.0], [0.0, 2.0]];
        for (sum, paths) in tile.stats.iter().zip(expected) {
            assert!((sum.sum[0] - (paths[0] + paths[1])).abs() < 1e-6);
            assert!((sum.sum_squared[0] - (paths[0] * paths[0] + paths[1] * paths[1])).abs() < 1e-5);
        }
        assert_eq!(tile.aovs[1].indirect, [-1.0; 3]);
    }
}
