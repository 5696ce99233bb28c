//! What a batch of rays found: emission is added to its paths, surfaces that scatter become vertices.

use glam::Vec3;

use super::contrast;
use crate::balance::{Finding, Technique};
use crate::bsdf::MetallicRoughness;
use crate::integrator::vertices::Group;
use crate::integrator::wave::{PathState, Wave};
use crate::integrator::{PixelPlan, PixelSum, Transport};
use crate::lanes::{LANES, V3};
use crate::light::area;
use crate::rays::MISS;

const NO_BSDF: MetallicRoughness =
    MetallicRoughness { diffuse: Vec3::ZERO, f0: Vec3::ZERO, f90: 0.0, layer0: 0.0, layer90: 0.0, alpha: 1.0 };

impl Wave {
    /// Sorts the rays of the batch at `depth` (0 for camera rays) into escaped and hit; fills the vertices.
    pub(in crate::integrator) fn hits(
        &mut self,
        transport: &Transport,
        plan: &[PixelPlan],
        depth: u32,
        sums: &mut [PixelSum],
    ) {
        self.escaped.clear();
        self.vertices.clear(self.states.len());
        let scatters = depth + 1 < transport.max_depth;
        let mut group = Group {
            position: [[0.0; LANES]; 3],
            ng: [[1.0; LANES]; 3],
            ns: [[1.0; LANES]; 3],
            direction: [[0.0; LANES]; 3],
            beta: [[0.0; LANES]; 3],
            stand_off: [0.0; LANES],
            bsdf: [NO_BSDF; LANES],
        };
        let mut lane = 0;
        for i in 0..self.states.len() {
            if self.hits.instance[i] == MISS {
                self.escaped.push(i as u32);
                continue;
            }
            let state = self.states[i];
            let (instance, mesh, prim) = (self.hits.instance[i], self.hits.mesh[i], self.hits.prim[i]);
            let barycentric = (self.hits.u[i], self.hits.v[i]);
            let point = transport.geometry.point(transport.scene, instance, mesh, prim, barycentric);
            let material = point.material;
            if depth == 0 {
                let slot = &mut self.slots[state.slot as usize];
                slot.covered = true;
                if transport.aovs {
                    let aovs = &mut sums[slot.pixel as usize].aovs;
                    let toward = point.ng.dot(self.rays.direction(i));
                    let normal = point.ns.normalize_or_zero() * if toward > 0.0 { -1.0 } else { 1.0 };
                    let albedo = point.base_color(transport.scene);
                    for c in 0..3 {
                        aovs.albedo[c] += albedo[c];
                        aovs.normal[c] += normal[c];
                    }
                    aovs.depth += self.hits.t[i];
                    (aovs.object, aovs.material) = (instance + 1, point.mesh.material + 1);
                }
            }
            if material.unlit {
                self.emitted(transport, plan, sums, depth, &state, point.base_color(transport.scene), 0.0);
                continue;
            }
            if material.is_emissive() {
                let direction = self.rays.direction(i);
                if material.double_sided || point.ng.dot(direction) < 0.0 {
                    let radiance = area::emission(transport.scene, point.mesh, prim, barycentric.0, barycentric.1);
                    let pdf = match depth {
                        0 => 0.0,
                        _ => transport.lights.area_pdf(instance, mesh, prim, direction, self.hits.t[i]),
                    };
                    self.emitted(transport, plan, sums, depth, &state, radiance, pdf);
                }
            }
            if !scatters {
                continue;
            }
            let bsdf = transport.materials.at(transport.scene, &point);
            if bsdf.is_black() {
                continue;
            }
            for axis in 0..3 {
                group.position[axis][lane] = point.position[axis];
                group.ng[axis][lane] = point.ng[axis];
                group.ns[axis][lane] = point.ns[axis];
                group.direction[axis][lane] = self.rays.direction[axis][i];
                group.beta[axis][lane] = state.beta[axis];
            }
            group.stand_off[lane] = point.stand_off;
            group.bsdf[lane] = bsdf;
            self.vertices.slot.push(state.slot);
            self.vertices.index.push(state.index);
            self.vertices.child.push(state.child);
            lane += 1;
            if lane == LANES {
                self.vertices.put(self.vertices.len() - LANES, &group);
                lane = 0;
            }
        }
        if lane > 0 {
            self.vertices.put(self.vertices.len() - lane, &group);
        }
        self.escapes(transport, plan, depth, sums);
    }

    /// Light from infinity along the rays that hit nothing.
    fn escapes(&mut self, transport: &Transport, plan: &[PixelPlan], depth: u32, sums: &mut [PixelSum]) {
        if transport.lights.environment.is_none() {
            return;
        }
        for at in (0..self.escaped.len()).step_by(LANES) {
            let mut rows = [self.escaped[at]; LANES];
            let n = LANES.min(self.escaped.len() - at);
            rows[..n].copy_from_slice(&self.escaped[at..at + n]);
            let direction = [0, 1, 2].map(|axis| rows.map(|row| self.rays.direction[axis][row as usize]));
            let (radiance, pdf) = transport.lights.environment(V3::from_arrays(direction));
            for (lane, &row) in rows[..n].iter().enumerate() {
                let state = self.states[row as usize];
                let pdf = if depth == 0 { 0.0 } else { pdf.as_array()[lane] };
                self.emitted(transport, plan, sums, depth, &state, radiance.lane(lane), pdf);
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
        let slot = &mut self.slots[state.slot as usize];
        let pixel = slot.pixel as usize;
        let weight = if light_pdf > 0.0 {
            let a_l = if depth == 1 { plan[pixel].a_path[0] } else { 1.0 };
            transport.heuristic.weight(state.weighted_pdf, a_l * light_pdf)
        } else {
            1.0
        };
        let found = state.beta * radiance * weight;
        if !found.is_finite() || found == Vec3::ZERO {
            return;
        }
        slot.radiance += found;
        if depth <= 1 {
            slot.direct += found;
        } else {
            self.children[state.child as usize].indirect += found;
        }
        if depth == 1 && transport.learns {
            let plan = &plan[pixel];
            let r = contrast(light_pdf, state.weighted_pdf / plan.a_path[1]);
            sums[pixel].moments.add(found, r, plan.share());
            if self.record {
                let finding =
                    Finding { pixel: plan.place, technique: Technique::Bsdf, index: state.index, r, radiance: found };
                self.findings.push(finding);
            }
        }
    }
}
