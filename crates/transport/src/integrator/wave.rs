//! The wavefront loop: traces a batch of paths, stage by stage. Buffers are reused between waves, so that the steady state
//! allocates nothing.

use std::ops::Range;

use super::data::context::WaveContext;
use super::data::counts::{WaveCounts, timed};
use super::data::path_states::PathStates;
use super::data::queues::{PathRays, ShadowRays, SortedHits};
use super::data::task::PixelTask;
use super::data::transport::Transport;
use super::data::vertices::Vertices;
use super::events::{FoundEmission, PathEvents};
use super::reuse::{Lending, Loan, PathLight};
use super::stages::requests::Requests;
use super::stages::{camera_rays, emission, lights, media, mixture, scatter, sort, surfaces};
use super::through::Through;
use crate::rays::{HitBatch, RayOrder};

/// The wavefront integrator of one thread, with its buffers.
#[derive(Debug, Default)]
pub struct Wave {
    rays: PathRays,
    next_rays: PathRays,
    hits: HitBatch,
    sorted: SortedHits,
    found: Vec<FoundEmission>,
    vertices: Vertices,
    requests: Requests,
    shadows: ShadowRays,
    path_states: PathStates,
    through: Through,
    lending: Lending,
    /// Totals over all waves so far.
    pub counts: WaveCounts,
}

impl Wave {
    /// Traces the paths of the pixels' tasks, in a fixed order, and tells `clients` what happens to them.
    pub fn run<E: PathEvents>(&mut self, transport: &Transport, tasks: &[PixelTask], clients: &mut E) {
        let Self { rays, next_rays, hits, sorted, found, vertices, requests, shadows, path_states, .. } = self;
        let Self { through, lending, counts, .. } = self;
        path_states.start_paths(tasks, transport.proposal.lights.environment_probability);
        let PathStates { paths, radiance, non_finite } = path_states;
        camera_rays::begin(transport, tasks, rays);
        let mut at = WaveContext { transport, tasks, paths, depth: 0 };
        let light = &mut PathLight { radiance, lending, clients };
        light.begin(&at);
        while at.depth < transport.longest_path() && rays.len > 0 {
            light.rays(&at, rays);
            through.sized_lights(&at, rays, non_finite, light, counts);
            trace(&at, rays, hits, counts);
            through.resolve(&at, rays, hits, non_finite, light);
            sort::sort(transport, at.depth, rays, hits, sorted);
            media::attenuate(transport, at.depth, rays, hits);
            through.visible_emission(&at, sorted, non_finite, light, counts);
            emission::find(&at, sorted, rays, hits, found, non_finite, light);
            surfaces::vertices(transport, sorted, rays, hits, vertices);
            light.lend(&at, rays, vertices);
            mixture::find_cells(transport, vertices);

            requests.light_samples(transport, at.depth, vertices, paths, tasks);
            lights::sample(&at, vertices, requests, non_finite, shadows, light);
            requests.bsdf_samples(at.depth, vertices, paths);
            let next = (rays.next_number(), &mut *next_rays);
            scatter::sample(&at, vertices, requests, non_finite, next, light);
            if shadows.len > 0 {
                through.occlude(transport, shadows, counts);
                light.shadow_rays(&at, shadows);
                lights::unoccluded(&at, shadows, light);
            }
            light.lending.keep(&at, vertices);
            light.discard(&at, counts, non_finite);
            std::mem::swap(rays, next_rays);
            at.depth += 1;
        }
        light.end(&at, counts, non_finite);
    }

    /// Lists, from the next wave on, what the paths of these indices borrow.
    pub fn watch(&mut self, paths: Range<u32>) {
        self.lending.watched = paths;
    }

    /// What the watched paths have borrowed in the last wave.
    pub fn loans(&self) -> &[Loan] {
        &self.lending.loans
    }
}

/// Finds the closest hits of rays.
fn trace(at: &WaveContext, rays: &PathRays, hits: &mut HitBatch, counts: &mut WaveCounts) {
    counts.add_rays(at.depth, rays.len);
    let order = if at.depth == 0 { RayOrder::Coherent } else { RayOrder::Incoherent };
    timed(counts, || at.transport.rays.closest_hits(&rays.rays, order, hits));
}
