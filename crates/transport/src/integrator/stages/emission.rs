//! Emission at the end of rays: emissive surfaces and the environment, with MIS weights.

use glam::Vec3;

use super::{contribution_terms, eight_of, surfaces};
use crate::balance::{Contribution, Technique};
use crate::integrator::batch::PixelBatch;
use crate::integrator::path_states::{PathStates, clamp_contribution};
use crate::integrator::queues::PathRays;
use crate::integrator::transport::Transport;
use crate::lanes::LANES;
use crate::rays::HitBatch;

/// Adds the emission of the surfaces that the rays `emissive` hit.
#[inline(never)]
pub fn surfaces(
    transport: &Transport,
    depth: u32,
    emissive: &[u32],
    rays: &PathRays,
    hits: &HitBatch,
    path_states: &mut PathStates,
    batch: &mut PixelBatch,
) {
    for ray in emissive.iter().map(|&ray| ray as usize) {
        let point = surfaces::point(transport, rays, hits, ray);
        if point.material.unlit {
            let emission = Emission { radiance: point.base_color(transport.scene), pdf: [0.0; 2], group: 1 };
            add_emission(transport, depth, ray, emission, rays, path_states, batch);
            continue;
        }
        let direction = rays.rays.direction(ray);
        if point.emits_against(direction) {
            let hit = (hits.instance[ray], hits.mesh[ray], hits.prim[ray]);
            let radiance = point.emitted_radiance(transport.scene, hit.2, (hits.u[ray], hits.v[ray]), direction);
            let from = (rays.rays.origin(ray), rays.normal.get(ray));
            let at = (transport.scene, rays.rays.time(ray));
            let pdf = match depth {
                0 => 0.0,
                _ if has_passed(rays, ray) => 0.0,
                _ => transport.lights.area_pdf(at, from, hit, direction, hits.t[ray], transport.drawing),
            };
            add_emission(
                transport,
                depth,
                ray,
                Emission { radiance, pdf: [0.0, pdf], group: 1 },
                rays,
                path_states,
                batch,
            );
        }
    }
}

/// Adds the environment radiance along the rays `escaped`, which hit nothing.
#[inline(never)]
pub fn environment(
    transport: &Transport,
    depth: u32,
    escaped: &[u32],
    rays: &PathRays,
    path_states: &mut PathStates,
    batch: &mut PixelBatch,
) {
    if transport.lights.environment.is_none() || (depth == 0 && transport.hides_environment) {
        return;
    }
    for at in (0..escaped.len()).step_by(LANES) {
        let (rows, n) = eight_of(escaped, at);
        let (radiance, pdf) = transport.lights.environment(rays.rays.directions(&rows), transport.drawing);
        for lane in 0..n {
            let passed = has_passed(rays, escaped[at + lane] as usize);
            let pdf = if depth == 0 || passed { 0.0 } else { pdf.as_array()[lane] };
            let emission = Emission { radiance: radiance.lane(lane), pdf: [pdf, 0.0], group: 0 };
            add_emission(transport, depth, escaped[at + lane] as usize, emission, rays, path_states, batch);
        }
    }
}

/// Has the ray passed a back face ([`back_faces`](crate::integrator::back_faces))? Shadow rays do not: no light sample has its
/// direction.
fn has_passed(rays: &PathRays, ray: usize) -> bool {
    rays.rays.tnear[ray] > 0.0
}

/// Emission that a ray hits.
struct Emission {
    radiance: Vec3,
    /// Densities per solid angle of light samples in this direction: environment, area lights. One of them is zero.
    pdf: [f32; 2],
    /// Light group of [`ExtraSums::add_light`](crate::film::ExtraSums::add_light).
    group: usize,
}

/// Adds emission to the path, weighted against light samples by MIS.
#[inline]
fn add_emission(
    transport: &Transport,
    depth: u32,
    ray: usize,
    light: Emission,
    rays: &PathRays,
    path_states: &mut PathStates,
    batch: &mut PixelBatch,
) {
    let path = &mut path_states.paths[rays.path[ray] as usize];
    let weighted_pdf = rays.weighted_pdf[ray];
    let [a_env, a_area, a_b] = if depth == 1 { path.samples_per_path } else { transport.deeper_samples_per_path() };
    // At first surfaces, light samples are not subject to roulette.
    let has_roulette = depth > 1 && transport.has_roulette();
    let probability = if has_roulette { rays.light_probability[ray] } else { 1.0 };
    let weighted_light = probability * (a_env * light.pdf[0] + a_area * light.pdf[1]);
    let weight = if weighted_light > 0.0 { transport.heuristic.weight(weighted_pdf, weighted_light) } else { 1.0 };
    let radiance = rays.beta.get(ray) * light.radiance * weight;
    if !radiance.is_finite() {
        path_states.non_finite.add(rays.path[ray]);
        return;
    }
    if radiance == Vec3::ZERO {
        return;
    }
    let radiance =
        if depth == 0 { radiance } else { clamp_contribution(radiance, transport.limits[(depth > 1) as usize]).0 };
    path.radiance += radiance;
    if let Some(extras) = batch.extras.get_mut(path.pixel as usize) {
        extras.add_light(light.group, radiance);
        if depth == 0 && light.group == 1 {
            extras.add_emission(radiance);
        }
    }
    if depth <= 1 {
        path.direct += radiance;
    }
    if depth > 1 || (depth == 1 && path_states.scatter_records.is_some()) {
        path_states.sub_paths[rays.sub_path[ray] as usize].indirect += radiance;
    }
    if depth == 1 && batch.observer.is_some() {
        let pixel = path.pixel as usize;
        let a_l = a_env + a_area;
        let (w, r) = contribution_terms(radiance, weighted_light / a_l, weighted_pdf / a_b, a_l / (a_l + a_b));
        let (index, area) = (rays.index[ray], batch.tasks[pixel].counts.environment.is_some() && light.pdf[1] > 0.0);
        batch.notify(pixel, Contribution { pixel: 0, technique: Technique::Bsdf, area, index, r, w, radiance });
    }
}
