//! Accumulated radiance of the paths of a wave, and its transfer to their pixels.

use glam::Vec3;

use super::batch::{PixelBatch, PixelTask};
use super::queues::{NO_RECORD, PUNCTUAL_GROUP, ShadowRays};
use crate::balance::{Contribution, Technique, deal};
use crate::color::luminance;
use crate::lanes::{LANES, U, V3, eight};
use crate::light::LightSampleRecord;

/// State of a path of the wave.
#[derive(Debug, Clone, Copy)]
pub struct PathState {
    /// Index of its pixel in the batch.
    pub pixel: u32,
    /// Radiance so far, linear RGB.
    pub radiance: Vec3,
    /// The part of `radiance` with at most one bounce: emission seen directly, and direct illumination.
    pub direct: Vec3,
    /// Did its camera ray hit a surface?
    pub covered: bool,
    /// Number of light samples at the first surface.
    pub light: u8,
    /// Number of BSDF samples at the first surface.
    pub bsdf: u8,
    /// Index of the first of these light samples in the pixel's sequence.
    pub first_light: u32,
    /// Index of the first of these BSDF samples in the pixel's sequence.
    pub first_bsdf: u32,
    /// Samples per path of its pixel: environment, area lights, BSDF.
    pub samples_per_path: [f32; 3],
}

/// The sub-path that begins with a BSDF sample at a first surface.
#[derive(Debug, Clone, Copy)]
pub struct SubPath {
    /// Index of its path in the wave.
    pub path: u32,
    /// Index of the BSDF sample in its pixel's sequence.
    pub index: u32,
    /// Radiance that it contributes by way of further surfaces.
    pub indirect: Vec3,
}

/// How a ray was sampled at a surface, for training of the guiding field. Record i belongs to sub-path i.
#[derive(Debug, Clone, Copy)]
pub struct ScatterRecord {
    /// Record of the ray that arrived at the surface; [`NO_PARENT`] for a camera ray.
    pub parent: u32,
    /// Origin of the ray, world space.
    pub position: Vec3,
    /// Unit geometric normal on the side of `wo`.
    pub normal: Vec3,
    /// Unit direction of the ray.
    pub wi: Vec3,
    /// Luminance of the path throughput at the surface, before scattering.
    pub beta: f32,
    /// Is the surface diffuse enough to be guided?
    pub diffuse: bool,
    /// Luminance contributed by the light sample (environment or area light) at the vertex where the ray ends.
    pub light: f32,
    /// Roulette probabilities at the surface: of the light sample, and of continuing the path with this ray.
    pub roulette: [f32; 2],
    /// Densities per solid angle of the direction: of the mixture that sampled it, of the BSDF, of the field.
    pub pdf: [f32; 3],
}

/// [`ScatterRecord::parent`] of rays from first surfaces.
pub const NO_PARENT: u32 = u32::MAX;

/// The last vertex of a chain of mirrors at the start of a path.
#[derive(Debug, Clone, Copy)]
pub struct MirrorVertex {
    /// Product of the base colours of the chain.
    pub tint: Vec3,
    /// Shading normal of the first mirror, on the camera's side.
    pub normal: Vec3,
    /// Index of the vertex on the path, 0 for the first hit.
    pub depth: u32,
}

/// Samples that were discarded because their radiance was not finite.
#[derive(Debug, Clone, Copy, Default)]
pub struct NonFiniteSamples {
    /// Number of samples.
    pub count: u64,
    /// Path of the first one.
    pub first: Option<u32>,
}

impl NonFiniteSamples {
    /// Counts a sample of a path of the wave.
    #[inline]
    pub fn add(&mut self, path: u32) {
        self.count += 1;
        self.first.get_or_insert(path);
    }

    /// Counts a sample for each of eight paths whose bit is set.
    #[inline(always)]
    pub fn add_lanes(&mut self, bits: u32, paths: U) {
        if bits != 0 {
            (0..LANES).filter(|lane| bits >> lane & 1 == 1).for_each(|lane| self.add(paths.as_array()[lane]));
        }
    }
}

/// Scales a contribution so that no channel exceeds `limit`. Returns it with the scale factor.
#[inline]
pub fn clamp_contribution(radiance: Vec3, limit: f32) -> (Vec3, f32) {
    let peak = radiance.max_element();
    if peak > limit { (radiance * (limit / peak), limit / peak) } else { (radiance, 1.0) }
}

/// The paths and sub-paths of a wave, with their accumulated radiance.
#[derive(Debug, Default)]
pub struct PathStates {
    /// The paths, pixel by pixel.
    pub paths: Vec<PathState>,
    /// The sub-paths of all paths. While training, every scattered ray is one.
    pub sub_paths: Vec<SubPath>,
    /// Discarded samples.
    pub non_finite: NonFiniteSamples,
    /// By path, the mirror chain whose end is still to be found for the denoising guides; empty if they are not requested.
    pub mirrors: Vec<Option<MirrorVertex>>,
    /// By sub-path, how its first ray was sampled; present while training. `SubPath::indirect` then holds only the radiance
    /// found at the end of that ray, until [`accumulate_descendants`](Self::accumulate_descendants).
    pub scatter_records: Option<Vec<ScatterRecord>>,
    /// Light samples of area lights; present while light distributions are learned. `pixel` is an index into the batch.
    pub light_sample_records: Option<Vec<LightSampleRecord>>,
}

impl PathStates {
    /// Adds to the radiance of each sub-path that of its descendants.
    pub fn accumulate_descendants(&mut self) {
        let scatter_records = self.scatter_records.as_deref().unwrap_or_default();
        for (i, record) in scatter_records.iter().enumerate().rev().filter(|(_, record)| record.parent != NO_PARENT) {
            let light = self.sub_paths[i].indirect;
            self.sub_paths[record.parent as usize].indirect += light;
        }
    }

    /// Starts the paths of all pixels and distributes each pixel's samples over its paths. `environment_probability` is that
    /// of [`Lights`](crate::light::Lights).
    pub fn start_paths(&mut self, tasks: &[PixelTask], environment_probability: f32) {
        self.paths.clear();
        self.sub_paths.clear();
        self.non_finite = NonFiniteSamples::default();
        self.mirrors.clear();
        self.scatter_records.iter_mut().for_each(Vec::clear);
        for (pixel, task) in tasks.iter().enumerate() {
            let (mut first_light, mut first_bsdf) = (task.first_light, task.first_bsdf);
            let samples_per_path = task.weighed.samples_per_path(environment_probability);
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
                    samples_per_path,
                });
                first_light += u32::from(light);
                first_bsdf += u32::from(bsdf);
            }
        }
    }

    /// Records the light samples in the lanes of a mask: shading point and normal, chosen emitter, path. Returns their indices,
    /// [`NO_RECORD`] in other lanes.
    pub fn record_light_samples(&mut self, lanes: u32, (p, n): (V3, V3), emitter: [u32; LANES], path: U) -> U {
        let Some(records) = &mut self.light_sample_records else { return U::splat(NO_RECORD) };
        U::from(eight(|lane| {
            if lanes >> lane & 1 == 0 {
                return NO_RECORD;
            }
            let pixel = self.paths[path.as_array()[lane] as usize].pixel;
            let (position, normal) = (p.lane(lane), n.lane(lane));
            records.push(LightSampleRecord { position, normal, emitter: emitter[lane], pixel, contribution: 0.0 });
            records.len() as u32 - 1
        }))
    }

    /// Adds the contributions of shadow rays from vertices at `depth` that are not occluded, clamped to `limit`.
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
            let (radiance, scale) = clamp_contribution(shadows.radiance.get(i), limit);
            let record = shadows.light_sample_record.get(i).zip(self.light_sample_records.as_mut());
            if let Some(record) = record.and_then(|(&number, records)| records.get_mut(number as usize)) {
                record.contribution = luminance(radiance);
            }
            let path = &mut self.paths[owner as usize];
            path.radiance += radiance;
            if let Some(extras) = batch.extras.get_mut(path.pixel as usize) {
                extras.add_light(shadows.light_group[i] as usize, radiance);
            }
            if depth > 0 {
                let sub_path = shadows.sub_path[i] as usize;
                if let Some(scatter_records) =
                    self.scatter_records.as_mut().filter(|_| shadows.light_group[i] != PUNCTUAL_GROUP)
                {
                    scatter_records[sub_path].light += luminance(radiance);
                }
                self.sub_paths[sub_path].indirect += radiance;
                continue;
            }
            path.direct += radiance;
            if let Some(contribution) = shadows.contribution(i, radiance) {
                batch.notify(path.pixel as usize, Contribution { w: contribution.w * scale * scale, ..contribution });
            }
        }
    }

    /// Adds the paths to the sums of their pixels, in path order.
    #[inline(never)]
    pub fn add_to_pixels(&self, batch: &mut PixelBatch) {
        // A mirror chain that reached no other surface: its first mirror is the guide.
        for (path, mirror) in self.paths.iter().zip(&self.mirrors) {
            if let (Some(mirror), Some(extras)) = (mirror, batch.extras.get_mut(path.pixel as usize)) {
                extras.add_guide(mirror.tint, mirror.normal);
            }
        }
        if batch.observer.is_some() {
            for sub_path in self.sub_paths.iter().filter(|sub_path| sub_path.indirect != Vec3::ZERO) {
                let path = &self.paths[sub_path.path as usize];
                let radiance = sub_path.indirect;
                // Light samples cannot find it: Z = 2X, Y = 2 a_b X, r = −1.
                let w = 4.0 * path.samples_per_path[2] * radiance.length_squared();
                let (technique, index) = (Technique::Indirect, sub_path.index);
                let contribution = Contribution { pixel: 0, technique, area: false, index, r: -1.0, w, radiance };
                batch.notify(path.pixel as usize, contribution);
            }
        }
        let mut remaining = &self.paths[..];
        for (pixel, task) in batch.tasks.iter().enumerate() {
            let (paths, rest) = remaining.split_at(task.counts.paths as usize);
            remaining = rest;
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
