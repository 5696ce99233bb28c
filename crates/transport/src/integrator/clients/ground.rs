//! The ground that catches shadows: a horizontal plane that only camera rays see, from above, and that takes part in nothing
//! else. What it shows is the fraction of its light that the scene takes: alpha is 1 − E/E₀ where E is the irradiance with the
//! scene in between and E₀ without it, both from the same light samples, so that a point that sees all lights has exactly 0.
//! A pixel's alpha is the ratio of two sums over its paths, which is consistent: its bias falls like one over their number.

use glam::Vec3;

use crate::color::luminance;
use crate::film::GroundSums;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions;
use crate::integrator::data::queues::{PathRays, ShadowRays};
use crate::integrator::events::PathEvents;
use crate::integrator::through::thin_walls::ThinWalls;
use crate::lanes::{F, LANES, Survivors, U, V3, eight, mask};
use crate::light::{LightSampleContext, LightSamples, punctual};
use crate::rays::{HitBatch, MISS};
use crate::sampling::{hashes, keys, samples};

/// Light samples of a point on the ground: a path that ends there costs little else.
const SAMPLES: u32 = 4;

/// Columns of [`Ground`], kept by its owner.
#[derive(Debug, Default)]
pub struct GroundColumns {
    shadows: ShadowRays,
    walls: ThinWalls,
    /// Luminance of each shadow ray's contribution if unoccluded.
    light: Vec<f32>,
    /// Camera rays that end on the ground: their row, and the point.
    points: Vec<(u32, Vec3)>,
}

/// Adds the light of the ground to the sums of pixels, one entry per task.
#[derive(Debug)]
pub struct Ground<'a> {
    /// Height of the plane in metres (world y). No surface lies below.
    pub height: f32,
    pub sums: &'a mut [GroundSums],
    pub columns: &'a mut GroundColumns,
}

impl PathEvents for Ground<'_> {
    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if at.depth > 0 {
            return;
        }
        self.find(rays, hits);
        for (row, _) in &self.columns.points {
            self.sums[at.pixel(rays.path[*row as usize])].paths += 1;
        }
        self.sample(at, rays);
        let GroundColumns { shadows, walls, light, .. } = &mut *self.columns;
        if shadows.len == 0 {
            return;
        }
        walls.occlude(at.transport, shadows);
        for (row, &light) in light.iter().enumerate() {
            let sums = &mut self.sums[at.pixel(shadows.path[row])];
            let left = if shadows.occluded[row] { 0.0 } else { luminance(shadows.radiance.get(row)).min(light) };
            sums.light += f64::from(light);
            sums.taken += f64::from(light - left);
        }
    }
}

impl Ground<'_> {
    /// Finds the points of rays from above that meet nothing else.
    fn find(&mut self, rays: &PathRays, hits: &HitBatch) {
        self.columns.points.clear();
        for row in (0..rays.len).filter(|row| hits.mesh[*row] == MISS) {
            let (origin, direction) = (rays.rays.origin(row), rays.rays.direction(row));
            let t = (self.height - origin.y) / direction.y;
            let point = origin + direction * t;
            let inside = t >= rays.rays.tnear[row] && t <= rays.rays.tfar[row];
            if origin.y > self.height && direction.y < 0.0 && point.is_finite() && inside {
                self.columns.points.push((row as u32, point.with_y(self.height)));
            }
        }
    }

    /// Fills the shadow rays of the points, [`SAMPLES`] times: a sample of the environment or the area lights, and one of the
    /// punctual lights.
    /// The densities are those that need no BSDF samples.
    fn sample(&mut self, at: &WaveContext, rays: &PathRays) {
        let GroundColumns { shadows, light, points, .. } = &mut *self.columns;
        let transport = at.transport;
        let lights = transport.lights;
        shadows.open(transport, 2 * SAMPLES as usize * points.len());
        light.clear();
        let up = V3::splat(Vec3::Y);
        for (packet, sample) in points.chunks(LANES).flat_map(|packet| (0..SAMPLES).map(move |sample| (packet, sample)))
        {
            let lane_of = |lane: usize| packet[lane.min(packet.len() - 1)];
            let column = |column: &[u32]| U::from(eight(|lane| column[lane_of(lane).0 as usize]));
            let (path, seed, index) = (column(&rays.path), column(&rays.seed), column(&rays.index));
            let index = index * U::splat(SAMPLES) + U::splat(sample);
            let time = F::from(eight(|lane| rays.rays.time(lane_of(lane).0 as usize)));
            let point = V3::gather(eight(|lane| lane_of(lane).1));
            let key = hashes(keys(seed, index, dimensions::light(0)));
            let [choice, u, v, other] = samples(seed, index, dimensions::light(0));
            let mut push = |LightSamples { wi, end, .. }: LightSamples, radiance: V3, valid: F| {
                let radiance = radiance * wi.y;
                let bright = wi.y.simd_gt(F::ZERO) & radiance.max_element().simd_gt(F::ZERO) & radiance.is_finite();
                let survivors = Survivors::of(mask(packet.len()) & valid & bright);
                shadows.set_bodies(&survivors, U::MAX, U::ZERO);
                let first = shadows.len;
                shadows.push(&survivors, (point, wi), end, (key, time), radiance, [path, U::ZERO, U::ZERO, U::ZERO]);
                light.extend((first..shadows.len).map(|row| luminance(shadows.radiance.get(row))));
            };
            let context = LightSampleContext { scene: transport.scene, time, p: point, origin_error: F::ZERO, n: up };
            if lights.has_extent() {
                let proposal = lights.proposal();
                let (to_environment, choice) = proposal.draw_kind(choice);
                let sample = lights.sample(&context, to_environment, &proposal, [choice, u, v]);
                let q = F::splat(proposal.environment_probability);
                let pdf = to_environment.select(q, F::ONE - q) * sample.pdf;
                push(sample, sample.radiance * (F::ONE / pdf), pdf.simd_gt(F::ZERO));
            }
            if lights.punctual {
                let sample = punctual::sample(&context, &lights.proposal(), [other, F::ZERO, F::ZERO]);
                push(sample, sample.radiance, sample.pdf.simd_gt(F::ZERO));
            }
        }
        shadows.close();
    }
}
