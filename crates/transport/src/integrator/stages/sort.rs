//! Sorting of rays by their next stage.

use crate::integrator::queues::SortedHits;
use crate::integrator::transport::Transport;
use crate::rays::{HitBatch, MISS};

/// Sorts the rays at `depth` (0 for camera rays) by what they hit.
#[inline(never)]
pub fn sort(transport: &Transport, depth: u32, hits: &HitBatch, sorted: &mut SortedHits) {
    sorted.clear();
    let scatters = depth + 1 < transport.max_depth;
    for (ray, &mesh) in (0..).zip(&hits.mesh) {
        if mesh == MISS {
            sorted.escaped.push(ray);
            continue;
        }
        let kind = transport.materials.mesh_material(mesh);
        if kind.emits {
            sorted.emissive.push(ray);
        }
        if scatters && !kind.black && !kind.unlit {
            let queue = if kind.constant { &mut sorted.constant } else { &mut sorted.varying };
            queue.push(ray);
        }
    }
}
