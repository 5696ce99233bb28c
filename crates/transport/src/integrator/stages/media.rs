//! Absorption in media by the Beer-Lambert law, exp(−σ t). Light from the environment is not attenuated: a boundary that it
//! crosses once is not closed.

use crate::integrator::data::queues::PathRays;
use crate::integrator::data::transport::Transport;
use crate::integrator::surface::materials::transmittance;
use crate::lanes::{F, U, V3, eight};
use crate::rays::{HitBatch, MISS};

/// Attenuates the throughput of the rays at `depth` over the distance to their hits, if a medium absorbs. The medium of a camera ray is unknown at
/// its origin; it is that of the boundary that the ray hits from inside, if it does.
pub fn attenuate(transport: &Transport, depth: u32, rays: &mut PathRays, hits: &HitBatch) {
    if !transport.materials.absorbs() {
        return;
    }
    if depth == 0 {
        rays.medium.clear();
        rays.medium.resize(rays.weighted_pdf.len(), 0);
    }
    for ray in (0..rays.len).filter(|&ray| hits.mesh[ray] != MISS) {
        if depth == 0
            && transport.materials.mesh_material(hits.mesh[ray]).interior_medium.is_some_and(|medium| medium > 0)
        {
            let back_facing = transport.point(&rays.rays, hits, ray).is_back_facing(rays.rays.direction(ray));
            [rays.medium[ray], _] = transport.materials.media_at_surface(hits.mesh[ray], back_facing, 0);
        }
        if rays.medium[ray] > 0 {
            let absorption = transport.materials.media[rays.medium[ray] as usize];
            rays.beta.set(ray, rays.beta.get(ray) * transmittance(absorption, hits.t[ray]));
        }
    }
}

/// Attenuates `radiance` over `distance` metres in `media`, if there are any that absorb.
#[inline(always)]
pub fn attenuated(transport: &Transport, radiance: V3, media: Option<U>, distance: F) -> V3 {
    let Some(media) = media else { return radiance };
    let (media, distance) = (media.to_array(), distance.to_array());
    let transmittance = eight(|lane| transmittance(transport.materials.media[media[lane] as usize], distance[lane]));
    let V3 { x, y, z } = V3::gather(transmittance);
    V3 { x: radiance.x * x, y: radiance.y * y, z: radiance.z * z }
}
