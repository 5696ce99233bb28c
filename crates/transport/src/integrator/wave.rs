//! The wavefront loop: traces a batch of paths, stage by stage. Buffers are reused between waves, so that the steady state
//! allocates nothing.

use std::time::Instant;

use super::back_faces::BackFaces;
use super::batch::{PixelBatch, PixelTask};
use super::path_states::{NO_PARENT, PathStates, ScatterRecord};
use super::queues::{PathRays, ShadowRays, SortedHits};
use super::stages::requests::Requests;
use super::stages::{camera_rays, emission, lights, media, mixture, scatter, sort, surfaces};
use super::transport::Transport;
use super::vertices::Vertices;
use crate::color::luminance;
use crate::film::PixelStats;
use crate::guiding::{TrainingSample, VertexRecord};
use crate::light::LightSampleRecord;
use crate::rays::{HitBatch, RayOrder};

/// Ray counts and query time of waves.
#[derive(Debug, Clone, Copy, Default)]
pub struct WaveCounts {
    /// Camera rays.
    pub camera_rays: u64,
    /// Rays of the first bounce.
    pub first_bounce_rays: u64,
    /// Rays of later bounces.
    pub later_bounce_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Time in ray queries, in seconds.
    pub query_seconds: f64,
    /// Samples discarded because their radiance was not finite.
    pub not_finite: u64,
    /// The first of them: column, row, number of the path in its pixel.
    pub first_not_finite: Option<[u32; 3]>,
}

impl WaveCounts {
    /// Total number of rays.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// The sum of two counts.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            camera_rays: self.camera_rays + other.camera_rays,
            first_bounce_rays: self.first_bounce_rays + other.first_bounce_rays,
            later_bounce_rays: self.later_bounce_rays + other.later_bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            query_seconds: self.query_seconds + other.query_seconds,
            not_finite: self.not_finite + other.not_finite,
            first_not_finite: self.first_not_finite.or(other.first_not_finite),
        }
    }

    fn add_rays(&mut self, depth: u32, n: usize) {
        match depth {
            0 => self.camera_rays += n as u64,
            1 => self.first_bounce_rays += n as u64,
            _ => self.later_bounce_rays += n as u64,
        }
    }
}

/// The wavefront integrator of one thread, with its buffers.
#[derive(Debug, Default)]
pub struct Wave {
    rays: PathRays,
    next_rays: PathRays,
    hits: HitBatch,
    sorted: SortedHits,
    vertices: Vertices,
    requests: Requests,
    shadows: ShadowRays,
    occluded: Vec<bool>,
    path_states: PathStates,
    back_faces: BackFaces,
    /// Totals over all waves so far.
    pub counts: WaveCounts,
}

impl Wave {
    /// Traces the paths of the batch's tasks and adds them to its sums, in a fixed order.
    pub fn run(&mut self, transport: &Transport, batch: &mut PixelBatch) {
        let Self {
            rays,
            next_rays,
            hits,
            sorted,
            vertices,
            requests,
            shadows,
            occluded,
            path_states,
            back_faces,
            counts,
        } = self;
        path_states.start_paths(batch.tasks, transport.lights.environment_probability);
        if !batch.extras.is_empty() {
            path_states.mirrors.resize(path_states.paths.len(), None);
        }
        camera_rays::begin(transport, batch.tasks, rays);
        let learns = path_states.scatter_records.is_some();
        for depth in 0..transport.max_depth {
            if rays.len == 0 {
                break;
            }
            counts.add_rays(depth, rays.len);
            let order = if depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
            timed(counts, || transport.rays.closest_hits(&rays.rays, order, hits));
            back_faces.pass(transport, depth, path_states, rays, hits);

            sort::sort(transport, depth, hits, sorted);
            if depth == 0 {
                surfaces::record_first_hits(transport, rays, hits, path_states, batch);
            } else if !batch.extras.is_empty() {
                surfaces::follow_mirrors(transport, depth, rays, hits, path_states, batch);
            }
            if transport.materials.absorbs() {
                media::attenuate(transport, depth, rays, hits);
            }
            emission::surfaces(transport, depth, &sorted.emissive, rays, hits, path_states, batch);
            emission::environment(transport, depth, &sorted.escaped, rays, path_states, batch);
            surfaces::vertices(transport, learns, sorted, rays, hits, vertices);
            mixture::find_cells(transport, vertices);

            requests.light_samples(transport, depth, vertices, path_states, batch.tasks);
            lights::sample(transport, depth, vertices, requests, path_states, batch.observer.is_some(), shadows);
            requests.bsdf_samples(depth, transport.max_depth, vertices, path_states);
            scatter::sample(transport, depth, vertices, requests, path_states, next_rays);

            if !shadows.rays.is_empty() {
                counts.shadow_rays += shadows.len as u64;
                timed(counts, || transport.rays.occluded(&shadows.rays, RayOrder::Incoherent, occluded));
                path_states.add_light_samples(shadows, occluded, depth, transport.limits[(depth > 0) as usize], batch);
            }
            std::mem::swap(rays, next_rays);
        }
        path_states.add_to_pixels(batch);
        counts.not_finite += path_states.non_finite.count;
        if let (None, Some(path)) = (counts.first_not_finite, path_states.non_finite.first) {
            let pixel = path_states.paths[path as usize].pixel;
            let before = batch.tasks[..pixel as usize].iter().map(|task| task.counts.paths).sum::<u32>();
            let task = &batch.tasks[pixel as usize];
            counts.first_not_finite = Some([task.x, task.y, task.first_path + path - before]);
        }
    }
}

/// Computes, from the tasks and statistics of pixels, the divisor of each pixel's squared contributions.
pub type Divisors<'a> = &'a dyn Fn(&[PixelTask], &[PixelStats]) -> Vec<f32>;

impl Wave {
    /// Runs a wave and collects training data of the guiding field: appends a training sample for each scattered ray that found
    /// light, weighted by the divisor of its pixel, and a vertex record for each vertex beyond the first. Returns the divisors.
    pub fn collect_training_samples(
        &mut self,
        transport: &Transport,
        batch: &mut PixelBatch,
        divisors: Divisors,
        (training_samples, vertex_records): (&mut Vec<TrainingSample>, &mut Vec<VertexRecord>),
    ) -> Vec<f32> {
        self.path_states.scatter_records.get_or_insert_default();
        self.run(transport, batch);
        self.path_states.accumulate_descendants();
        let divisors = divisors(batch.tasks, batch.stats);
        let PathStates { scatter_records, sub_paths, paths, .. } = &mut self.path_states;
        let scatter_records = scatter_records.take().unwrap_or_default();
        for (record, sub_path) in scatter_records.iter().zip(sub_paths.iter()) {
            let found = luminance(sub_path.indirect);
            if record.parent != NO_PARENT && record.beta > 0.0 {
                // Estimates for roulette probabilities of one.
                let [light, on] = record.roulette;
                let found = [light.sqrt() * scatter_records[record.parent as usize].light, on * found];
                let found = found.map(|found| (found / record.beta).powi(2));
                vertex_records.push(VertexRecord {
                    position: record.position,
                    normal: record.normal,
                    squared_contributions: found,
                });
            }
            if found > 0.0 && record.diffuse && record.beta > 0.0 && found.is_finite() {
                let ScatterRecord { position, normal, wi, beta, pdf: [pdf, bsdf_pdf, field_pdf], .. } = *record;
                training_samples.push(TrainingSample {
                    position,
                    normal,
                    wi,
                    contribution: found / beta,
                    weight: found * found / divisors[paths[sub_path.path as usize].pixel as usize],
                    pdf,
                    bsdf_pdf,
                    field_pdf,
                });
            }
        }
        divisors
    }
}

impl Wave {
    /// Runs a wave and returns its light samples of area lights, each divided by the square root of its pixel's divisor, and the
    /// divisors. [`LightSampleRecord::pixel`] is an index into the batch.
    pub fn collect_light_samples(
        &mut self,
        transport: &Transport,
        batch: &mut PixelBatch,
        divisors: Divisors,
    ) -> (Vec<LightSampleRecord>, Vec<f32>) {
        self.path_states.light_sample_records.get_or_insert_default();
        self.run(transport, batch);
        let mut records = self.path_states.light_sample_records.take().unwrap_or_default();
        let divisors = divisors(batch.tasks, batch.stats);
        records.iter_mut().for_each(|record| record.contribution /= divisors[record.pixel as usize].sqrt());
        (records, divisors)
    }
}

/// Runs a ray query and adds its time.
fn timed(counts: &mut WaveCounts, query: impl FnOnce()) {
    let start = Instant::now();
    query();
    counts.query_seconds += start.elapsed().as_secs_f64();
}
