//! Where light comes from: the environment, emissive triangles, punctual lights; and which one to sample.

pub mod area;
pub mod environment;
pub mod punctual;

use glam::Vec3;

use crate::scene::Scene;
pub use area::{AreaLights, EmissiveTriangle};
pub use environment::EnvironmentSampler;
pub use punctual::PunctualSample;

/// A direction toward a light that has extent: what MIS weighs against BSDF sampling.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// Unit, toward the light.
    pub wi: Vec3,
    /// To the light; infinite for the environment.
    pub distance: f32,
    /// Radiance along `wi` if nothing is in the way.
    pub radiance: Vec3,
    /// Per solid angle, over all lights with extent, > 0.
    pub pdf: f32,
}

/// All the lights of a scene. Lights with extent are one technique, chosen between by power; punctual lights are
/// another, which BSDF sampling can never find.
#[derive(Debug)]
pub struct Lights {
    /// The environment, if it shines.
    pub environment: Option<EnvironmentSampler>,
    /// Emissive triangles, if any.
    pub area: Option<AreaLights>,
    /// Are there lights without size?
    pub punctual: bool,
    /// Chance of choosing the environment when there are both.
    environment_share: f32,
}

impl Lights {
    /// Gathers a scene's lights. `radius` is the scene's bounding radius in metres: it turns the environment's
    /// radiance into a power that can be compared with the lamps'.
    pub fn new(scene: &Scene, radius: f32) -> Self {
        let environment = scene.environment.as_ref().and_then(EnvironmentSampler::new);
        let area = AreaLights::new(scene);
        let environment_share = match (&environment, &area) {
            (Some(environment), Some(area)) => {
                // Power through the scene's bounding disk against emitted power; neither is ever left out.
                let sky = environment.mean_luminance() * std::f32::consts::PI * radius * radius;
                let lamps = area.power();
                (sky / (sky + lamps)).clamp(0.1, 0.9)
            }
            (Some(_), None) => 1.0,
            _ => 0.0,
        };
        Self { environment, area, punctual: !scene.lights.is_empty(), environment_share }
    }

    /// Is there a light with extent?
    pub fn has_extent(&self) -> bool {
        self.environment.is_some() || self.area.is_some()
    }

    /// Draws a direction toward a light as seen from `p`: `choice` picks the light, (`u`, `v`) the point on it, all in
    /// [0, 1). `None` when the light's back is seen (then the sample counts with value zero).
    #[inline]
    pub fn sample(&self, scene: &Scene, p: Vec3, choice: f32, u: f32, v: f32) -> Option<LightSample> {
        let q = self.environment_share;
        if choice < q {
            let mut sample = self.environment.as_ref()?.sample(u, v)?;
            sample.pdf *= q;
            Some(sample)
        } else {
            let choice = ((choice - q) / (1.0 - q)).min(crate::sampling::warp::ONE_MINUS);
            let mut sample = self.area.as_ref()?.sample(scene, p, choice, u, v)?;
            sample.pdf *= 1.0 - q;
            Some(sample)
        }
    }

    /// Density per solid angle with which [`sample`](Self::sample) draws the direction `wi` from the environment.
    #[inline]
    pub fn environment_pdf(&self, wi: Vec3) -> f32 {
        self.environment.as_ref().map_or(0.0, |e| e.pdf(wi) * self.environment_share)
    }

    /// Density per solid angle with which [`sample`](Self::sample), at a point that sees triangle `prim` of `mesh` in
    /// `instance` at `distance` along `wi`, draws that direction. Zero when that triangle is not a light.
    #[inline]
    pub fn area_pdf(&self, instance: u32, mesh: u32, prim: u32, wi: Vec3, distance: f32) -> f32 {
        self.area.as_ref().map_or(0.0, |a| a.pdf(instance, mesh, prim, wi, distance) * (1.0 - self.environment_share))
    }
}
