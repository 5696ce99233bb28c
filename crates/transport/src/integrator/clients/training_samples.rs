//! Training data of the guiding field: how rays were sampled, and what they found.

use glam::Vec3;
use wide::bytemuck::cast;

use crate::color::luminance;
use crate::guiding::{TrainingSample, VertexRecord};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{FoundEmission, PathEvents, ScatteredPacket, UnoccludedLight};
use crate::integrator::stages::mixture;
use crate::lanes::load_bits;
use crate::rays::HitBatch;

/// Records every scattered ray of a wave.
#[derive(Debug, Default)]
pub struct TrainingRecorder {
    /// By number of a ray behind those of the camera.
    records: Vec<ScatterRecord>,
}

/// How a ray was sampled at a surface, and what it found.
#[derive(Debug, Clone, Copy)]
struct ScatterRecord {
    /// Index of its pixel in the wave.
    pixel: u32,
    /// Record of the ray that arrived at the surface; `None` for a camera ray.
    parent: Option<u32>,
    /// Origin of the ray, world space.
    position: Vec3,
    /// Unit geometric normal on the side of `wo`.
    normal: Vec3,
    /// Unit direction of the ray.
    wi: Vec3,
    /// Luminance of the path throughput at the surface, before scattering.
    beta: f32,
    /// Is the surface diffuse enough to be guided?
    diffuse: bool,
    /// Luminance contributed by the light sample (environment or area light) at the vertex where the ray ends.
    light: f32,
    /// Roulette probabilities at the surface: of the light sample, and of continuing the path with this ray.
    roulette: [f32; 2],
    /// Densities per solid angle of the direction: of the mixture that sampled it, of the BSDF, of the field.
    pdf: [f32; 3],
    /// Density per solid angle of light samples toward the light at the end of the ray; 0 without one.
    light_pdf: f32,
    /// Radiance found at the end of the ray and, after the wave, by its descendants.
    found: Vec3,
    /// Distance to the end of the ray; infinite where it meets nothing.
    distance: f32,
}

impl TrainingRecorder {
    /// Appends a training sample for each scattered ray of the wave that found light, weighted by the divisor of its pixel, and a
    /// vertex record for each vertex beyond the first.
    pub fn append_to(
        &mut self,
        divisors: &[f32],
        training_samples: &mut impl Extend<TrainingSample>,
        vertex_records: &mut impl Extend<VertexRecord>,
    ) {
        let records = &mut self.records;
        for i in (0..records.len()).rev() {
            let ScatterRecord { parent, found, .. } = records[i];
            parent.into_iter().for_each(|parent| records[parent as usize].found += found);
        }
        for record in records.iter() {
            let ScatterRecord { position, normal, wi, beta, pdf: [pdf, bsdf_pdf, field_pdf], .. } = *record;
            let found = luminance(record.found);
            if let Some(parent) = record.parent.filter(|_| beta > 0.0) {
                // Estimates for roulette probabilities of one.
                let [light, on] = record.roulette;
                let found = [light.sqrt() * records[parent as usize].light, on * found];
                let squared_contributions = found.map(|found| (found / beta).powi(2));
                vertex_records.extend([VertexRecord { position, normal, squared_contributions }]);
            }
            if found > 0.0 && record.diffuse && beta > 0.0 && found.is_finite() {
                training_samples.extend([TrainingSample {
                    position,
                    normal,
                    wi,
                    contribution: found / beta,
                    weight: found * found / divisors[record.pixel as usize],
                    pdf,
                    bsdf_pdf,
                    field_pdf,
                    light_pdf: record.light_pdf,
                    distance: record.distance,
                }]);
            }
        }
    }

    /// The record of the ray of this number.
    fn of_ray(&mut self, at: &WaveContext, ray: u32) -> &mut ScatterRecord {
        &mut self.records[ray as usize - at.paths.len()]
    }
}

impl PathEvents for TrainingRecorder {
    fn begin(&mut self, _at: &WaveContext) {
        self.records.clear();
    }

    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if at.depth > 0 {
            (rays.first..).zip(&hits.t[..rays.len]).for_each(|(ray, t)| self.of_ray(at, ray).distance = *t);
        }
    }

    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        if at.depth > 0 {
            let record = self.of_ray(at, rays.first + found.ray);
            record.found += found.radiance;
            record.light_pdf = found.pdf[0] + found.pdf[1];
        }
    }

    #[inline(never)]
    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {
        let (rows, survivors) = (&packet.rows, &samples.survivors);
        let [position, normal, wi] = [vertices.origin.load(rows), vertices.ng.load(rows), samples.wi]
            .map(|column| survivors.compress_v3(column));
        let beta = survivors.compress(vertices.beta.load(rows).luminance()).to_array();
        let diffuse = survivors.compress_bits(cast(mixture::are_diffuse(vertices, rows))).to_array();
        let pdf = samples.pdf.map(|pdf| survivors.compress(pdf).to_array());
        let roulette = samples.roulette.map(|probability| survivors.compress(probability).to_array());
        let path = survivors.compress_bits(packet.path_ids.path).to_array();
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, rows)).to_array();
        self.records.extend((0..survivors.len).map(|lane| ScatterRecord {
            pixel: at.pixel(path[lane]) as u32,
            parent: arrived[lane].checked_sub(at.paths.len() as u32),
            position: position.lane(lane),
            normal: normal.lane(lane),
            wi: wi.lane(lane),
            beta: beta[lane],
            diffuse: diffuse[lane] != 0,
            light: 0.0,
            roulette: roulette.map(|probability| probability[lane]),
            pdf: pdf.map(|pdf| pdf[lane]),
            light_pdf: 0.0,
            found: Vec3::ZERO,
            distance: f32::INFINITY,
        }));
    }

    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        if at.depth > 0 {
            let record = self.of_ray(at, shadows.ray[found.row]);
            record.found += found.radiance;
            if shadows.kind(found.row) != LightKind::Punctual {
                record.light += luminance(found.radiance);
            }
        }
    }
}
