//! What lies between ray queries and stages: back faces and thin walls that rays pass, shadows of glass, camera rays for
//! emission, lights with a size.

pub mod back_faces;
pub mod emission_rays;
pub mod glass_shadows;
pub mod passing;
pub mod sized_lights;
pub mod thin_walls;

use super::data::context::WaveContext;
use super::data::counts::{WaveCounts, timed};
use super::data::path_states::NonFiniteSamples;
use super::data::queues::{PathRays, ShadowRays, SortedHits};
use super::data::transport::Transport;
use super::events::PathEvents;
use crate::rays::HitBatch;
use emission_rays::EmissionRays;
use glass_shadows::GlassShadows;
use passing::Passing;
use sized_lights::SizedLightHits;

/// All that lies between ray queries and stages; one per thread.
#[derive(Debug, Default)]
pub struct Through {
    passing: Passing,
    glass_shadows: GlassShadows,
    emission_rays: EmissionRays,
    sized_lights: SizedLightHits,
}

impl Through {
    /// Adds the light of lights with a size that rays hit, before they are traced.
    pub fn sized_lights<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
        counts: &mut WaveCounts,
    ) {
        self.sized_lights.find(at, rays, &mut self.passing, non_finite, clients, counts);
    }

    /// Takes rays to the surfaces that they see: replaces their hits, and tells `clients` of them.
    pub fn resolve<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &mut HitBatch,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
    ) {
        self.passing.pass_back_faces(at.transport, rays, hits);
        if at.depth == 0 {
            clients.hits(at, rays, hits);
        }
        self.passing.pass_thin_walls(at, rays, hits, clients);
        if at.depth > 0 {
            clients.hits(at, rays, hits);
        } else if at.transport.materials.has_thin_walls {
            clients.hits_behind_walls(at, rays, hits);
        }
        self.glass_shadows.find(at, rays, hits, non_finite, clients);
    }

    /// Adds the emission that camera rays of its own find.
    pub fn visible_emission<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        sorted: &mut SortedHits,
        non_finite: &mut NonFiniteSamples,
        clients: &mut E,
        counts: &mut WaveCounts,
    ) {
        if at.depth == 0 {
            self.emission_rays.trace(at, sorted, &mut self.passing, non_finite, clients, counts);
        }
    }

    /// Tests which shadow rays are occluded, and attenuates the others by what they pass.
    pub(crate) fn occlude(&mut self, transport: &Transport, shadows: &mut ShadowRays, counts: &mut WaveCounts) {
        counts.shadow_rays += shadows.len as u64;
        timed(counts, || self.passing.walls.occlude(transport, shadows));
    }
}
