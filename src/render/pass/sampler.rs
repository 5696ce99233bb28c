//! The [`Sampler`] of a tile: traces the paths that a balance method requests, in waves.

use std::cell::RefCell;
use std::time::Instant;

use glam::Vec3;

use super::adaptive::group_of;
use super::tile::{Tile, TilePixel, TileWork};
use crate::balance::sampler::LightInfo;
use crate::balance::{Contribution, Cost, Counts, LearnedPixels, Observer, PixelFeatures, Sampler, Technique};
use crate::film::stats::accumulate;
use crate::integrator::clients::{
    AovColumns, Aovs, ContributionColumns, Contributions, Ground, GroundColumns, MeanVarianceColumns, MeanVarianceSums,
};
use crate::integrator::{PixelSums, PixelTask, Transport, Wave, WaveCounts, guides};
use crate::render::settings::RenderSettings;
use crate::render::settings::noise::NoiseGoal;

/// Maximum paths of a wave. Their buffers fit into the second-level cache.
pub const PATHS_PER_WAVE: u32 = 2048;
/// Cost of a level of the light tree in rays, fitted to CPU times of scenes with 6 to 16 000 emissive triangles.
const RAYS_PER_TREE_LEVEL: f32 = 0.1;

thread_local! {
    static BUFFERS: RefCell<Buffers> = RefCell::default();
}

/// The buffers of a thread, reused for all tiles and passes.
#[derive(Debug, Default)]
pub struct Buffers {
    tracer: Tracer,
    pilot: Pilot,
}

/// The wave of a thread, with the columns of its clients.
#[derive(Debug, Default)]
struct Tracer {
    wave: Wave,
    tasks: Vec<PixelTask>,
    aovs: AovColumns,
    contributions: ContributionColumns,
    ground: GroundColumns,
    blocks: MeanVarianceColumns,
    /// [`Pilot::indirect`]; empty outside of a pilot.
    indirect: Vec<[f32; 3]>,
}

impl Buffers {
    /// The wave of the current thread.
    pub fn wave(&mut self) -> &mut Wave {
        &mut self.tracer.wave
    }
}

/// Calls `work` with the buffers of the current thread.
pub fn with_buffers<T>(work: impl FnOnce(&mut Buffers) -> T) -> T {
    BUFFERS.with_borrow_mut(work)
}

/// The contributions of a pilot's samples and the radiance of its paths, pixel by pixel.
#[derive(Debug, Default)]
struct Pilot {
    counts: Option<Counts>,
    contributions: Vec<Contribution>,
    paths: Vec<Vec3>,
    /// By pixel and then by layer of lights, what its BSDF samples found by way of further surfaces.
    indirect: Vec<[f32; 3]>,
}

impl Observer for Pilot {
    fn contribution(&mut self, contribution: &Contribution) {
        self.contributions.push(*contribution);
    }

    fn path(&mut self, _pixel: u32, radiance: Vec3) {
        self.paths.push(radiance);
    }
}

impl Tile {
    /// Traces a pass of `paths` paths per pixel, or fewer where a noise goal requires fewer, by the balance method.
    pub fn pass(&mut self, transport: &Transport, settings: &RenderSettings, paths: u32) -> TileWork {
        self.pass_watched(transport, settings, paths, &mut |_| ())
    }

    /// Traces a pass like [`pass`](Self::pass) and calls `watch` with the tasks of each wave before it is traced.
    pub fn pass_watched(
        &mut self,
        transport: &Transport,
        settings: &RenderSettings,
        paths: u32,
        watch: &mut dyn FnMut(&[PixelTask]),
    ) -> TileWork {
        let start = Instant::now();
        let (done, before) = (self.paths(), self.all_paths());
        let (mut shares, mut moments) = (std::mem::take(&mut self.shares), std::mem::take(&mut self.moments));
        let counts = with_buffers(|buffers| {
            let mut sampler = TileSampler::new(self, transport, buffers, watch);
            sampler.goal = settings.noise_goal();
            let mut learned = LearnedPixels { shares: &mut shares, moments: &mut moments };
            settings.balance.method().pass(&mut learned, &mut sampler, done, paths);
            sampler.counts()
        });
        (self.shares, self.moments) = (shares, moments);
        TileWork { counts, seconds: start.elapsed().as_secs_f64(), paths: self.all_paths() - before }
    }
}

/// The sampler of a tile during a pass.
pub struct TileSampler<'a> {
    tile: &'a mut Tile,
    transport: &'a Transport<'a>,
    buffers: &'a mut Buffers,
    watch: &'a mut dyn FnMut(&[PixelTask]),
    goal: Option<NoiseGoal>,
}

impl<'a> TileSampler<'a> {
    /// Begins a pass without a noise goal in which all pixels get as many paths. `watch` is called with the tasks of each wave
    /// before it is traced.
    pub fn new(
        tile: &'a mut Tile,
        transport: &'a Transport<'a>,
        buffers: &'a mut Buffers,
        watch: &'a mut dyn FnMut(&[PixelTask]),
    ) -> Self {
        buffers.tracer.wave.counts = WaveCounts::default();
        buffers.tracer.blocks.begin(tile.stats.iter().map(|stats| stats.samples));
        Self { tile, transport, buffers, watch, goal: None }
    }

    /// Rays and time of the pass so far.
    pub fn counts(&self) -> WaveCounts {
        self.buffers.tracer.wave.counts
    }
}

impl Sampler for TileSampler<'_> {
    fn pixels(&self) -> usize {
        self.tile.pixels()
    }

    fn width(&self) -> usize {
        self.tile.width()
    }

    fn lights(&self) -> Option<LightInfo> {
        let lights = self.transport.lights;
        let proposal = &self.transport.proposal.lights;
        let environment_probability = lights.two_kinds().then_some(proposal.environment_probability);
        let selection_cost = lights.area.as_ref().map_or(0.0, |area| RAYS_PER_TREE_LEVEL * area.levels());
        lights.has_extent().then_some(LightInfo {
            environment_probability,
            indirect: self.transport.max_depth > 2,
            selection_cost,
        })
    }

    fn shares_paths(&self) -> bool {
        self.transport.proposal.reuse.is_some()
    }

    fn max_paths(&self) -> u32 {
        PATHS_PER_WAVE
    }

    fn paths(&mut self, paths: u32) -> Vec<u32> {
        let stats = self.tile.tile_stats();
        stats.deal(stats.paths_for(paths, self.goal.as_ref()))
    }

    fn take(&mut self, counts: &[Counts], weighed: &[Counts], observer: Option<&mut dyn Observer>) {
        let tracer = &mut self.buffers.tracer;
        let (width, apart) = (self.tile.width(), self.goal.is_some());
        let class = |i| if apart { group_of(i, width) } else { 0 };
        tracer.trace(self.tile, self.transport, (counts, weighed), &class, observer, self.watch);
    }

    fn pilot(&mut self, counts: Counts) -> &[Contribution] {
        let Buffers { tracer, pilot } = self.buffers;
        pilot.counts = Some(counts);
        pilot.contributions.clear();
        pilot.paths.clear();
        let all = vec![counts; self.tile.pixels()];
        // Light samples toward the environment, toward area lights where these are divided, and BSDF samples so far.
        let first = |p: &TilePixel| match counts.environment {
            Some(_) => [p.environment, p.light - p.environment, p.bsdf],
            None => [p.light, 0, p.bsdf],
        };
        let first: Vec<_> = self.tile.pixels.iter().map(first).collect();
        tracer.indirect.resize(self.tile.layers.len(), [0.0; 3]);
        let (width, apart) = (self.tile.width(), self.goal.is_some());
        let class = |i| if apart { group_of(i, width) } else { i % width % 2 };
        tracer.trace(self.tile, self.transport, (&all, &all), &class, Some(pilot), self.watch);
        pilot.indirect = std::mem::take(&mut tracer.indirect);
        // Sample indices of a pilot count from 0.
        for found in &mut pilot.contributions {
            let technique = if found.technique == Technique::Light { usize::from(found.area) } else { 2 };
            found.index -= first[found.pixel as usize][technique];
        }
        &pilot.contributions
    }

    fn reweight(&mut self, total: &[Counts]) {
        reweight(self.tile, &self.buffers.pilot, total);
    }

    fn features(&mut self) -> Vec<PixelFeatures> {
        let places: Vec<_> = self.tile.pixels.iter().map(|p| [p.x, p.y]).collect();
        guides(self.transport, &places)
    }

    fn cost(&self) -> Cost {
        let rays = &self.buffers.tracer.wave.counts;
        // A light sample at the first surface is at most one shadow ray; all other rays follow from BSDF samples.
        let light = rays.shadow_rays.min(rays.camera_rays);
        let bsdf = rays.first_bounce_rays + rays.later_bounce_rays + rays.shadow_rays - light;
        let all = rays.camera_rays.max(1) as f32;
        Cost { fixed: 1.0, light: light as f32 / all, bsdf: bsdf as f32 / all }
    }
}

impl Tracer {
    /// Traces paths with sample counts `counts` and the MIS weights of sample counts `weighed`. Pixels of different classes
    /// share no paths.
    fn trace(
        &mut self,
        tile: &mut Tile,
        transport: &Transport,
        (counts, weighed): (&[Counts], &[Counts]),
        class: &dyn Fn(usize) -> usize,
        mut observer: Option<&mut dyn Observer>,
        watch: &mut dyn FnMut(&[PixelTask]),
    ) {
        let Self { wave, tasks, aovs, contributions, ground, blocks, indirect } = self;
        let shares = transport.proposal.reuse.is_some();
        let count = tile.layers.len() / tile.pixels().max(1);
        for Part { pixels: range, paths: [from, to] } in parts(counts, shares) {
            let std::ops::Range { start, end } = range;
            tasks.clear();
            let pixels = tile.pixels[start..end].iter_mut().zip(&tile.stats[start..end]);
            for (i, (pixel, stats)) in (start..end).zip(pixels) {
                let counts = counts[i].of_paths(from, to);
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
                    class: class(i) as u32,
                });
                pixel.light += counts.light;
                pixel.environment += counts.environment.unwrap_or(0);
                pixel.bsdf += counts.bsdf;
            }
            watch(tasks);
            let pixels = PixelSums { stats: &mut tile.stats[start..end], peaks: &mut tile.peaks[start..end] };
            let sums = tile.aovs.get_mut(start..end).unwrap_or_default();
            let extras = tile.extras.get_mut(start..end).unwrap_or_default();
            let layers = tile.layers.get_mut(start * count..end * count).unwrap_or_default();
            let indirect = indirect.get_mut(start * count..end * count).unwrap_or_default();
            let wanted = !(sums.is_empty() && extras.is_empty() && layers.is_empty());
            let aovs = wanted.then_some(Aovs { sums, extras, layers, indirect, columns: &mut *aovs });
            let contributions = observer
                .as_mut()
                .map(|observer| Contributions { observer: &mut **observer, columns: &mut *contributions });
            let sums = tile.ground.get_mut(start..end);
            let ground =
                transport.ground.zip(sums).map(|(height, sums)| Ground { height, sums, columns: &mut *ground });
            let blocks = MeanVarianceSums { sums: &mut tile.blocks, columns: &mut *blocks };
            wave.run(transport, tasks, &mut ((pixels, (ground, blocks)), aovs, contributions));
        }
    }
}

/// What a wave traces.
struct Part {
    pixels: std::ops::Range<usize>,
    /// The paths of each pixel, from and to these numbers.
    paths: [u32; 2],
}

/// The waves of a tile: whole pixels, as many as fit, at least one. Where pixels `share` what their paths find, all pixels, and as
/// many of their paths as fit.
fn parts(counts: &[Counts], share: bool) -> Vec<Part> {
    if share {
        let most = counts.iter().map(|counts| counts.paths).max().unwrap_or(0);
        let step = (PATHS_PER_WAVE / counts.len().max(1) as u32).max(1);
        return (0..most)
            .step_by(step as usize)
            .map(|from| Part { pixels: 0..counts.len(), paths: [from, from + step] })
            .collect();
    }
    let (mut parts, mut start) = (Vec::new(), 0);
    while start < counts.len() {
        let mut paths = 0;
        let fits = |c: &&Counts| {
            paths += c.paths;
            paths <= PATHS_PER_WAVE
        };
        let end = start + counts[start..].iter().take_while(fits).count().max(1);
        parts.push(Part { pixels: start..end, paths: [0, u32::MAX] });
        start = end;
    }
    parts
}

/// Reweights a pilot, which has one light sample and one BSDF sample per path, to each pixel's `total` counts.
fn reweight(tile: &mut Tile, pilot: &Pilot, total: &[Counts]) {
    let Some(counts) = pilot.counts else { return };
    // Samples per path, over those of the pilot.
    let rates: Vec<_> = total.iter().map(|total| total.relative_to(counts)).collect();
    let (n, count) = (counts.paths as usize, tile.layers.len() / tile.stats.len());
    let mut changes = vec![Vec3::ZERO; pilot.paths.len()];
    for found in &pilot.contributions {
        let pixel = found.pixel as usize;
        let change = found.reweighted(rates[pixel]) - found.radiance;
        changes[pixel * n + found.path(counts.paths) as usize] += change;
        if found.technique != Technique::Indirect
            && let Some(sum) = tile.layers.get_mut(pixel * count + usize::from(found.layer))
        {
            accumulate(sum, change.into());
        }
        if let Some(aovs) = tile.aovs.get_mut(pixel) {
            match found.technique {
                Technique::Indirect => aovs.add_light(Vec3::ZERO, change),
                _ => aovs.add_light(change, Vec3::ZERO),
            }
        }
    }
    for (i, (sum, indirect)) in tile.layers.iter_mut().zip(&pilot.indirect).enumerate() {
        // No light sample finds it.
        let [.., ratio] = rates[i / count];
        accumulate(sum, indirect.map(|x| x * (1.0 / ratio - 1.0)));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::settings::Columns;

    #[test]
    fn a_pilot_weighed_again_has_the_sums_of_paths_that_were_weighed_so_at_once() {
        let mut tile =
            Tile::new([0, 0], 2, 1, Columns { moments: false, aovs: true, extras: false, ground: false, layers: 0 });
        let mut pilot = Pilot { counts: Some(Counts::half(2)), ..Default::default() };
        let contribution = |pixel, technique, index, r, y| Contribution {
            pixel,
            technique,
            area: false,
            layer: 0,
            index,
            r,
            w: 0.0,
            radiance: Vec3::splat(y),
        };
        pilot.contributions = vec![
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
