//! Absorption in media by the Beer-Lambert law, exp(−σ t). Light from the environment is not attenuated behind the last boundary that
//! it crosses: if that does not lead out of all media, it is not closed.

use crate::integrator::data::queues::PathRays;
use crate::integrator::data::transport::Transport;
use crate::lanes::{F, U, V3, eight};
use crate::rays::{HitBatch, MISS};

/// Attenuates the throughput of the rays at `depth` over the distance to their hits, if a medium absorbs. Finds the media of
/// camera rays.
pub(crate) fn attenuate(transport: &Transport, depth: u32, rays: &mut PathRays, hits: &HitBatch) {
    if !transport.materials.tracks_media {
        return;
    }
    if depth == 0 {
        rays.medium.clear();
        rays.medium.resize(rays.weighted_pdf.len(), 0);
    }
    let mut known = None;
    for ray in (0..rays.len).filter(|&ray| hits.mesh[ray] != MISS) {
        let mut distance = hits.t[ray];
        if depth == 0 {
            let (origin, direction, time) = (rays.rays.origin(ray), rays.rays.direction(ray), rays.rays.time(ray));
            let near = transport.camera.intervals(V3::splat(direction), F::splat(time)).0.as_array()[0];
            let (media, from) = transport.media_at_camera((origin, direction), near, time, &mut known);
            let back_facing =
                transport.geometry.normal(transport.scene, hits.primitive(ray), time).dot(direction) > 0.0;
            [rays.medium[ray], _] = transport.materials.media_at_surface(hits.mesh[ray], back_facing, media);
            distance -= from;
        }
        if rays.medium[ray] != 0 {
            let left = transport.materials.media.transmittance(rays.medium[ray], distance);
            rays.beta.set(ray, rays.beta.get(ray) * left);
        }
    }
}

/// Attenuates `radiance` over `distance` metres in `media`, if there are any.
#[inline(always)]
pub(crate) fn attenuated(transport: &Transport, radiance: V3, media: Option<U>, distance: F) -> V3 {
    let Some(media) = media else { return radiance };
    let (media, distance) = (media.to_array(), distance.to_array());
    let transmittance = eight(|lane| transport.materials.media.transmittance(media[lane], distance[lane]));
    let V3 { x, y, z } = V3::gather(transmittance);
    V3 { x: radiance.x * x, y: radiance.y * y, z: radiance.z * z }
}
