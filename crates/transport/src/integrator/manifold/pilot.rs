//! How much of the picture has lamps behind smooth glass.

use super::{Candidate, Start, Walker, is_behind_glass};
use crate::integrator::stages::lights::SHADOW_END;
use crate::integrator::transport::Transport;
use crate::lanes::{F, LANES, NUMBERS, U, V3};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::sampling::samples;

/// Rows and columns of camera rays.
const SIDE: usize = 24;

/// The share of the seen surfaces, in [0, 1], from which a light sample of the emissive surfaces or the punctual lights is found
/// by a walk. `size` is the picture's in pixels. 0 without bodies of smooth glass.
pub fn share_behind_glass(transport: &Transport, [width, height]: [u32; 2]) -> f32 {
    if !transport.materials.has_smooth_bodies {
        return 0.0;
    }
    let moves = transport.geometry.moves;
    let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
    for first in (0..SIDE * SIDE).step_by(LANES) {
        let number = |lane: usize| first + lane;
        let at = |pixels: u32, i: usize| (i as f32 + 0.5) / SIDE as f32 * pixels as f32;
        let x = F::from(std::array::from_fn(|lane| at(width, number(lane) % SIDE)));
        let y = F::from(std::array::from_fn(|lane| at(height, number(lane) / SIDE)));
        let middle = F::splat(0.5);
        let (origin, direction) = transport.camera.rays_through((x, y), (middle, middle), F::ZERO);
        for lane in 0..LANES {
            rays.push(origin.lane(lane), direction.lane(lane), 0.0, f32::INFINITY, number(lane) as u32);
            rays.time.extend(moves.then_some(0.0));
        }
    }
    transport.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
    let (mut seen, mut found) = (0, 0);
    let (mut walker, mut probe, mut probed) = (Walker::default(), RayBatch::default(), HitBatch::default());
    for row in 0..SIDE * SIDE {
        let hit = (hits.instance[row], hits.mesh[row], hits.prim[row]);
        if hit.1 == MISS || is_behind_glass(transport, hit.1) {
            continue;
        }
        seen += 1;
        let point = transport.geometry.point(transport.scene, hit, (hits.u[row], hits.v[row]), 0.0);
        let side = if point.is_back_facing(rays.direction(row)) { -1.0 } else { 1.0 };
        let ng = point.ng.normalize_or_zero() * side;
        let origin = point.position + ng * point.origin_offset;
        let numbers = samples(U::splat(0), U::splat(row as u32) + U::from(NUMBERS), 0);
        let is_found =
            Candidate::eight(transport, V3::splat(origin), F::ZERO, numbers).iter().any(|[candidate, ..]| {
                let Some(candidate) = candidate.filter(|candidate| ng.dot(candidate.wi) > 0.0) else { return false };
                let start = Start { origin, key: row as u32, ..Default::default() };
                probe.clear();
                probe.push(origin, candidate.wi, 0.0, candidate.distance * SHADOW_END, start.key);
                probe.time.extend(moves.then_some(0.0));
                transport.rays.closest_hits(&probe, RayOrder::Incoherent, &mut probed);
                is_behind_glass(transport, probed.mesh[0]) && candidate.light(transport, &mut walker, &start).is_some()
            });
        found += u32::from(is_found);
    }
    found as f32 / (seen.max(1)) as f32
}
