//! Light sampling: shadow rays with their contributions.

use wide::bytemuck::cast;

use super::media;
use super::mixture::Mixture;
use super::requests::{Requests, one_per_vertex, select_environment};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions;
use crate::integrator::data::path_states::{NonFiniteSamples, clamp_contribution};
use crate::integrator::data::queues::{LightKind, LightNumber, ShadowRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{LightSamplePacket, PathEvents, UnoccludedLight};
use crate::lanes::{F, LANES, Survivors, U, V3, load, load_bits, mask};
use crate::light::samples::SIZED;
use crate::light::{LightSampleContext, LightSamples, punctual};
use crate::sampling::{hashes, keys, samples};

/// Fills the shadow rays of the vertices: the light samples of `requests` (environment and area lights), and one sample of the
/// punctual lights per vertex.
pub fn sample<E: PathEvents>(
    at: &WaveContext,
    vertices: &Vertices,
    requests: &Requests,
    non_finite: &mut NonFiniteSamples,
    shadows: &mut ShadowRays,
    events: &mut E,
) {
    let WaveContext { transport, depth, .. } = *at;
    let punctual = if transport.lights.punctual { vertices.len() } else { 0 };
    shadows.open(transport, requests.count() + punctual);
    if transport.lights.has_extent() {
        for first in (0..requests.count()).step_by(LANES) {
            let packet = requests.packet(transport, vertices, at.paths, first);
            let samples = sample_packet(at, vertices, &packet, non_finite, shadows);
            events.light_samples(at, vertices, &packet, &samples);
        }
    }
    for first in (0..punctual).step_by(LANES) {
        let packet = one_per_vertex(transport, vertices, first);
        sample_punctual(transport, depth, vertices, &packet, non_finite, shadows);
    }
    shadows.close();
}

/// Tells `events` of the contributions of shadow rays that are not occluded, clamped.
pub fn unoccluded<E: PathEvents>(at: &WaveContext, shadows: &ShadowRays, events: &mut E) {
    let limit = at.transport.limits[(at.depth > 0) as usize];
    for (row, _) in shadows.occluded[..shadows.len].iter().enumerate().filter(|(_, occluded)| !**occluded) {
        let (radiance, scale) = clamp_contribution(shadows.radiance.get(row), limit);
        let scale = scale * shadows.through.get(row).copied().unwrap_or(1.0);
        events.unoccluded(at, shadows, &UnoccludedLight { row, radiance, scale });
    }
}

/// [`sample_extended`] with the BSDFs of the packet's vertices.
#[inline(never)]
fn sample_packet(
    at: &WaveContext,
    vertices: &Vertices,
    packet: &RequestPacket,
    non_finite: &mut NonFiniteSamples,
    shadows: &mut ShadowRays,
) -> LightSamplePacket {
    match vertices.core() {
        Some(columns) => sample_extended(at, vertices, &Core::load(columns, &packet.rows), packet, non_finite, shadows),
        None => sample_extended(at, vertices, &vertices.bsdf(&packet.rows), packet, non_finite, shadows),
    }
}

/// Eight samples of the environment and of area lights, with MIS weights.
#[inline(never)]
fn sample_extended(
    at: &WaveContext,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    packet: &RequestPacket,
    non_finite: &mut NonFiniteSamples,
    shadows: &mut ShadowRays,
) -> LightSamplePacket {
    let WaveContext { transport, depth, .. } = *at;
    let (rows, id) = (&packet.rows, &packet.path_ids);
    let [choice, u, v, _] = samples(id.seed, id.index, dimensions::light(depth));
    let [a_env, a_area, a_b] = packet.samples_per_path;
    let (is_environment, choice) = select_environment(transport, packet.target, choice);
    let transmits = bsdf.transmits();
    let (p, n) = (vertices.origin.load(rows), vertices.light_sampling_normals(rows, transmits));
    // Rays that cross the surface begin beyond it.
    let origin_error = transmits & (load(&vertices.origin_offset, rows) * F::splat(2.0));
    let context = LightSampleContext { scene: transport.scene, time: id.time, p, origin_error, n };
    let light = transport.lights.sample(&context, is_environment, &transport.proposal.lights, [choice, u, v]);
    let (value, own_pdf) = bsdf.eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
    let mut bsdf_pdf = own_pdf;
    if let Some(mixture) = Mixture::at(transport, vertices, rows) {
        bsdf_pdf = mixture.pdf(light.wi, bsdf_pdf);
    }
    let weighted_pdf = is_environment.select(a_env, a_area) * light.pdf;
    let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
    let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
    let [environment, area, sized] =
        [LightKind::Environment, LightKind::Area, LightKind::Sized].map(|kind| U::splat(kind as u32));
    let mut kind = cast::<F, U>(is_environment).select(environment, area);
    if transport.lights.sized.is_some() {
        kind = (U::from(light.emitter) & U::splat(SIZED)).simd_eq(U::splat(SIZED)).select(sized, kind);
    }
    let found = Found { number: numbers(kind, &light), light, radiance, bsdf_pdf, own_pdf };
    let (survivors, first_row, radiance) =
        push_shadow_rays(transport, depth, vertices, bsdf, packet, &found, (non_finite, shadows));
    let emitter = light.emitter;
    LightSamplePacket { survivors, first_row, is_environment, from: (p, n), emitter, weighted_pdf, bsdf_pdf, radiance }
}

/// One sample of the punctual lights for each of eight vertices. BSDF samples never hit them, so there is no MIS weight.
#[inline(never)]
fn sample_punctual(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    packet: &RequestPacket,
    non_finite: &mut NonFiniteSamples,
    shadows: &mut ShadowRays,
) {
    let (rows, id) = (&packet.rows, &packet.path_ids);
    let [.., choice] = samples(id.seed, id.index, dimensions::light(depth));
    let p = vertices.origin.load(rows) - vertices.ng.load(rows) * load(&vertices.origin_offset, rows);
    let context = LightSampleContext { scene: transport.scene, time: id.time, p, origin_error: F::ZERO, n: V3::ZERO };
    let light = punctual::sample(&context, &transport.proposal.lights, [choice, F::ZERO, F::ZERO]);
    let bsdf = vertices.bsdf(rows);
    let (value, bsdf_pdf) = bsdf.eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
    let radiance = vertices.beta.load(rows) * value * light.radiance;
    let number = numbers(U::splat(LightKind::Punctual as u32), &light);
    let found = Found { light, radiance, bsdf_pdf, own_pdf: bsdf_pdf, number };
    push_shadow_rays(transport, depth, vertices, &bsdf, packet, &found, (non_finite, shadows));
}

/// [`LightNumber`] of eight light samples of these kinds.
#[inline(always)]
fn numbers(kind: U, light: &LightSamples) -> U {
    kind | U::from(light.emitter) << LightNumber::BITS
}

/// Eight light samples, with the contribution of the light where nothing is in between.
struct Found {
    light: LightSamples,
    radiance: V3,
    bsdf_pdf: F,
    /// Density of the BSDF alone, without a guiding field.
    own_pdf: F,
    /// [`LightNumber`].
    number: U,
}

/// Pushes the shadow rays of eight light samples: those that survive, the row of the first of them, and their radiance after
/// the medium.
#[inline(always)]
fn push_shadow_rays(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    packet: &RequestPacket,
    found: &Found,
    (non_finite, shadows): (&mut NonFiniteSamples, &mut ShadowRays),
) -> (Survivors, usize, V3) {
    let (rows, id) = (&packet.rows, &packet.path_ids);
    let Found { light, bsdf_pdf, own_pdf, number, .. } = *found;
    let spawned = vertices.spawn_rays(rows, bsdf.transmits(), light.wi);
    let medium = vertices.media(rows, spawned.beyond);
    let bodies = vertices.shadow_policy(transport, rows, bsdf, bsdf_pdf, spawned.beyond);
    let radiance = match bodies {
        Some(_) => found.radiance,
        None => media::attenuated(transport, found.radiance, medium, light.distance),
    };
    let allowed = bodies.map_or(spawned.allowed, |bodies| spawned.allowed & !bodies.excluded);
    let valid = mask(packet.len) & light.pdf.simd_gt(F::ZERO) & allowed;
    let finite = radiance.is_finite();
    non_finite.add_lanes((valid & !finite).to_bitmask(), id.path);
    let alive = valid & radiance.max_element().simd_gt(F::ZERO) & finite;
    let key = hashes(keys(id.seed, id.index, dimensions::light(depth)));
    let (ray, ids) = ((spawned.origin, light.wi), [id.path, load_bits(&vertices.ray, rows), id.root, number]);
    let (survivors, first_row) = (Survivors::of(alive), shadows.len);
    if let Some(bodies) = bodies {
        shadows.set_bodies(&survivors, cast(bodies.passes), medium.unwrap_or(U::ZERO));
    }
    shadows.set_backs(&survivors, vertices.passes_backs(transport, rows, own_pdf));
    shadows.push(&survivors, ray, light.end, (key, id.time), radiance, ids);
    (survivors, first_row, radiance)
}
