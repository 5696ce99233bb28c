//! Samples of lights.

use crate::lanes::{F, LANES, V3};
use crate::scene::Scene;

/// Eight points that light samples are taken for.
#[derive(Debug, Clone, Copy)]
pub struct LightSampleContext<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Times in [0, 1] of the shutter.
    pub time: F,
    /// The points, world space.
    pub p: V3,
    /// Unit normals, as for [`LightTree::sample`](super::tree::LightTree::sample): zero where light from both sides counts.
    pub n: V3,
}

/// Eight light samples. MIS weights those of lights that have an extent against BSDF samples.
#[derive(Debug, Clone, Copy)]
pub struct LightSamples {
    /// Unit directions toward the light, world space.
    pub wi: V3,
    /// Distances to the light in metres; infinite for the environment and for directional lights.
    pub distance: F,
    /// Radiance along `wi` without occlusion, linear RGB. Of punctual lights: irradiance at normal incidence over the
    /// probability of the choice.
    pub radiance: V3,
    /// Densities per solid angle, over all lights of the same kind (environment or area lights); 1 for punctual lights. 0 where
    /// the sample is on a side that does not emit, or where no punctual light reaches the point: such a sample counts with
    /// value zero.
    pub pdf: F,
    /// Indices of the area lights or punctual lights, or the environment's regions where the proposal has any.
    pub emitter: [u32; LANES],
}
