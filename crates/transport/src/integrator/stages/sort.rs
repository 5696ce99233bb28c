//! Sorting of rays by their next stage.

use crate::integrator::data::queues::{PathRays, SortedHits};
use crate::integrator::data::transport::Transport;
use crate::rays::{HitBatch, MISS};

/// Sorts the rays at `depth` (0 for camera rays) by what they hit.
#[inline(never)]
pub fn sort(transport: &Transport, depth: u32, rays: &PathRays, hits: &HitBatch, sorted: &mut SortedHits) {
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
        if rays.history(ray as usize).scatters(transport, depth) && !kind.black && !kind.unlit {
            let queue = if kind.constant { &mut sorted.constant } else { &mut sorted.varying };
            queue.push(ray);
        }
    }
}
