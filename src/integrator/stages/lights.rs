//! Light sampling: shadow rays that carry what they bring if nothing is in their way.

use super::{DRAWN, ENVIRONMENT, Technique, light_set, observations};
use crate::integrator::Transport;
use crate::integrator::wave::Wave;
use crate::lanes::{F, LANES, Survivors, V3, are, mask};
use crate::light::punctual;
use crate::sampling::{hashes, keys, samples};

/// Shadow rays toward a point end this share before it.
const SHADOW_END: f32 = 1.0 - 1e-4;

impl Wave {
    /// Fills the shadow rays for the vertices at `depth`.
    pub(in crate::integrator) fn lights(&mut self, transport: &Transport, depth: u32, observed: bool) {
        let tasks = self.set_tasks(Technique::Light, depth);
        let punctual = if transport.lights.punctual { self.vertices.len() } else { 0 };
        self.shadow_rays.open(tasks + punctual);
        self.pending.open(tasks + punctual);
        if transport.lights.has_extent() {
            for at in (0..tasks).step_by(LANES) {
                self.sample_lights(transport, depth, at, observed);
            }
        }
        for at in (0..punctual).step_by(LANES) {
            self.sample_punctual(transport, depth, at);
        }
        self.shadow_rays.close(self.pending.len);
    }

    /// One group of light samples.
    #[inline(never)]
    fn sample_lights(&mut self, transport: &Transport, depth: u32, at: usize, observed: bool) {
        let task = self.task_group(transport, at, depth);
        let [choice, u, v, _] = samples(task.seed, task.index, light_set(depth));
        let vertices = &self.vertices;
        let rows = &task.rows;
        let origin = vertices.origin.load(rows);
        let ng = vertices.ng.load(rows);
        let [a_env, a_area, a_b] = task.rates;
        let (drawn_environment, left) = transport.lights.draw_kind(choice);
        let draws = are(task.kind, DRAWN);
        let toward_environment = are(task.kind, ENVIRONMENT) | (draws & drawn_environment);
        let choice = draws.select(left, choice);
        let light = transport.lights.sample(transport.scene, (origin, ng), toward_environment, choice, u, v);
        let (value, bsdf_pdf) = vertices.lobes(rows).eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), light.wi);
        let weighted_pdf = toward_environment.select(a_env, a_area) * light.pdf;
        let weight = transport.heuristic.weights(weighted_pdf, a_b * bsdf_pdf);
        let radiance = vertices.beta.load(rows) * value * light.radiance * (weight / weighted_pdf);
        let alive = mask(task.len)
            & light.pdf.simd_gt(F::ZERO)
            & ng.dot(light.wi).simd_gt(F::ZERO)
            & radiance.max_element().simd_gt(F::ZERO)
            & radiance.is_finite();
        let (w, r) = if depth == 0 && observed {
            let a_l = a_env + a_area;
            observations(radiance, weighted_pdf / a_l, bsdf_pdf, a_l / (a_l + a_b))
        } else {
            (F::ZERO, F::ZERO)
        };
        let survivors = Survivors::of(alive);
        self.shadow_rays.put(
            self.pending.len,
            survivors.compress_v3(origin),
            survivors.compress_v3(light.wi),
            survivors.compress(light.distance * F::splat(SHADOW_END)),
            survivors.compress_bits(hashes(keys(task.seed, task.index, light_set(depth)))),
        );
        // Light of first surfaces has no child: its place is the sample's index.
        let child = if depth == 0 { task.index } else { task.child };
        self.pending.push(&survivors, radiance, [task.slot, child], [w, r]);
    }

    /// One of the lights without size for each of eight vertices: nothing to weigh, nothing to learn.
    #[inline(never)]
    fn sample_punctual(&mut self, transport: &Transport, depth: u32, at: usize) {
        let task = self.vertex_group(transport, at);
        let [.., choice] = samples(task.seed, task.index, light_set(depth));
        let vertices = &self.vertices;
        let rows = &task.rows;
        let (origin, ng) = (vertices.origin.load(rows), vertices.ng.load(rows));
        let position = origin - ng * crate::lanes::load(&vertices.origin_offset, rows);
        let lights: [_; LANES] = std::array::from_fn(|lane| {
            let choice = choice.as_array()[lane];
            punctual::sample(&transport.scene.lights, position.lane(lane), choice).unwrap_or(punctual::DARK)
        });
        let wi = V3::gather(lights.map(|l| l.wi));
        let (value, _) = vertices.lobes(rows).eval_pdf(vertices.ns.load(rows), vertices.wo.load(rows), wi);
        let radiance = vertices.beta.load(rows) * value * V3::gather(lights.map(|l| l.irradiance));
        let alive = mask(task.len)
            & ng.dot(wi).simd_gt(F::ZERO)
            & radiance.max_element().simd_gt(F::ZERO)
            & radiance.is_finite();
        let survivors = Survivors::of(alive);
        self.shadow_rays.put(
            self.pending.len,
            survivors.compress_v3(origin),
            survivors.compress_v3(wi),
            survivors.compress(F::from(lights.map(|l| l.distance * SHADOW_END))),
            survivors.compress_bits(hashes(keys(task.seed, task.index, light_set(depth)))),
        );
        self.pending.push(&survivors, radiance, [task.slot, task.child], [F::ZERO; 2]);
    }
}
