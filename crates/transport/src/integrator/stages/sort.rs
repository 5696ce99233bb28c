//! Sorting of rays by their next stage.

use crate::integrator::data::history::RayHistory;
use crate::integrator::data::queues::SortedHits;
use crate::integrator::data::transport::Transport;
use crate::rays::{HitBatch, MISS};

/// Sorts the rays at `depth` (0 for camera rays) by what they hit. `history` is empty where nothing depends on it.
#[inline(never)]
pub fn sort(transport: &Transport, depth: u32, history: &[RayHistory], hits: &HitBatch, sorted: &mut SortedHits) {
    sorted.clear();
    for (ray, &mesh) in (0..).zip(&hits.mesh) {
        if mesh == MISS {
            sorted.escaped.push(ray);
            continue;
        }
        let kind = transport.materials.mesh_material(mesh);
        if kind.emits {
            sorted.emissive.push(ray);
        }
        let history = history.get(ray as usize).copied().unwrap_or_default();
        if history.scatters(transport, depth) && !kind.black && !kind.unlit {
            let queue = if kind.constant { &mut sorted.constant } else { &mut sorted.varying };
            queue.push(ray);
        }
    }
}
