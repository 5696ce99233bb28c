//! The wavefront loop: traces a batch of paths, stage by stage. Buffers are reused between waves, so that the steady state
//! allocates nothing.

use std::time::Instant;

use super::back_faces::BackFaces;
use super::batch::PixelTask;
use super::emission_rays::EmissionRays;
use super::events::{FoundEmission, PathEvents, WaveContext};
use super::glass_bounces::GlassBounces;
use super::glass_shadows::GlassShadows;
use super::manifold::Manifolds;
use super::path_states::{NonFiniteSamples, PathStates};
use super::queues::{PathRays, ShadowRays, SortedHits};
use super::stages::requests::Requests;
use super::stages::{camera_rays, emission, lights, media, mixture, scatter, sort, surfaces};
use super::thin_walls::ThinWalls;
use super::transport::Transport;
use super::vertices::Vertices;
use crate::rays::{HitBatch, RayOrder};

/// Ray counts and query time of waves.
#[derive(Debug, Clone, Copy, Default)]
pub struct WaveCounts {
    /// Camera rays.
    pub camera_rays: u64,
    /// Camera rays for directly visible emission alone ([`emission_rays`](super::emission_rays)).
    pub emission_rays: u64,
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
        self.camera_rays + self.emission_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// The sum of two counts.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            camera_rays: self.camera_rays + other.camera_rays,
            emission_rays: self.emission_rays + other.emission_rays,
            first_bounce_rays: self.first_bounce_rays + other.first_bounce_rays,
            later_bounce_rays: self.later_bounce_rays + other.later_bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            query_seconds: self.query_seconds + other.query_seconds,
            not_finite: self.not_finite + other.not_finite,
            first_not_finite: self.first_not_finite.or(other.first_not_finite),
        }
    }

    fn add_not_finite(&mut self, at: &WaveContext, samples: &NonFiniteSamples) {
        self.not_finite += samples.count;
        if let (None, Some(path)) = (self.first_not_finite, samples.first) {
            let pixel = at.pixel(path);
            let before = at.tasks[..pixel].iter().map(|task| task.counts.paths).sum::<u32>();
            let task = &at.tasks[pixel];
            self.first_not_finite = Some([task.x, task.y, task.first_path + path - before]);
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
    emission: Vec<FoundEmission>,
    vertices: Vertices,
    requests: Requests,
    shadows: ShadowRays,
    occluded: Vec<bool>,
    path_states: PathStates,
    back_faces: BackFaces,
    walls: ThinWalls,
    glass_shadows: GlassShadows,
    glass_bounces: GlassBounces,
    manifolds: Manifolds,
    emission_rays: EmissionRays,
    /// Totals over all waves so far.
    pub counts: WaveCounts,
}

impl Wave {
    /// Traces the paths of the pixels' tasks, in a fixed order, and tells `events` what happens to them.
    pub fn run<E: PathEvents>(&mut self, transport: &Transport, tasks: &[PixelTask], events: &mut E) {
        let Self {
            rays,
            next_rays,
            hits,
            sorted,
            vertices,
            requests,
            shadows,
            occluded,
            back_faces,
            walls,
            glass_shadows,
            glass_bounces,
            manifolds,
            emission_rays,
            counts,
            ..
        } = self;
        let events = &mut (events, back_faces, (glass_shadows, glass_bounces, manifolds));
        self.path_states.start_paths(tasks, transport.proposal.lights.environment_probability);
        let PathStates { paths, radiance, non_finite } = &mut self.path_states;
        camera_rays::begin(transport, tasks, rays);
        let mut at = WaveContext { transport, tasks, paths, depth: 0 };
        events.begin(&at);
        while at.depth < transport.longest_path() && rays.len > 0 {
            counts.add_rays(at.depth, rays.len);
            let order = if at.depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
            timed(counts, || transport.rays.closest_hits(&rays.rays, order, hits));
            events.1.pass(&at, rays, hits);
            if at.depth == 0 {
                events.hits(&at, rays, hits);
            }
            if transport.materials.has_thin_walls {
                walls.pass(&at, rays, hits, events.1);
                if at.depth == 0 {
                    events.hits_behind_walls(&at, rays, hits);
                }
            }
            if at.depth > 0 {
                events.hits(&at, rays, hits);
            }

            let (clients, _, (glass_shadows, glass_bounces, manifolds)) = &mut *events;
            glass_shadows.find(&at, rays, hits, (radiance, non_finite), clients);
            manifolds.find(&at, rays, hits);
            sort::sort(transport, (at.depth, rays.first), glass_bounces, hits, sorted);
            if transport.materials.absorbs() {
                media::attenuate(transport, at.depth, rays, hits);
            }
            if at.depth == 0 {
                emission_rays.trace(&at, sorted, walls, (radiance, non_finite), events, counts);
            }
            emission::add(&at, sorted, rays, hits, &mut self.emission, (radiance, non_finite), events);
            surfaces::vertices(transport, sorted, rays, hits, vertices);
            events.2.0.mark(transport, vertices);
            events.2.2.mark(transport, vertices);
            mixture::find_cells(transport, vertices);

            requests.light_samples(transport, at.depth, vertices, paths, tasks);
            lights::sample(&at, vertices, requests, non_finite, shadows, events);
            requests.bsdf_samples(at.depth, vertices, paths);
            scatter::sample(&at, vertices, requests, non_finite, (rays.next_number(), next_rays), events);

            if !shadows.rays.is_empty() {
                counts.shadow_rays += shadows.len as u64;
                timed(counts, || match transport.materials.has_thin_walls || transport.passes_bodies() {
                    true => walls.pass_shadow_rays(transport, shadows, occluded),
                    false => transport.rays.occluded(&shadows.rays, RayOrder::Incoherent, occluded),
                });
                lights::add_unoccluded(&at, shadows, occluded, radiance, events);
            }
            let (clients, _, (.., manifolds)) = &mut *events;
            manifolds.sample(&at, vertices, (radiance, non_finite), clients);
            std::mem::swap(rays, next_rays);
            at.depth += 1;
        }
        events.end(&at, radiance);
        counts.add_not_finite(&at, non_finite);
    }
}

/// Runs a ray query and adds its time.
pub(super) fn timed(counts: &mut WaveCounts, query: impl FnOnce()) {
    let start = Instant::now();
    query();
    counts.query_seconds += start.elapsed().as_secs_f64();
}
