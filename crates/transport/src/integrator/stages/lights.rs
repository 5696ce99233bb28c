//! Light sampling: shadow rays with their contributions.

use wide::bytemuck::cast;

use super::mixture::Mixture;
use super::requests::{AREA_SEQUENCE, LightTarget, RequestGroup, Requests, one_per_vertex, select_environment};
use super::{contribution_terms_wide, light_set, media};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::path_states::{NonFiniteSamples, PathStates};
use crate::integrator::queues::{ContributionTerms, PUNCTUAL_GROUP, ShadowRays};
use crate::integrator::transport::Transport;
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, Survivors, U, V3, load, mask};
use crate::light::punctual;
use crate::sampling::{hashes, keys, samples};

/// Length of shadow rays relative to the distance of the light.
pub const SHADOW_END: f32 = 1.0 - 1e-4;

/// Fills the shadow rays of the vertices at `depth`: the light samples of `requests` (environment and area lights), and one
/// sample of the punctual lights per vertex. `observed`: are contributions at first surfaces reported to an observer?
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
                    sample_extended(
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
                    sample_extended(
                        transport,
                        depth,
                        vertices,
                        &vertices.bsdf(&group.rows),
                        &group,
                        path_states,
                        shadows,
                    );
                }
            }
        }
    }
    for at in (0..punctual).step_by(LANES) {
        sample_punctual(
            transport,
            depth,
            vertices,
            &one_per_vertex(transport, vertices, at),
            &mut path_states.non_finite,
            shadows,
        );
    }
    shadows.close();
}

/// Eight samples of the environment and of area lights, with MIS weights.
#[inline(never)]
fn sample_extended(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    group: &RequestGroup,
    path_states: &mut PathStates,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&group.rows, &group.path_ids);
    let [choice, u, v, _] = samples(id.seed, id.index, light_set(depth));
    let transmits = bsdf.transmits();
    let [a_env, a_area, a_b] = group.samples_per_path;
    let (is_environment, choice) = select_environment(transport, group.target, choice);
    let from = (vertices.origin.load(rows), vertices.light_sampling_normals(rows, transmits));
    let drawing = (is_environment, transport.drawing);
    let light = transport.lights.sample((transport.scene, id.time), from, drawing, [choice, u, v]);
    let (value, mut bsdf_pdf) = bsdf.eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
    if let Some(mixture) = Mixture::at(transport, vertices, rows) {
        bsdf_pdf = mixture.pdf(light.wi, bsdf_pdf);
    }
    let spawned = vertices.spawn_rays(rows, transmits, light.wi);
    let weighted_pdf = is_environment.select(a_env, a_area) * light.pdf;
    let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
    let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
    let radiance = media::attenuated(transport, radiance, vertices.media(rows, spawned.beyond), light.distance);
    let valid = mask(group.len) & light.pdf.simd_gt(F::ZERO) & spawned.allowed;
    let finite = radiance.is_finite();
    path_states.non_finite.add_lanes((valid & !finite).to_bitmask(), id.path);
    let alive = valid & radiance.max_element().simd_gt(F::ZERO) & finite;
    let contribution_terms = || {
        let a_l = a_env + a_area;
        let (w, r) = contribution_terms_wide(radiance, weighted_pdf / a_l, bsdf_pdf, a_l / (a_l + a_b));
        let index = id.index & U::splat(!AREA_SEQUENCE);
        ContributionTerms { index, area: group.target.simd_eq(U::splat(LightTarget::AreaLight as u32)), w, r }
    };
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = light.distance * F::splat(SHADOW_END);
    let kind: U = cast(!is_environment & cast::<U, F>(U::ONE));
    let (ray, ids) = ((spawned.origin, light.wi), [id.path, id.sub_path, kind]);
    let survivors = Survivors::of(alive);
    if path_states.light_sample_records.is_some() {
        let toward_area = (mask(group.len) & !is_environment).to_bitmask();
        shadows.set_records(&survivors, path_states.record_light_samples(toward_area, from, light.emitter, id.path));
    }
    shadows.push(&survivors, ray, tfar, (key, id.time), radiance, ids, contribution_terms);
}

/// One sample of the punctual lights for each of eight vertices. BSDF samples never hit them, so there is no MIS weight.
#[inline(never)]
fn sample_punctual(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    group: &RequestGroup,
    non_finite: &mut NonFiniteSamples,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&group.rows, &group.path_ids);
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
    let spawned = vertices.spawn_rays(rows, bsdf.transmits(), wi);
    let radiance = vertices.beta.load(rows) * value * V3::gather(lights.map(|l| l.irradiance));
    let distance = F::from(lights.map(|l| l.distance));
    let radiance = media::attenuated(transport, radiance, vertices.media(rows, spawned.beyond), distance);
    let (valid, finite) = (mask(group.len) & spawned.allowed, radiance.is_finite());
    non_finite.add_lanes((valid & !finite).to_bitmask(), id.path);
    let alive = valid & radiance.max_element().simd_gt(F::ZERO) & finite;
    let key = hashes(keys(id.seed, id.index, light_set(depth)));
    let tfar = F::from(lights.map(|l| l.distance * SHADOW_END));
    let nothing = || ContributionTerms { index: U::ZERO, area: U::ZERO, w: F::ZERO, r: F::ZERO };
    let ids = [id.path, id.sub_path, U::splat(PUNCTUAL_GROUP)];
    shadows.push(&Survivors::of(alive), (spawned.origin, wi), tfar, (key, id.time), radiance, ids, nothing);
}
