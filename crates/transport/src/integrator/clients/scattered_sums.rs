//! Radiance of pixels without what the camera sees directly.

use glam::Vec3;

use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::PathRays;
use crate::integrator::events::{FoundEmission, PathEvents};

/// Adds the radiance of paths, without the emission at the end of camera rays, to the sums of their pixels, and that emission to
/// others, one per task.
#[derive(Debug)]
pub struct ScatteredSums<'a> {
    /// Without the emission.
    pub scattered: &'a mut [Vec3],
    /// The emission alone.
    pub emitted: &'a mut [Vec3],
}

impl PathEvents for ScatteredSums<'_> {
    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        if at.depth == 0 {
            let pixel = at.pixel(rays.path[found.ray as usize]);
            self.scattered[pixel] -= found.radiance;
            self.emitted[pixel] += found.radiance;
        }
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        for (sum, (_, paths)) in self.scattered.iter_mut().zip(at.by_pixel(radiance)) {
            *sum += paths.iter().sum::<Vec3>();
        }
    }
}
