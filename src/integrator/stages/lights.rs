//! Light sampling: shadow rays that carry what they bring if nothing is in their way.

use super::{contrast, light_set};
use crate::bsdf::Lobes;
use crate::integrator::wave::{PUNCTUAL, Pending, Wave};
use crate::integrator::{PixelPlan, Transport};
use crate::lanes::{F, LANES, Rows, V3, first};
use crate::light::punctual;
use crate::sampling::hash;

/// Shadow rays toward a point end this share before it.
const SHADOW_END: f32 = 1.0 - 1e-4;

impl Wave {
    /// Fills the shadow rays for the vertices at `depth`.
    pub(in crate::integrator) fn lights(&mut self, transport: &Transport, plan: &[PixelPlan], depth: u32) {
        if transport.lights.has_extent() {
            self.tasks.clear();
            for vertex in 0..self.vertices.len() as u32 {
                if depth > 0 {
                    self.tasks.push((vertex, self.vertices.index[vertex as usize]));
                    continue;
                }
                let slot = &self.slots[self.vertices.slot[vertex as usize] as usize];
                for k in 0..u32::from(slot.light) {
                    self.tasks.push((vertex, slot.first_light + k));
                }
            }
            for at in (0..self.tasks.len()).step_by(LANES) {
                self.sample_lights(transport, plan, depth, at);
            }
        }
        if transport.lights.punctual {
            for vertex in 0..self.vertices.len() {
                self.sample_punctual(transport, depth, vertex);
            }
        }
    }

    /// One group of light samples.
    #[inline]
    fn sample_lights(&mut self, transport: &Transport, plan: &[PixelPlan], depth: u32, at: usize) {
        let task = self.task_group(at);
        let [choice, u, v, _] = self.numbers(&task, light_set(depth));
        let vertices = &self.vertices;
        let rows = &task.rows;
        let origin = vertices.origin.load(rows);
        let light = transport.lights.sample(transport.scene, origin, choice, u, v);
        let (value, bsdf_pdf) = vertices.lobes(rows).eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
        let (a_l, a_b) = self.samples_a_path(plan, depth, &task.vertex);
        let weighted_pdf = a_l * light.pdf;
        let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
        let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
        let alive = first(task.len)
            & light.pdf.simd_gt(F::ZERO)
            & vertices.ng.load(rows).dot(light.wi).simd_gt(F::ZERO)
            & radiance.max_element().simd_gt(F::ZERO)
            & radiance.is_finite();
        let mut alive = alive.to_bitmask();
        while alive != 0 {
            let lane = alive.trailing_zeros() as usize;
            alive &= alive - 1;
            let vertex = task.vertex[lane] as usize;
            let radiance = radiance.lane(lane);
            let r = contrast(light.pdf.as_array()[lane], bsdf_pdf.as_array()[lane]);
            let index = task.index[lane];
            let (slot, child) = (self.vertices.slot[vertex], self.vertices.child[vertex]);
            self.pending.push(Pending { radiance, slot, child, index, r });
            let key = hash(self.slots[slot as usize].sequence.key(task.index[lane], light_set(depth)));
            let tfar = light.distance.as_array()[lane] * SHADOW_END;
            self.shadow_rays.push(origin.lane(lane), light.wi.lane(lane), 0.0, tfar, key);
        }
    }

    /// One of the lights without size: nothing to weigh, nothing to learn.
    fn sample_punctual(&mut self, transport: &Transport, depth: u32, vertex: usize) {
        let vertices = &self.vertices;
        let (slot, index, child) = (vertices.slot[vertex], vertices.index[vertex], vertices.child[vertex]);
        let sequence = self.slots[slot as usize].sequence;
        let [.., choice] = sequence.sample(index, light_set(depth));
        let (origin, ng) = (vertices.origin.get(vertex), vertices.ng.get(vertex));
        let position = origin - ng * vertices.stand_off[vertex];
        let Some(light) = punctual::sample(&transport.scene.lights, position, choice) else { return };
        if ng.dot(light.wi) <= 0.0 {
            return;
        }
        let rows = Rows::Each([vertex as u32; LANES]);
        let lobes: Lobes = vertices.lobes(&rows);
        let (value, _) = lobes.eval_pdf(vertices.ns.load(&rows), vertices.wo.load(&rows), V3::splat(light.wi));
        let radiance = vertices.beta.get(vertex) * value.lane(0) * light.irradiance;
        if !radiance.is_finite() || radiance.max_element() <= 0.0 {
            return;
        }
        self.pending.push(Pending { radiance, slot, child, index: PUNCTUAL, r: 0.0 });
        let key = hash(sequence.key(index, light_set(depth)));
        self.shadow_rays.push(origin, light.wi, 0.0, light.distance * SHADOW_END, key);
    }

    /// Four numbers in [0, 1) a task.
    #[inline(always)]
    pub(super) fn numbers(&self, task: &TaskGroup, set: u32) -> [[f32; LANES]; 4] {
        let points: [[f32; 4]; LANES] = std::array::from_fn(|lane| {
            let slot = self.vertices.slot[task.vertex[lane] as usize];
            self.slots[slot as usize].sequence.sample(task.index[lane], set)
        });
        std::array::from_fn(|dimension| points.map(|point| point[dimension]))
    }

    /// a_l and a_b at some vertices: samples of each technique over paths.
    #[inline(always)]
    pub(super) fn samples_a_path(&self, plan: &[PixelPlan], depth: u32, vertex: &[u32; LANES]) -> (F, F) {
        if depth > 0 {
            return (F::ONE, F::ONE);
        }
        let a_path = vertex.map(|v| plan[self.slots[self.vertices.slot[v as usize] as usize].pixel as usize].a_path);
        (F::from(a_path.map(|a| a[0])), F::from(a_path.map(|a| a[1])))
    }

    /// The tasks from `at` on, the last one repeated in spare lanes.
    #[inline(always)]
    pub(super) fn task_group(&self, at: usize) -> TaskGroup {
        let tasks = &self.tasks[at..self.tasks.len().min(at + LANES)];
        let task: [(u32, u32); LANES] = std::array::from_fn(|lane| tasks[lane.min(tasks.len() - 1)]);
        let vertex = task.map(|t| t.0);
        let start = vertex[0];
        let consecutive = tasks.len() == LANES && vertex[LANES - 1] == start + LANES as u32 - 1;
        let rows = if consecutive { Rows::From(start as usize) } else { Rows::Each(vertex) };
        TaskGroup { vertex, index: task.map(|t| t.1), len: tasks.len(), rows }
    }
}

/// Up to eight samples to take: at which vertices, with which points of their sequences.
pub(super) struct TaskGroup {
    pub vertex: [u32; LANES],
    pub index: [u32; LANES],
    pub len: usize,
    pub rows: Rows,
}
