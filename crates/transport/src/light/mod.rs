//! Where light comes from: the environment, emissive triangles, punctual lights; and which one to sample. Each kind is
//! a file and answers the same three questions:
//!
//! | kind | emitted radiance | sample | pdf |
//! | --- | --- | --- | --- |
//! | [`environment`] | [`radiance_pdf`](EnvironmentSampler::radiance_pdf) | [`sample`](EnvironmentSampler::sample) | with the radiance: one look-up |
//! | [`area`] | [`radiance`](AreaLights::radiance) | [`sample`](AreaLights::sample) | [`pdf`](AreaLights::pdf) |
//! | [`punctual`] | none: no ray meets them | [`sample`](punctual::sample) | 0 |

pub mod area;
pub mod environment;
pub mod learned;
pub mod punctual;
pub mod tree;

use std::sync::Arc;

use glam::Vec3;

use crate::lanes::{F, LANES, V3};
use crate::scene::Scene;
pub use area::AreaLights;
pub use environment::{Density, EnvironmentSampler};
pub use learned::{LearnedLights, LightSampleRecord};
pub use punctual::PunctualSample;

/// Directions toward lights that have extent: what MIS weighs against BSDF sampling.
#[derive(Debug, Clone, Copy)]
pub struct LightSamples {
    /// Unit, toward the light.
    pub wi: V3,
    /// To the light; infinite for the environment.
    pub distance: F,
    /// Radiance along `wi` if nothing is in the way.
    pub radiance: V3,
    /// Per solid angle, over all lights of its kind (environment, area lights); 0 where a light's back is seen (such a sample
    /// counts, with value zero).
    pub pdf: F,
    /// Which one, of area lights.
    pub emitter: [u32; LANES],
}

/// What light samples are drawn by.
#[derive(Debug, Clone, Copy, Default)]
pub struct Drawing<'a> {
    /// Those toward the environment.
    pub density: Density,
    /// What is known of area lights besides their power and place.
    pub learned: Option<&'a LearnedLights>,
}

/// All the lights of a scene. The environment is one technique and the area lights, emissive triangles chosen by a light tree,
/// are another; or both are one, whose samples draw the kind. Punctual lights are apart: BSDF sampling never finds them.
#[derive(Debug)]
pub struct Lights {
    /// The environment, if it shines.
    pub environment: Option<Arc<EnvironmentSampler>>,
    /// Emissive triangles, if any.
    pub area: Option<AreaLights>,
    /// Are there lights without size?
    pub punctual: bool,
    /// The part of light samples that goes to the environment where each draws: between 0.1 and 0.9 by power if there
    /// are area lights too, else 1 or 0.
    pub environment_probability: f32,
}

/// The bits of a mask that is set in all lanes.
const ALL: u32 = (1 << LANES) - 1;

impl Lights {
    /// Gathers a scene's lights. `radius` is the scene's bounding radius in metres: it turns the environment's
    /// radiance into a power that can be compared with the area lights'.
    pub fn new(scene: &Scene, radius: f32) -> Self {
        Self::after(scene, radius, None)
    }

    /// As [`Self::new`], with the tables of an earlier scene's environment where it is the same.
    pub fn after(scene: &Scene, radius: f32, previous: Option<(&Scene, &Self)>) -> Self {
        let known = previous.and_then(|(earlier, lights)| {
            let same = earlier.environment.as_ref()?.is(scene.environment.as_ref()?);
            lights.environment.clone().filter(|_| same)
        });
        let make = || scene.environment.as_ref().and_then(EnvironmentSampler::new).map(Arc::new);
        let environment = known.or_else(make);
        let area = AreaLights::new(scene);
        let environment_probability = match (&environment, &area) {
            (Some(environment), Some(area)) => {
                // Power through the scene's bounding disk against emitted power; neither is ever left out.
                let env = environment.mean_luminance() * std::f32::consts::PI * radius * radius;
                let emitters = area.power();
                (env / (env + emitters)).clamp(0.1, 0.9)
            }
            (Some(_), None) => 1.0,
            _ => 0.0,
        };
        Self { environment, area, punctual: !scene.lights.is_empty(), environment_probability }
    }

    /// Is there a light with extent?
    pub fn has_extent(&self) -> bool {
        self.environment.is_some() || self.area.is_some()
    }

    /// Are there both an environment and area lights?
    pub fn two_kinds(&self) -> bool {
        self.environment.is_some() && self.area.is_some()
    }

    /// Draws for each of eight samples whether it goes to the environment (the mask), by `choice` in [0, 1), and what is
    /// left of `choice` for the area lights.
    #[inline]
    pub fn draw_kind(&self, choice: F) -> (F, F) {
        let q = self.environment_probability;
        let toward = choice.simd_lt(F::splat(q));
        let left = (choice - F::splat(q)) * F::splat(1.0 / (1.0 - q));
        (toward, left.fast_max(F::ZERO).fast_min(F::splat(crate::sampling::warp::ONE_MINUS)))
    }

    /// Draws directions, by `drawing`, toward the environment where the mask `toward_environment` is set (all of them, if that is all there is), else
    /// toward area lights as seen from `p` with normals `n` as for [`tree::LightTree::sample`]: of three numbers in [0, 1), one chooses the
    /// light and two the point on it; `at` the scene and times in [0, 1] of the shutter.
    #[inline]
    pub fn sample(
        &self,
        at: (&Scene, F),
        (p, n): (V3, V3),
        (toward_environment, drawing): (F, Drawing),
        numbers: [F; 3],
    ) -> LightSamples {
        let mask = toward_environment.to_bitmask();
        let Drawing { density, learned } = drawing;
        let [_, u, v] = numbers;
        match (&self.environment, &self.area) {
            (Some(environment), None) => environment.sample(u, v, density),
            (Some(environment), Some(_)) if mask == ALL => environment.sample(u, v, density),
            (None, Some(area)) => area.sample(at, (p, n), learned, numbers),
            (Some(_), Some(area)) if mask == 0 => area.sample(at, (p, n), learned, numbers),
            (Some(environment), Some(area)) => {
                let a = environment.sample(u, v, density);
                let b = area.sample(at, (p, n), learned, numbers);
                LightSamples {
                    wi: V3::select(toward_environment, a.wi, b.wi),
                    distance: toward_environment.select(a.distance, b.distance),
                    radiance: V3::select(toward_environment, a.radiance, b.radiance),
                    pdf: toward_environment.select(a.pdf, b.pdf),
                    emitter: b.emitter,
                }
            }
            (None, None) => {
                let (wi, radiance) = (V3::splat(Vec3::Z), V3::splat(Vec3::ZERO));
                LightSamples { wi, distance: F::ONE, radiance, pdf: F::ZERO, emitter: [0; LANES] }
            }
        }
    }

    /// Radiance of the environment from `wi`, and the density per solid angle with which [`sample`](Self::sample) draws
    /// those directions from it by `drawing`.
    #[inline]
    pub fn environment(&self, wi: V3, drawing: Drawing) -> (V3, F) {
        match &self.environment {
            Some(environment) => environment.radiance_pdf(wi, drawing.density),
            None => (V3::splat(Vec3::ZERO), F::ZERO),
        }
    }

    /// Density per solid angle with which [`sample`](Self::sample), by `drawing` at `from` (point, normal), draws direction `wi`, in
    /// which triangle `prim` of `mesh` in `instance` is `distance` away; `at` the scene and a time in [0, 1] of the shutter. Zero
    /// when that triangle is not a light.
    #[inline]
    pub fn area_pdf(
        &self,
        at: (&Scene, f32),
        from: (Vec3, Vec3),
        hit: (u32, u32, u32),
        wi: Vec3,
        distance: f32,
        drawing: Drawing,
    ) -> f32 {
        self.area.as_ref().map_or(0.0, |a| a.pdf(at, from, hit, wi, distance, drawing.learned))
    }
}
