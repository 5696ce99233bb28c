//! Surfaces that rays pass on their way.

use super::thin_walls::ThinWalls;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::PathRays;
use crate::integrator::data::transport::Transport;
use crate::integrator::events::PathEvents;
use crate::rays::HitBatch;

/// Takes rays through back faces and thin walls; one per thread.
#[derive(Debug, Default)]
pub struct Passing {
    /// Also of shadow rays.
    pub walls: ThinWalls,
}

impl Passing {
    /// Replaces the hits of rays that meet back faces.
    pub(crate) fn pass_back_faces(&mut self, transport: &Transport, rays: &PathRays, hits: &mut HitBatch) {
        let passes = |row: usize| rays.passes_backs(transport, row);
        self.walls.back_faces.resolve(transport, &rays.rays, &passes, hits);
    }

    /// Takes rays through thin walls, and through the back faces behind them, and tells `clients`.
    pub(crate) fn pass_thin_walls<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &mut HitBatch,
        clients: &mut E,
    ) {
        if at.transport.materials.has_thin_walls {
            self.walls.pass(at, rays, hits, &mut |rays, passed| clients.passed_wall(at, rays, passed));
        }
    }
}
