//! A batch of paths from camera to end, stage by stage. Buffers are kept between waves: none is allocated in the
//! steady state.

use std::time::Instant;

use glam::Vec3;

use super::Transport;
use super::paths::{Paths, Pending};
use super::stages::{AREA, ENVIRONMENT};
use super::vertices::Vertices;
use crate::balance::{Contribution, Counts, Observer, Technique, deal};
use crate::film::{AovSums, PixelStats};
use crate::lanes::{F, LANES, NUMBERS, U, V3};
use crate::rays::{HitBatch, RayBatch, RayOrder};
use crate::sampling::{keys, pixel_seed, samples};

/// One pixel's part in a wave.
#[derive(Debug, Clone, Copy)]
pub struct PixelTask {
    /// Position in the whole picture.
    pub x: u32,
    /// Position in the whole picture.
    pub y: u32,
    /// Paths that the pixel has taken before.
    pub first_path: u32,
    /// Light samples at first surfaces that it has taken before.
    pub first_light: u32,
    /// How many of these light samples were toward the environment by count, not by drawing.
    pub first_environment: u32,
    /// BSDF samples at first surfaces that it has taken before.
    pub first_bsdf: u32,
    /// Light and BSDF samples at first surfaces for the paths of this wave.
    pub counts: Counts,
    /// The counts of all the paths that are weighed together with this wave's: contributions are weighed by these.
    pub weighed: Counts,
    /// Number of the pixel in its tile, for observers.
    pub number: u32,
}

/// What a wave works on and adds to, an entry a pixel, and who is told what first surfaces' samples find.
pub struct PixelBatch<'a> {
    /// What each pixel is to take.
    pub tasks: &'a [PixelTask],
    /// Radiance statistics.
    pub stats: &'a mut [PixelStats],
    /// AOV sums; empty if none are asked for.
    pub aovs: &'a mut [AovSums],
    /// Hears of contributions, if anybody does.
    pub observer: Option<&'a mut dyn Observer>,
}

impl PixelBatch<'_> {
    /// Tells the observer of a contribution in pixel `pixel` of the batch.
    pub(super) fn tell(&mut self, pixel: usize, found: Contribution) {
        if let Some(observer) = &mut self.observer {
            observer.contribution(&Contribution { pixel: self.tasks[pixel].number, ..found });
        }
    }
}

/// Rays and time of waves.
#[derive(Debug, Clone, Copy, Default)]
pub struct WaveCounts {
    /// Rays from the camera.
    pub camera_rays: u64,
    /// Rays of the first bounce.
    pub first_bounce_rays: u64,
    /// Rays of later bounces.
    pub later_bounce_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Seconds inside ray queries.
    pub query_seconds: f64,
}

impl WaveCounts {
    /// The sum of two.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            camera_rays: self.camera_rays + other.camera_rays,
            first_bounce_rays: self.first_bounce_rays + other.first_bounce_rays,
            later_bounce_rays: self.later_bounce_rays + other.later_bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            query_seconds: self.query_seconds + other.query_seconds,
        }
    }
}

/// The buffers of one thread.
#[derive(Debug, Default)]
pub struct Wave {
    pub(super) rays: RayBatch,
    pub(super) next_rays: RayBatch,
    pub(super) shadow_rays: RayBatch,
    pub(super) hits: HitBatch,
    pub(super) paths: Paths,
    pub(super) next_paths: Paths,
    pub(super) pending: Pending,
    occluded: Vec<bool>,
    /// Rays of the batch that hit nothing, surfaces without texture, other surfaces.
    pub(super) escaped: Vec<u32>,
    pub(super) plain: Vec<u32>,
    pub(super) detailed: Vec<u32>,
    pub(super) vertices: Vertices,
    /// Samples to take at first surfaces: at which vertex, with which index into its pixel's sequence, toward what.
    pub(super) tasks: Vec<(u32, u32, u32)>,
    /// Where each pixel's light samples go, if not by drawing.
    pub(super) splits: Vec<Option<Split>>,
    /// A path: its pixel's place in the batch.
    pub(super) slots: Vec<Slot>,
    /// A BSDF sample at a first surface: its slot and the indirect light that it brought.
    pub(super) children: Vec<Child>,
    /// Rays and time so far.
    pub counts: WaveCounts,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Slot {
    pub pixel: u32,
    pub radiance: Vec3,
    pub direct: Vec3,
    pub covered: bool,
    /// How many light and BSDF samples it takes at its first surface, and their first indices in the sequence.
    pub light: u8,
    pub bsdf: u8,
    pub first_light: u32,
    pub first_bsdf: u32,
    /// Samples a path of its pixel: toward the environment, toward area lights, of the BSDF.
    pub rates: [f32; 3],
}

/// How a pixel's light samples divide between the environment, which the first ones go to, and area lights.
#[derive(Debug, Clone, Copy)]
pub(super) struct Split {
    /// The number of the first light sample toward area lights.
    area_from: u32,
    /// Light samples toward area lights before this wave.
    area_before: u32,
}

impl Split {
    /// Area lights have a sequence of their own: its points are numbered from here.
    const AREA_SEQUENCE: u32 = 1 << 31;

    fn new(task: &PixelTask) -> Option<Self> {
        let area_before = task.first_light - task.first_environment;
        task.counts.environment.map(|environment| Self { area_from: task.first_light + environment, area_before })
    }

    /// The point in its technique's sequence of light sample number `light` of the pixel, and what it is toward.
    pub(super) fn place(self, light: u32) -> (u32, u32) {
        if light < self.area_from {
            return (light - self.area_before, ENVIRONMENT);
        }
        (Self::AREA_SEQUENCE | (light - self.area_from + self.area_before), AREA)
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Child {
    pub slot: u32,
    /// Index of the BSDF sample in its pixel's sequence.
    pub index: u32,
    pub indirect: Vec3,
}

impl Wave {
    /// Traces `paths` paths for each pixel of the batch and adds to its sums, in a fixed order.
    pub fn run(&mut self, transport: &Transport, paths: u32, batch: &mut PixelBatch) {
        self.begin(transport, batch.tasks, paths);
        for depth in 0..transport.max_depth {
            if self.paths.len == 0 {
                break;
            }
            self.count(depth);
            let order = if depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
            let start = Instant::now();
            transport.rays.closest_hits(&self.rays, order, &mut self.hits);
            self.counts.query_seconds += start.elapsed().as_secs_f64();
            self.hits(transport, depth, batch);
            self.lights(transport, depth, batch.observer.is_some());
            self.scatter(transport, depth);
            self.shadows(transport, depth, batch);
            std::mem::swap(&mut self.rays, &mut self.next_rays);
            std::mem::swap(&mut self.paths, &mut self.next_paths);
        }
        self.finish(batch);
    }

    /// Camera rays, and each path's share of its pixel's samples.
    #[inline(never)]
    fn begin(&mut self, transport: &Transport, tasks: &[PixelTask], paths: u32) {
        let all = tasks.len() * paths as usize;
        self.rays.open(all);
        self.paths.open(all);
        self.slots.clear();
        self.children.clear();
        self.splits.clear();
        for (pixel, task) in tasks.iter().enumerate() {
            let seed = U::splat(pixel_seed(task.x, task.y, transport.seed));
            for i in (0..paths).step_by(LANES) {
                let n = LANES.min((paths - i) as usize);
                let index = U::splat(task.first_path + i) + U::from(NUMBERS);
                let [px, py, ..] = samples(seed, index, 0);
                let x = transport.filter.offsets(px) + F::splat(task.x as f32 + 0.5);
                let y = transport.filter.offsets(py) + F::splat(task.y as f32 + 0.5);
                let (origin, direction) = transport.camera.rays(x, y);
                let key = keys(seed, index, 0);
                self.rays.put(self.paths.len, origin, direction, F::splat(f32::INFINITY), key);
                let slot = U::splat(self.paths.len as u32) + U::from(NUMBERS);
                let path = [slot, index, U::splat(u32::MAX), seed];
                self.paths.push(n, V3::splat(Vec3::ONE), V3::ZERO, F::ZERO, path);
            }
            let (mut first_light, mut first_bsdf) = (task.first_light, task.first_bsdf);
            let rates = task.weighed.rates(transport.lights.environment_probability);
            self.splits.push(Split::new(task));
            for path in 0..paths {
                let [light, bsdf] = [task.counts.light, task.counts.bsdf].map(|n| deal(n, paths, path));
                self.slots.push(Slot {
                    pixel: pixel as u32,
                    radiance: Vec3::ZERO,
                    direct: Vec3::ZERO,
                    covered: false,
                    light,
                    bsdf,
                    first_light,
                    first_bsdf,
                    rates,
                });
                first_light += u32::from(light);
                first_bsdf += u32::from(bsdf);
            }
        }
        self.rays.close(all);
    }

    /// Adds what the shadow rays let through.
    #[inline(never)]
    fn shadows(&mut self, transport: &Transport, depth: u32, batch: &mut PixelBatch) {
        if self.shadow_rays.is_empty() {
            return;
        }
        self.counts.shadow_rays += self.shadow_rays.len() as u64;
        let start = Instant::now();
        transport.rays.occluded(&self.shadow_rays, RayOrder::Incoherent, &mut self.occluded);
        self.counts.query_seconds += start.elapsed().as_secs_f64();
        let pending = &self.pending;
        for i in (0..pending.len).filter(|&i| !self.occluded[i]) {
            let radiance = pending.radiance.get(i);
            let slot = &mut self.slots[pending.slot[i] as usize];
            slot.radiance += radiance;
            if depth == 0 {
                slot.direct += radiance;
                if pending.w[i] > 0.0 {
                    let pixel = slot.pixel as usize;
                    let (w, r, number) = (pending.w[i], pending.r[i], pending.child[i]);
                    let (index, area) = (number & !Split::AREA_SEQUENCE, number >= Split::AREA_SEQUENCE);
                    batch.tell(
                        pixel,
                        Contribution { pixel: 0, technique: Technique::Light, area, index, r, w, radiance },
                    );
                }
            } else {
                self.children[pending.child[i] as usize].indirect += radiance;
            }
        }
    }

    /// Folds the paths into their pixels, in path order.
    #[inline(never)]
    fn finish(&mut self, batch: &mut PixelBatch) {
        if batch.observer.is_some() {
            for child in &self.children {
                let radiance = child.indirect;
                if radiance == Vec3::ZERO {
                    continue;
                }
                let slot = &self.slots[child.slot as usize];
                let pixel = slot.pixel as usize;
                // Indirect light: Z = 2X, Y = 2 a_b X, r = −1.
                let w = 4.0 * slot.rates[2] * radiance.length_squared();
                let technique = Technique::Indirect;
                batch.tell(
                    pixel,
                    Contribution { pixel: 0, technique, area: false, index: child.index, r: -1.0, w, radiance },
                );
            }
        }
        for slot in &self.slots {
            let pixel = slot.pixel as usize;
            if let Some(observer) = &mut batch.observer {
                observer.path(batch.tasks[pixel].number, slot.radiance);
            }
            let stats = &mut batch.stats[pixel];
            stats.samples += 1;
            stats.covered += u32::from(slot.covered);
            for c in 0..3 {
                let x = f64::from(slot.radiance[c]);
                stats.sum[c] += x;
                stats.sum_squared[c] += x * x;
            }
            if let Some(aovs) = batch.aovs.get_mut(pixel) {
                let indirect = slot.radiance - slot.direct;
                for c in 0..3 {
                    aovs.direct[c] += slot.direct[c];
                    aovs.indirect[c] += indirect[c];
                }
            }
        }
    }

    fn count(&mut self, depth: u32) {
        let n = self.paths.len as u64;
        match depth {
            0 => self.counts.camera_rays += n,
            1 => self.counts.first_bounce_rays += n,
            _ => self.counts.later_bounce_rays += n,
        }
    }
}
