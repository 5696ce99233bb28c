//! BSDF sampling: the next rays.

use glam::Vec3;

use super::bsdf_set;
use super::mixture::{Mixture, MixtureSample};
use super::requests::{RequestGroup, Requests};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::path_states::{NO_PARENT, PathStates, ScatterRecord, SubPath};
use crate::integrator::queues::{PathIds, PathRays};
use crate::integrator::transport::Transport;
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, NUMBERS, Rows, Survivors, U, V3, grow, load_bits, mask, store, store_bits};
use crate::sampling::{keys, samples};

/// Russian roulette begins after this many path segments.
pub const ROULETTE_DEPTH: u32 = 3;
/// Survival probability is this times the largest throughput channel, at most 1. In relMSE × seconds on a diffuse room, 1 (the
/// usual choice) is a third worse than 2, and 3 is no better.
pub const ROULETTE_GAIN: f32 = 2.0;

/// Fills the next rays from the vertices at `depth`. Rays from first surfaces begin sub-paths.
pub fn sample(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    requests: &Requests,
    path_states: &mut PathStates,
    next: &mut PathRays,
) {
    next.open(requests.count(), vertices.moves());
    if vertices.media.is_some() {
        grow(&mut next.medium, requests.count());
    }
    if vertices.guiding.is_some() {
        grow(&mut next.light_probability, requests.count());
    }
    for at in (0..requests.count()).step_by(LANES) {
        let group = requests.group(transport, vertices, path_states, at);
        match vertices.core() {
            Some(columns) => {
                one_group(transport, depth, vertices, &Core::load(columns, &group.rows), &group, path_states, next)
            }
            None => one_group(transport, depth, vertices, &vertices.bsdf(&group.rows), &group, path_states, next),
        }
    }
    next.close();
}

#[inline(never)]
fn one_group(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    bsdf: &impl Lobe,
    group: &RequestGroup,
    path_states: &mut PathStates,
    next: &mut PathRays,
) {
    let (rows, id) = (&group.rows, &group.path_ids);
    let [lobe, u, v, survive] = samples(id.seed, id.index, bsdf_set(depth));
    let transmits = bsdf.transmits();
    let (ns, wo) = (vertices.ns.load(rows), vertices.wo.load(rows));
    let mixture = Mixture::at(transport, vertices, rows);
    let MixtureSample { sample, pdfs } = match &mixture {
        Some(mixture) => mixture.sample(bsdf, ns, wo, [lobe, u, v]),
        None => MixtureSample::from_bsdf(bsdf.sample(ns, wo, [lobe, u, v])),
    };
    let weighted_pdf = group.samples_per_path[2] * sample.pdf;
    let spawned = vertices.spawn_rays(rows, transmits, sample.wi);
    let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
    let valid = mask(group.len) & sample.pdf.simd_gt(F::ZERO) & spawned.allowed;
    let finite = beta.is_finite();
    path_states.non_finite.add_lanes((valid & !finite).to_bitmask(), id.path);
    let mut alive = valid & beta.max_element().simd_gt(F::ZERO) & finite;
    let roulette = vertices.roulette(transport, rows).filter(|_| depth > 0);
    let keep = match roulette {
        Some([_, on]) => Some(on),
        None if depth + 1 < ROULETTE_DEPTH => None,
        None => Some((beta.max_element() * F::splat(ROULETTE_GAIN)).fast_min(F::ONE)),
    };
    if let Some(keep) = keep {
        alive &= keep.simd_gt(survive);
        beta = beta * keep.simd_ge(F::ONE).select(F::ONE, F::ONE / keep);
    }
    let survivors = Survivors::of(alive);
    let (path, index) = (survivors.compress_bits(id.path), survivors.compress_bits(id.index));
    let sub_path = if depth == 0 || path_states.scatter_records.is_some() {
        let first = path_states.sub_paths.len() as u32;
        let new = path.as_array()[..survivors.len].iter().zip(index.as_array());
        path_states.sub_paths.extend(new.map(|(&path, &index)| SubPath { path, index, indirect: Vec3::ZERO }));
        U::splat(first) + U::from(NUMBERS)
    } else {
        survivors.compress_bits(id.sub_path)
    };
    if let Some(scatter_records) = &mut path_states.scatter_records {
        let pdfs = [sample.pdf, pdfs[0], pdfs[1]];
        let roulette = [roulette.map_or(F::ONE, |[light, _]| light), keep.unwrap_or(F::ONE)];
        push_scatter_records(
            depth,
            vertices,
            rows,
            &survivors,
            sample.wi,
            (pdfs, roulette),
            id.sub_path,
            scatter_records,
        );
    }
    if let Some([light, _]) = roulette {
        store(&mut next.light_probability, next.len, survivors.compress(light));
    }
    let (seed, time) = (survivors.compress_bits(id.seed), survivors.compress(id.time));
    let path_ids = PathIds { path, index, sub_path, seed, time };
    let ray = (survivors.compress_v3(spawned.origin), survivors.compress_v3(sample.wi));
    let key = survivors.compress_bits(keys(id.seed, id.index, bsdf_set(depth)));
    let (beta, normal) =
        (survivors.compress_v3(beta), survivors.compress_v3(vertices.light_sampling_normals(rows, transmits)));
    if let Some(medium) = vertices.media(rows, spawned.beyond) {
        store_bits(&mut next.medium, next.len, survivors.compress_bits(medium));
    }
    next.push(survivors.len, ray, key, beta, normal, survivors.compress(weighted_pdf), path_ids);
}

/// Appends the scatter records of the survivors of a group.
#[inline(never)]
#[allow(clippy::too_many_arguments, reason = "a group's columns")]
fn push_scatter_records(
    depth: u32,
    vertices: &Vertices,
    rows: &Rows,
    survivors: &Survivors,
    wi: V3,
    (pdfs, roulette): ([F; 3], [F; 2]),
    parent: U,
    scatter_records: &mut Vec<ScatterRecord>,
) {
    let Some(guiding) = &vertices.guiding else { return };
    let [position, normal, wi] =
        [vertices.origin.load(rows), vertices.ng.load(rows), wi].map(|column| survivors.compress_v3(column));
    let beta = survivors.compress(vertices.beta.load(rows).luminance()).to_array();
    let diffuse = survivors.compress_bits(load_bits(&guiding.diffuse, rows)).to_array();
    let pdfs = pdfs.map(|pdf| survivors.compress(pdf).to_array());
    let roulette = roulette.map(|probability| survivors.compress(probability).to_array());
    let parent = survivors.compress_bits(parent).to_array();
    scatter_records.extend((0..survivors.len).map(|lane| ScatterRecord {
        parent: if depth == 0 { NO_PARENT } else { parent[lane] },
        position: position.lane(lane),
        normal: normal.lane(lane),
        wi: wi.lane(lane),
        beta: beta[lane],
        diffuse: diffuse[lane] == 1,
        light: 0.0,
        roulette: roulette.map(|probability| probability[lane]),
        pdf: pdfs.map(|pdf| pdf[lane]),
    }));
}
