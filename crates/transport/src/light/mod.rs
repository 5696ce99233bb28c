//! Lights: the environment, area lights (emissive triangles) and punctual lights, and the choice among them. Each kind is a
//! file. All `sample` functions have one signature: [`LightSampleContext`], [`LightProposal`] and three random numbers make
//! [`LightSamples`].
//!
//! | kind | emitted radiance | sample | pdf |
//! | --- | --- | --- | --- |
//! | [`environment`] | [`radiance_pdf`](EnvironmentSampler::radiance_pdf) | [`sample`](EnvironmentSampler::sample) | with the radiance, by one look-up |
//! | [`area`] | [`radiance`](AreaLights::radiance) | [`sample`](AreaLights::sample) | [`pdf`](AreaLights::pdf) |
//! | [`sized`]: punctual lights with a size | [`hit`](SizedLights::hit) | [`sample`](SizedLights::sample) | with the radiance |
//! | [`punctual`], without a size | none: rays cannot hit them | [`sample`](punctual::sample) | 0 |

pub mod area;
pub mod environment;
pub mod learn;
pub mod learned;
pub mod punctual;
pub mod samples;
pub mod sized;
pub mod tree;

use std::sync::Arc;

use glam::Vec3;

use crate::lanes::{F, LANES, V3};
use crate::sampling::warp::ONE_MINUS_EPSILON;
use crate::scene::Primitive;
use crate::scene::Scene;
pub use area::AreaLights;
pub use environment::{Density, EnvironmentSampler};
pub use learn::LightSampleRecord;
pub use learned::LearnedLights;
pub use punctual::PunctualSample;
pub use samples::{LightProposal, LightSampleContext, LightSamples};
pub use sized::{SizedHit, SizedLights};

/// All lights of a scene. Environment and area lights are either two techniques, or one technique whose samples choose the
/// kind at random. Punctual lights with a size count as area lights. Those without are separate: BSDF sampling never finds them.
#[derive(Debug)]
pub struct Lights {
    /// The environment, if it is not black.
    pub environment: Option<Arc<EnvironmentSampler>>,
    pub area: Option<AreaLights>,
    /// Punctual lights with a size, if any.
    pub sized: Option<SizedLights>,
    /// Whether there are punctual lights without one.
    pub punctual: bool,
    /// The probability, among samples of area lights, of emissive triangles: by power, between 0.1 and 0.9 if there are lights with
    /// a size too, otherwise 1 or 0.
    triangle_probability: f32,
    /// The probability of the environment by power: between 0.1 and 0.9 if there are area lights too, otherwise 1 or 0.
    environment_probability: f32,
}

/// The bitmask of a mask that is set in all lanes.
const ALL_LANES: u32 = (1 << LANES) - 1;

impl Lights {
    /// The lights of a scene, with the environment's tables of an earlier scene if the environment is the same. `radius` is the
    /// scene's bounding radius in metres, which turns the environment's radiance into a power to compare with that of the area
    /// lights.
    pub fn after(scene: &Scene, radius: f32, previous: Option<(&Scene, &Self)>) -> Self {
        let reused = previous.and_then(|(earlier, lights)| {
            let same = earlier.environment.as_ref()?.is_same(scene.environment.as_ref()?);
            lights.environment.clone().filter(|_| same)
        });
        let make = || scene.environment.as_ref().and_then(EnvironmentSampler::new).map(Arc::new);
        let environment = reused.or_else(make);
        let (area, sized) = (AreaLights::new(scene), SizedLights::new(scene, radius));
        let [triangles, of_sized] =
            [area.as_ref().map_or(0.0, AreaLights::power), sized.as_ref().map_or(0.0, SizedLights::power)];
        let environment_probability = match &environment {
            Some(environment) if area.is_some() || sized.is_some() => {
                // Power through the scene's bounding disk against emitted power; both kinds are always sampled.
                let env = environment.mean_luminance() * std::f32::consts::PI * radius * radius;
                let emitters = triangles + of_sized;
                (env / (env + emitters)).clamp(0.1, 0.9)
            }
            Some(_) => 1.0,
            None => 0.0,
        };
        let triangle_probability = match (&area, &sized) {
            (Some(_), Some(_)) => (1.0 / (1.0 + of_sized / triangles)).clamp(0.1, 0.9),
            (Some(_), None) => 1.0,
            (None, _) => 0.0,
        };
        let punctual = scene.lights.iter().any(|light| light.size == 0.0);
        Self { environment, area, sized, punctual, triangle_probability, environment_probability }
    }

    /// Whether any light has an extent.
    pub fn has_extent(&self) -> bool {
        self.environment.is_some() || self.has_area()
    }

    /// Whether there are area lights: emissive triangles, or punctual lights with a size.
    fn has_area(&self) -> bool {
        self.area.is_some() || self.sized.is_some()
    }

    /// Whether there are both an environment and area lights.
    pub fn two_kinds(&self) -> bool {
        self.environment.is_some() && self.has_area()
    }

    /// The proposal without anything learned: by radiance, power and the light tree.
    pub fn proposal(&self) -> LightProposal<'static> {
        LightProposal { environment_probability: self.environment_probability, ..Default::default() }
    }

    /// Samples directions by `proposal`: toward the environment where the mask `toward_environment` is set, otherwise toward area
    /// lights. If only one kind exists, the mask has no effect. The first of three random `numbers` in [0, 1) chooses the light,
    /// the others the point on it.
    #[inline]
    pub fn sample(
        &self,
        context: &LightSampleContext,
        toward_environment: F,
        proposal: &LightProposal,
        numbers: [F; 3],
    ) -> LightSamples {
        let mask = toward_environment.to_bitmask();
        match &self.environment {
            Some(environment) if mask == ALL_LANES || !self.has_area() => environment.sample(proposal, numbers),
            Some(environment) if mask != 0 => {
                let a = environment.sample(proposal, numbers);
                LightSamples::select(toward_environment, &a, &self.sample_area(context, proposal, numbers))
            }
            _ => self.sample_area(context, proposal, numbers),
        }
    }

    /// Samples directions toward area lights.
    #[inline(always)]
    fn sample_area(&self, context: &LightSampleContext, proposal: &LightProposal, numbers: [F; 3]) -> LightSamples {
        match (&self.area, &self.sized) {
            (Some(area), None) => area.sample(context, proposal, numbers),
            (None, Some(sized)) => sized.sample(context, numbers),
            (Some(area), Some(sized)) => {
                let (own, [choice, u, v]) = (F::splat(self.triangle_probability), numbers);
                let to_triangles = choice.simd_lt(own);
                let rest = to_triangles.select(choice / own, (choice - own) / (F::ONE - own));
                let numbers = [rest.fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON)), u, v];
                let [a, b] = [area.sample(context, proposal, numbers), sized.sample(context, numbers)];
                let samples = LightSamples::select(to_triangles, &a, &b);
                LightSamples { pdf: samples.pdf * to_triangles.select(own, F::ONE - own), ..samples }
            }
            (None, None) => {
                let (wi, radiance) = (V3::splat(Vec3::Z), V3::splat(Vec3::ZERO));
                LightSamples { wi, distance: F::ONE, end: F::ONE, radiance, pdf: F::ZERO, emitter: [0; LANES] }
            }
        }
    }

    /// What a ray sees of a light with a size, by [`SizedLights::hit`]; the density is that of [`sample`](Self::sample).
    #[inline]
    pub fn sized_hit(
        &self,
        scene: &Scene,
        index: usize,
        from: (Vec3, Vec3),
        direction: Vec3,
        time: f32,
    ) -> Option<SizedHit> {
        let hit = self.sized.as_ref()?.hit(scene, index, from, direction, time)?;
        Some(SizedHit { pdf: hit.pdf * (1.0 - self.triangle_probability), ..hit })
    }

    /// Radiance (linear RGB) of the environment from `wi`, and the density per solid angle with which [`sample`](Self::sample)
    /// samples these directions by `proposal`.
    #[inline]
    pub fn environment(&self, wi: V3, proposal: &LightProposal) -> (V3, F) {
        match &self.environment {
            Some(environment) => environment.radiance_pdf(wi, proposal.density),
            None => (V3::splat(Vec3::ZERO), F::ZERO),
        }
    }

    /// Density per solid angle with which [`sample`](Self::sample) samples direction `wi` by `proposal` at `from` (point, normal).
    /// `hit` is the triangle at `distance` metres along `wi`; `at` is the scene and a time in [0, 1] of the
    /// shutter. Zero if the triangle is not a light.
    #[inline]
    pub fn area_pdf(
        &self,
        at: (&Scene, f32),
        from: (Vec3, Vec3),
        hit: Primitive,
        wi: Vec3,
        distance: f32,
        proposal: &LightProposal,
    ) -> f32 {
        let pdf = self.area.as_ref().map_or(0.0, |a| a.pdf(at, from, hit, wi, distance, proposal.learned));
        pdf * self.triangle_probability
    }
}
