//! Camera rays for emission that the camera sees directly, besides those of paths.
//!
//! Where the silhouette of a light crosses a pixel, whether a camera ray meets the light or not is most of a path's variance. A
//! camera ray that ends there costs a fraction of a path. So in such pixels the emission that a path sees directly is the mean
//! over several camera rays of their own (splitting), and its own camera ray finds all other light only. Means do not change;
//! statistics of paths, AOVs and light layers include the mean as the path's emission.

use glam::Vec3;

use super::passing::Passing;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::dimensions;
use crate::integrator::data::history::RayHistory;
use crate::integrator::data::path_states::NonFiniteSamples;
use crate::integrator::data::queues::{PathIds, PathRays, SortedHits};
use crate::integrator::events::{FoundEmission, PathEvents};
use crate::integrator::stages::camera_rays::{camera_ray, clip};
use crate::integrator::stages::{emission, media, sort};
use crate::lanes::{F, LANES, NUMBERS, U, V3};
use crate::rays::{HitBatch, RayOrder};
use crate::sampling::{hash, keys, pixel_seed};

/// The seed of the sequences of these camera rays.
pub fn emission_seed(seed: u32) -> u32 {
    hash(seed ^ 0x6564_6765)
}

/// Traces these camera rays; one per thread.
#[derive(Debug, Default)]
pub struct EmissionRays {
    rays: PathRays,
    hits: HitBatch,
    sorted: SortedHits,
    found: Vec<FoundEmission>,
}

impl EmissionRays {
    /// Takes the paths of pixels with several camera rays out of `sorted`, the hits of the paths' own rays, as far as these
    /// found emission, and adds the emission that the several rays find.
    #[inline(never)]
    pub fn trace<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        sorted: &mut SortedHits,
        passing: &mut Passing,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
        counts: &mut WaveCounts,
    ) {
        let Some(numbers) = at.transport.proposal.emission_rays else { return };
        let of = |pixel: usize| numbers.rays_per_path(at.tasks[pixel].x, at.tasks[pixel].y);
        if (0..at.tasks.len()).all(|pixel| of(pixel) == 1) {
            return;
        }
        for rows in [&mut sorted.escaped, &mut sorted.emissive] {
            rows.retain(|path| of(at.pixel(*path)) == 1);
        }
        // Rays of a batch have the numbers of camera rays.
        let capacity = at.paths.len();
        self.rays.open(capacity, at.transport.geometry.moves, 0);
        let mut first_path = 0;
        for (pixel, task) in at.tasks.iter().enumerate() {
            let per_path = of(pixel);
            let all = if per_path > 1 { task.counts.paths * per_path } else { 0 };
            let mut next = 0;
            while next < all {
                if self.rays.len == capacity {
                    self.add(at, passing, non_finite, clients, counts);
                }
                let n = LANES.min(capacity - self.rays.len).min((all - next) as usize);
                self.push(at, [pixel as u32, first_path, per_path], next, n);
                next += n as u32;
            }
            first_path += task.counts.paths;
        }
        self.add(at, passing, non_finite, clients, counts);
    }

    /// Appends `n` rays of a pixel from number `first` on. Its first path in the wave has the number `first_path`.
    fn push(&mut self, at: &WaveContext, [pixel, first_path, per_path]: [u32; 3], first: u32, n: usize) {
        let task = &at.tasks[pixel as usize];
        let seed = U::splat(pixel_seed(task.x, task.y, emission_seed(at.transport.seed)));
        let index = U::splat(task.first_path.wrapping_mul(per_path).wrapping_add(first)) + U::from(NUMBERS);
        let path = U::from(NUMBERS.map(|lane| first_path + (first + lane) / per_path));
        let (ray, time) = camera_ray(at.transport, [task.x, task.y], seed, index);
        let beta = V3::splat(Vec3::splat(1.0 / per_path as f32));
        let path_ids = PathIds { path, index, seed, time, root: U::ZERO, history: U::splat(RayHistory::CAMERA.0) };
        self.rays.push(n, ray, keys(seed, index, dimensions::CAMERA), beta, V3::ZERO, F::ZERO, path_ids);
        clip(at.transport, &mut self.rays, n);
    }

    /// Adds the emission that the rays find, and empties the batch.
    fn add<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        passing: &mut Passing,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
        counts: &mut WaveCounts,
    ) {
        let Self { rays, hits, sorted, found } = self;
        let transport = at.transport;
        rays.close();
        counts.emission_rays += rays.len as u64;
        timed(counts, || transport.rays.closest_hits(&rays.rays, RayOrder::Coherent, hits));
        passing.pass_back_faces(transport, rays, hits);
        passing.pass_thin_walls(at, rays, hits, &mut ());
        sort::sort(transport, at.depth, rays, hits, sorted);
        media::attenuate(transport, at.depth, rays, hits);
        emission::find(at, sorted, rays, hits, found, non_finite, clients);
        rays.open(at.paths.len(), transport.geometry.moves, 0);
    }
}
