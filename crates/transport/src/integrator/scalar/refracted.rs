//! Light of single paths through bodies of smooth glass by refraction.

use glam::Vec3;

use super::{EventKind, Ray, Tracer, Vertex, key};
use crate::bsdf::Lobe;
use crate::integrator::back_faces::MIRROR_PDF;
use crate::integrator::manifold::{Candidate, History, Start, Walker, is_behind_glass, manifold_set};
use crate::integrator::path_states::clamp_contribution;
use crate::integrator::stages::lights::SHADOW_END;
use crate::lanes::{F, V3};
use crate::rays::{HitBatch, RayBatch, RayOrder};
use crate::sampling::hash;

impl Tracer<'_> {
    /// Do walks find the emission that a ray has hit?
    pub(super) fn is_connected(&self, ray: &Ray, hits: &HitBatch) -> bool {
        let hit = (hits.instance[0], hits.mesh[0], hits.prim[0]);
        let at = (ray.origin + ray.direction * hits.t[0], ray.key, ray.time);
        self.transport.connects() && ray.history.is_found(self.transport, &mut Walker::default(), hit, at)
    }

    /// The history of a ray that leaves a vertex.
    pub(super) fn history_after(&self, vertex: &Vertex, pdf: f32, ray: (Vec3, Vec3)) -> History {
        if !self.transport.connects() {
            return History::default();
        }
        vertex.history.after(pdf, [vertex.is_smooth(), vertex.transmits && vertex.ng.dot(ray.1) < 0.0], ray)
    }

    /// Light samples of a vertex through bodies of glass.
    pub(super) fn refracted_light(&mut self, vertex: &Vertex, depth: u32, index: u32) -> Vec3 {
        let t = self.transport;
        let numbers = self.sequence.sample(index, manifold_set(depth)).map(F::splat);
        let key = hash(key(self.seed, index, manifold_set(depth)));
        let from = V3::splat(vertex.origin);
        let mut sum = Vec3::ZERO;
        for [candidate, ..] in Candidate::eight(t, from, F::splat(vertex.time), numbers) {
            let Some(candidate) = candidate else { continue };
            let seen = vertex.spawn_ray(candidate.wi);
            let mut probe = RayBatch::default();
            probe.push(seen.origin, candidate.wi, 0.0, candidate.distance * SHADOW_END, key);
            probe.time.extend(t.geometry.moves.then_some(vertex.time));
            let mut hits = HitBatch::default();
            t.rays.closest_hits(&probe, RayOrder::Incoherent, &mut hits);
            if !seen.allowed || vertex.is_smooth() || !is_behind_glass(t, hits.mesh[0]) {
                continue;
            }
            let start = Start { origin: seen.origin, medium: seen.medium, key, time: vertex.time };
            let Some((wi, light)) = candidate.light(t, &mut Walker::default(), &start) else { continue };
            let (value, mut pdf) = vertex.bsdf.eval_pdf(V3::splat(vertex.ns), V3::splat(vertex.wo), V3::splat(wi));
            if let Some(mixture) = self.mixture(vertex) {
                pdf = mixture.pdf(V3::splat(wi), pdf);
            }
            let spawned = vertex.spawn_ray(wi);
            let allowed = spawned.allowed && spawned.origin == seen.origin;
            let radiance = vertex.beta * value.lane(0) * light;
            if allowed && pdf.as_array()[0] < MIRROR_PDF && radiance.is_finite() {
                let (radiance, _) = clamp_contribution(radiance, t.limits[(depth > 0) as usize]);
                let (toward, distance, occluded) = ("light through glass", candidate.distance, false);
                self.report(depth, EventKind::LightSample { toward, wi, distance, radiance, occluded });
                sum += radiance;
            }
        }
        sum
    }
}
