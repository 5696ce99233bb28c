//! Auxiliary features of pixels (object, normal, depth), which decide what statistics neighbouring pixels share. They are
//! those of the surface behind back faces and thin walls that most paths pass.

use crate::balance::PixelFeatures;
use crate::integrator::data::transport::Transport;
use crate::integrator::through::thin_walls;
use crate::lanes::{F, LANES, U, store};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};

/// Features at the centres of `pixels`, by one extra ray each: they do not depend on the pixels' samples.
pub fn guides(transport: &Transport, pixels: &[[u32; 2]]) -> Vec<PixelFeatures> {
    let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
    let time = F::splat(0.5);
    rays.open(pixels.len(), transport.geometry.moves);
    for (packet, at) in pixels.chunks(LANES).zip((0..).step_by(LANES)) {
        let middle =
            |axis: usize| F::from(std::array::from_fn(|lane| packet[lane.min(packet.len() - 1)][axis] as f32 + 0.5));
        let ray = transport.camera.rays(middle(0), middle(1), time);
        let (near, far) = transport.camera.intervals(ray.1, time);
        rays.put(at, ray, far, U::ZERO, time);
        store(&mut rays.tnear, at, near);
    }
    rays.close(pixels.len());
    transport.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
    thin_walls::pass_most(transport, &rays, &mut hits);
    let guide = |ray: usize| {
        if hits.mesh[ray] == MISS {
            return PixelFeatures::default();
        }
        let point = transport.point(&rays, &hits, ray);
        PixelFeatures {
            object: hits.instance[ray] + 1,
            material: point.mesh.material + 1,
            normal: point.ns.normalize_or_zero(),
            depth: hits.t[ray],
            roughness: point.parameters(transport.scene).roughness,
        }
    };
    (0..pixels.len()).map(guide).collect()
}
