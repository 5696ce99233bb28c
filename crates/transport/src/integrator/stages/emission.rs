//! Emission at the end of rays: emissive surfaces and the environment, with MIS weights.

use glam::Vec3;

use super::eight_of;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::path_states::{NonFiniteSamples, clamp_contribution};
use crate::integrator::data::queues::{LightKind, PathRays, SortedHits};
use crate::integrator::events::{FoundEmission, PathEvents};
use crate::lanes::LANES;
use crate::rays::HitBatch;

/// Finds the emission at the end of rays, and tells `events`. `found` is scratch space.
pub fn find<E: PathEvents>(
    at: &WaveContext,
    sorted: &SortedHits,
    rays: &PathRays,
    hits: &HitBatch,
    found: &mut Vec<FoundEmission>,
    non_finite: &mut NonFiniteSamples,
    events: &mut E,
) {
    found.clear();
    emissive_surfaces(at, &sorted.emissive, rays, hits, non_finite, found);
    environment(at, &sorted.escaped, rays, non_finite, found);
    found.iter().for_each(|found| events.emission(at, rays, found));
}

/// Finds the emission of the surfaces that the rays `emissive` hit.
#[inline(never)]
fn emissive_surfaces(
    at: &WaveContext,
    emissive: &[u32],
    rays: &PathRays,
    hits: &HitBatch,
    non_finite: &mut NonFiniteSamples,
    found: &mut Vec<FoundEmission>,
) {
    let transport = at.transport;
    let emission = |ray: usize, radiance: Vec3, pdf: f32| {
        let kind = LightKind::Area;
        let layer = transport.layer(kind, |layers| layers.hit(hits.primitive(ray)));
        FoundEmission { ray: ray as u32, radiance, pdf: [0.0, pdf], kind, layer }
    };
    for ray in emissive.iter().map(|&ray| ray as usize) {
        let history = rays.history(ray);
        let point = transport.point(&rays.rays, hits, ray);
        if point.material.unlit {
            // It is seen, but gives no light.
            if at.depth > 0 && !history.is_mirror_image() {
                continue;
            }
            found.extend(weighted(emission(ray, point.base_color(transport.scene), 0.0), at, rays, non_finite));
            continue;
        }
        let direction = rays.rays.direction(ray);
        if point.emits_against(direction) && !history.is_refracted() {
            let hit = hits.primitive(ray);
            let radiance = point.emitted_radiance(transport.scene, direction);
            let from = (rays.rays.origin(ray), rays.normal.get(ray));
            let when = (transport.scene, rays.rays.time(ray));
            let pdf = match at.depth {
                0 => 0.0,
                _ => transport.lights.area_pdf(when, from, hit, direction, hits.t[ray], &transport.proposal.lights),
            };
            found.extend(weighted(emission(ray, radiance, pdf), at, rays, non_finite));
        }
    }
}

/// Finds the environment radiance along the rays `escaped`, which hit nothing.
#[inline(never)]
fn environment(
    at: &WaveContext,
    escaped: &[u32],
    rays: &PathRays,
    non_finite: &mut NonFiniteSamples,
    found: &mut Vec<FoundEmission>,
) {
    let WaveContext { transport, depth, .. } = *at;
    // Seen through glass, the environment is visible.
    let hidden = depth == 0 && transport.hides_environment;
    if transport.lights.environment.is_none() || (hidden && rays.passed_wall.is_empty()) {
        return;
    }
    let kind = LightKind::Environment;
    let layer = transport.layer(kind, |layers| layers.environment);
    for first in (0..escaped.len()).step_by(LANES) {
        let (rows, n) = eight_of(escaped, first);
        let (radiance, pdf) = transport.lights.environment(rays.rays.directions(&rows), &transport.proposal.lights);
        for lane in 0..n {
            let row = escaped[first + lane];
            let ray = row as usize;
            if rays.history(ray).is_refracted() || (hidden && !rays.passed_wall[ray]) {
                continue;
            }
            let pdf = if depth == 0 { 0.0 } else { pdf.as_array()[lane] };
            let emission = FoundEmission { ray: row, radiance: radiance.lane(lane), pdf: [pdf, 0.0], kind, layer };
            found.extend(weighted(emission, at, rays, non_finite));
        }
    }
}

/// What emission at the end of a ray adds to the ray's path, weighted against light samples by MIS and clamped; `None` if that is
/// nothing.
#[inline]
fn weighted(
    found: FoundEmission,
    at: &WaveContext,
    rays: &PathRays,
    non_finite: &mut NonFiniteSamples,
) -> Option<FoundEmission> {
    let ray = found.ray as usize;
    let radiance = rays.beta.get(ray) * found.radiance * mis_weight(at, rays, ray, found.pdf);
    if !radiance.is_finite() {
        non_finite.add(rays.path[ray]);
        return None;
    }
    if radiance == Vec3::ZERO {
        return None;
    }
    let (radiance, _) = clamp_contribution(radiance, limit(at));
    Some(FoundEmission { radiance, ..found })
}

/// The clamp of emission that rays find.
pub fn limit(at: &WaveContext) -> f32 {
    if at.depth == 0 { f32::INFINITY } else { at.transport.limits[(at.depth > 1) as usize] }
}

/// The MIS weight of emission at the end of a ray against light samples with these densities per solid angle: environment, area
/// lights.
#[inline]
pub(crate) fn mis_weight(at: &WaveContext, rays: &PathRays, ray: usize, pdf: [f32; 2]) -> f32 {
    let weighted_light = weighted_light_pdf(at, rays, ray, pdf);
    match weighted_light > 0.0 {
        true => at.transport.heuristic.weight(rays.weighted_pdf[ray], weighted_light),
        false => 1.0,
    }
}

/// Density of light samples in the direction of a ray, times their number per path.
#[inline]
pub(crate) fn weighted_light_pdf(at: &WaveContext, rays: &PathRays, ray: usize, pdf: [f32; 2]) -> f32 {
    let WaveContext { transport, depth, .. } = *at;
    let [a_env, a_area, _] = match depth {
        1 => at.paths[rays.path[ray] as usize].samples_per_path,
        _ => transport.deeper_samples_per_path(),
    };
    // At first surfaces, light samples are not subject to roulette.
    let has_roulette = depth > 1 && transport.proposal.has_roulette();
    let probability = if has_roulette { rays.light_probability[ray] } else { 1.0 };
    probability * (a_env * pdf[0] + a_area * pdf[1])
}
