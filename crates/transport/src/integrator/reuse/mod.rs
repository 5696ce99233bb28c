//! Path re-use (Bekaert, Sbert and Halton 2002, *Accelerating Path Tracing by Re-Using Paths*): first surfaces of several pixels
//! share what their paths find at second surfaces.
//!
//! N BSDF samples of first surfaces form a group. Sample k leaves x_k with density p_k and finds y_k, from where its path goes on
//! and finds the outgoing radiance L_k, without what y_k emits. In area measure p_k(y) = p_k(x_k → y) cos θ_y / |x_k − y|², and
//! zero where x_k does not see y. By the balance heuristic over the N techniques, each x_i estimates its indirect light from all
//! of them:
//!
//! I_i = Σ_j f(x_i → y_j) cos θ_i (cos θ_y / |x_i − y_j|²) V(x_i, y_j) L_j(→ x_i) / Σ_k p_k(y_j) V(x_k, y_j)
//!
//! A fraction q of the samples of a group goes on from y; L is then divided by q (*sparse* re-use). Groups are drawn before
//! anything is known of y. A pair (x, y) takes part where `pairs` says so; the light of all others stays with its own path.

mod groups;
mod lenders;
mod pairs;

use glam::Vec3;

use super::data::context::WaveContext;
use super::data::counts::WaveCounts;
use super::data::history::MIRROR_PDF;
use super::data::light_groups::MAX_GROUPS;
use super::data::path_states::NonFiniteSamples;
use super::data::queues::{LightKind, PathRays, ShadowRays};
use super::data::requests::RequestGroup;
use super::data::transport::Transport;
use super::data::vertices::Vertices;
use super::events::{BorrowedLight, FoundEmission, LightSampleGroup, PathEvents, ScatteredGroup, UnoccludedLight};
use crate::lanes::{F, LANES, NUMBERS, Rows, U, load_bits};
use crate::rays::HitBatch;
use groups::Groups;
use lenders::{FirstSample, Lender, NONE};
use pairs::Pairs;

/// What first surfaces lend each other; one per thread.
#[derive(Debug, Default)]
pub struct Lending {
    /// Is it used in this wave?
    active: bool,
    /// First and second surfaces.
    vertices: [Vertices; 2],
    /// By pixel, index of its first path.
    first_paths: Vec<u32>,
    /// BSDF samples of first surfaces.
    samples: Vec<FirstSample>,
    groups: Groups,
    /// By number of a ray behind those of the camera: the sample that it belongs to.
    sample_of: Vec<u32>,
    /// By number of a ray behind those of the camera: the lender that it belongs to, or [`NONE`].
    lender_of: Vec<u32>,
    lenders: Vec<Lender>,
    pairs: Pairs,
    /// Index in the wave of the path whose loans are listed.
    pub watched: Option<u32>,
    /// What it borrows, lender by lender.
    pub loans: Vec<Loan>,
}

/// Light that a path borrows from a second surface.
#[derive(Debug, Clone, Copy)]
pub struct Loan {
    /// Column and row of the pixel whose path has found the second surface, and the path's number in it.
    pub from: [u32; 3],
    /// Linear RGB, as it is added to the path that borrows.
    pub radiance: Vec3,
}

/// Can the paths of a scene be lent? Not where the way to y depends on more than its ends: on time, on random numbers of blended
/// alpha.
pub fn is_possible(transport: &Transport) -> bool {
    !transport.geometry.moves && !transport.materials.blends && transport.limits[1] == f32::INFINITY
}

impl Lending {
    fn begin(&mut self, at: &WaveContext) {
        self.active = at.transport.proposal.reuse.is_some();
        self.samples.clear();
        self.groups.clear();
        self.sample_of.clear();
        self.lender_of.clear();
        self.lenders.clear();
        self.loans.clear();
        self.first_paths.clear();
        self.first_paths.extend(at.tasks.iter().scan(0, |next, task| {
            *next += task.counts.paths;
            Some(*next - task.counts.paths)
        }));
    }

    /// The lender that a ray of this number behind the camera's belongs to.
    #[inline]
    fn lender(&mut self, number: usize) -> Option<&mut Lender> {
        self.lenders.get_mut(*self.lender_of.get(number)? as usize)
    }

    /// Marks the second surfaces that lend their light: their paths go on with a throughput of one, or end.
    pub fn lend(&mut self, at: &WaveContext, rays: &PathRays, vertices: &mut Vertices) {
        vertices.ended.clear();
        let Some(reuse) = at.transport.proposal.reuse.filter(|_| self.active && at.depth == 1) else { return };
        self.groups.form(reuse);
        if self.groups.is_empty() {
            return;
        }
        vertices.ended.resize(vertices.len(), false);
        for first in (0..vertices.len()).step_by(LANES) {
            let lends = pairs::lends(vertices, &Rows::From(first)).to_bitmask();
            for row in (first..vertices.len().min(first + LANES)).filter(|row| lends >> (row - first) & 1 == 1) {
                let ray = (vertices.ray[row] - rays.first) as usize;
                let sample = self.sample_of[ray];
                // Rays in rough directions pass no back faces.
                let passed = rays.passed_wall.get(ray).is_some_and(|passed| *passed);
                let Some(traced) = self.groups.is_traced(sample) else { continue };
                if passed || !self.samples[sample as usize].rough {
                    continue;
                }
                if traced {
                    let lender = self.lenders.len() as u32;
                    self.samples[sample as usize].lender = lender;
                    self.lender_of[ray] = lender;
                    self.lenders.push(Lender { y: row as u32, ..Default::default() });
                    vertices.beta.set(row, Vec3::ONE);
                } else {
                    vertices.beta.set(row, Vec3::ZERO);
                    vertices.ended[row] = true;
                }
            }
        }
    }

    /// Keeps the vertices of first and second surfaces.
    pub fn keep(&mut self, at: &WaveContext, vertices: &mut Vertices) {
        if let Some(kept) = self.vertices.get_mut(at.depth as usize).filter(|_| self.active) {
            std::mem::swap(kept, vertices);
        }
    }

    /// Records the directions of first surfaces.
    fn record_samples(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, found: &ScatteredGroup) {
        let rows = &group.rows;
        let borrows = pairs::borrows(vertices, rows).to_bitmask();
        let rough = found.pdf[1].simd_lt(F::splat(MIRROR_PDF)).to_bitmask();
        let [octants, random] = groups::keys(vertices, group).map(U::to_array);
        let ids = &group.path_ids;
        let (path, index) = (ids.path.to_array(), ids.index.to_array());
        for lane in 0..group.len {
            let x = match rows {
                Rows::From(first) => (first + lane) as u32,
                Rows::Each(rows) => rows[lane],
            };
            let rough = rough >> lane & 1 == 1;
            if borrows >> lane & 1 == 1 {
                let path = path[lane];
                let number = path - self.first_paths[at.pixel(path)];
                self.groups.add([octants[lane], number, random[lane]], self.samples.len() as u32);
            }
            self.samples.push(FirstSample { x, path: path[lane], index: index[lane], lender: NONE, rough });
        }
        let first = (self.samples.len() - group.len) as u32;
        let lanes = found.survivors.compress_bits(U::from(NUMBERS)).to_array();
        self.sample_of.extend(lanes[..found.survivors.len].iter().map(|lane| first + lane));
        self.lender_of.extend([NONE].iter().cycle().take(found.survivors.len));
    }

    /// Estimates the light that first surfaces borrow, and tells the clients.
    pub fn share<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        counts: &mut WaveCounts,
        non_finite: &mut NonFiniteSamples,
        light: &mut [Vec3],
        clients: &mut E,
    ) {
        let Some(reuse) = at.transport.proposal.reuse.filter(|_| self.active) else { return };
        let Self { vertices, samples, groups, lenders, pairs, loans, watched, .. } = self;
        let weighted = |sum: Vec3, sample: &FirstSample| {
            vertices[0].beta.get(sample.x as usize) * sum / at.paths[sample.path as usize].samples_per_path[2]
        };
        pairs.begin(at.transport, samples.len());
        for (members, traced) in groups.each(reuse) {
            let q = traced as f32 / members.len() as f32;
            let lenders_of = members[..traced].iter().map(|member| samples[*member as usize].lender);
            let is_lit = |lender: &u32| lenders.get(*lender as usize).is_some_and(Lender::is_lit);
            let lit = lenders_of.filter(is_lit);
            let of_watched = |path| members.iter().find(|member| samples[**member as usize].path == path);
            let Some(borrower) = watched.and_then(of_watched) else {
                pairs.push(members, lit, q);
                if pairs.is_full() {
                    pairs.evaluate(at.transport, vertices, samples, lenders, counts);
                }
                continue;
            };
            // One lender after the other, which tells them apart.
            pairs.evaluate(at.transport, vertices, samples, lenders, counts);
            for own in members[..traced].iter().map(|member| &samples[*member as usize]) {
                let before = pairs.borrowed_by(*borrower);
                let lit = lenders.get(own.lender as usize).filter(|lender| lender.is_lit()).map(|_| own.lender);
                pairs.push(members, lit.into_iter(), q);
                pairs.evaluate(at.transport, vertices, samples, lenders, counts);
                let radiance = weighted(pairs.borrowed_by(*borrower) - before, &samples[*borrower as usize]);
                loans.push(Loan { from: at.place(own.path), radiance });
            }
        }
        pairs.evaluate(at.transport, vertices, samples, lenders, counts);
        let borrowed = pairs.borrowed.chunks(pairs.groups.len().max(1));
        for (sample, sums) in samples.iter().zip(borrowed) {
            if sums.iter().all(|sum| *sum == Vec3::ZERO) {
                continue;
            }
            let mut by_group = [Vec3::ZERO; MAX_GROUPS];
            for (group, sum) in pairs.groups.iter().zip(sums) {
                by_group[*group] = weighted(*sum, sample);
            }
            let radiance = by_group.iter().sum::<Vec3>();
            if !radiance.is_finite() {
                non_finite.add(sample.path);
                continue;
            }
            light[sample.path as usize] += radiance;
            clients.borrowed(at, &BorrowedLight { path: sample.path, index: sample.index, radiance, by_group });
        }
    }
}

/// The light of a wave's paths, a client: adds what is found to the path that found it, or to the second surface that lends it.
/// Other clients hear of what is lent only when it is borrowed.
pub struct PathLight<'a, E> {
    /// By path, its radiance so far, linear RGB.
    pub radiance: &'a mut [Vec3],
    /// What is lent.
    pub lending: &'a mut Lending,
    /// The other clients.
    pub clients: &'a mut E,
}

impl<E: PathEvents> PathLight<'_, E> {
    /// All paths have ended: shares what is lent.
    pub fn end(&mut self, at: &WaveContext, counts: &mut WaveCounts, non_finite: &mut NonFiniteSamples) {
        self.lending.share(at, counts, non_finite, self.radiance, self.clients);
        self.clients.end(at, self.radiance);
    }
}

impl<E: PathEvents> PathEvents for PathLight<'_, E> {
    fn begin(&mut self, at: &WaveContext) {
        self.lending.begin(at);
        self.clients.begin(at);
    }

    #[inline]
    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        self.clients.hits(at, rays, hits);
    }

    #[inline]
    fn hits_behind_walls(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        self.clients.hits_behind_walls(at, rays, hits);
    }

    #[inline]
    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        if at.depth > 1 {
            let number = (rays.first + found.ray) as usize - at.paths.len();
            if let Some(lender) = self.lending.lender(number) {
                lender.add(found.group, found.radiance);
                return;
            }
        }
        self.radiance[rays.path[found.ray as usize] as usize] += found.radiance;
        self.clients.emission(at, rays, found);
    }

    #[inline]
    fn light_samples(
        &mut self,
        at: &WaveContext,
        vertices: &Vertices,
        group: &RequestGroup,
        samples: &LightSampleGroup,
    ) {
        self.clients.light_samples(at, vertices, group, samples);
    }

    #[inline]
    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, samples: &ScatteredGroup) {
        self.clients.scattered(at, vertices, group, samples);
        let lending = &mut *self.lending;
        if !lending.active {
            return;
        }
        if at.depth == 0 {
            return lending.record_samples(at, vertices, group, samples);
        }
        let survivors = &samples.survivors;
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, &group.rows)).to_array();
        let wi = survivors.compress_v3(samples.wi);
        for (lane, ray) in arrived[..survivors.len].iter().enumerate() {
            let lender = lending.lender_of[*ray as usize - at.paths.len()];
            lending.lender_of.push(lender);
            if let Some(lender) = lending.lenders.get_mut(lender as usize).filter(|_| at.depth == 1) {
                lender.directions[2] = wi.lane(lane);
            }
        }
    }

    #[inline]
    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        if at.depth > 0 {
            let number = shadows.ray[found.row] as usize - at.paths.len();
            if let Some(lender) = self.lending.lender(number) {
                let group = at.transport.sampled_group(shadows.light(found.row));
                if at.depth == 1 {
                    let i = usize::from(shadows.kind(found.row) == LightKind::Punctual);
                    (lender.sampled[i], lender.groups[i]) = (found.radiance, group);
                    lender.lit |= 1 << group;
                    lender.directions[i] = shadows.rays.direction(found.row);
                } else {
                    lender.add(group, found.radiance);
                }
                return;
            }
        }
        self.radiance[shadows.path[found.row] as usize] += found.radiance;
        self.clients.unoccluded(at, shadows, found);
    }
}
