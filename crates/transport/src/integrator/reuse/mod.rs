//! Path re-use (Bekaert, Sbert and Halton 2002, *Accelerating Path Tracing by Re-Using Paths*): first surfaces of several pixels
//! share what their paths find at second surfaces.
//!
//! N BSDF samples of first surfaces form a pool. Sample k leaves x_k with density p_k and finds y_k, from where its path goes on
//! and finds the outgoing radiance L_k, without what y_k emits. In area measure p_k(y) = p_k(x_k → y) cos θ_y / |x_k − y|², and
//! zero where x_k does not see y. By the balance heuristic over the N techniques, each x_i estimates its indirect light from all
//! of them:
//!
//! I_i = Σ_j f(x_i → y_j) cos θ_i (cos θ_y / |x_i − y_j|²) V(x_i, y_j) L_j(→ x_i) / Σ_k p_k(y_j) V(x_k, y_j)
//!
//! A fraction q of the samples of a pool goes on from y (*sparse* re-use). Pools are drawn before anything is known of y; q
//! depends on the pair (x, y), and the divisor has q_k p_k(y). A pair takes part where `pairs` says so; the light of all others
//! stays with its own path.
//!
//! L_j depends on the direction w in which its light arrives at y, which path j has drawn with a density p_j(w) toward x_j. The
//! balance heuristic is that of y and w: in the divisor, p_k(y) stands with p_k(w), the density toward x_k, so that no x counts
//! more of what another has found than of its own sample. Which surfaces of blended alpha are there depends on a ray's key
//! alone, so y and the key of the ray to it are drawn together: V is that of the key. Rough lobes of y are lent. What sharp lobes scatter stays with the
//! own path: their densities differ without bound between two x.

mod lenders;
mod pairs;
mod pools;

use std::ops::Range;

use glam::Vec3;

use super::data::context::WaveContext;
use super::data::counts::WaveCounts;
use super::data::path_states::NonFiniteSamples;
use super::data::queues::{LightKind, PathRays, ShadowRays};
use super::data::requests::RequestPacket;
use super::data::vertices::Vertices;
use super::events::{
    BorrowedLight, FoundEmission, LightSamplePacket, PassedWall, PathEvents, ScatteredPacket, UnoccludedLight,
};
use super::stages::emission::weighted_light_pdf;
use crate::lanes::{F, LANES, Rows, U, grow, store};
use crate::rays::HitBatch;
use lenders::{Find, FirstSample, LIGHT, Lender, NEXT, NONE, PUNCTUAL};
use pairs::Pairs;
use pools::Pools;

/// What first surfaces lend each other; one per thread.
#[derive(Debug, Default)]
pub struct Lending {
    /// Is it used in this wave?
    active: bool,
    /// First and second surfaces.
    vertices: [Vertices; 2],
    /// By pixel, index of its first path.
    first_paths: Vec<u32>,
    /// BSDF samples of first surfaces, by [`PathRays::root`].
    samples: Vec<FirstSample>,
    pools: Pools,
    /// By row of shadow rays at second surfaces, [`Find::light_pdf`]; without meaning for punctual lights.
    light_pdf: Vec<f32>,
    lenders: Vec<Lender>,
    finds: Vec<Find>,
    pairs: Pairs,
    /// Indices in the wave of the paths whose loans are listed.
    pub watched: Range<u32>,
    /// What they borrow, lender by lender.
    pub loans: Vec<Loan>,
}

/// Light that a path borrows from a second surface, or that sharp lobes of its own second surface scatter.
#[derive(Debug, Clone, Copy)]
pub struct Loan {
    /// Index in the wave of the path that borrows.
    pub to: u32,
    /// Column and row of the pixel whose path has found the second surface, and the path's number in it.
    pub from: [u32; 3],
    /// Linear RGB, as it is added to the path that borrows.
    pub radiance: Vec3,
}

impl Lending {
    fn begin(&mut self, at: &WaveContext) {
        self.active = at.transport.proposal.reuse.is_some();
        self.samples.clear();
        self.pools.clear();
        self.lenders.clear();
        self.finds.clear();
        self.loans.clear();
        self.first_paths.clear();
        self.first_paths.extend(at.tasks.iter().scan(0, |next, task| {
            *next += task.counts.paths;
            Some(*next - task.counts.paths)
        }));
    }

    /// The lender on the paths with this root.
    #[inline]
    fn lender(&mut self, root: u32) -> Option<&mut Lender> {
        self.lenders.get_mut(self.samples.get(root as usize)?.lender as usize)
    }

    /// Keeps what the lender on the paths with this root has found at the end of a direction. False if there is none.
    #[inline]
    fn find(&mut self, root: u32, direction: usize, (radiance, light_pdf): (Vec3, f32)) -> bool {
        let number = self.finds.len() as u32;
        let Some(lender) = self.lender(root) else { return false };
        let next = std::mem::replace(&mut lender.found, number);
        self.finds.push(Find { direction, radiance, light_pdf, next });
        true
    }

    /// Marks the second surfaces that lend their light: their paths go on with a throughput of one, or end. Tells `clients`.
    fn lend<E: PathEvents>(&mut self, at: &WaveContext, rays: &PathRays, vertices: &mut Vertices, clients: &mut E) {
        vertices.ended.clear();
        let Some(reuse) = at.transport.proposal.reuse.filter(|_| self.active && at.depth == 1) else { return };
        let (first, samples) = (&self.vertices[0].origin, &self.samples);
        self.pools.form(reuse, |sample| first.get(samples[sample as usize].x as usize));
        if self.pools.is_empty() {
            return;
        }
        vertices.ended.resize(vertices.len(), false);
        for at_row in (0..vertices.len()).step_by(LANES) {
            let [lends, sharp] = pairs::lends(vertices, &Rows::From(at_row)).map(|mask| mask.to_bitmask());
            let rows = at_row..vertices.len().min(at_row + LANES);
            for (lane, row) in rows.enumerate().filter(|(lane, _)| lends >> lane & 1 == 1) {
                let root = vertices.root[row];
                let sample = &mut self.samples[root as usize];
                // Rays in rough directions pass no back faces.
                let ray = (vertices.ray[row] - rays.first) as usize;
                let passed = rays.passed_wall.get(ray).is_some_and(|passed| *passed);
                let Some((place, pool)) = self.pools.place(root) else { continue };
                if passed || !sample.rough {
                    continue;
                }
                let sharp = sharp >> lane & 1 == 1;
                let distance2 =
                    vertices.origin.get(row).distance_squared(self.vertices[0].origin.get(sample.x as usize));
                let goes_on = pool.goes_on(F::splat(distance2), sharp).as_array()[0];
                clients.lends(at, vertices.ray[row], place.order < goes_on);
                if place.order < goes_on {
                    sample.lender = self.lenders.len() as u32;
                    let beta = vertices.beta.get(row);
                    self.lenders.push(Lender::new((row as u32, rays.rays.key[ray]), beta, goes_on, sharp));
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
    fn record_samples(
        &mut self,
        at: &WaveContext,
        vertices: &Vertices,
        packet: &RequestPacket,
        found: &ScatteredPacket,
    ) {
        let rows = &packet.rows;
        let borrows = pairs::borrows(vertices, rows).to_bitmask();
        let rough = pairs::is_rough(at.transport, found.pdf[0], found.pdf[1]).to_bitmask();
        let [octants, random, random2] = pools::keys(vertices, packet).map(U::to_array);
        let ids = &packet.path_ids;
        let (path, index) = (ids.path.to_array(), ids.index.to_array());
        for lane in 0..packet.len {
            let x = match rows {
                Rows::From(first) => (first + lane) as u32,
                Rows::Each(rows) => rows[lane],
            };
            let rough = rough >> lane & 1 == 1;
            if borrows >> lane & 1 == 1 {
                let path = path[lane];
                let pixel = at.pixel(path);
                let (number, kind) = (path - self.first_paths[pixel], at.tasks[pixel].class << 3 | octants[lane]);
                self.pools.add([kind, number, random[lane], random2[lane]], self.samples.len() as u32);
            }
            self.samples.push(FirstSample { x, path: path[lane], index: index[lane], lender: NONE, rough });
        }
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
        if !self.active {
            return;
        }
        let Self { vertices, samples, pools, lenders, finds, pairs, loans, watched, .. } = self;
        let weighted = |sum: Vec3, sample: &FirstSample| {
            vertices[0].beta.get(sample.x as usize) * sum / at.paths[sample.path as usize].samples_per_path[2]
        };
        pairs.begin(samples.len());
        for (pool, members) in pools.each() {
            let is_lit = |lender: &u32| lenders.get(*lender as usize).is_some_and(Lender::is_lit);
            let lit = members.iter().map(|member| samples[*member as usize].lender).filter(is_lit);
            let watches = |sample: &&u32| watched.contains(&samples[**sample as usize].path);
            let borrowers: Vec<_> = members.iter().filter(watches).map(|sample| *sample as usize).collect();
            if borrowers.is_empty() {
                pairs.push(pool, members, lit);
                if pairs.is_full() {
                    pairs.evaluate(at.transport, vertices, samples, (lenders, finds), counts);
                }
                continue;
            }
            // One lender after the other, which tells them apart.
            let lit: Vec<u32> = lit.collect();
            pairs.evaluate(at.transport, vertices, samples, (lenders, finds), counts);
            for own in members.iter().map(|member| &samples[*member as usize]).filter(|own| lit.contains(&own.lender)) {
                let before: Vec<_> = borrowers.iter().map(|borrower| pairs.borrowed[*borrower]).collect();
                pairs.push(pool, members, [own.lender].into_iter());
                pairs.evaluate(at.transport, vertices, samples, (lenders, finds), counts);
                for (borrower, before) in borrowers.iter().zip(before) {
                    let radiance = weighted(pairs.borrowed[*borrower] - before, &samples[*borrower]);
                    loans.push(Loan { to: samples[*borrower].path, from: at.place(own.path), radiance });
                }
            }
        }
        pairs.evaluate(at.transport, vertices, samples, (lenders, finds), counts);
        for (sample, sum) in samples.iter().zip(&pairs.borrowed) {
            let own = lenders.get(sample.lender as usize).map_or(Vec3::ZERO, |own| own.beta * own.own / own.goes_on);
            let radiance = weighted(*sum, sample) + own;
            if radiance == Vec3::ZERO {
                continue;
            }
            if !radiance.is_finite() {
                non_finite.add(sample.path);
                continue;
            }
            light[sample.path as usize] += radiance;
            if watched.contains(&sample.path) {
                loans.push(Loan { to: sample.path, from: at.place(sample.path), radiance: own });
            }
            clients.borrowed(at, &BorrowedLight { path: sample.path, index: sample.index, radiance });
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
    /// Marks the second surfaces that lend their light.
    pub fn lend(&mut self, at: &WaveContext, rays: &PathRays, vertices: &mut Vertices) {
        self.lending.lend(at, rays, vertices, self.clients);
    }

    /// Counts the samples that were discarded at this depth.
    pub fn discard(&mut self, at: &WaveContext, counts: &mut WaveCounts, samples: &mut NonFiniteSamples) {
        for path in samples.paths.drain(..) {
            counts.add_not_finite(at, path);
            self.clients.not_finite(at, path);
        }
    }

    /// All paths have ended: shares what is lent.
    pub fn end(&mut self, at: &WaveContext, counts: &mut WaveCounts, non_finite: &mut NonFiniteSamples) {
        self.lending.share(at, counts, non_finite, self.radiance, self.clients);
        self.discard(at, counts, non_finite);
        self.clients.end(at, self.radiance);
    }
}

impl<E: PathEvents> PathEvents for PathLight<'_, E> {
    fn begin(&mut self, at: &WaveContext) {
        self.lending.begin(at);
        self.clients.begin(at);
    }

    #[inline]
    fn rays(&mut self, at: &WaveContext, rays: &PathRays) {
        self.clients.rays(at, rays);
    }

    #[inline]
    fn passed_wall(&mut self, at: &WaveContext, rays: &PathRays, passed: &PassedWall) {
        self.clients.passed_wall(at, rays, passed);
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
        let root = rays.root[found.ray as usize];
        if at.depth == 2 {
            let light_pdf = weighted_light_pdf(at, rays, found.ray as usize, found.pdf);
            if self.lending.find(root, NEXT, (found.radiance, light_pdf)) {
                return self.clients.lent(at, rays, found);
            }
        } else if at.depth > 2
            && let Some(lender) = self.lending.lender(root)
        {
            lender.beyond += found.radiance;
            return self.clients.lent(at, rays, found);
        }
        self.radiance[rays.path[found.ray as usize] as usize] += found.radiance;
        self.clients.emission(at, rays, found);
    }

    #[inline]
    fn light_samples(
        &mut self,
        at: &WaveContext,
        vertices: &Vertices,
        packet: &RequestPacket,
        samples: &LightSamplePacket,
    ) {
        self.clients.light_samples(at, vertices, packet, samples);
        let lending = &mut *self.lending;
        if lending.active && at.depth == 1 {
            grow(&mut lending.light_pdf, samples.first_row);
            store(&mut lending.light_pdf, samples.first_row, samples.survivors.compress(samples.weighted_pdf));
        }
    }

    #[inline]
    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {
        self.clients.scattered(at, vertices, packet, samples);
        let lending = &mut *self.lending;
        if lending.active && at.depth == 0 {
            lending.record_samples(at, vertices, packet, samples);
        } else if lending.active && at.depth == 1 {
            let survivors = &samples.survivors;
            let (root, wi) = (survivors.compress_bits(packet.path_ids.root), survivors.compress_v3(samples.wi));
            for (lane, root) in root.to_array()[..survivors.len].iter().enumerate() {
                lending.lender(*root).into_iter().for_each(|lender| lender.directions[NEXT] = wi.lane(lane));
            }
        }
    }

    #[inline]
    fn shadow_rays(&mut self, at: &WaveContext, shadows: &ShadowRays) {
        self.clients.shadow_rays(at, shadows);
    }

    #[inline]
    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        let (row, root, lending) = (found.row, shadows.root[found.row], &mut *self.lending);
        if at.depth == 1 {
            let (direction, light_pdf) = match shadows.kind(row) {
                LightKind::Punctual => (PUNCTUAL, 1.0),
                _ => (LIGHT, lending.light_pdf.get(row).copied().unwrap_or(0.0)),
            };
            if lending.find(root, direction, (found.radiance, light_pdf)) {
                let wi = shadows.rays.direction(row);
                lending.lender(root).into_iter().for_each(|own| own.directions[direction] = wi);
                return;
            }
        } else if at.depth > 1
            && let Some(lender) = lending.lender(root)
        {
            lender.beyond += found.radiance;
            return;
        }
        self.radiance[shadows.path[row] as usize] += found.radiance;
        self.clients.unoccluded(at, shadows, found);
    }
}
