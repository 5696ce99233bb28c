//! The wavefront loop: traces a batch of paths, stage by stage. Buffers are reused between waves, so that the steady state
//! allocates nothing.

use super::back_faces::BackFaces;
use super::batch::PixelTask;
use super::counts::{WaveCounts, timed};
use super::emission_rays::EmissionRays;
use super::events::{FoundEmission, PathEvents, WaveContext};
use super::glass_bounces::GlassBounces;
use super::glass_shadows::GlassShadows;
use super::path_states::PathStates;
use super::queues::{PathRays, ShadowRays, SortedHits};
use super::stages::requests::Requests;
use super::stages::{camera_rays, emission, lights, media, mixture, scatter, sort, surfaces};
use super::thin_walls::ThinWalls;
use super::transport::Transport;
use super::vertices::Vertices;
use crate::rays::{HitBatch, RayOrder};

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
            emission_rays,
            counts,
            ..
        } = self;
        let events = &mut (events, back_faces, (glass_shadows, glass_bounces));
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

            let (clients, _, (glass_shadows, glass_bounces)) = &mut *events;
            glass_shadows.find(&at, rays, hits, (radiance, non_finite), clients);
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
            std::mem::swap(rays, next_rays);
            at.depth += 1;
        }
        events.end(&at, radiance);
        counts.add_not_finite(&at, non_finite);
    }
}
