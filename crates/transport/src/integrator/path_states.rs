//! What the paths of a wave have found so far, and how it comes to their pixels.

use glam::Vec3;

use super::batch::{PixelBatch, PixelTask};
use super::queues::{NO_RECORD, PUNCTUAL, ShadowRays};
use crate::balance::{Contribution, Technique, deal};
use crate::color::luminance;
use crate::lanes::{LANES, U, V3, eight};
use crate::light::LightSampleRecord;

/// A path of the wave.
#[derive(Debug, Clone, Copy)]
pub struct PathState {
    /// Its pixel's place in the batch.
    pub pixel: u32,
    /// All that it has found.
    pub radiance: Vec3,
    /// Of this, lights seen directly and by one bounce.
    pub direct: Vec3,
    /// Did its camera ray hit a surface?
    pub covered: bool,
    /// How many light samples it takes at its first surface.
    pub light: u8,
    /// How many BSDF samples it takes there.
    pub bsdf: u8,
    /// The number of the first of these light samples in its pixel.
    pub first_light: u32,
    /// The number of the first of these BSDF samples in its pixel.
    pub first_bsdf: u32,
    /// Samples a path of its pixel: toward the environment, toward area lights, of the BSDF.
    pub rates: [f32; 3],
}

/// A BSDF sample at a first surface, and what descends from it.
#[derive(Debug, Clone, Copy)]
pub struct SubPath {
    /// Path of the wave.
    pub path: u32,
    /// Index of the BSDF sample in its pixel's sequence.
    pub index: u32,
    /// Light that came by further surfaces.
    pub indirect: Vec3,
}

/// A ray that leaves a surface, as it was drawn: of what paths are learned from. Its sub-path is its number.
#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// The ray that led there; [`CAMERA`] if the camera's did.
    pub parent: u32,
    /// Where it begins.
    pub position: Vec3,
    /// Unit geometric normal on the side that was met.
    pub normal: Vec3,
    /// Its unit direction.
    pub wi: Vec3,
    /// Luminance of the throughput that the surface had.
    pub beta: f32,
    /// Does the surface scatter widely enough to be guided?
    pub broad: bool,
    /// Luminance that the light sample of the vertex where it ended brought, of lights with extent.
    pub light: f32,
    /// Chances that a light sample where it begins had, and it itself.
    pub chances: [f32; 2],
    /// Density with which it was drawn, of the BSDF, and of the field.
    pub pdf: [f32; 3],
}

/// The parent of rays from first surfaces.
pub const CAMERA: u32 = u32::MAX;

/// A mirror at the end of a path's chain of mirrors.
#[derive(Debug, Clone, Copy)]
pub struct Mirror {
    /// Product of the base colours so far.
    pub tint: Vec3,
    /// The first one's, turned to the eye.
    pub normal: Vec3,
    /// Where on the path it is, 0 for the first hit.
    pub depth: u32,
}

/// Samples that were left out because their light was no finite number.
#[derive(Debug, Clone, Copy, Default)]
pub struct Faults {
    /// How many.
    pub count: u64,
    /// The path of the first.
    pub first: Option<u32>,
}

impl Faults {
    /// One more, of this path of the wave.
    #[inline]
    pub fn add(&mut self, path: u32) {
        self.count += 1;
        self.first.get_or_insert(path);
    }

    /// Those of eight paths whose bit is set.
    #[inline(always)]
    pub fn add_lanes(&mut self, bits: u32, paths: U) {
        if bits != 0 {
            (0..LANES).filter(|lane| bits >> lane & 1 == 1).for_each(|lane| self.add(paths.as_array()[lane]));
        }
    }
}

/// A contribution whose brightest channel is `most` at most, and the share of it that is left.
#[inline]
pub fn limited(radiance: Vec3, most: f32) -> (Vec3, f32) {
    let peak = radiance.max_element();
    if peak > most { (radiance * (most / peak), most / peak) } else { (radiance, 1.0) }
}

/// Paths, and sub-paths of paths, with what they have found.
#[derive(Debug, Default)]
pub struct PathStates {
    /// The wave's paths, pixel by pixel.
    pub paths: Vec<PathState>,
    /// Their BSDF samples at first surfaces that went on.
    pub sub_paths: Vec<SubPath>,
    /// What was left out.
    pub faults: Faults,
    /// Of each path, the mirror in which its guide is still looked for; empty if nobody asks.
    pub mirrors: Vec<Option<Mirror>>,
    /// Of each sub-path, how it was drawn: where paths are learned from, and every ray is then a sub-path. Its light is that which
    /// it brings itself, until [`gather`](Self::gather).
    pub steps: Option<Vec<Step>>,
    /// Light samples toward area lights, where these are learned of; their pixels are places in the batch.
    pub light_sample_records: Option<Vec<LightSampleRecord>>,
}

impl PathStates {
    /// Adds to each sub-path's light that of those that descend from it.
    pub fn gather(&mut self) {
        let steps = self.steps.as_deref().unwrap_or_default();
        for (i, step) in steps.iter().enumerate().rev().filter(|(_, step)| step.parent != CAMERA) {
            let light = self.sub_paths[i].indirect;
            self.sub_paths[step.parent as usize].indirect += light;
        }
    }

    /// Begins each pixel's paths, each with its part of the pixel's samples. `environment_probability` as for
    /// [`Counts::rates`](crate::balance::Counts::rates).
    pub fn begin(&mut self, tasks: &[PixelTask], environment_probability: f32) {
        self.paths.clear();
        self.sub_paths.clear();
        self.faults = Faults::default();
        self.mirrors.clear();
        self.steps.iter_mut().for_each(Vec::clear);
        for (pixel, task) in tasks.iter().enumerate() {
            let (mut first_light, mut first_bsdf) = (task.first_light, task.first_bsdf);
            let rates = task.weighed.rates(environment_probability);
            let paths = task.counts.paths;
            for path in 0..paths {
                let [light, bsdf] = [task.counts.light, task.counts.bsdf].map(|n| deal(n, paths, path));
                self.paths.push(PathState {
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
    }

    /// Notes light samples in lanes of a mask, which chose these emitters `from` points and normals, and numbers them.
    pub fn light_sample_record(&mut self, lanes: u32, (p, n): (V3, V3), emitter: [u32; LANES], path: U) -> U {
        let Some(light_sample_records) = &mut self.light_sample_records else { return U::splat(NO_RECORD) };
        U::from(eight(|lane| {
            if lanes >> lane & 1 == 0 {
                return NO_RECORD;
            }
            let pixel = self.paths[path.as_array()[lane] as usize].pixel;
            let (position, normal) = (p.lane(lane), n.lane(lane));
            light_sample_records.push(LightSampleRecord {
                position,
                normal,
                emitter: emitter[lane],
                pixel,
                found: 0.0,
            });
            light_sample_records.len() as u32 - 1
        }))
    }

    /// Adds what shadow rays from vertices at `depth` bring that are not `occluded`, each at most `limit`.
    #[inline(never)]
    pub fn add_light_samples(
        &mut self,
        shadows: &ShadowRays,
        occluded: &[bool],
        depth: u32,
        limit: f32,
        batch: &mut PixelBatch,
    ) {
        let owners = shadows.path.iter().zip(&occluded[..shadows.len]).enumerate();
        for (i, (&owner, _)) in owners.filter(|(_, (_, occluded))| !**occluded) {
            let (radiance, share) = limited(shadows.radiance.get(i), limit);
            let light_sample_record = shadows.light_sample_record.get(i).zip(self.light_sample_records.as_mut());
            if let Some(light_sample_record) =
                light_sample_record.and_then(|(&number, all)| all.get_mut(number as usize))
            {
                light_sample_record.found = luminance(radiance);
            }
            let path = &mut self.paths[owner as usize];
            path.radiance += radiance;
            if let Some(extras) = batch.extras.get_mut(path.pixel as usize) {
                extras.add_light(shadows.group[i] as usize, radiance);
            }
            if depth > 0 {
                let sub_path = shadows.sub_path[i] as usize;
                if let Some(steps) = self.steps.as_mut().filter(|_| shadows.group[i] != PUNCTUAL) {
                    steps[sub_path].light += luminance(radiance);
                }
                self.sub_paths[sub_path].indirect += radiance;
                continue;
            }
            path.direct += radiance;
            if let Some(found) = shadows.observed(i, radiance) {
                batch.tell(path.pixel as usize, Contribution { w: found.w * share * share, ..found });
            }
        }
    }

    /// Folds the paths into their pixels, in path order.
    #[inline(never)]
    pub fn finish(&self, batch: &mut PixelBatch) {
        // What was seen in no mirror after all: the mirror itself.
        for (path, mirror) in self.paths.iter().zip(&self.mirrors) {
            if let (Some(mirror), Some(extras)) = (mirror, batch.extras.get_mut(path.pixel as usize)) {
                extras.add_guide(mirror.tint, mirror.normal);
            }
        }
        if batch.observer.is_some() {
            for sub_path in self.sub_paths.iter().filter(|sub_path| sub_path.indirect != Vec3::ZERO) {
                let path = &self.paths[sub_path.path as usize];
                let radiance = sub_path.indirect;
                // No light sample finds it: Z = 2X, Y = 2 a_b X, r = −1.
                let w = 4.0 * path.rates[2] * radiance.length_squared();
                let (technique, index) = (Technique::Indirect, sub_path.index);
                let found = Contribution { pixel: 0, technique, area: false, index, r: -1.0, w, radiance };
                batch.tell(path.pixel as usize, found);
            }
        }
        let mut left = &self.paths[..];
        for (pixel, task) in batch.tasks.iter().enumerate() {
            let (paths, others) = left.split_at(task.counts.paths as usize);
            left = others;
            let stats = &mut batch.stats[pixel];
            paths.iter().for_each(|path| stats.add(path.radiance, path.covered));
            if let Some(peak) = batch.peaks.get_mut(pixel) {
                let numbered = paths.iter().zip(task.first_path..);
                numbered.for_each(|(path, number)| peak.add(luminance(path.radiance), number));
            }
            if let Some(observer) = &mut batch.observer {
                paths.iter().for_each(|path| observer.path(task.number, path.radiance));
            }
            if let Some(aovs) = batch.aovs.get_mut(pixel) {
                paths.iter().for_each(|path| aovs.add_light(path.direct, path.radiance - path.direct));
            }
        }
    }
}
