//! What comes next for each ray.

use crate::integrator::Transport;
use crate::integrator::queues::SortedHits;
use crate::rays::{HitBatch, MISS};

/// Sorts the rays of the batch at `depth` (0 for camera rays) by what they hit.
#[inline(never)]
pub fn sort(transport: &Transport, depth: u32, hits: &HitBatch, sorted: &mut SortedHits) {
    sorted.clear();
    let scatters = depth + 1 < transport.max_depth;
    for (ray, &mesh) in (0..).zip(&hits.mesh) {
        if mesh == MISS {
            sorted.escaped.push(ray);
            continue;
        }
        let kind = transport.materials.kind(mesh);
        if kind.shines {
            sorted.emissive.push(ray);
        }
        if scatters && !kind.black && !kind.unlit {
            let queue = if kind.plain { &mut sorted.plain } else { &mut sorted.detailed };
            queue.push(ray);
        }
    }
}
