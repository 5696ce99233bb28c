//! What pixels' centres show, by which pixels know from which neighbours to learn.

use super::Transport;
use crate::balance::pilot::Guide;
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};

/// What the centres of pixels show, found by rays of their own: nothing in it depends on a pixel's samples.
pub fn guides(transport: &Transport, pixels: impl Iterator<Item = (u32, u32)>) -> Vec<Guide> {
    let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
    for (x, y) in pixels {
        let (origin, direction) = transport.camera.ray(x as f32 + 0.5, y as f32 + 0.5);
        rays.push(origin, direction, 0.0, f32::INFINITY, 0);
    }
    transport.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
    (0..rays.len())
        .map(|i| {
            if hits.instance[i] == MISS {
                return Guide::default();
            }
            let barycentric = (hits.u[i], hits.v[i]);
            let point =
                transport.geometry.point(transport.scene, hits.instance[i], hits.mesh[i], hits.prim[i], barycentric);
            Guide {
                object: hits.instance[i] + 1,
                material: point.mesh.material + 1,
                normal: point.ns.normalize_or_zero(),
                depth: hits.t[i],
                roughness: transport.materials.at(transport.scene, &point).alpha.sqrt(),
            }
        })
        .collect()
}
