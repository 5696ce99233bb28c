//! Pairs of first and second surfaces.
//!
//! A pair takes part if both surfaces are diffuse enough and opaque, if the path of x would go on in that direction (f is not
//! zero) and it is no mirror image, if the second surface is seen from its side and with a normal that need not be bent, and if
//! nothing lies in between. These are properties of the pair alone, whichever path has found it, so that the balance heuristic
//! may leave out the others.

use std::ops::Range;

use glam::Vec3;
use wide::bytemuck::cast;

use super::lenders::{DIRECTIONS, Find, FirstSample, Lender, NEXT, PUNCTUAL};
use super::pools::Pool;
use crate::bsdf::{Core, Lobe, MIN_ROUGH_ALPHA, Parameters};
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::history::MIRROR_PDF;
use crate::integrator::data::proposal::Reuse;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::stages::mixture::Mixture;
use crate::integrator::surface::shading_normal;
use crate::lanes::{F, LANES, Rows, Survivors, U, V3, V3Column, eight, grow, load_bits, mask, store};
use crate::rays::{RayBatch, RayOrder};

/// Pairs of a batch, at which it is evaluated.
const FULL: usize = 2048;
/// Maximum times eight members of a pool.
const MAX_BLOCKS: usize = Reuse::MAX_POOL as usize / LANES;

/// Albedo of sharp lobes, over that of rough ones, from which a second surface counts as sharp.
const MIN_SHARP: f32 = 0.1;

/// Masks of the vertices that may borrow light, on rough, opaque surfaces, in no medium that absorbs; and of those with sharp
/// lobes.
#[inline(never)]
fn are_rough(vertices: &Vertices, rows: &Rows) -> [F; 2] {
    fn masks(bsdf: &impl Lobe) -> [F; 2] {
        let [rough, sharp] = bsdf.albedos();
        [rough.simd_ge(sharp) & !bsdf.transmits(), sharp.simd_gt(rough * F::splat(MIN_SHARP))]
    }
    let [rough, sharp] = match vertices.core() {
        Some(columns) => masks(&Core::load(columns, rows)),
        None => masks(&vertices.bsdf(rows)),
    };
    let outside = vertices.media.as_ref().map(|[own, _]| cast::<U, F>(load_bits(own, rows).simd_eq(U::ZERO)));
    [outside.map_or(rough, |outside| rough & outside), sharp]
}

/// Mask of the directions that are no mirror images, by their densities: of the mixture with a guiding field, and of the BSDF.
/// Histories of rays ask for the first where shadow rays pass bodies of glass.
#[inline(always)]
pub fn is_rough(transport: &Transport, pdf: F, bsdf_pdf: F) -> F {
    let rough = bsdf_pdf.simd_lt(F::splat(MIRROR_PDF));
    if transport.passes_bodies() { rough & pdf.simd_lt(F::splat(MIRROR_PDF)) } else { rough }
}

/// Mask of the vertices that may borrow light.
pub fn borrows(vertices: &Vertices, rows: &Rows) -> F {
    are_rough(vertices, rows)[0]
}

/// Masks of the vertices that may lend light to the side of `wo`, and of those with sharp lobes.
#[inline(never)]
pub fn lends(vertices: &Vertices, rows: &Rows) -> [F; 2] {
    let (ng, ns, wo) = (vertices.ng.load(rows), vertices.ns.load(rows), vertices.wo.load(rows));
    let [rough, sharp] = are_rough(vertices, rows);
    [rough & shading_normal::is_clear(ng, ns, wo), sharp]
}

/// The pairs of a pool in the batch: its members and its lit lenders, as ranges of [`Pairs::members`] and [`Pairs::lenders`].
#[derive(Debug)]
struct Batch {
    members: Range<usize>,
    lenders: Range<usize>,
    pool: Pool,
}

/// Eight members of a pool at their first surfaces. All lenders of the pool meet them: they are gathered once.
struct Block<'a, B> {
    /// Mask of the lanes with a member.
    present: F,
    /// The lenders of their own paths.
    own: U,
    origin: V3,
    ng: V3,
    ns: V3,
    wo: V3,
    beta: V3,
    bsdf: B,
    mixture: Option<Mixture<'a>>,
}

/// A second surface, in eight equal lanes.
struct Second<'a, B> {
    lender: &'a Lender,
    index: u32,
    position: V3,
    ng: V3,
    ns: V3,
    bsdf: B,
}

/// The pairs of a batch. Those of a lender lie in consecutive rows, from a multiple of [`LANES`] on.
#[derive(Debug, Default)]
pub struct Pairs {
    batch: Vec<Batch>,
    members: Vec<u32>,
    lenders: Vec<u32>,
    /// Rows of the batch.
    rows: usize,
    /// Density in area measure with which x goes on to y and from there; zero where the pair takes no part.
    pdf: Vec<f32>,
    /// Density per solid angle of the directions at y, by [`Lender::mixture`]; without meaning for directions without light.
    bsdf_pdf: [Vec<f32>; DIRECTIONS],
    /// What x borrows of incident radiance from these directions, but for the divisor; as above.
    value: [V3Column; DIRECTIONS],
    /// Visibility rays, and their pairs.
    rays: RayBatch,
    pair_of: Vec<u32>,
    occluded: Vec<bool>,
    /// By sample, what it borrows, for a throughput of one, linear RGB.
    pub borrowed: Vec<Vec3>,
}

impl Pairs {
    /// Begins with nothing borrowed.
    pub fn begin(&mut self, samples: usize) {
        self.clear();
        self.borrowed.clear();
        self.borrowed.resize(samples, Vec3::ZERO);
    }

    fn clear(&mut self) {
        self.batch.clear();
        self.members.clear();
        self.lenders.clear();
        self.rows = 0;
    }

    /// Adds all pairs of a pool's `members` with those of the `lenders` that have something to lend.
    pub fn push(&mut self, pool: Pool, members: &[u32], lit: impl Iterator<Item = u32>) {
        let starts = [self.members.len(), self.lenders.len()];
        self.lenders.extend(lit);
        let lenders = starts[1]..self.lenders.len();
        if !lenders.is_empty() {
            self.members.extend(members);
            self.rows += lenders.len() * members.len().next_multiple_of(LANES);
            self.batch.push(Batch { members: starts[0]..self.members.len(), lenders, pool });
        }
    }

    /// Is it time to evaluate them?
    pub fn is_full(&self) -> bool {
        self.rows >= FULL
    }

    /// Evaluates and removes all pairs, and adds what is borrowed.
    pub fn evaluate(
        &mut self,
        transport: &Transport,
        vertices: &[Vertices; 2],
        samples: &[FirstSample],
        (lenders, finds): (&mut [Lender], &mut [Find]),
        counts: &mut WaveCounts,
    ) {
        let [.., samples_per_path] = transport.deeper_samples_per_path();
        grow(&mut self.pdf, self.rows);
        self.bsdf_pdf.iter_mut().for_each(|column| grow(column, self.rows));
        self.value.iter_mut().for_each(|column| column.grow(self.rows));
        self.rays.open(self.rows, false);
        self.pair_of.clear();
        let batch = std::mem::take(&mut self.batch);
        let [from, to] = vertices;
        let mut row = 0;
        for of_pool in &batch {
            let at = (transport, vertices, samples);
            let found = (&mut *lenders, &mut *finds);
            row = match (from.core(), to.core()) {
                (Some(x), Some(y)) => {
                    self.pool(at, found, of_pool, row, |rows| Core::load(x, rows), |rows| Core::load(y, rows))
                }
                _ => self.pool(at, found, of_pool, row, |rows| from.bsdf(rows), |rows| to.bsdf(rows)),
            };
        }
        self.batch = batch;
        let Self { batch, rays, pair_of, occluded, pdf, bsdf_pdf, value, borrowed, members, .. } = self;
        rays.close(pair_of.len());
        counts.shadow_rays += rays.len() as u64;
        counts.shared_rays += rays.len() as u64;
        timed(counts, || transport.rays.occluded(rays, RayOrder::Incoherent, occluded));
        pair_of
            .iter()
            .zip(&*occluded)
            .filter(|(_, occluded)| **occluded)
            .for_each(|(pair, _)| pdf[*pair as usize] = 0.0);
        let mut start = 0;
        for of_pool in &*batch {
            let members = &members[of_pool.members.clone()];
            for lender in &self.lenders[of_pool.lenders.clone()] {
                let lender = &lenders[*lender as usize];
                let rows = start..start + members.len();
                start = rows.start + members.len().next_multiple_of(LANES);
                let all: f32 = pdf[rows.clone()].iter().sum();
                let divisors: [f32; DIRECTIONS] = std::array::from_fn(|i| {
                    let terms = pdf[rows.clone()].iter().zip(&bsdf_pdf[i][rows.clone()]);
                    if i == PUNCTUAL { 0.0 } else { samples_per_path * terms.map(|(a, b)| a * b).sum::<f32>() }
                });
                let mut light = [Vec3::ZERO; DIRECTIONS];
                light[NEXT] = over(lender.beyond, divisors[NEXT]);
                for find in lender.finds(finds) {
                    light[find.direction] += over(find.radiance, find.light_pdf.mul_add(all, divisors[find.direction]));
                }
                for i in (0..DIRECTIONS).filter(|i| lender.directions[*i] != Vec3::ZERO) {
                    for (row, sample) in rows.clone().zip(members).filter(|(row, _)| pdf[*row] > 0.0) {
                        borrowed[*sample as usize] += value[i].get(row) * light[i];
                    }
                }
            }
        }
        self.clear();
    }

    /// Evaluates the pairs of a pool, whose first row is `row`; returns the row behind them.
    #[inline(never)]
    fn pool<B: Lobe>(
        &mut self,
        (transport, [from, to], samples): (&Transport, &[Vertices; 2], &[FirstSample]),
        (lenders, finds): (&mut [Lender], &mut [Find]),
        Batch { members, lenders: of_pool, pool }: &Batch,
        mut row: usize,
        first_bsdf: impl Fn(&Rows) -> B,
        second_bsdf: impl Fn(&Rows) -> B,
    ) -> usize {
        let members = &self.members[members.clone()];
        let [.., samples_per_path] = transport.deeper_samples_per_path();
        for lit in self.lenders[of_pool.clone()].chunks(LANES) {
            let lane_of = |lane: usize| lit[lane.min(lit.len() - 1)] as usize;
            let y = Rows::Each(eight(|lane| lenders[lane_of(lane)].y));
            let (ns, wo, bsdf) = (to.ns.load(&y), to.wo.load(&y), second_bsdf(&y));
            let mixture = Mixture::at(transport, to, &y);
            for i in 0..DIRECTIONS {
                let wi = V3::gather(eight(|lane| lenders[lane_of(lane)].directions[i]));
                let (all, _) = value(&bsdf, ns, wo, wi, F::ZERO);
                let (lent, pdf) = value(&bsdf, ns, wo, wi, F::splat(MIN_ROUGH_ALPHA));
                let parts = match &mixture {
                    _ if i == PUNCTUAL => [F::ZERO; 2],
                    Some(mixture) => mixture.parts(wi),
                    None => [F::ONE, F::ZERO],
                };
                let pdf = parts[0].mul_add(pdf, parts[1]) * F::splat(samples_per_path);
                for (lane, lender) in lit.iter().enumerate() {
                    let lender = &mut lenders[*lender as usize];
                    lender.mixture[i] = parts.map(|part| part.as_array()[lane]);
                    lender.weigh(finds, i, [all.lane(lane), lent.lane(lane)], pdf.as_array()[lane]);
                }
            }
        }
        let block = |i: usize| {
            let members = members.get(i * LANES..)?.chunks(LANES).next()?;
            let sample = eight(|lane| &samples[members[lane.min(members.len() - 1)] as usize]);
            let x = Rows::Each(sample.map(|sample| sample.x));
            Some(Block {
                present: mask(members.len()),
                own: sample.map(|sample| sample.lender).into(),
                origin: from.origin.load(&x),
                ng: from.ng.load(&x),
                ns: from.ns.load(&x),
                wo: from.wo.load(&x),
                beta: from.beta.load(&x),
                bsdf: first_bsdf(&x),
                mixture: Mixture::at(transport, from, &x),
            })
        };
        let blocks: [_; MAX_BLOCKS] = std::array::from_fn(block);
        for i in of_pool.clone() {
            let index = self.lenders[i];
            let lender = &lenders[index as usize];
            let y = Rows::Each([lender.y; LANES]);
            let (position, ng, ns) = (to.origin.load(&y), to.ng.load(&y), to.ns.load(&y));
            let second = Second { lender, index, position, ng, ns, bsdf: second_bsdf(&y) };
            for block in blocks.iter().flatten() {
                self.eight(transport, pool, block, &second, row);
                row += LANES;
            }
        }
        row
    }

    /// Evaluates eight pairs.
    #[inline(always)]
    fn eight<B: Lobe>(&mut self, transport: &Transport, pool: &Pool, x: &Block<B>, y: &Second<B>, row: usize) {
        let way = y.position - x.origin;
        let distance2 = way.length_squared();
        let wi = way.normalize_or(V3::ZERO);
        let (f, bsdf_pdf) = x.bsdf.eval_pdf(x.ns, x.wo, wi);
        let pdf = x.mixture.as_ref().map_or(bsdf_pdf, |mixture| mixture.pdf(wi, bsdf_pdf));
        let wo = wi * F::splat(-1.0);
        let cos_y = y.ng.dot(wo);
        let takes_part = x.present
            & distance2.simd_gt(F::ZERO)
            & x.ng.dot(wi).simd_gt(F::ZERO)
            & cos_y.simd_gt(F::ZERO)
            & pdf.simd_gt(F::ZERO)
            & (x.beta * f).max_element().simd_gt(F::ZERO)
            & is_rough(transport, pdf, bsdf_pdf)
            & shading_normal::is_clear(y.ng, y.ns, wo);
        let to_area = cos_y / distance2;
        let goes_on = pool.goes_on(distance2, y.lender.sharp);
        store(&mut self.pdf, row, takes_part & (pdf * to_area * goes_on));
        let weight = f * to_area;
        for i in (0..DIRECTIONS).filter(|i| y.lender.directions[*i] != Vec3::ZERO) {
            let (lent, pdf) = value(&y.bsdf, y.ns, wo, V3::splat(y.lender.directions[i]), F::splat(MIN_ROUGH_ALPHA));
            let [factor, summand] = y.lender.mixture[i].map(F::splat);
            store(&mut self.bsdf_pdf[i], row, factor.mul_add(pdf, summand));
            self.value[i].store(row, weight * lent);
        }
        let traced = takes_part & cast::<U, F>(!x.own.simd_eq(U::splat(y.index)));
        let survivors = Survivors::of(traced);
        let ray = (survivors.compress_v3(x.origin), survivors.compress_v3(wi));
        self.rays.put(self.pair_of.len(), ray, survivors.compress(distance2.sqrt()), U::splat(y.lender.key), F::ZERO);
        let bits = traced.to_bitmask();
        self.pair_of.extend((0..LANES).filter(|lane| bits >> lane & 1 == 1).map(|lane| (row + lane) as u32));
    }
}

/// `radiance` over a divisor; zero where no pair takes part.
fn over(radiance: Vec3, divisor: f32) -> Vec3 {
    if divisor > 0.0 { radiance / divisor } else { Vec3::ZERO }
}

/// f cos of eight second surfaces, and the density of its sampling; of lobes whose α is at least `min_alpha`.
#[inline(never)]
fn value(bsdf: &impl Lobe, ns: V3, wo: V3, wi: V3, min_alpha: F) -> (V3, F) {
    bsdf.eval_pdf_above(ns, wo, wi, min_alpha)
}
