//! Light sampling: shadow rays that carry what they bring if nothing is in their way.

use super::requests::{AREA_SEQUENCE, RequestGroup, Requests, Toward, one_each};
use super::{light_set, observations};
use crate::integrator::Transport;
use crate::integrator::ledger::{Faults, Ledger};
use crate::integrator::queues::{Observation, ShadowRays};
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, Survivors, U, V3, are, load, mask};
use crate::light::punctual;
use crate::sampling::{hashes, keys, samples};

/// Shadow rays toward a point end this share before it.
pub const SHADOW_END: f32 = 1.0 - 1e-4;

/// Fills the shadow rays for the vertices at `depth`: the samples of `requests` toward lights with extent, one a vertex
/// toward the others. `observed`: will somebody be told what those of first surfaces find?
pub fn sample(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    requests: &Requests,
    ledger: &mut Ledger,
    observed: bool,
    shadows: &mut ShadowRays,
) {
    let punctual = if transport.lights.punctual { vertices.len() } else { 0 };
    shadows.open(requests.count() + punctual, observed && depth == 0);
    if transport.lights.has_extent() {
        for at in (0..requests.count()).step_by(LANES) {
            let group = requests.group(transport, vertices, ledger, at);
            with_extent(transport, depth, vertices, &group, &mut ledger.faults, shadows);
        }
    }
    for at in (0..punctual).step_by(LANES) {
        without_extent(transport, depth, vertices, &one_each(transport, vertices, at), &mut ledger.faults, shadows);
    }
    shadows.close();
}

/// Samples of lights that MIS weighs.
#[inline(never)]
fn with_extent(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    group: &RequestGroup,
    faults: &mut Faults,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&group.rows, &group.identity);
    let [choice, u, v, _] = samples(id.seed, id.index, light_set(depth));
    let origin = vertices.origin.load(rows);
    let ng = vertices.ng.load(rows);
    let [a_env, a_area, a_b] = group.rates;
    let (drawn_environment, left) = transport.lights.draw_kind(choice);
    let draws = are(group.toward, Toward::Drawn as u32);
    let toward_environment = are(group.toward, Toward::Environment as u32) | (draws & drawn_environment);
    let choice = draws.select(left, choice);
    let light = transport.lights.sample(transport.scene, (origin, ng), toward_environment, choice, u, v);
    let (value, bsdf_pdf) = vertices.bsdf(rows).eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
    let weighted_pdf = toward_environment.select(a_env, a_area) * light.pdf;
    let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
    let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
    let there = mask(group.len) & light.pdf.simd_gt(F::ZERO) & ng.dot(light.wi).simd_gt(F::ZERO);
    let finite = radiance.is_finite();
    faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let alive = there & radiance.max_element().simd_gt(F::ZERO) & finite;
    let observation = || {
        let a_l = a_env + a_area;
        let (w, r) = observations(radiance, weighted_pdf / a_l, bsdf_pdf, a_l / (a_l + a_b));
        let index = id.index & U::splat(!AREA_SEQUENCE);
        Observation { index, area: group.toward.simd_eq(U::splat(Toward::AreaLight as u32)), w, r }
    };
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = light.distance * F::splat(SHADOW_END);
    let group = toward_environment.to_bitmask();
    let group = U::from(std::array::from_fn(|lane| u32::from(group >> lane & 1 == 0)));
    let whose = [id.path, id.branch, group];
    shadows.push(&Survivors::of(alive), (origin, light.wi), tfar, key, radiance, whose, observation);
}

/// One of the lights without size for each of eight vertices: nothing to weigh, nothing to learn.
#[inline(never)]
fn without_extent(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    group: &RequestGroup,
    faults: &mut Faults,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&group.rows, &group.identity);
    let [.., choice] = samples(id.seed, id.index, light_set(depth));
    let (origin, ng) = (vertices.origin.load(rows), vertices.ng.load(rows));
    let position = origin - ng * load(&vertices.origin_offset, rows);
    let lights: [_; LANES] = std::array::from_fn(|lane| {
        let choice = choice.as_array()[lane];
        punctual::sample(&transport.scene.lights, position.lane(lane), choice).unwrap_or(punctual::DARK)
    });
    let wi = V3::gather(lights.map(|l| l.wi));
    let (value, _) = vertices.bsdf(rows).eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), wi);
    let radiance = vertices.beta.load(rows) * value * V3::gather(lights.map(|l| l.irradiance));
    let (there, finite) = (mask(group.len) & ng.dot(wi).simd_gt(F::ZERO), radiance.is_finite());
    faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let alive = there & radiance.max_element().simd_gt(F::ZERO) & finite;
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = F::from(lights.map(|l| l.distance * SHADOW_END));
    let nothing = || Observation { index: U::ZERO, area: U::ZERO, w: F::ZERO, r: F::ZERO };
    let whose = [id.path, id.branch, U::splat(2)];
    shadows.push(&Survivors::of(alive), (origin, wi), tfar, key, radiance, whose, nothing);
}
