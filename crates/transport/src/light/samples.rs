//! Samples of lights.

use super::environment::Density;
use super::learned::LearnedLights;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::warp::ONE_MINUS_EPSILON;
use crate::scene::Scene;

/// Eight points that light samples are taken for.
#[derive(Debug, Clone, Copy)]
pub struct LightSampleContext<'a> {
    pub scene: &'a Scene,
    /// Times in [0, 1] of the shutter.
    pub time: F,
    /// The points, world space.
    pub p: V3,
    /// How far the origins of shadow rays may be from the points, in metres; not 0 on surfaces that transmit.
    pub origin_error: F,
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
    /// Ends of shadow rays in metres: before the light by the bound on what rounding may move it, so that it does not occlude
    /// itself, and everything before it does.
    pub end: F,
    /// Radiance along `wi` without occlusion, linear RGB. Of punctual lights: irradiance at normal incidence over the
    /// probability of the choice.
    pub radiance: V3,
    /// Densities per solid angle, over all lights of the same kind (environment, or area lights and lights with a size); 1 for punctual lights. 0 where
    /// the sample is on a side that does not emit, or where no punctual light reaches the point: such a sample counts with
    /// value zero.
    pub pdf: F,
    /// Indices of the area lights or punctual lights, the latter with the bit [`SIZED`] if they have a size; without meaning for
    /// the environment.
    pub emitter: [u32; LANES],
}

/// Tells the index of a light with a size from that of an area light.
pub const SIZED: u32 = 1 << 31;

impl LightSamples {
    /// `a` where the mask is set, else `b`.
    #[inline(always)]
    pub fn select(mask: F, a: &Self, b: &Self) -> Self {
        let bits = mask.to_bitmask();
        Self {
            wi: V3::select(mask, a.wi, b.wi),
            distance: mask.select(a.distance, b.distance),
            end: mask.select(a.end, b.end),
            radiance: V3::select(mask, a.radiance, b.radiance),
            pdf: mask.select(a.pdf, b.pdf),
            emitter: eight(|lane| if bits >> lane & 1 == 1 { a.emitter[lane] } else { b.emitter[lane] }),
        }
    }
}

/// Bound on the rounding error of a point on a surface, relative to the largest coordinate that it was computed from: that of
/// its interpolation, of instance transforms, and of ray queries. Rays begin and end so far from surfaces (Wächter and Binder,
/// "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems, 2019, for the idea; the number by tests).
pub const ROUNDING: f32 = 16.0 * f32::EPSILON;

/// What light samples are drawn by.
#[derive(Debug, Clone, Copy, Default)]
pub struct LightProposal<'a> {
    /// The probability in [0, 1] of the environment where each light sample chooses its kind at random.
    pub environment_probability: f32,
    pub density: Density,
    /// Learned selection of area lights; `None` for the light tree alone.
    pub learned: Option<&'a LearnedLights>,
}

impl LightProposal<'_> {
    /// Chooses the kind of light for eight samples by `choice` in [0, 1): the mask of those that go to the environment, and the
    /// remapped `choice` in [0, 1) for the area lights.
    #[inline]
    pub fn draw_kind(&self, choice: F) -> (F, F) {
        let q = self.environment_probability;
        let toward = choice.simd_lt(F::splat(q));
        let remapped = (choice - F::splat(q)) * F::splat(1.0 / (1.0 - q));
        (toward, remapped.fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON)))
    }
}
