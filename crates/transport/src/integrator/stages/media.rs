//! Absorption by the media that rays cross: exp(−σ t) of Beer and Lambert. Light from infinity loses nothing: a body that it
//! reaches without another surface is not closed.

use glam::Vec3;

use super::surfaces;
use crate::integrator::Transport;
use crate::integrator::queues::PathRays;
use crate::lanes::{F, U, V3, eight};
use crate::rays::{HitBatch, MISS};

/// What is left after `distance` of light in a medium that absorbs `absorption` per metre.
#[inline]
pub fn left(absorption: Vec3, distance: f32) -> Vec3 {
    if distance.is_finite() { (absorption * -distance).exp() } else { Vec3::ONE }
}

/// Dims the rays of the batch at `depth` by what they crossed on their way to where they hit. Of camera rays it is not known
/// where they begin: in the body which they see from behind.
#[inline(never)]
pub fn cross(transport: &Transport, depth: u32, rays: &mut PathRays, hits: &HitBatch) {
    if depth == 0 {
        rays.medium.clear();
        rays.medium.resize(rays.weighted_pdf.len(), 0);
    }
    for ray in (0..rays.len).filter(|&ray| hits.mesh[ray] != MISS) {
        if depth == 0 && transport.materials.kind(hits.mesh[ray]).bounds.is_some_and(|medium| medium > 0) {
            let behind = surfaces::point(transport, rays, hits, ray).is_behind(rays.rays.direction(ray));
            [rays.medium[ray], _] = transport.materials.sides(hits.mesh[ray], behind, 0);
        }
        if rays.medium[ray] > 0 {
            let absorption = transport.materials.media[rays.medium[ray] as usize];
            rays.beta.set(ray, rays.beta.get(ray) * left(absorption, hits.t[ray]));
        }
    }
}

/// What is left of `radiance` that comes from `distance` through `media`, if any absorb.
#[inline(always)]
pub fn dimmed(transport: &Transport, radiance: V3, media: Option<U>, distance: F) -> V3 {
    let Some(media) = media else { return radiance };
    let (media, distance) = (media.to_array(), distance.to_array());
    let left = eight(|lane| left(transport.materials.media[media[lane] as usize], distance[lane]));
    let V3 { x, y, z } = V3::gather(left);
    V3 { x: radiance.x * x, y: radiance.y * y, z: radiance.z * z }
}
