//! Samples of lights that have an extent.

use crate::lanes::{F, LANES, V3};

/// Eight light samples: directions toward lights that have an extent. MIS weights them against BSDF samples.
#[derive(Debug, Clone, Copy)]
pub struct LightSamples {
    /// Unit directions toward the light, world space.
    pub wi: V3,
    /// Distances to the light in metres; infinite for the environment.
    pub distance: F,
    /// Radiance along `wi` without occlusion, linear RGB.
    pub radiance: V3,
    /// Densities per solid angle, over all lights of the same kind (environment or area lights). 0 where the sample is on a
    /// side that does not emit: such a sample counts with value zero.
    pub pdf: F,
    /// Indices of the area lights.
    pub emitter: [u32; LANES],
}
