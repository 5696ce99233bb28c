//! Light sampling: shadow rays that carry what they bring if nothing is in their way.

use wide::bytemuck::cast;

use super::mixture::Mixture;
use super::requests::{AREA_SEQUENCE, RequestGroup, Requests, Toward, one_each, toward_environment};
use super::{light_set, media, observations};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::Transport;
use crate::integrator::path_states::{Faults, PathStates};
use crate::integrator::queues::{Observation, PUNCTUAL, ShadowRays};
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, Survivors, U, V3, load, mask};
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
    path_states: &mut PathStates,
    observed: bool,
    shadows: &mut ShadowRays,
) {
    let punctual = if transport.lights.punctual { vertices.len() } else { 0 };
    let learns = path_states.light_sample_records.is_some();
    shadows.open(requests.count() + punctual, vertices.moves(), observed && depth == 0, learns);
    if transport.lights.has_extent() {
        for at in (0..requests.count()).step_by(LANES) {
            let group = requests.group(transport, vertices, path_states, at);
            match vertices.core() {
                Some(columns) => {
                    with_extent(
                        transport,
                        depth,
                        vertices,
                        &Core::load(columns, &group.rows),
                        &group,
                        path_states,
                        shadows,
                    );
                }
                None => {
                    with_extent(transport, depth, vertices, &vertices.bsdf(&group.rows), &group, path_states, shadows);
                }
            }
        }
    }
    for at in (0..punctual).step_by(LANES) {
        without_extent(
            transport,
            depth,
            vertices,
            &one_each(transport, vertices, at),
            &mut path_states.faults,
            shadows,
        );
    }
    shadows.close();
}

/// Samples of lights that MIS weighs.
#[inline(never)]
fn with_extent(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    group: &RequestGroup,
    path_states: &mut PathStates,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&group.rows, &group.identity);
    let [choice, u, v, _] = samples(id.seed, id.index, light_set(depth));
    let both = bsdf.transmits();
    let [a_env, a_area, a_b] = group.rates;
    let (toward_environment, choice) = toward_environment(transport, group.toward, choice);
    let from = (vertices.origin.load(rows), vertices.facing(rows, both));
    let drawing = (toward_environment, transport.drawing);
    let light = transport.lights.sample((transport.scene, id.time), from, drawing, [choice, u, v]);
    let (value, mut bsdf_pdf) = bsdf.eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
    if let Some(mixture) = Mixture::at(transport, vertices, rows) {
        bsdf_pdf = mixture.pdf(light.wi, bsdf_pdf);
    }
    let leaving = vertices.leave(rows, both, light.wi);
    let weighted_pdf = toward_environment.select(a_env, a_area) * light.pdf;
    let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
    let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
    let radiance = media::dimmed(transport, radiance, vertices.media(rows, leaving.beyond), light.distance);
    let there = mask(group.len) & light.pdf.simd_gt(F::ZERO) & leaving.allowed;
    let finite = radiance.is_finite();
    path_states.faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let alive = there & radiance.max_element().simd_gt(F::ZERO) & finite;
    let observation = || {
        let a_l = a_env + a_area;
        let (w, r) = observations(radiance, weighted_pdf / a_l, bsdf_pdf, a_l / (a_l + a_b));
        let index = id.index & U::splat(!AREA_SEQUENCE);
        Observation { index, area: group.toward.simd_eq(U::splat(Toward::AreaLight as u32)), w, r }
    };
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = light.distance * F::splat(SHADOW_END);
    let kind: U = cast(!toward_environment & cast::<U, F>(U::ONE));
    let (ray, whose) = ((leaving.origin, light.wi), [id.path, id.sub_path, kind]);
    let survivors = Survivors::of(alive);
    if path_states.light_sample_records.is_some() {
        let toward_area = (mask(group.len) & !toward_environment).to_bitmask();
        shadows.set_records(&survivors, path_states.light_sample_record(toward_area, from, light.emitter, id.path));
    }
    shadows.push(&survivors, ray, tfar, (key, id.time), radiance, whose, observation);
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
        let (choice, time) = (choice.as_array()[lane], id.time.as_array()[lane]);
        punctual::sample(&transport.scene.lights, position.lane(lane), choice, time).unwrap_or(punctual::DARK)
    });
    let wi = V3::gather(lights.map(|l| l.wi));
    let bsdf = vertices.bsdf(rows);
    let (value, _) = bsdf.eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), wi);
    let leaving = vertices.leave(rows, bsdf.transmits(), wi);
    let radiance = vertices.beta.load(rows) * value * V3::gather(lights.map(|l| l.irradiance));
    let distance = F::from(lights.map(|l| l.distance));
    let radiance = media::dimmed(transport, radiance, vertices.media(rows, leaving.beyond), distance);
    let (there, finite) = (mask(group.len) & leaving.allowed, radiance.is_finite());
    faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let alive = there & radiance.max_element().simd_gt(F::ZERO) & finite;
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = F::from(lights.map(|l| l.distance * SHADOW_END));
    let nothing = || Observation { index: U::ZERO, area: U::ZERO, w: F::ZERO, r: F::ZERO };
    let whose = [id.path, id.sub_path, U::splat(PUNCTUAL)];
    shadows.push(&Survivors::of(alive), (leaving.origin, wi), tfar, (key, id.time), radiance, whose, nothing);
}
