//! BSDF sampling: the next rays.

use glam::Vec3;

use super::bsdf_set;
use super::requests::{RequestGroup, Requests};
use crate::bsdf::Lobe;
use crate::integrator::Transport;
use crate::integrator::ledger::{Branch, Ledger};
use crate::integrator::queues::{Identity, PathRays};
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, NUMBERS, Survivors, U, grow, mask, store_bits};
use crate::sampling::{keys, samples};

/// Segments after which Russian roulette begins.
pub const ROULETTE_DEPTH: u32 = 3;
/// A path survives with this times its throughput: by relMSE times seconds on a diffuse room, 1 (the rule of thumb) is a
/// third worse than 2, and 3 no better.
pub const ROULETTE_GAIN: f32 = 2.0;

/// Fills the next rays for the vertices at `depth`; those of first surfaces begin branches.
pub fn sample(
    transport: &Transport,
    depth: u32,
    vertices: &Vertices,
    requests: &Requests,
    ledger: &mut Ledger,
    next: &mut PathRays,
) {
    next.open(requests.count());
    if vertices.media.is_some() {
        grow(&mut next.medium, requests.count());
    }
    for at in (0..requests.count()).step_by(LANES) {
        let group = requests.group(transport, vertices, ledger, at);
        one_group(depth, vertices, &group, ledger, next);
    }
    next.close();
}

#[inline(never)]
fn one_group(depth: u32, vertices: &Vertices, group: &RequestGroup, ledger: &mut Ledger, next: &mut PathRays) {
    let (rows, id) = (&group.rows, &group.identity);
    let [lobe, u, v, survive] = samples(id.seed, id.index, bsdf_set(depth));
    let bsdf = vertices.bsdf(rows);
    let both = bsdf.transmits();
    let sample = bsdf.sample(vertices.ns.load(rows), vertices.wo.load(rows), [lobe, u, v]);
    let weighted_pdf = group.rates[2] * sample.pdf;
    let leaving = vertices.leave(rows, both, sample.wi);
    let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
    let there = mask(group.len) & sample.pdf.simd_gt(F::ZERO) & leaving.allowed;
    let finite = beta.is_finite();
    ledger.faults.add_lanes((there & !finite).to_bitmask(), id.path);
    let mut alive = there & beta.max_element().simd_gt(F::ZERO) & finite;
    if depth + 1 >= ROULETTE_DEPTH {
        let keep = (beta.max_element() * F::splat(ROULETTE_GAIN)).fast_min(F::ONE);
        alive &= keep.simd_gt(survive);
        beta = beta * keep.simd_ge(F::ONE).select(F::ONE, F::ONE / keep);
    }
    let survivors = Survivors::of(alive);
    let (path, index) = (survivors.compress_bits(id.path), survivors.compress_bits(id.index));
    let branch = if depth == 0 {
        let first = ledger.branches.len() as u32;
        let new = path.as_array()[..survivors.len].iter().zip(index.as_array());
        ledger.branches.extend(new.map(|(&path, &index)| Branch { path, index, indirect: Vec3::ZERO }));
        U::splat(first) + U::from(NUMBERS)
    } else {
        survivors.compress_bits(id.branch)
    };
    let identity = Identity { path, index, branch, seed: survivors.compress_bits(id.seed) };
    let ray = (survivors.compress_v3(leaving.origin), survivors.compress_v3(sample.wi));
    let key = survivors.compress_bits(keys(id.seed, id.index, bsdf_set(depth)));
    let (beta, normal) = (survivors.compress_v3(beta), survivors.compress_v3(vertices.facing(rows, both)));
    if let Some(medium) = vertices.media(rows, leaving.beyond) {
        store_bits(&mut next.medium, next.len, survivors.compress_bits(medium));
    }
    next.push(survivors.len, ray, key, beta, normal, survivors.compress(weighted_pdf), identity);
}
