//! The shading stage: what a batch of hits emits, which shadow rays and which next rays follow.

use glam::Vec3;

use super::Transport;
use super::geometry::SurfacePoint;
use super::wave::{PathState, Pending, PixelPlan, PixelSum, Wave};
use crate::bsdf::MetallicRoughness;
use crate::light::punctual;
use crate::rays::MISS;
use crate::sampling::{PixelSequence, hash};

/// Segments after which Russian roulette begins.
const ROULETTE_DEPTH: u32 = 3;
/// Shadow rays toward a point end this share before it.
const SHADOW_END: f32 = 1.0 - 1e-4;

/// Where a ray of the batch came from and where it hit: what a shading step needs of its vertex.
struct Vertex<'a> {
    state: PathState,
    surface: SurfacePoint<'a>,
    bsdf: MetallicRoughness,
    origin: Vec3,
    wo: Vec3,
    sequence: PixelSequence,
    depth: u32,
}

impl Wave {
    /// Shades all hits of the batch at `depth` (0 for camera rays); fills the shadow rays and the next rays.
    pub(super) fn shade(&mut self, transport: &Transport, plan: &[PixelPlan], depth: u32, sums: &mut [PixelSum]) {
        self.next_rays.clear();
        self.next_states.clear();
        for i in 0..self.states.len() {
            let state = self.states[i];
            let direction = Vec3::new(self.rays.direction[0][i], self.rays.direction[1][i], self.rays.direction[2][i]);
            if self.hits.instance[i] == MISS {
                if let Some(environment) = &transport.lights.environment {
                    let pdf = if depth == 0 { 0.0 } else { transport.lights.environment_pdf(direction) };
                    self.emitted(transport, plan, sums, depth, &state, environment.radiance(direction), pdf);
                }
                continue;
            }
            let (instance, mesh, prim) = (self.hits.instance[i], self.hits.mesh[i], self.hits.prim[i]);
            let barycentric = (self.hits.u[i], self.hits.v[i]);
            let wo = -direction;
            let surface = transport.geometry.surface(transport.scene, instance, mesh, prim, barycentric, wo);
            let slot = &mut self.slots[state.slot as usize];
            if depth == 0 {
                slot.covered = true;
                if transport.aovs {
                    let aovs = &mut sums[slot.pixel as usize].aovs;
                    let (albedo, normal) = (surface.base_color(transport.scene), surface.frame[2]);
                    for c in 0..3 {
                        aovs.albedo[c] += albedo[c];
                        aovs.normal[c] += normal[c];
                    }
                    aovs.depth += self.hits.t[i];
                    (aovs.object, aovs.material) = (instance + 1, surface.mesh.material + 1);
                }
            }
            if surface.material.unlit {
                self.emitted(transport, plan, sums, depth, &state, surface.base_color(transport.scene), 0.0);
                continue;
            }
            if surface.shines() {
                let radiance =
                    crate::light::area::emission(transport.scene, surface.mesh, prim, barycentric.0, barycentric.1);
                let pdf = if depth == 0 {
                    0.0
                } else {
                    transport.lights.area_pdf(instance, mesh, prim, direction, self.hits.t[i])
                };
                self.emitted(transport, plan, sums, depth, &state, radiance, pdf);
            }
            if depth + 1 >= transport.max_depth {
                continue;
            }
            let bsdf = MetallicRoughness::new(&surface.parameters(transport.scene));
            if bsdf.is_black() {
                continue;
            }
            let slot = &self.slots[state.slot as usize];
            let (sequence, samples) = (slot.sequence, *slot);
            let vertex = Vertex { state, origin: surface.origin(), surface, bsdf, wo, sequence, depth };
            if transport.lights.punctual {
                self.sample_punctual(transport, &vertex);
            }
            if depth == 0 {
                let counts = &plan[samples.pixel as usize].counts;
                let a = [counts.light_a_path(), counts.bsdf_a_path()];
                for k in 0..u32::from(samples.light) {
                    self.sample_light(transport, &vertex, samples.first_light + k, a);
                }
                for k in 0..u32::from(samples.bsdf) {
                    self.sample_bsdf(&vertex, samples.first_bsdf + k, a[1]);
                }
            } else {
                if transport.lights.has_extent() {
                    self.sample_light(transport, &vertex, state.index, [1.0, 1.0]);
                }
                self.sample_bsdf(&vertex, state.index, 1.0);
            }
        }
    }

    /// Light that a ray of the batch found: weighed against having been sampled with density `light_pdf`.
    #[inline]
    #[allow(clippy::too_many_arguments)]
    fn emitted(
        &mut self,
        transport: &Transport,
        plan: &[PixelPlan],
        sums: &mut [PixelSum],
        depth: u32,
        state: &PathState,
        radiance: Vec3,
        light_pdf: f32,
    ) {
        if radiance == Vec3::ZERO {
            return;
        }
        let slot = &mut self.slots[state.slot as usize];
        let pixel = slot.pixel as usize;
        let weight = if light_pdf > 0.0 {
            let a_l = if depth == 1 { plan[pixel].counts.light_a_path() } else { 1.0 };
            transport.heuristic.weight(state.weighted_pdf, a_l * light_pdf)
        } else {
            1.0
        };
        let found = state.beta * radiance * weight;
        if !found.is_finite() {
            return;
        }
        slot.radiance += found;
        if depth <= 1 {
            slot.direct += found;
        } else {
            self.children[state.child as usize].indirect += found;
        }
        if depth == 1 && transport.learns {
            let counts = &plan[pixel].counts;
            let bsdf_pdf = state.weighted_pdf / counts.bsdf_a_path();
            let (w, r) = observation(found, light_pdf, bsdf_pdf, counts.alpha());
            sums[pixel].moments.add(f64::from(w), f64::from(r));
        }
    }

    /// One light sample: a shadow ray that carries its weighed contribution. `a` is samples a path of each technique.
    #[inline]
    fn sample_light(&mut self, transport: &Transport, vertex: &Vertex, index: u32, a: [f32; 2]) {
        let [choice, u, v, _] = vertex.sequence.sample(index, light_set(vertex.depth));
        let Some(light) = transport.lights.sample(transport.scene, vertex.origin, choice, u, v) else { return };
        if vertex.surface.ng.dot(light.wi) <= 0.0 {
            return;
        }
        let wi = vertex.surface.to_local(light.wi);
        let (value, bsdf_pdf) = vertex.bsdf.eval_pdf(vertex.surface.to_local(vertex.wo), wi);
        let weighted_pdf = a[0] * light.pdf;
        let weight = transport.heuristic.weight(weighted_pdf, a[1] * bsdf_pdf);
        let radiance = vertex.state.beta * value * light.radiance * (weight / weighted_pdf);
        if !radiance.is_finite() || radiance.max_element() <= 0.0 {
            return;
        }
        let (w, r) = if vertex.depth == 0 && transport.learns {
            observation(radiance, light.pdf, bsdf_pdf, a[0] / (a[0] + a[1]))
        } else {
            (0.0, 0.0)
        };
        self.shadow(
            vertex,
            index,
            light.wi,
            light.distance,
            Pending { radiance, slot: vertex.state.slot, child: vertex.state.child, w, r },
        );
    }

    /// One of the lights without size: nothing to weigh, nothing to learn.
    #[inline]
    fn sample_punctual(&mut self, transport: &Transport, vertex: &Vertex) {
        let [.., choice] = vertex.sequence.sample(vertex.state.index, light_set(vertex.depth));
        let Some(light) = punctual::sample(&transport.scene.lights, vertex.surface.position, choice) else { return };
        if vertex.surface.ng.dot(light.wi) <= 0.0 {
            return;
        }
        let wi = vertex.surface.to_local(light.wi);
        let (value, _) = vertex.bsdf.eval_pdf(vertex.surface.to_local(vertex.wo), wi);
        let radiance = vertex.state.beta * value * light.irradiance;
        if !radiance.is_finite() || radiance.max_element() <= 0.0 {
            return;
        }
        let pending = Pending { radiance, slot: vertex.state.slot, child: vertex.state.child, w: 0.0, r: 0.0 };
        self.shadow(vertex, vertex.state.index, light.wi, light.distance, pending);
    }

    #[inline]
    fn shadow(&mut self, vertex: &Vertex, index: u32, wi: Vec3, distance: f32, pending: Pending) {
        let key = hash(vertex.sequence.key(index, light_set(vertex.depth)));
        self.shadow_rays.push(vertex.origin, wi, 0.0, distance * SHADOW_END, key);
        self.pending.push(pending);
    }

    /// One BSDF sample: the next ray. `a_b` is BSDF samples a path.
    #[inline]
    fn sample_bsdf(&mut self, vertex: &Vertex, index: u32, a_b: f32) {
        let set = bsdf_set(vertex.depth);
        let [lobe, u, v, survive] = vertex.sequence.sample(index, set);
        let Some(sample) = vertex.bsdf.sample(vertex.surface.to_local(vertex.wo), lobe, u, v) else { return };
        let direction = vertex.surface.to_world(sample.wi);
        if vertex.surface.ng.dot(direction) <= 0.0 {
            return;
        }
        let weighted_pdf = a_b * sample.pdf;
        let mut beta = vertex.state.beta * sample.value / weighted_pdf;
        if !beta.is_finite() || beta.max_element() <= 0.0 {
            return;
        }
        if vertex.depth + 1 >= ROULETTE_DEPTH {
            let keep = beta.max_element().min(1.0);
            if survive >= keep {
                return;
            }
            beta /= keep;
        }
        let child = if vertex.depth == 0 {
            self.children.push(super::wave::Child { slot: vertex.state.slot, indirect: Vec3::ZERO });
            self.children.len() as u32 - 1
        } else {
            vertex.state.child
        };
        let key = vertex.sequence.key(index, set);
        self.next_rays.push(vertex.origin, direction, 0.0, f32::INFINITY, key);
        self.next_states.push(PathState { beta, weighted_pdf, slot: vertex.state.slot, index, child });
    }
}

/// A direct contribution `found` = g/(a_l p_l + a_b p_b), as the balance sees it: W = Σ_c Y_c Z_c and r.
#[inline]
fn observation(found: Vec3, light_pdf: f32, bsdf_pdf: f32, alpha: f32) -> (f32, f32) {
    // With counts that add up to 2N: Z = 2 · found, Y = Z · p_α/p_½; in ratios, so that no pdf overflows.
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = 2.0 * (alpha * q_l + (1.0 - alpha) * q_b);
    (4.0 * found.length_squared() * y_over_z, q_l - q_b)
}

/// The set of dimensions of light samples at a depth.
#[inline]
fn light_set(depth: u32) -> u32 {
    1 + 2 * depth
}

/// The set of dimensions of BSDF samples at a depth.
#[inline]
fn bsdf_set(depth: u32) -> u32 {
    2 + 2 * depth
}
