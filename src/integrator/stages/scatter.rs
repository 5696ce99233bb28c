//! BSDF sampling: the next rays.

use glam::Vec3;

use super::bsdf_set;
use crate::integrator::PixelPlan;
use crate::integrator::wave::{Child, PathState, Wave};
use crate::lanes::{F, LANES, first};

/// Segments after which Russian roulette begins.
const ROULETTE_DEPTH: u32 = 3;

impl Wave {
    /// Fills the next rays for the vertices at `depth`.
    pub(in crate::integrator) fn scatter(&mut self, plan: &[PixelPlan], depth: u32) {
        self.next_rays.clear();
        self.next_states.clear();
        self.tasks.clear();
        for vertex in 0..self.vertices.len() as u32 {
            if depth > 0 {
                self.tasks.push((vertex, self.vertices.index[vertex as usize]));
                continue;
            }
            let slot = &self.slots[self.vertices.slot[vertex as usize] as usize];
            for k in 0..u32::from(slot.bsdf) {
                self.tasks.push((vertex, slot.first_bsdf + k));
            }
        }
        for at in (0..self.tasks.len()).step_by(LANES) {
            self.sample_bsdfs(plan, depth, at);
        }
    }

    /// One group of BSDF samples.
    #[inline]
    fn sample_bsdfs(&mut self, plan: &[PixelPlan], depth: u32, at: usize) {
        let task = self.task_group(at);
        let vertices = &self.vertices;
        let rows = &task.rows;
        let [lobe, u, v, survive] = self.numbers(&task, bsdf_set(depth)).map(F::from);
        let sample = vertices.lobes(rows).sample(vertices.ns.load(rows), vertices.wo.load(rows), [lobe, u, v]);
        let (_, a_b) = self.samples_a_path(plan, depth, &task.vertex);
        let weighted_pdf = a_b * sample.pdf;
        let mut beta = vertices.beta.load(rows) * sample.value * (F::ONE / weighted_pdf);
        let mut alive = first(task.len)
            & sample.pdf.simd_gt(F::ZERO)
            & vertices.ng.load(rows).dot(sample.wi).simd_gt(F::ZERO)
            & beta.max_element().simd_gt(F::ZERO)
            & beta.is_finite();
        if depth + 1 >= ROULETTE_DEPTH {
            let keep = beta.max_element().fast_min(F::ONE);
            alive &= keep.simd_gt(survive);
            beta = beta * keep.simd_ge(F::ONE).select(F::ONE, F::ONE / keep);
        }
        let mut alive = alive.to_bitmask();
        let origin = vertices.origin.load(rows);
        while alive != 0 {
            let lane = alive.trailing_zeros() as usize;
            alive &= alive - 1;
            let vertex = task.vertex[lane] as usize;
            let (slot, index) = (self.vertices.slot[vertex], task.index[lane]);
            let child = if depth == 0 {
                self.children.push(Child { slot, index, indirect: Vec3::ZERO });
                self.children.len() as u32 - 1
            } else {
                self.vertices.child[vertex]
            };
            let key = self.slots[slot as usize].sequence.key(index, bsdf_set(depth));
            self.next_rays.push(origin.lane(lane), sample.wi.lane(lane), 0.0, f32::INFINITY, key);
            let weighted_pdf = weighted_pdf.as_array()[lane];
            self.next_states.push(PathState { beta: beta.lane(lane), weighted_pdf, slot, index, child });
        }
    }
}
