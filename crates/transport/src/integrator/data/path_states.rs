//! The paths of a wave, their radiance, and how contributions are clamped.

use glam::Vec3;

use super::task::PixelTask;
use crate::balance::deal;
use crate::lanes::{LANES, U};

/// A path of the wave: the samples that it takes at its first surface.
#[derive(Debug, Clone, Copy)]
pub struct PathState {
    /// Index of its pixel in the batch.
    pub pixel: u32,
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

/// Samples that were discarded because their radiance was not finite, since clients were told.
#[derive(Debug, Clone, Default)]
pub struct NonFiniteSamples {
    /// By sample, its path.
    pub paths: Vec<u32>,
}

impl NonFiniteSamples {
    /// Counts a sample of a path of the wave.
    #[inline]
    pub fn add(&mut self, path: u32) {
        self.paths.push(path);
    }

    /// Counts a sample for each of eight paths whose bit is set.
    #[inline(always)]
    pub(crate) fn add_lanes(&mut self, bits: u32, paths: U) {
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

/// The paths of a wave, with their light.
#[derive(Debug, Default)]
pub struct PathStates {
    /// The paths, pixel by pixel.
    pub paths: Vec<PathState>,
    /// By path, its radiance so far, linear RGB.
    pub radiance: Vec<Vec3>,
    pub non_finite: NonFiniteSamples,
}

impl PathStates {
    /// Starts the paths of all pixels and distributes each pixel's samples over its paths. `environment_probability` is that
    /// of [`LightProposal`](crate::light::LightProposal).
    pub(crate) fn start_paths(&mut self, tasks: &[PixelTask], environment_probability: f32) {
        self.paths.clear();
        for (pixel, task) in tasks.iter().enumerate() {
            let (mut first_light, mut first_bsdf) = (task.first_light, task.first_bsdf);
            let samples_per_path = task.weighed.samples_per_path(environment_probability);
            let paths = task.counts.paths;
            for path in 0..paths {
                let [light, bsdf] = [task.counts.light, task.counts.bsdf].map(|n| deal(n, paths, path));
                self.paths.push(PathState {
                    pixel: pixel as u32,
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
        self.radiance.clear();
        self.radiance.resize(self.paths.len(), Vec3::ZERO);
    }
}
