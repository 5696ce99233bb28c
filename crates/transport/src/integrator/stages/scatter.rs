//! BSDF sampling: the next rays.

use super::mixture::{self, Mixture, MixtureSample};
use super::requests::Requests;
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions;
use crate::integrator::data::history::{Bounces, MIRROR_PDF, RayHistory};
use crate::integrator::data::path_states::NonFiniteSamples;
use crate::integrator::data::queues::{PathIds, PathRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{PathEvents, ScatteredPacket};
use crate::lanes::{F, LANES, NUMBERS, Survivors, U, grow, mask, store, store_bits};
use crate::sampling::{keys, samples};

/// Russian roulette begins after this many path segments.
pub const ROULETTE_DEPTH: u32 = 3;
/// Survival probability is this times the largest throughput channel, at most 1. Over 2, which was used before, 6 leaves 0.84 of
/// relMSE × CPU seconds in seven scenes; 4 and 8 are within noise of it, 1 and no roulette worse (lab/notes/throughput.md).
pub const ROULETTE_GAIN: f32 = 6.0;

/// Fills the next rays from the vertices. `first_ray` is the number in the wave of the first one.
pub fn sample<E: PathEvents>(
    at: &WaveContext,
    vertices: &Vertices,
    requests: &Requests,
    non_finite: &mut NonFiniteSamples,
    (first_ray, next): (u32, &mut PathRays),
    events: &mut E,
) {
    next.open(requests.count(), at.transport.geometry.moves, first_ray);
    if vertices.media.is_some() {
        grow(&mut next.medium, requests.count());
    }
    if vertices.guiding.is_some() {
        grow(&mut next.light_probability, requests.count());
    }
    for first in (0..requests.count()).step_by(LANES) {
        let packet = requests.packet(at.transport, vertices, at.paths, first);
        let samples = sample_packet(at, vertices, &packet, non_finite, next);
        events.scattered(at, vertices, &packet, &samples);
    }
    next.close();
}

/// [`one_packet`] with the BSDFs of the packet's vertices.
#[inline(never)]
fn sample_packet(
    at: &WaveContext,
    vertices: &Vertices,
    packet: &RequestPacket,
    non_finite: &mut NonFiniteSamples,
    next: &mut PathRays,
) -> ScatteredPacket {
    match vertices.core() {
        Some(columns) => one_packet(at, vertices, &Core::load(columns, &packet.rows), packet, non_finite, next),
        None => one_packet(at, vertices, &vertices.bsdf(&packet.rows), packet, non_finite, next),
    }
}

#[inline(never)]
fn one_packet(
    at: &WaveContext,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    packet: &RequestPacket,
    non_finite: &mut NonFiniteSamples,
    next: &mut PathRays,
) -> ScatteredPacket {
    let WaveContext { transport, depth, .. } = *at;
    let (rows, id) = (&packet.rows, &packet.path_ids);
    let [lobe, u, v, survive] = samples(id.seed, id.index, dimensions::bsdf(depth));
    let transmits = bsdf.transmits();
    let (ns, wo) = (vertices.ns.load(rows), vertices.wo.load(rows));
    let mixture = Mixture::at(transport, vertices, rows);
    let MixtureSample { sample, pdfs } = mixture::sample(mixture.as_ref(), bsdf, ns, wo, [lobe, u, v]);
    let weighted_pdf = packet.samples_per_path[2] * sample.pdf;
    let spawned = vertices.spawn_rays(rows, transmits, sample.wi);
    let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
    let valid = mask(packet.len) & sample.pdf.simd_gt(F::ZERO) & spawned.allowed;
    let finite = beta.is_finite();
    non_finite.add_lanes((valid & !finite).to_bitmask(), id.path);
    let (mut alive, mut ended) = (valid & beta.max_element().simd_gt(F::ZERO) & finite, F::ZERO);
    let roulette = vertices.roulette(transport, rows).filter(|_| depth > 0);
    let keep = match roulette {
        Some([_, on]) => Some(on),
        None if depth + 1 < ROULETTE_DEPTH => None,
        None => Some((beta.max_element() * F::splat(ROULETTE_GAIN)).fast_min(F::ONE)),
    };
    if let Some(keep) = keep {
        let survives = keep.simd_gt(survive);
        (alive, ended) = (alive & survives, alive & !survives);
        beta = beta * keep.simd_ge(F::ONE).select(F::ONE, F::ONE / keep);
    }
    let survivors = Survivors::of(alive);
    let (path, index) = (survivors.compress_bits(id.path), survivors.compress_bits(id.index));
    if let Some([light, _]) = roulette {
        store(&mut next.light_probability, next.len, survivors.compress(light));
    }
    let (seed, time) = (survivors.compress_bits(id.seed), survivors.compress(id.time));
    let root = if depth == 0 { U::splat(packet.first as u32) + U::from(NUMBERS) } else { id.root };
    let mut bounces = Bounces { pdf: sample.pdf, bsdf_pdf: pdfs[0], beyond: spawned.beyond, smooth: F::ZERO };
    if transport.materials.has_smooth_bodies && (sample.pdf.simd_ge(F::splat(MIRROR_PDF)) | spawned.beyond).any() {
        bounces.smooth = vertices.is_smooth_glass(rows, bsdf);
    }
    let history = survivors.compress_bits(RayHistory::after(id.history, transport, &bounces));
    let path_ids = PathIds { path, index, seed, time, root: survivors.compress_bits(root), history };
    let ray = (survivors.compress_v3(spawned.origin), survivors.compress_v3(sample.wi));
    let key = survivors.compress_bits(keys(id.seed, id.index, dimensions::bsdf(depth)));
    let (beta, normal) =
        (survivors.compress_v3(beta), survivors.compress_v3(vertices.light_sampling_normals(rows, transmits)));
    if let Some(medium) = vertices.media(rows, spawned.beyond) {
        store_bits(&mut next.medium, next.len, survivors.compress_bits(medium));
    }
    let first_ray = next.first + next.len as u32;
    next.push(survivors.len, ray, key, beta, normal, survivors.compress(weighted_pdf), path_ids);
    let roulette = [roulette.map_or(F::ONE, |[light, _]| light), keep.unwrap_or(F::ONE)];
    let pdf = [sample.pdf, pdfs[0], pdfs[1]];
    ScatteredPacket { survivors, first_ray, wi: sample.wi, pdf, roulette, ended }
}
