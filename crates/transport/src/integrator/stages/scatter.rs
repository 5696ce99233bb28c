//! BSDF sampling: the next rays.

use glam::Vec3;

use super::bsdf_set;
use super::mixture::{Drawn, Mixture};
use super::requests::{RequestGroup, Requests};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::Transport;
use crate::integrator::path_states::{CAMERA, PathStates, Step, SubPath};
use crate::integrator::queues::{Identity, PathRays};
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, NUMBERS, Rows, Survivors, U, V3, grow, load_bits, mask, store, store_bits};
use crate::sampling::{keys, samples};

/// Segments after which Russian roulette begins.
pub const ROULETTE_DEPTH: u32 = 3;
/// A path survives with this times its throughput: by relMSE times seconds on a diffuse room, 1 (the rule of thumb) is a
/// third worse than 2, and 3 no better.
pub const ROULETTE_GAIN: f32 = 2.0;

/// Fills the next rays for the vertices at `depth`; those of first surfaces begin sub-paths.
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
    if vertices.guided.is_some() {
        grow(&mut next.light_chance, requests.count());
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
    let (rows, id) = (&group.rows, &group.identity);
    let [lobe, u, v, survive] = samples(id.seed, id.index, bsdf_set(depth));
    let both = bsdf.transmits();
    let (ns, wo) = (vertices.ns.load(rows), vertices.wo.load(rows));
    let mixture = Mixture::at(transport, vertices, rows);
    let Drawn { sample, pdfs } = match &mixture {
        Some(mixture) => mixture.draw(bsdf, ns, wo, [lobe, u, v]),
        None => Drawn::of_bsdf(bsdf.sample(ns, wo, [lobe, u, v])),
    };
    let weighted_pdf = group.rates[2] * sample.pdf;
    let leaving = vertices.leave(rows, both, sample.wi);
    let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
    let there = mask(group.len) & sample.pdf.simd_gt(F::ZERO) & leaving.allowed;
    let finite = beta.is_finite();
    path_states.faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let mut alive = there & beta.max_element().simd_gt(F::ZERO) & finite;
    let chances = vertices.chances(transport, rows).filter(|_| depth > 0);
    let keep = match chances {
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
    let sub_path = if depth == 0 || path_states.steps.is_some() {
        let first = path_states.sub_paths.len() as u32;
        let new = path.as_array()[..survivors.len].iter().zip(index.as_array());
        path_states.sub_paths.extend(new.map(|(&path, &index)| SubPath { path, index, indirect: Vec3::ZERO }));
        U::splat(first) + U::from(NUMBERS)
    } else {
        survivors.compress_bits(id.sub_path)
    };
    if let Some(steps) = &mut path_states.steps {
        let pdfs = [sample.pdf, pdfs[0], pdfs[1]];
        let chances = [chances.map_or(F::ONE, |[light, _]| light), keep.unwrap_or(F::ONE)];
        push_steps(depth, vertices, rows, &survivors, sample.wi, (pdfs, chances), id.sub_path, steps);
    }
    if let Some([light, _]) = chances {
        store(&mut next.light_chance, next.len, survivors.compress(light));
    }
    let (seed, time) = (survivors.compress_bits(id.seed), survivors.compress(id.time));
    let identity = Identity { path, index, sub_path, seed, time };
    let ray = (survivors.compress_v3(leaving.origin), survivors.compress_v3(sample.wi));
    let key = survivors.compress_bits(keys(id.seed, id.index, bsdf_set(depth)));
    let (beta, normal) = (survivors.compress_v3(beta), survivors.compress_v3(vertices.facing(rows, both)));
    if let Some(medium) = vertices.media(rows, leaving.beyond) {
        store_bits(&mut next.medium, next.len, survivors.compress_bits(medium));
    }
    next.push(survivors.len, ray, key, beta, normal, survivors.compress(weighted_pdf), identity);
}

/// Keeps how the survivors of a group were drawn.
#[inline(never)]
#[allow(clippy::too_many_arguments, reason = "a group's columns")]
fn push_steps(
    depth: u32,
    vertices: &Vertices,
    rows: &Rows,
    survivors: &Survivors,
    wi: V3,
    (pdfs, chances): ([F; 3], [F; 2]),
    parent: U,
    steps: &mut Vec<Step>,
) {
    let Some(guided) = &vertices.guided else { return };
    let [position, normal, wi] =
        [vertices.origin.load(rows), vertices.ng.load(rows), wi].map(|column| survivors.compress_v3(column));
    let beta = survivors.compress(vertices.beta.load(rows).luminance()).to_array();
    let broad = survivors.compress_bits(load_bits(&guided.broad, rows)).to_array();
    let pdfs = pdfs.map(|pdf| survivors.compress(pdf).to_array());
    let chances = chances.map(|chance| survivors.compress(chance).to_array());
    let parent = survivors.compress_bits(parent).to_array();
    steps.extend((0..survivors.len).map(|lane| Step {
        parent: if depth == 0 { CAMERA } else { parent[lane] },
        position: position.lane(lane),
        normal: normal.lane(lane),
        wi: wi.lane(lane),
        beta: beta[lane],
        broad: broad[lane] == 1,
        light: 0.0,
        chances: chances.map(|chance| chance[lane]),
        pdf: pdfs.map(|pdf| pdf[lane]),
    }));
}
