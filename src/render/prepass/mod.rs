//! Pre-passes: short renders of the same view at low resolution before the first pass. They decide how the environment is
//! sampled ([`compensation`]), how emissive triangles are ([`learned_lights`]) and whether paths are guided ([`guiding`]).
//! Their results depend only on the scene, the view, the seed and settings, so that every part, crop and session decides
//! alike.

pub mod compensation;
pub mod guiding;
pub mod learned_lights;
pub(super) mod low_resolution;

use std::sync::atomic::AtomicBool;

use super::RenderSettings;
use super::stats::CompensationStats;
use super::transport::transport;
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::light::{Density, LightProposal};

/// The results of a render's pre-passes.
#[derive(Debug, Default)]
pub struct Prepasses {
    /// Whether the environment is sampled by the compensated density.
    pub compensation: Option<CompensationStats>,
    /// Learned emissive triangles.
    pub learned_lights: Option<learned_lights::LearnedLightsResult>,
    /// The field of guiding.
    pub guiding: Option<guiding::Learned>,
}

impl Prepasses {
    /// Runs the pre-passes that `settings` ask for. Each uses the results of those before it. The results mean nothing if
    /// `stop` is raised: the rest then ends within a tile's time.
    pub fn run(scene: &PreparedScene, settings: &RenderSettings, stop: &AtomicBool) -> Self {
        let mut found = Self::default();
        found.compensation =
            compensation::compensation(scene, settings, &found.apply(transport(scene, settings)), stop);
        found.learned_lights = learned_lights::learned(scene, settings, &found.apply(transport(scene, settings)), stop);
        found.guiding = guiding::learned(scene, settings, &found.apply(transport(scene, settings)), stop);
        found
    }

    /// The transport with these results.
    pub fn apply<'a>(&'a self, transport: Transport<'a>) -> Transport<'a> {
        let learned = self.learned_lights.as_ref().and_then(|result| result.lights.as_ref());
        let field = self.guiding.as_ref().and_then(|guiding| guiding.field.as_ref());
        let density = match self.compensation {
            Some(CompensationStats { on: true, .. }) => Density::Compensated,
            _ => Density::Radiance,
        };
        let lights = LightProposal { density, learned, ..transport.proposal.lights };
        Transport { proposal: Proposal { lights, field }, ..transport }
    }
}
