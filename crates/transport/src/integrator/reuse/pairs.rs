//! Pairs of first and second surfaces.
//!
//! A pair takes part if both surfaces are diffuse enough and opaque, if the direction is no mirror image, if the second surface
//! is seen from its side and with a normal that need not be bent, and if nothing lies in between. These are properties of the
//! pair alone, whichever path has found it, so that the balance heuristic may leave out the others.

use glam::Vec3;
use wide::bytemuck::cast;

use super::lenders::{FirstSample, Lender};
use crate::bsdf::{Core, Lobe, Parameters};
use crate::integrator::data::counts::{WaveCounts, timed};
use crate::integrator::data::history::MIRROR_PDF;
use crate::integrator::data::light_groups::MAX_GROUPS;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::stages::mixture::{self, Mixture};
use crate::integrator::surface::shading_normal;
use crate::lanes::{F, LANES, Rows, Survivors, U, V3, V3Column, are, eight, grow, load_bits, mask, store};
use crate::rays::{RayBatch, RayOrder};

/// Pairs of a batch, at which it is evaluated.
const FULL: usize = 2048;

/// Calls a function with the BSDFs of eight vertices.
macro_rules! with_bsdf {
    ($vertices:expr, $rows:expr, $bsdf:ident => $body:expr) => {
        match $vertices.core() {
            Some(columns) => {
                let $bsdf = &Core::load(columns, $rows);
                $body
            }
            None => {
                let $bsdf = &$vertices.bsdf($rows);
                $body
            }
        }
    };
}

/// Mask of the vertices that may borrow light: on rough, opaque surfaces, in no medium that absorbs.
#[inline(never)]
pub fn borrows(vertices: &Vertices, rows: &Rows) -> F {
    let outside = vertices.media.as_ref().map(|[own, _]| cast::<U, F>(load_bits(own, rows).simd_eq(U::ZERO)));
    let rough = with_bsdf!(vertices, rows, bsdf => mixture::is_diffuse(bsdf) & !bsdf.transmits());
    outside.map_or(rough, |outside| rough & outside)
}

/// Mask of the vertices that may lend light to the side of `wo`.
#[inline(never)]
pub fn lends(vertices: &Vertices, rows: &Rows) -> F {
    let (ng, ns, wo) = (vertices.ng.load(rows), vertices.ns.load(rows), vertices.wo.load(rows));
    borrows(vertices, rows) & shading_normal::is_clear(ng, ns, wo)
}

/// The pairs of a batch.
#[derive(Debug, Default)]
pub struct Pairs {
    /// Lenders and samples, lender by lender.
    ends: Vec<[u32; 2]>,
    /// The lenders, and the fraction q of their groups.
    lenders: Vec<(u32, f32)>,
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
        self.ends.clear();
        self.lenders.clear();
        self.borrowed.clear();
        self.borrowed.resize(samples * self.groups.len(), Vec3::ZERO);
    }

    /// Adds a lender with all members of its group.
    pub fn push(&mut self, lender: u32, members: &[u32], q: f32) {
        self.ends.extend(members.iter().map(|member| [lender, *member]));
        self.lenders.push((lender, q));
    }

    /// Is it time to evaluate them?
    pub fn is_full(&self) -> bool {
        self.ends.len() >= FULL
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
        let n = self.ends.len();
        grow(&mut self.pdf, n);
        self.radiance.iter_mut().for_each(|column| column.grow(n));
        self.rays.open(n, false);
        self.pair_of.clear();
        self.divide_by_bsdf(&vertices[1], lenders);
        for first in (0..n).step_by(LANES) {
            self.eight(transport, vertices, samples, lenders, first);
        }
        let Self { ends, rays, pair_of, occluded, pdf, radiance, borrowed, groups, lenders: of } = self;
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
        for ((_, q), pairs) in of.iter().zip(ends.chunk_by(|a, b| a[0] == b[0])) {
            let rows = start..start + pairs.len();
            start = rows.end;
            let scale = 1.0 / (q * pdf[rows.clone()].iter().sum::<f32>());
            let lit = lenders[pairs[0][0] as usize].lit;
            for (i, group) in groups.iter().enumerate().filter(|(_, group)| lit >> *group & 1 == 1) {
                for (row, [_, sample]) in rows.clone().zip(pairs).filter(|(row, _)| pdf[*row] > 0.0) {
                    borrowed[*sample as usize * groups.len() + i] += radiance[*group].get(row) * scale;
                }
            }
        }
        ends.clear();
        of.clear();
    }

    /// Divides what the lenders' samples found by their BSDFs toward their own first surfaces.
    fn divide_by_bsdf(&self, second: &Vertices, lenders: &mut [Lender]) {
        for group in self.lenders.chunks(LANES) {
            let lane_of = |lane: usize| group[lane.min(group.len() - 1)].0 as usize;
            let y = Rows::Each(eight(|lane| lenders[lane_of(lane)].y));
            let (ns, wo) = (second.ns.load(&y), second.wo.load(&y));
            let values = [0, 1, 2].map(|i| {
                let wi = V3::gather(eight(|lane| lenders[lane_of(lane)].directions[i]));
                value(second, &y, ns, wo, wi)
            });
            for lane in 0..group.len() {
                let lender = &mut lenders[lane_of(lane)];
                let over = |found: Vec3, direction: usize| {
                    let value = values[direction].lane(lane);
                    Vec3::select(value.cmpgt(Vec3::ZERO), found / value, Vec3::ZERO)
                };
                lender.sampled = [0, 1].map(|i| over(lender.sampled[i], i));
                self.groups.iter().for_each(|group| lender.beyond[*group] = over(lender.beyond[*group], 2));
            }
        }
    }

    /// Evaluates eight pairs.
    #[inline(never)]
    fn eight(
        &mut self,
        transport: &Transport,
        vertices: &[Vertices; 2],
        samples: &[FirstSample],
        lenders: &[Lender],
        first: usize,
    ) {
        let len = LANES.min(self.ends.len() - first);
        let pair = eight(|lane| self.ends[first + lane.min(len - 1)]);
        let own = eight(|lane| samples[pair[lane][1] as usize].lender == pair[lane][0]);
        let lender = pair.map(|[lender, _]| &lenders[lender as usize]);
        let x = Rows::Each(pair.map(|[_, sample]| samples[sample as usize].x));
        let y = Rows::Each(lender.map(|lender| lender.y));
        let [from, to] = vertices;
        let (origin, target) = (from.origin.load(&x), to.origin.load(&y));
        let way = target - origin;
        let distance2 = way.length_squared();
        let wi = way.normalize_or(V3::ZERO);
        let (ns, wo) = (from.ns.load(&x), from.wo.load(&x));
        let (f, bsdf_pdf) = with_bsdf!(from, &x, bsdf => bsdf.eval_pdf(ns, wo, wi));
        let pdf = Mixture::at(transport, from, &x).map_or(bsdf_pdf, |mixture| mixture.pdf(wi, bsdf_pdf));
        let (ng_y, ns_y, wo_y) = (to.ng.load(&y), to.ns.load(&y), wi * F::splat(-1.0));
        let cos_y = ng_y.dot(wo_y);
        let takes_part = mask(len)
            & distance2.simd_gt(F::ZERO)
            & from.ng.load(&x).dot(wi).simd_gt(F::ZERO)
            & cos_y.simd_gt(F::ZERO)
            & pdf.simd_gt(F::ZERO)
            & bsdf_pdf.simd_lt(F::splat(MIRROR_PDF))
            & shading_normal::is_clear(ng_y, ns_y, wo_y);
        let to_area = cos_y / distance2;
        store(&mut self.pdf, first, takes_part & (pdf * to_area));
        let values = [0, 1, 2].map(|i| {
            if i == 1 && !transport.lights.punctual {
                return V3::ZERO;
            }
            value(to, &y, ns_y, wo_y, V3::gather(eight(|lane| lender[lane].directions[i])))
        });
        let sampled = [0, 1].map(|i| V3::gather(eight(|lane| lender[lane].sampled[i])) * values[i]);
        let groups_of = [0, 1].map(|i| U::from(eight(|lane| u32::from(lender[lane].groups[i]))));
        let lit = lender.iter().fold(0, |lit, lender| lit | lender.lit);
        for &group in self.groups.iter().filter(|group| lit >> **group & 1 == 1) {
            let beyond = V3::gather(eight(|lane| lender[lane].beyond[group]));
            let [a, b] = [0, 1].map(|i| V3::select(are(groups_of[i], group as u32), sampled[i], V3::ZERO));
            self.radiance[group].store(first, f * (a + b + beyond * values[2]) * to_area);
        }
        let own = F::from(own.map(|own| if own { 1.0 } else { 0.0 })).simd_gt(F::ZERO);
        let traced = takes_part & !own;
        let survivors = Survivors::of(traced);
        let ray = (survivors.compress_v3(origin), survivors.compress_v3(wi));
        self.rays.put(self.pair_of.len(), ray, survivors.compress(distance2.sqrt()), U::ZERO, F::ZERO);
        let bits = traced.to_bitmask();
        self.pair_of.extend((0..LANES).filter(|lane| bits >> lane & 1 == 1).map(|lane| (first + lane) as u32));
    }
}

/// f cos of eight second surfaces.
#[inline(never)]
fn value(vertices: &Vertices, rows: &Rows, ns: V3, wo: V3, wi: V3) -> V3 {
    with_bsdf!(vertices, rows, bsdf => bsdf.eval_pdf(ns, wo, wi).0)
}
