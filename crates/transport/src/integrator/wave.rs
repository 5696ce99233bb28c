//! A batch of paths from camera to end, stage by stage. Buffers are kept between waves: none is allocated in the
//! steady state.

use std::time::Instant;

use super::Transport;
use super::batch::{PixelBatch, PixelTask};
use super::path_states::{CAMERA, PathStates, Step};
use super::queues::{PathRays, ShadowRays, SortedHits};
use super::stages::requests::Requests;
use super::stages::{camera_rays, emission, lights, media, mixture, scatter, sort, surfaces};
use super::vertices::Vertices;
use crate::color::luminance;
use crate::film::PixelStats;
use crate::guiding::{TrainingSample, VertexRecord};
use crate::light::LightSampleRecord;
use crate::rays::{HitBatch, RayOrder};

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
    /// Samples left out as their light was no finite number.
    pub not_finite: u64,
    /// Of the first of them: column, row, number of the path in its pixel.
    pub first_not_finite: Option<[u32; 3]>,
}

impl WaveCounts {
    /// Rays of all kinds.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// The sum of two.
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

/// The buffers of one thread.
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
    /// Rays and time so far.
    pub counts: WaveCounts,
}

impl Wave {
    /// Traces the paths that the batch's tasks count and adds to its sums, in a fixed order.
    pub fn run(&mut self, transport: &Transport, batch: &mut PixelBatch) {
        let Self { rays, next_rays, hits, sorted, vertices, requests, shadows, occluded, path_states, counts } = self;
        path_states.begin(batch.tasks, transport.lights.environment_probability);
        if !batch.extras.is_empty() {
            path_states.mirrors.resize(path_states.paths.len(), None);
        }
        camera_rays::begin(transport, batch.tasks, rays);
        let learns = path_states.steps.is_some();
        for depth in 0..transport.max_depth {
            if rays.len == 0 {
                break;
            }
            counts.add_rays(depth, rays.len);
            let order = if depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
            timed(counts, || transport.rays.closest_hits(&rays.rays, order, hits));

            sort::sort(transport, depth, hits, sorted);
            if depth == 0 {
                surfaces::observe(transport, rays, hits, path_states, batch);
            } else if !batch.extras.is_empty() {
                surfaces::follow_mirrors(transport, depth, rays, hits, path_states, batch);
            }
            if transport.materials.absorbs() {
                media::cross(transport, depth, rays, hits);
            }
            emission::surfaces(transport, depth, &sorted.emissive, rays, hits, path_states, batch);
            emission::environment(transport, depth, &sorted.escaped, rays, path_states, batch);
            surfaces::vertices(transport, learns, sorted, rays, hits, vertices);
            mixture::find(transport, vertices);

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
        path_states.finish(batch);
        counts.not_finite += path_states.faults.count;
        if let (None, Some(path)) = (counts.first_not_finite, path_states.faults.first) {
            let pixel = path_states.paths[path as usize].pixel;
            let before = batch.tasks[..pixel as usize].iter().map(|task| task.counts.paths).sum::<u32>();
            let task = &batch.tasks[pixel as usize];
            counts.first_not_finite = Some([task.x, task.y, task.first_path + path - before]);
        }
    }
}

/// What the squares of pixels' contributions are divided by, from what the pixels took and found.
pub type Divisors<'a> = &'a dyn Fn(&[PixelTask], &[PixelStats]) -> Vec<f32>;

impl Wave {
    /// As [`run`](Self::run), for what is to be learned from the paths: adds to `training_samples` those that found light, each weighed
    /// by what `divisors` makes of its pixel, and to `vertex_records` what vertices beyond the first found; gives the divisors.
    pub fn learn(
        &mut self,
        transport: &Transport,
        batch: &mut PixelBatch,
        divisors: Divisors,
        (training_samples, vertex_records): (&mut Vec<TrainingSample>, &mut Vec<VertexRecord>),
    ) -> Vec<f32> {
        self.path_states.steps.get_or_insert_default();
        self.run(transport, batch);
        self.path_states.gather();
        let divisors = divisors(batch.tasks, batch.stats);
        let PathStates { steps, sub_paths, paths, .. } = &mut self.path_states;
        let steps = steps.take().unwrap_or_default();
        for (step, sub_path) in steps.iter().zip(sub_paths.iter()) {
            let found = luminance(sub_path.indirect);
            if step.parent != CAMERA && step.beta > 0.0 {
                // As if they had been taken for sure.
                let [light, on] = step.chances;
                let found = [light.sqrt() * steps[step.parent as usize].light, on * found];
                let found = found.map(|found| (found / step.beta).powi(2));
                vertex_records.push(VertexRecord { position: step.position, normal: step.normal, found });
            }
            if found > 0.0 && step.broad && step.beta > 0.0 && found.is_finite() {
                let Step { position, normal, wi, beta, pdf: [pdf, bsdf_pdf, field_pdf], .. } = *step;
                training_samples.push(TrainingSample {
                    position,
                    normal,
                    wi,
                    found: found / beta,
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
    /// As [`run`](Self::run), for what is to be learned of area lights: the light samples toward them, each weighed by what
    /// `divisors` makes of its pixel, a place in the batch; and the divisors.
    pub fn light_sample_records(
        &mut self,
        transport: &Transport,
        batch: &mut PixelBatch,
        divisors: Divisors,
    ) -> (Vec<LightSampleRecord>, Vec<f32>) {
        self.path_states.light_sample_records.get_or_insert_default();
        self.run(transport, batch);
        let mut light_sample_records = self.path_states.light_sample_records.take().unwrap_or_default();
        let divisors = divisors(batch.tasks, batch.stats);
        light_sample_records.iter_mut().for_each(|light_sample_record| {
            light_sample_record.found /= divisors[light_sample_record.pixel as usize].sqrt()
        });
        (light_sample_records, divisors)
    }
}

/// Adds a ray query's time.
fn timed(counts: &mut WaveCounts, query: impl FnOnce()) {
    let start = Instant::now();
    query();
    counts.query_seconds += start.elapsed().as_secs_f64();
}
