//! Sorting of rays by their next stage.

use crate::integrator::glass_bounces::GlassBounces;
use crate::integrator::queues::SortedHits;
use crate::integrator::transport::Transport;
use crate::rays::{HitBatch, MISS};

/// Sorts the rays at `depth` (0 for camera rays), numbered from `first` on, by what they hit.
#[inline(never)]
pub fn sort(
    transport: &Transport,
    (depth, first): (u32, u32),
    glass_bounces: &GlassBounces,
    hits: &HitBatch,
    sorted: &mut SortedHits,
) {
    sorted.clear();
    let ray_scatters = glass_bounces.scatters(transport, depth);
    let all_scatter = depth + 1 < transport.max_depth;
    for (ray, &mesh) in (0..).zip(&hits.mesh) {
        if mesh == MISS {
            sorted.escaped.push(ray);
            continue;
        }
        let kind = transport.materials.mesh_material(mesh);
        if kind.emits {
            sorted.emissive.push(ray);
        }
        let scatters = ray_scatters.as_ref().map_or(all_scatter, |scatters| scatters(first + ray));
        if scatters && !kind.black && !kind.unlit {
            let queue = if kind.constant { &mut sorted.constant } else { &mut sorted.varying };
            queue.push(ray);
        }
    }
}
