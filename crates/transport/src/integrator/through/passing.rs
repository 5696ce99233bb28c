//! Surfaces that rays pass on their way.

use super::back_faces::BackFaces;
use super::history::Histories;
use super::thin_walls::ThinWalls;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::queues::{PathRays, ShadowRays};
use crate::integrator::data::transport::Transport;
use crate::integrator::events::PathEvents;
use crate::rays::HitBatch;

/// Takes rays through back faces and thin walls; one per thread.
#[derive(Debug, Default)]
pub struct Passing {
    /// Those of all rays.
    pub histories: Histories,
    back_faces: BackFaces,
    /// Also of shadow rays.
    walls: ThinWalls,
}

impl Passing {
    /// Takes rays to the surfaces that they see: replaces their hits, and tells `clients` of them.
    pub fn resolve<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &mut HitBatch,
        clients: &mut E,
    ) {
        self.pass_back_faces(at.transport, rays, hits);
        if at.depth == 0 {
            clients.hits(at, rays, hits);
        }
        self.pass_thin_walls(at, rays, hits);
        if at.depth > 0 {
            clients.hits(at, rays, hits);
        } else if at.transport.materials.has_thin_walls {
            clients.hits_behind_walls(at, rays, hits);
        }
    }

    /// Fills the histories of rays, and takes the rays through the back faces that they pass.
    pub fn pass_back_faces(&mut self, transport: &Transport, rays: &mut PathRays, hits: &mut HitBatch) {
        self.histories.fill(rays);
        self.back_faces.pass(transport, 0..rays.len as u32, rays, hits);
    }

    /// Takes rays through thin walls, and through the back faces behind them.
    pub fn pass_thin_walls(&mut self, at: &WaveContext, rays: &mut PathRays, hits: &mut HitBatch) {
        if at.transport.materials.has_thin_walls {
            self.walls.pass(at, rays, hits, &mut self.back_faces);
        }
    }

    /// Tests which shadow rays are occluded, and attenuates the others by what they pass.
    pub fn occlude(&mut self, transport: &Transport, shadows: &mut ShadowRays, counts: &mut WaveCounts) {
        counts.shadow_rays += shadows.len as u64;
        timed(counts, || self.walls.occlude(transport, shadows));
    }
}
