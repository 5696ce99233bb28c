//! Radiance statistics of pixels, and their brightest paths.

use glam::Vec3;

use crate::color::luminance;
use crate::film::{Peak, PixelStats};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::PathRays;
use crate::integrator::events::PathEvents;
use crate::rays::{HitBatch, MISS};

/// Adds paths to the statistics of their pixels, one entry per task in each slice.
#[derive(Debug)]
pub struct PixelSums<'a> {
    pub stats: &'a mut [PixelStats],
    /// Brightest path of each pixel; empty if not requested.
    pub peaks: &'a mut [Peak],
}

impl<'a> PixelSums<'a> {
    /// Sums radiance only.
    pub fn new(stats: &'a mut [PixelStats]) -> Self {
        Self { stats, peaks: &mut [] }
    }
}

impl PathEvents for PixelSums<'_> {
    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if at.depth == 0 {
            for (path, _) in rays.path.iter().zip(&hits.mesh[..rays.len]).filter(|(_, mesh)| **mesh != MISS) {
                self.stats[at.pixel(*path)].covered += 1;
            }
        }
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        for (stats, (_, paths)) in self.stats.iter_mut().zip(at.by_pixel(radiance)) {
            paths.iter().for_each(|radiance| stats.add(*radiance, false));
        }
        for (peak, (task, paths)) in self.peaks.iter_mut().zip(at.by_pixel(radiance)) {
            paths.iter().zip(task.first_path..).for_each(|(radiance, number)| peak.add(luminance(*radiance), number));
        }
    }
}
