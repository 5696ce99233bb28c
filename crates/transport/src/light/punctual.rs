//! Punctual lights without a size: only light sampling finds them, so they need no MIS weight.

use glam::Vec3;

use super::samples::ROUNDING;
use super::{LightProposal, LightSampleContext, LightSamples};
use crate::color::luminance;
use crate::lanes::{F, V3, eight};
use crate::scene::{LightKey, PunctualKind, PunctualLight};

/// A sample of a punctual light at a point.
#[derive(Debug, Clone, Copy)]
pub struct PunctualSample {
    /// Unit direction toward the light, world space.
    pub wi: Vec3,
    /// Distance to the light in metres; infinite for a directional one.
    pub distance: f32,
    /// Irradiance at normal incidence, linear RGB, divided by the probability of the choice of this light.
    pub irradiance: Vec3,
    pub light: usize,
}

impl PunctualSample {
    /// End of its shadow ray from `p`, [`LightSamples::end`].
    #[inline]
    pub fn end(&self, p: Vec3) -> f32 {
        let light = p + self.wi * self.distance;
        match self.distance.is_finite() {
            true => self.distance - ROUNDING * p.abs().max(light.abs()).max_element().max(self.distance),
            false => self.distance,
        }
    }
}

/// The sample where no light reaches the point.
const DARK: PunctualSample = PunctualSample { wi: Vec3::Y, distance: 0.0, irradiance: Vec3::ZERO, light: 0 };

/// Samples one punctual light for each point, with the first of three random numbers in [0, 1). Nothing is learned about them:
/// `_proposal` has no effect.
#[inline]
pub fn sample(context: &LightSampleContext, _proposal: &LightProposal, [choice, ..]: [F; 3]) -> LightSamples {
    let samples = eight(|lane| {
        let (choice, time) = (choice.as_array()[lane], context.time.as_array()[lane]);
        choose(&context.scene.lights, context.p.lane(lane), choice, time).unwrap_or(DARK)
    });
    LightSamples {
        wi: V3::gather(samples.map(|sample| sample.wi)),
        distance: F::from(samples.map(|sample| sample.distance)),
        end: F::from(eight(|lane| samples[lane].end(context.p.lane(lane)))),
        radiance: V3::gather(samples.map(|sample| sample.irradiance)),
        pdf: F::from(samples.map(|sample| f32::from(u8::from(sample.distance > 0.0)))),
        emitter: samples.map(|sample| sample.light as u32),
    }
}

/// Chooses one of the `lights` without a size in proportion to its unoccluded irradiance at `p`, by `choice` in [0, 1), at a time in [0, 1] of the
/// shutter. `None` if none reaches `p`.
#[inline]
pub fn choose(lights: &[PunctualLight], p: Vec3, choice: f32, time: f32) -> Option<PunctualSample> {
    let points = || lights.iter().enumerate().filter(|(_, light)| light.size == 0.0);
    let total: f32 = points().map(|(_, l)| luminance(irradiance(l, p, time).2)).sum();
    if total <= 0.0 || !total.is_finite() {
        return None;
    }
    let mut rest = choice * total;
    let mut chosen = None;
    for (index, light) in points() {
        let (wi, distance, e) = irradiance(light, p, time);
        let weight = luminance(e);
        if weight > 0.0 {
            chosen = Some(PunctualSample { wi, distance, irradiance: e * (total / weight), light: index });
            if rest < weight {
                break;
            }
        }
        rest -= weight;
    }
    chosen
}

/// Direction to the light, distance in metres, and irradiance at normal incidence, after KHR_lights_punctual: candela over
/// squared distance, times 1 − (distance/range)⁴, which is 0 at the range. The edge of a spot fades by the square of a linear
/// ramp in the cosine.
#[inline]
pub fn irradiance(light: &PunctualLight, p: Vec3, time: f32) -> (Vec3, f32, Vec3) {
    let LightKey { intensity, position, direction } = light.at(time);
    if light.kind == PunctualKind::Directional {
        return (-direction, f32::INFINITY, intensity);
    }
    let to = position - p;
    let distance2 = to.length_squared();
    if distance2 == 0.0 {
        return (Vec3::Y, 0.0, Vec3::ZERO);
    }
    let distance = distance2.sqrt();
    let wi = to / distance;
    (wi, distance, intensity * (left(light, direction, wi, distance) / distance2))
}

/// What is left of a light with an axis `direction` at this distance in metres, in the direction of a spot whose opposite is `wi`.
#[inline]
pub(super) fn left(light: &PunctualLight, direction: Vec3, wi: Vec3, distance: f32) -> f32 {
    let fade = match light.kind {
        PunctualKind::Spot { inner, outer } => {
            let (cos_inner, cos_outer) = (inner.cos(), outer.cos());
            let cos = -direction.dot(wi);
            let ramp = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-3)).clamp(0.0, 1.0);
            ramp * ramp
        }
        _ => 1.0,
    };
    fade * (1.0 - (distance / light.range).powi(4)).max(0.0)
}
