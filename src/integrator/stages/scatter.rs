//! BSDF sampling: the next rays.

use glam::Vec3;

use super::{Technique, bsdf_set};
use crate::integrator::Transport;
use crate::integrator::wave::{Child, Wave};
use crate::lanes::{F, LANES, NUMBERS, Survivors, U, mask};
use crate::sampling::{keys, samples};

/// Segments after which Russian roulette begins.
const ROULETTE_DEPTH: u32 = 3;
/// A path survives with this times its throughput: by relMSE times seconds on a diffuse room, 1 (the rule of thumb) is a
/// third worse than 2, and 3 no better.
const ROULETTE_GAIN: f32 = 2.0;

impl Wave {
    /// Fills the next rays for the vertices at `depth`.
    pub(in crate::integrator) fn scatter(&mut self, transport: &Transport, depth: u32) {
        let last = depth + 1 >= transport.max_depth;
        let tasks = if last { 0 } else { self.set_tasks(Technique::Bsdf, depth) };
        self.next_rays.open(tasks);
        self.next_paths.open(tasks);
        for at in (0..tasks).step_by(LANES) {
            self.sample_bsdfs(transport, depth, at);
        }
        self.next_rays.close(self.next_paths.len);
    }

    /// One group of BSDF samples.
    #[inline(never)]
    fn sample_bsdfs(&mut self, transport: &Transport, depth: u32, at: usize) {
        let task = self.task_group(transport, at, depth);
        let vertices = &self.vertices;
        let rows = &task.rows;
        let [lobe, u, v, survive] = samples(task.seed, task.index, bsdf_set(depth));
        let sample = vertices.lobes(rows).sample(vertices.ns.load(rows), vertices.wo.load(rows), [lobe, u, v]);
        let weighted_pdf = task.rates[2] * sample.pdf;
        let ng = vertices.ng.load(rows);
        let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
        let mut alive = mask(task.len)
            & sample.pdf.simd_gt(F::ZERO)
            & ng.dot(sample.wi).simd_gt(F::ZERO)
            & beta.max_element().simd_gt(F::ZERO)
            & beta.is_finite();
        if depth + 1 >= ROULETTE_DEPTH {
            let keep = (beta.max_element() * F::splat(ROULETTE_GAIN)).fast_min(F::ONE);
            alive &= keep.simd_gt(survive);
            beta = beta * keep.simd_ge(F::ONE).select(F::ONE, F::ONE / keep);
        }
        let survivors = Survivors::of(alive);
        let slot = survivors.compress_bits(task.slot);
        let child = if depth == 0 {
            let next = self.children.len() as u32;
            let index = survivors.compress_bits(task.index);
            let new = slot.as_array()[..survivors.len].iter().zip(index.as_array());
            self.children.extend(new.map(|(&slot, &index)| Child { slot, index, indirect: Vec3::ZERO }));
            U::splat(next) + U::from(NUMBERS)
        } else {
            survivors.compress_bits(task.child)
        };
        self.next_rays.put(
            self.next_paths.len,
            survivors.compress_v3(vertices.origin.load(rows)),
            survivors.compress_v3(sample.wi),
            F::splat(f32::INFINITY),
            survivors.compress_bits(keys(task.seed, task.index, bsdf_set(depth))),
        );
        let path = [slot, survivors.compress_bits(task.index), child, survivors.compress_bits(task.seed)];
        let (beta, normal) = (survivors.compress_v3(beta), survivors.compress_v3(ng));
        self.next_paths.push(survivors.len, beta, normal, survivors.compress(weighted_pdf), path);
    }
}
