//! A batch of paths from camera to end, stage by stage. Buffers are kept between waves: none is allocated in the
//! steady state.

use std::time::Instant;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::Transport;
use super::paths::{Paths, Pending};
use super::stages::{LAMP, SKY};
use super::vertices::Vertices;
use crate::balance::{Counts, Finding, Moments, Technique, deal};
use crate::film::{AovSums, PixelStats};
use crate::lanes::{F, LANES, NUMBERS, U, V3};
use crate::rays::{HitBatch, RayBatch, RayOrder};
use crate::sampling::{keys, pixel_seed, samples};

/// One pixel's part in a wave.
#[derive(Debug, Clone, Copy)]
pub struct PixelPlan {
    /// Position in the whole picture.
    pub x: u32,
    /// Position in the whole picture.
    pub y: u32,
    /// Paths that the pixel has taken before.
    pub first_path: u32,
    /// Light samples at first surfaces that it has taken before.
    pub first_light: u32,
    /// How many of these light samples were toward the environment by count, not by drawing.
    pub first_sky: u32,
    /// BSDF samples at first surfaces that it has taken before.
    pub first_bsdf: u32,
    /// Light and BSDF samples at first surfaces for the paths of this wave.
    pub counts: Counts,
    /// The counts of all the paths that are weighed together with this wave's: contributions are weighed by these.
    pub weighed: Counts,
    /// Number of the pixel in findings.
    pub place: u32,
}

/// What a wave adds to one pixel.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct PixelSum {
    /// Radiance statistics.
    pub stats: PixelStats,
    /// Balance moments, when learning.
    pub moments: Moments,
    /// AOV sums, when asked for.
    pub aovs: AovSums,
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
    /// A path: its pixel's place in the plan.
    pub(super) slots: Vec<Slot>,
    /// A BSDF sample at a first surface: its slot and the indirect light that it brought.
    pub(super) children: Vec<Child>,
    /// What first surfaces' samples found, while `record` is set.
    pub findings: Vec<Finding>,
    /// The paths' radiance, pixel by pixel, while `record` is set.
    pub recorded: Vec<Vec3>,
    /// Record findings?
    pub record: bool,
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
    /// Samples a path of its pixel: toward the environment, toward lamps, of the BSDF.
    pub rates: [f32; 3],
}

/// How a pixel's light samples divide between the environment, which the first ones go to, and lamps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Split {
    /// The number of the first light sample toward lamps.
    lamps_from: u32,
    /// Light samples toward lamps before this wave.
    lamps_before: u32,
}

impl Split {
    /// Lamps have a sequence of their own: its points are numbered from here.
    const LAMPS: u32 = 1 << 31;

    fn new(plan: &PixelPlan) -> Option<Self> {
        let lamps_before = plan.first_light - plan.first_sky;
        plan.counts.sky.map(|sky| Self { lamps_from: plan.first_light + sky, lamps_before })
    }

    /// The point in its technique's sequence of light sample number `light` of the pixel, and what it is toward.
    pub(super) fn place(self, light: u32) -> (u32, u32) {
        if light < self.lamps_from {
            return (light - self.lamps_before, SKY);
        }
        (Self::LAMPS | (light - self.lamps_from + self.lamps_before), LAMP)
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
    /// Traces `paths` paths for each pixel of `plan` and adds to `sums`, one a pixel, in a fixed order.
    pub fn run(&mut self, transport: &Transport, plan: &[PixelPlan], paths: u32, sums: &mut [PixelSum]) {
        self.begin(transport, plan, paths);
        for depth in 0..transport.max_depth {
            if self.paths.len == 0 {
                break;
            }
            self.count(depth);
            let order = if depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
            let start = Instant::now();
            transport.rays.closest_hits(&self.rays, order, &mut self.hits);
            self.counts.query_seconds += start.elapsed().as_secs_f64();
            self.hits(transport, plan, depth, sums);
            self.lights(transport, depth);
            self.scatter(transport, depth);
            self.shadows(transport, plan, depth, sums);
            std::mem::swap(&mut self.rays, &mut self.next_rays);
            std::mem::swap(&mut self.paths, &mut self.next_paths);
        }
        self.finish(transport, plan, sums);
    }

    /// Camera rays, and each path's share of its pixel's samples.
    #[inline(never)]
    fn begin(&mut self, transport: &Transport, plan: &[PixelPlan], paths: u32) {
        let all = plan.len() * paths as usize;
        self.rays.open(all);
        self.paths.open(all);
        self.slots.clear();
        self.children.clear();
        self.splits.clear();
        for (pixel, plan_of) in plan.iter().enumerate() {
            let seed = U::splat(pixel_seed(plan_of.x, plan_of.y, transport.seed));
            for i in (0..paths).step_by(LANES) {
                let n = LANES.min((paths - i) as usize);
                let index = U::splat(plan_of.first_path + i) + U::from(NUMBERS);
                let [px, py, ..] = samples(seed, index, 0);
                let x = transport.filter.offsets(px) + F::splat(plan_of.x as f32 + 0.5);
                let y = transport.filter.offsets(py) + F::splat(plan_of.y as f32 + 0.5);
                let (origin, direction) = transport.camera.rays(x, y);
                let key = keys(seed, index, 0);
                self.rays.put(self.paths.len, origin, direction, F::splat(f32::INFINITY), key);
                let slot = U::splat(self.paths.len as u32) + U::from(NUMBERS);
                let path = [slot, index, U::splat(u32::MAX), seed];
                self.paths.push(n, V3::splat(Vec3::ONE), V3::ZERO, F::ZERO, path);
            }
            let (mut first_light, mut first_bsdf) = (plan_of.first_light, plan_of.first_bsdf);
            let rates = plan_of.weighed.rates(transport.lights.sky_chance);
            self.splits.push(Split::new(plan_of));
            for path in 0..paths {
                let [light, bsdf] = [plan_of.counts.light, plan_of.counts.bsdf].map(|n| deal(n, paths, path));
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
    fn shadows(&mut self, transport: &Transport, plan: &[PixelPlan], depth: u32, sums: &mut [PixelSum]) {
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
                    let (w, r) = (pending.w[i], pending.r[i]);
                    if transport.moments {
                        sums[pixel].moments.add(w, r, 2.0 * radiance.element_sum());
                    }
                    if self.record {
                        let (pixel, place, technique) = (plan[pixel].place, pending.child[i], Technique::Light);
                        let (index, lamp) = (place & !Split::LAMPS, place >= Split::LAMPS);
                        self.findings.push(Finding { pixel, technique, lamp, index, r, radiance });
                    }
                }
            } else {
                self.children[pending.child[i] as usize].indirect += radiance;
            }
        }
    }

    /// Folds the paths into their pixels, in path order.
    #[inline(never)]
    fn finish(&mut self, transport: &Transport, plan: &[PixelPlan], sums: &mut [PixelSum]) {
        if transport.moments || self.record {
            for child in &self.children {
                let radiance = child.indirect;
                if radiance == Vec3::ZERO {
                    continue;
                }
                let slot = &self.slots[child.slot as usize];
                let pixel = slot.pixel as usize;
                // Indirect light: Z = 2X, Y = 2 a_b X, r = −1.
                let w = 4.0 * slot.rates[2] * radiance.length_squared();
                if transport.moments {
                    sums[pixel].moments.add(w, -1.0, 2.0 * radiance.element_sum());
                }
                if self.record {
                    let (pixel, index, r) = (plan[pixel].place, child.index, -1.0);
                    let (technique, lamp) = (Technique::Indirect, false);
                    self.findings.push(Finding { pixel, technique, lamp, index, r, radiance });
                }
            }
        }
        if self.record {
            self.recorded.extend(self.slots.iter().map(|slot| slot.radiance));
        }
        for slot in &self.slots {
            let sum = &mut sums[slot.pixel as usize];
            sum.stats.samples += 1;
            sum.stats.covered += u32::from(slot.covered);
            for c in 0..3 {
                let x = f64::from(slot.radiance[c]);
                sum.stats.sum[c] += x;
                sum.stats.sum_squared[c] += x * x;
            }
            if transport.aovs {
                let indirect = slot.radiance - slot.direct;
                for c in 0..3 {
                    sum.aovs.direct[c] += slot.direct[c];
                    sum.aovs.indirect[c] += indirect[c];
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
