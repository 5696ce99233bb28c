//! The pre-pass: a short render of the same view at low resolution before the first pass. It decides how the environment is
//! sampled ([`compensation`]), how emissive triangles are ([`learned_lights`]) and whether paths are guided ([`guiding`]); the
//! last two learn from the same paths ([`rounds`]). Results depend only on the scene, the view, the seed and settings, so that
//! every part, crop and session decides alike.

pub mod allocation;
mod comparison;
pub mod compensation;
mod effort;
pub mod guiding;
pub mod learned_lights;
pub(super) mod low_resolution;
pub mod rounds;
mod visible_emission;

use std::sync::atomic::AtomicBool;

use super::RenderSettings;
use super::techniques::{CompensationStats, TechniqueStats};
use super::transport::transport;
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::light::{Density, LightProposal};
use crate::scene::Scene;
use guiding::GuidingLearner;
use learned_lights::LightsLearner;
use rounds::Learner;

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
    /// Runs the pre-passes that `settings` ask for. First the density of the environment is chosen, then the paths of the same
    /// rounds teach all learners. The results mean nothing if `stop` is raised: the rest then ends within a tile's time.
    pub fn run(scene: &PreparedScene, settings: &RenderSettings, stop: &AtomicBool) -> Self {
        let mut found = Self::default();
        // Paths end at unlit surfaces, and in a scene without light they find nothing: there is nothing to sample better.
        let Scene { instances, materials, .. } = &*scene.scene;
        if instances.is_empty() || materials.iter().all(|material| material.unlit) || !scene.scene.is_lit() {
            return found;
        }
        found.compensation =
            compensation::compensation(scene, settings, &found.apply(transport(scene, settings)), stop);
        let untaught = found.apply(transport(scene, settings));
        let mut lights = LightsLearner::new(scene, settings);
        let mut guiding = GuidingLearner::new(scene, settings, &untaught);
        let learners =
            [lights.as_mut().map(|l| l as &mut dyn Learner), guiding.as_mut().map(|l| l as &mut dyn Learner)];
        let mut learners: Vec<_> = learners.into_iter().flatten().collect();
        if rounds::run(scene, settings, &untaught, &mut learners, stop).is_some() {
            found.learned_lights = lights.map(LightsLearner::result);
            let mut guiding = guiding.map(GuidingLearner::result);
            if let Some(guiding) = &mut guiding {
                guiding.compare(settings, &found.apply(transport(scene, settings)), stop);
            }
            found.guiding = guiding;
        }
        found
    }

    /// What they found, for reports.
    pub fn stats(&self) -> TechniqueStats {
        TechniqueStats {
            compensation: self.compensation,
            learned_lights: self.learned_lights.as_ref().map(|found| found.stats),
            guiding: self.guiding.as_ref().map(|guiding| guiding.stats()),
            adaptive: None,
        }
    }

    /// The transport with these results.
    pub fn apply<'a>(&'a self, transport: Transport<'a>) -> Transport<'a> {
        let density = match self.compensation {
            Some(CompensationStats { on: true, .. }) => Density::Compensated,
            _ => Density::Radiance,
        };
        let lights = LightProposal {
            density,
            learned: self.learned_lights.as_ref().and_then(|found| found.lights.as_ref()),
            ..transport.proposal.lights
        };
        let proposal = Proposal { lights, ..transport.proposal };
        let proposal = self.guiding.as_ref().map_or(proposal, |guiding| proposal.guided(guiding.field.as_ref()));
        Transport { proposal, ..transport }
    }
}
