//! Pairs of first and second surfaces.
//!
//! A pair takes part if both surfaces are diffuse enough and opaque, if the direction is no mirror image, if the second surface
//! is seen from its side and with a normal that need not be bent, and if nothing lies in between. These are properties of the
//! pair alone, whichever path has found it, so that the balance heuristic may leave out the others.

use std::ops::Range;

use glam::Vec3;
use wide::bytemuck::cast;

use super::lenders::{FirstSample, Lender};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::history::MIRROR_PDF;
use crate::integrator::data::light_groups::MAX_GROUPS;
use crate::integrator::data::proposal::Reuse;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::stages::mixture::{self, Mixture};
use crate::integrator::surface::shading_normal;
use crate::lanes::{F, LANES, Rows, Survivors, U, V3, V3Column, eight, grow, load_bits, mask, store};
use crate::rays::{RayBatch, RayOrder};

/// Pairs of a batch, at which it is evaluated.
const FULL: usize = 2048;
/// Maximum times eight members of a group.
const MAX_BLOCKS: usize = Reuse::MAX_GROUP as usize / LANES;

/// Mask of the vertices that may borrow light: on rough, opaque surfaces, in no medium that absorbs.
#[inline(never)]
pub fn borrows(vertices: &Vertices, rows: &Rows) -> F {
    fn is_rough(bsdf: &impl Lobe) -> F {
        mixture::is_diffuse(bsdf) & !bsdf.transmits()
    }
    let outside = vertices.media.as_ref().map(|[own, _]| cast::<U, F>(load_bits(own, rows).simd_eq(U::ZERO)));
    let rough = match vertices.core() {
        Some(columns) => is_rough(&Core::load(columns, rows)),
        None => is_rough(&vertices.bsdf(rows)),
    };
    outside.map_or(rough, |outside| rough & outside)
}

/// Mask of the vertices that may lend light to the side of `wo`.
#[inline(never)]
pub fn lends(vertices: &Vertices, rows: &Rows) -> F {
    let (ng, ns, wo) = (vertices.ng.load(rows), vertices.ns.load(rows), vertices.wo.load(rows));
    borrows(vertices, rows) & shading_normal::is_clear(ng, ns, wo)
}

/// A group whose pairs are in the batch: its members and its lit lenders, as ranges of [`Pairs::members`] and [`Pairs::lenders`].
#[derive(Debug)]
struct Group {
    members: Range<usize>,
    lenders: Range<usize>,
    /// Fraction of the members that go on.
    q: f32,
}

/// Eight members of a group at their first surfaces. All lenders of the group meet them: they are gathered once.
struct Block<'a, B> {
    /// Mask of the lanes with a member.
    present: F,
    /// The lenders of their own paths.
    own: U,
    origin: V3,
    ng: V3,
    ns: V3,
    wo: V3,
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
    batch: Vec<Group>,
    members: Vec<u32>,
    lenders: Vec<u32>,
    /// Rows of the batch.
    rows: usize,
    /// The groups of lights in the scene.
    pub groups: Vec<usize>,
    /// Density of the direction in area measure; zero where the pair takes no part.
    pdf: Vec<f32>,
    /// By group of lights, what is lent, but for the divisor; without meaning where the lender has none of it.
    radiance: [V3Column; MAX_GROUPS],
    /// Visibility rays, and their pairs.
    rays: RayBatch,
    pair_of: Vec<u32>,
    occluded: Vec<bool>,
    /// By sample and then by `groups`, what it borrows, for a throughput of one.
    pub borrowed: Vec<Vec3>,
}

impl Pairs {
    /// Begins with nothing borrowed.
    pub fn begin(&mut self, transport: &Transport, samples: usize) {
        let lights = transport.lights;
        let punctual = lights.punctual || lights.sized.is_some();
        let kinds = [lights.environment.is_some(), lights.area.is_some(), punctual];
        let is_used = transport.groups.as_ref().map_or(&kinds[..], |table| &table.is_used);
        self.groups.clear();
        self.groups.extend((0..is_used.len()).filter(|group| is_used[*group]));
        self.clear();
        self.borrowed.clear();
        self.borrowed.resize(samples * self.groups.len(), Vec3::ZERO);
    }

    fn clear(&mut self) {
        self.batch.clear();
        self.members.clear();
        self.lenders.clear();
        self.rows = 0;
    }

    /// Adds all pairs of a group's `members` with those of the `lenders` that have something to lend. `q` is the fraction of the
    /// members that go on.
    pub fn push(&mut self, members: &[u32], lit: impl Iterator<Item = u32>, q: f32) {
        let starts = [self.members.len(), self.lenders.len()];
        self.lenders.extend(lit);
        let lenders = starts[1]..self.lenders.len();
        if !lenders.is_empty() {
            self.members.extend(members);
            self.rows += lenders.len() * members.len().next_multiple_of(LANES);
            self.batch.push(Group { members: starts[0]..self.members.len(), lenders, q });
        }
    }

    /// All that a sample borrows so far, for a throughput of one.
    pub fn borrowed_by(&self, sample: u32) -> Vec3 {
        self.borrowed[sample as usize * self.groups.len()..][..self.groups.len()].iter().sum()
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
        lenders: &mut [Lender],
        counts: &mut WaveCounts,
    ) {
        grow(&mut self.pdf, self.rows);
        self.groups.iter().for_each(|group| self.radiance[*group].grow(self.rows));
        self.rays.open(self.rows, false);
        self.pair_of.clear();
        let batch = std::mem::take(&mut self.batch);
        let [from, to] = vertices;
        let mut row = 0;
        for group in &batch {
            let at = (transport, vertices, samples);
            row = match (from.core(), to.core()) {
                (Some(x), Some(y)) => {
                    self.group(at, lenders, group, row, |rows| Core::load(x, rows), |rows| Core::load(y, rows))
                }
                _ => self.group(at, lenders, group, row, |rows| from.bsdf(rows), |rows| to.bsdf(rows)),
            };
        }
        self.batch = batch;
        let Self { batch, rays, pair_of, occluded, pdf, radiance, borrowed, groups, members, .. } = self;
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
        for group in &*batch {
            let members = &members[group.members.clone()];
            for lender in &self.lenders[group.lenders.clone()] {
                let rows = start..start + members.len();
                start = rows.start + members.len().next_multiple_of(LANES);
                let scale = 1.0 / (group.q * pdf[rows.clone()].iter().sum::<f32>());
                let lit = lenders[*lender as usize].lit;
                for (i, light) in groups.iter().enumerate().filter(|(_, light)| lit >> **light & 1 == 1) {
                    for (row, sample) in rows.clone().zip(members).filter(|(row, _)| pdf[*row] > 0.0) {
                        borrowed[*sample as usize * groups.len() + i] += radiance[*light].get(row) * scale;
                    }
                }
            }
        }
        self.clear();
    }

    /// Evaluates the pairs of a group, whose first row is `row`; returns the row behind them.
    #[inline(never)]
    fn group<B: Lobe>(
        &mut self,
        (transport, [from, to], samples): (&Transport, &[Vertices; 2], &[FirstSample]),
        lenders: &mut [Lender],
        group: &Group,
        mut row: usize,
        first_bsdf: impl Fn(&Rows) -> B,
        second_bsdf: impl Fn(&Rows) -> B,
    ) -> usize {
        let members = &self.members[group.members.clone()];
        let of_group = group.lenders.clone();
        for lit in self.lenders[of_group.clone()].chunks(LANES) {
            let lane_of = |lane: usize| lit[lane.min(lit.len() - 1)] as usize;
            let y = Rows::Each(eight(|lane| lenders[lane_of(lane)].y));
            let (ns, wo, bsdf) = (to.ns.load(&y), to.wo.load(&y), second_bsdf(&y));
            let values =
                [0, 1, 2].map(|i| value(&bsdf, ns, wo, V3::gather(eight(|lane| lenders[lane_of(lane)].directions[i]))));
            (0..lit.len()).for_each(|lane| lenders[lane_of(lane)].divide(values.map(|value| value.lane(lane))));
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
                bsdf: first_bsdf(&x),
                mixture: Mixture::at(transport, from, &x),
            })
        };
        let blocks: [_; MAX_BLOCKS] = std::array::from_fn(block);
        for i in of_group {
            let index = self.lenders[i];
            let lender = &lenders[index as usize];
            let y = Rows::Each([lender.y; LANES]);
            let (position, ng, ns) = (to.origin.load(&y), to.ng.load(&y), to.ns.load(&y));
            let second = Second { lender, index, position, ng, ns, bsdf: second_bsdf(&y) };
            for block in blocks.iter().flatten() {
                self.eight(block, &second, row);
                row += LANES;
            }
        }
        row
    }

    /// Evaluates eight pairs.
    #[inline(always)]
    fn eight<B: Lobe>(&mut self, x: &Block<B>, y: &Second<B>, row: usize) {
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
            & bsdf_pdf.simd_lt(F::splat(MIRROR_PDF))
            & shading_normal::is_clear(y.ng, y.ns, wo);
        let to_area = cos_y / distance2;
        store(&mut self.pdf, row, takes_part & (pdf * to_area));
        let Lender { directions, sampled, groups, beyond, lit, .. } = y.lender;
        // A direction of zero length stands for none: nothing was found there.
        let values = directions.map(|wi| match wi == Vec3::ZERO {
            true => V3::ZERO,
            false => value(&y.bsdf, y.ns, wo, V3::splat(wi)),
        });
        let weight = f * to_area;
        for &group in self.groups.iter().filter(|group| lit >> **group & 1 == 1) {
            let from = |i: usize| if usize::from(groups[i]) == group { sampled[i] } else { Vec3::ZERO };
            let light = values[0] * V3::splat(from(0)) + values[1] * V3::splat(from(1));
            self.radiance[group].store(row, weight * (light + values[2] * V3::splat(beyond[group])));
        }
        let traced = takes_part & cast::<U, F>(!x.own.simd_eq(U::splat(y.index)));
        let survivors = Survivors::of(traced);
        let ray = (survivors.compress_v3(x.origin), survivors.compress_v3(wi));
        self.rays.put(self.pair_of.len(), ray, survivors.compress(distance2.sqrt()), U::ZERO, F::ZERO);
        let bits = traced.to_bitmask();
        self.pair_of.extend((0..LANES).filter(|lane| bits >> lane & 1 == 1).map(|lane| (row + lane) as u32));
    }
}

/// f cos of eight second surfaces.
#[inline(never)]
fn value(bsdf: &impl Lobe, ns: V3, wo: V3, wi: V3) -> V3 {
    bsdf.eval_pdf(ns, wo, wi).0
}
