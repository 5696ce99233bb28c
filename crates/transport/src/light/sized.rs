//! Lights with a size: point and spot lights that are spheres, directional lights that are discs at infinity. From a point, each
//! is a cone of directions with one radiance, so that it gives the irradiance of the same light without a size. The fade and the
//! range of a light are those at its centre. A point inside a sphere sees its radiance in all directions.
//!
//! A light is chosen in proportion to its radiance times its solid angle, then a direction uniformly in the cone (Pharr, Jakob
//! and Humphreys 2023, *Physically Based Rendering*, 6.2.4). So within the cone of a light the density is its radiance over the
//! sum of these products, all as luminance. Lights are not occluders, and camera rays do not see them.

use std::f32::consts::PI;

use glam::Vec3;

use super::punctual;
use super::samples::{ROUNDING, SIZED};
use super::{LightSampleContext, LightSamples};
use crate::color::luminance;
use crate::lanes::{F, V3, eight};
use crate::sampling::warp::{self, ONE_MINUS_EPSILON};
use crate::scene::{LightKey, PunctualKind, PunctualLight, Scene};

/// The lights of a scene that have a size.
#[derive(Debug)]
pub struct SizedLights {
    lights: Vec<SizedLight>,
    /// Luminance of the emitted power.
    power: f32,
}

/// A light with a size, and what rays that may hit it are told from others by.
#[derive(Debug)]
struct SizedLight {
    /// Index in [`Scene::lights`].
    light: usize,
    /// Centre of a sphere around all places of a sphere in metres, or unit direction toward the middle of all those of a disc.
    middle: Vec3,
    /// Radius of that sphere in metres, or cosine of the half angle of a cone around all places of the disc.
    extent: f32,
    is_disc: bool,
}

/// A light as a cone of directions, seen from a point.
#[derive(Debug, Clone, Copy)]
struct Cone {
    /// Index in [`Scene::lights`].
    light: u32,
    /// Unit direction toward the centre.
    axis: Vec3,
    /// Distance to the centre in metres; infinite for a disc.
    distance: f32,
    /// Squared radius in metres.
    radius2: f32,
    /// One minus the cosine of the half angle: 2 inside a sphere.
    one_minus_cos: f32,
    /// Linear RGB, without occlusion.
    radiance: Vec3,
    /// Luminance of the radiance times `one_minus_cos`; 0 if the light does not reach the point's side.
    weight: f32,
}

/// A light that a ray hits.
#[derive(Debug, Clone, Copy)]
pub struct SizedHit {
    /// Index in [`Scene::lights`].
    pub light: u32,
    /// Radiance along the ray without occlusion, linear RGB.
    pub radiance: Vec3,
    /// Density per solid angle with which [`SizedLights::sample`] samples this light in the ray's direction.
    pub pdf: f32,
    /// Distance to the sphere in metres: to where the ray leaves it, from inside; infinite for a disc.
    pub distance: f32,
    /// End of its shadow ray, [`LightSamples::end`].
    pub end: f32,
}

/// Smallest squared sine of the half angle. Smaller lights are dimmer and as large as this: densities and radiances stay finite
/// as 32-bit floats, and directions distinct.
const MIN_SIN2: f32 = 1e-12;
/// Rounding error, relative to the squared distance, of the squared distance of a ray from a light's centre.
const FIRST_TEST_ERROR: f32 = 4e-6;

impl Cone {
    /// A light seen from `p` with normal `n` (zero where light from both sides counts), at a time in [0, 1] of the shutter; `None`
    /// if it gives no light there.
    #[inline]
    fn new(scene: &Scene, index: usize, (p, n): (Vec3, Vec3), time: f32) -> Option<Self> {
        let light = &scene.lights[index];
        let LightKey { intensity, position, direction } = light.at(time);
        let (axis, distance, radius2, sin2, radiance) = if light.kind == PunctualKind::Directional {
            let sin2 = light.size.sin().powi(2).max(MIN_SIN2);
            (-direction, f32::INFINITY, 0.0, sin2, intensity / (PI * sin2))
        } else {
            let to = position - p;
            let distance2 = to.length_squared();
            let distance = distance2.sqrt();
            let axis = to.normalize_or(-direction);
            let radius2 = light.size.powi(2).max(MIN_SIN2 * distance2);
            let left = punctual::left(light, direction, axis, distance);
            (axis, distance, radius2, radius2 / distance2, intensity * (left / (PI * radius2)))
        };
        let inside = sin2 >= 1.0 && distance.is_finite();
        let one_minus_cos = if inside { 2.0 } else { sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt()) };
        let below = !inside && n != Vec3::ZERO && n.dot(axis) <= -sin2.sqrt();
        let weight = luminance(radiance) * one_minus_cos;
        let weight = if below || !weight.is_finite() { 0.0 } else { weight };
        (weight > 0.0).then_some(Self { light: index as u32, axis, distance, radius2, one_minus_cos, radiance, weight })
    }

    /// Distance to the light in a direction whose angle with the axis has a cosine of 1 − `a`, and the end of a shadow ray from
    /// `p`.
    #[inline]
    fn ends(&self, p: Vec3, a: f32) -> [f32; 2] {
        if self.distance == f32::INFINITY {
            return [f32::INFINITY; 2];
        }
        let half_chord = (self.radius2 - self.distance * self.distance * a * (2.0 - a)).max(0.0).sqrt();
        let sign = if self.one_minus_cos == 2.0 { 1.0 } else { -1.0 };
        let t = (self.distance * (1.0 - a) + sign * half_chord).max(0.0);
        let size = p.abs().max_element() + self.distance + self.radius2.sqrt();
        [t, (t - ROUNDING * size).max(0.0)]
    }
}

impl SizedLights {
    /// The lights of a scene that have a size; `None` if there are none. `radius` is the scene's bounding radius in metres.
    pub fn new(scene: &Scene, radius: f32) -> Option<Self> {
        let mut power = 0.0;
        let lights: Vec<_> = (0..scene.lights.len())
            .filter(|index| scene.lights[*index].size > 0.0)
            .map(|index| {
                let light = &scene.lights[index];
                let area = match light.kind {
                    PunctualKind::Directional => PI * radius * radius,
                    PunctualKind::Point => 4.0 * PI,
                    PunctualKind::Spot { outer, .. } => 2.0 * PI * (1.0 - outer.cos()),
                };
                power += luminance(light.intensity).min(1e15) * area.min(1e15);
                SizedLight::new(index, light)
            })
            .collect();
        (!lights.is_empty()).then_some(Self { lights, power })
    }

    /// Luminance of the emitted power.
    pub fn power(&self) -> f32 {
        self.power
    }

    /// The lights seen from a point that give it light.
    fn cones(&self, scene: &Scene, (p, n): (Vec3, Vec3), time: f32) -> impl Iterator<Item = Cone> {
        self.lights.iter().filter_map(move |own| Cone::new(scene, own.light, (p, n), time))
    }

    /// Chooses a light by a number in [0, 1), and the sum of all weights; `None` if none reaches the point.
    fn choose(&self, scene: &Scene, from: (Vec3, Vec3), time: f32, mut choice: f32) -> Option<(Cone, f32)> {
        let (mut chosen, mut sum) = (None, 0.0);
        for cone in self.cones(scene, from, time) {
            // Each light replaces those before it by its share in the sum so far, and the number is rescaled.
            sum += cone.weight;
            let share = cone.weight / sum;
            let replaces = choice < share;
            choice = if replaces { choice / share } else { (choice - share) / (1.0 - share) }.min(ONE_MINUS_EPSILON);
            if replaces {
                chosen = Some(cone);
            }
        }
        Some((chosen?, sum))
    }

    /// Samples directions toward the lights by three numbers in [0, 1).
    #[inline(never)]
    pub fn sample(&self, context: &LightSampleContext, [choice, u, v]: [F; 3]) -> LightSamples {
        #[rustfmt::skip]
        const DARK: Cone = Cone {
            light: 0, axis: Vec3::Y, distance: 1.0, radius2: 0.0, one_minus_cos: 1.0, radiance: Vec3::ZERO, weight: 0.0,
        };
        let chosen = eight(|lane| {
            let (choice, time) = (choice.as_array()[lane], context.time.as_array()[lane]);
            let from = (context.p.lane(lane), context.n.lane(lane));
            self.choose(context.scene, from, time, choice).unwrap_or((DARK, 1.0))
        });
        let a = u * F::from(chosen.map(|(cone, _)| cone.one_minus_cos));
        let (sin, (s, c)) = ((a * (F::splat(2.0) - a)).fast_max(F::ZERO).sqrt(), warp::sin_cos_turns(v));
        let axis = V3::gather(chosen.map(|(cone, _)| cone.axis));
        let (x, y) = warp::frames(axis);
        let wi = axis * (F::ONE - a) + (x * c + y * s) * sin;
        let ends = eight(|lane| chosen[lane].0.ends(context.p.lane(lane), a.as_array()[lane]));
        let distance = F::from(ends.map(|[distance, _]| distance));
        let end = (F::from(ends.map(|[_, end]| end)) - context.origin_error).fast_max(F::ZERO);
        let radiance = V3::gather(chosen.map(|(cone, _)| cone.radiance));
        let pdf = F::from(chosen.map(|(cone, sum)| density(&cone, sum)));
        LightSamples { wi, distance, end, radiance, pdf, emitter: chosen.map(|(cone, _)| SIZED | cone.light) }
    }

    /// The lights that eight rays may hit, as a bitmask of the rays for each light.
    #[inline(never)]
    pub fn candidates(&self, origin: V3, direction: V3, mut found: impl FnMut(usize, u32)) {
        for (index, light) in self.lights.iter().enumerate() {
            let middle = V3::splat(light.middle);
            let may_hit = if light.is_disc {
                direction.dot(middle).simd_ge(F::splat(light.extent))
            } else {
                let to = middle - origin;
                let (along, distance2) = (to.dot(direction), to.length_squared());
                let extent2 = F::splat(light.extent * light.extent);
                let near = extent2 + distance2 * F::splat(FIRST_TEST_ERROR);
                let ahead = along.simd_gt(F::ZERO) | distance2.simd_le(near);
                ahead & (distance2 - along * along).simd_le(near)
            };
            let rays = may_hit.to_bitmask();
            if rays != 0 {
                found(index, rays);
            }
        }
    }

    /// What a ray `from` a point and normal, of a unit direction and a time in [0, 1] of the shutter, sees of the light of this
    /// number among those that have a size; `None` if it does not hit it.
    pub fn hit(&self, scene: &Scene, index: usize, from: (Vec3, Vec3), direction: Vec3, time: f32) -> Option<SizedHit> {
        let cone = Cone::new(scene, self.lights[index].light, from, time)?;
        // Accurate for small angles: the squared length of the difference of two unit vectors is 2 (1 − cos).
        let a = 0.5 * (direction - cone.axis).length_squared();
        if a > cone.one_minus_cos {
            return None;
        }
        let sum = self.cones(scene, from, time).map(|cone| cone.weight).sum();
        let [distance, end] = cone.ends(from.0, a);
        Some(SizedHit { light: cone.light, radiance: cone.radiance, pdf: density(&cone, sum), distance, end })
    }

    /// Number of the lights that have a size.
    pub fn count(&self) -> usize {
        self.lights.len()
    }
}

/// Density per solid angle of directions within the cone of a light, where all weights add up to `sum`.
fn density(cone: &Cone, sum: f32) -> f32 {
    let pdf = cone.weight / (cone.one_minus_cos * sum * 2.0 * PI);
    if pdf.is_finite() { pdf } else { 0.0 }
}

impl SizedLight {
    fn new(index: usize, light: &PunctualLight) -> Self {
        let keys = if light.motion.is_empty() { vec![light.key()] } else { light.motion.clone() };
        let (first, n) = (&keys[0], keys.len() as f32);
        let is_disc = light.kind == PunctualKind::Directional;
        if is_disc {
            let middle = -keys.iter().map(|key| key.direction).sum::<Vec3>().normalize_or(first.direction);
            let turned = keys.iter().map(|key| middle.angle_between(-key.direction)).fold(0.0, f32::max);
            // A margin for rounding.
            let extent = (turned + light.size + 1e-3).min(PI).cos() - 1e-6;
            return Self { light: index, middle, extent, is_disc };
        }
        let middle = keys.iter().map(|key| key.position / n).sum::<Vec3>();
        let moved = keys.iter().map(|key| middle.distance(key.position)).fold(0.0, f32::max);
        Self { light: index, middle, extent: moved + light.size, is_disc }
    }
}
