//! The pre-passes: short renders of the same view before the first pass, which decide what paths are sampled by. Learners learn
//! from the same paths ([`rounds`]) which emissive triangles matter where ([`learned_lights`]) and where light comes from
//! ([`guiding`]). A [`trial`] then decides about them, about the density of the environment (`compensation`) and about
//! path re-use. At last paths are allocated to tiles ([`allocation`]). Results depend only on the scene, the view and settings
//! but the seed, so that every part, crop, session and seed decides alike.

pub mod allocation;
mod compensation;
pub mod default_light;
mod effort;
pub mod guiding;
pub mod learned_lights;
mod low_resolution;
mod path_reuse;
pub mod rounds;
pub mod trial;
mod visible_emission;

use std::sync::atomic::AtomicBool;

use tracing::warn;

use crate::integrator::{PreparedScene, Transport};
use crate::render::pass::decisions::{Found, RuledOut, TechniqueStats};
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};
use crate::render::settings::transport::transport;
use crate::scene::Scene;
use allocation::Allocation;
use compensation::Compensation;
use guiding::GuidingLearner;
use learned_lights::LightsLearner;
use path_reuse::PathReuse;
use rounds::Learner;
use trial::{Candidate, Decided};

/// The seed of all pre-passes, whose decisions are then those of all seeds. A picture with this one has other scrambles.
pub const SEED: u32 = 4;

/// The results of a render's pre-passes.
#[derive(Default)]
pub struct Prepasses<'s> {
    learners: Vec<Box<dyn Learner + 's>>,
    others: Vec<Box<dyn Candidate + 's>>,
    /// In the order of [`Prepasses::candidates`].
    decided: Vec<Decided>,
    /// Why techniques are none of these.
    ruled_out: Vec<(Technique, RuledOut)>,
    /// Paths of each tile, if they have their own numbers.
    pub allocation: Option<Allocation>,
}

impl<'s> Prepasses<'s> {
    /// Runs the pre-passes that `settings` ask for. The results mean nothing if `stop` is raised: the rest then ends within a
    /// tile's time.
    pub fn run(scene: &'s PreparedScene, settings: &'s RenderSettings, stop: &AtomicBool) -> Self {
        let mut found = Self::default();
        let plain = Transport { seed: SEED, ..transport(scene, settings) };
        // Paths end at unlit surfaces, and in a scene without light they find nothing: there is nothing to sample better.
        let Scene { instances, materials, .. } = &*scene.scene;
        if !instances.is_empty() && materials.iter().any(|material| !material.unlit) && scene.scene.is_lit() {
            found.gather(scene, settings, &plain);
            let mut learners: Vec<_> =
                found.learners.iter_mut().map(|learner| &mut **learner as &mut dyn Learner).collect();
            if rounds::run(scene, settings, &plain, &mut learners, stop).is_some() {
                let candidates: Vec<_> = found.candidates().collect();
                found.decided = trial::decide(&candidates, &plain, settings, stop);
            }
        }
        found.allocation = Allocation::new(&found.apply(plain), settings, stop);
        found
    }

    /// Finds the techniques that there is something to decide about.
    fn gather(&mut self, scene: &'s PreparedScene, settings: &'s RenderSettings, plain: &Transport) {
        let mut add = |technique, found: Result<(), RuledOut>| {
            let Err(why) = found else { return };
            let nothing = [RuledOut::EvenEnvironment, RuledOut::FewLights, RuledOut::Direct].contains(&why);
            if settings.techniques[technique] == Choice::On && !nothing {
                warn!("{}: {}", technique.title(), why.name());
            }
            self.ruled_out.push((technique, why));
        };
        let asks_for = |technique| settings.asks_for(technique);
        if asks_for(Technique::LearnedLights) {
            add(
                Technique::LearnedLights,
                LightsLearner::new(scene, settings).map(|new| self.learners.push(Box::new(new))),
            );
        }
        if asks_for(Technique::Guiding) {
            add(
                Technique::Guiding,
                GuidingLearner::new(scene, settings, plain).map(|new| self.learners.push(Box::new(new))),
            );
        }
        if asks_for(Technique::Compensation) {
            add(Technique::Compensation, Compensation::new(scene).map(|new| self.others.push(Box::new(new))));
        }
        if asks_for(Technique::PathReuse) {
            add(Technique::PathReuse, PathReuse::new(plain, settings).map(|new| self.others.push(Box::new(new))));
        }
    }

    fn candidates(&self) -> impl Iterator<Item = &dyn Candidate> {
        let learners = self.learners.iter().map(|learner| &**learner as &dyn Candidate);
        learners.chain(self.others.iter().map(|other| &**other))
    }

    /// What they found, for reports.
    pub fn stats(&self) -> Found {
        let mut found = Found::default();
        for (technique, why) in &self.ruled_out {
            found[*technique] = Some(TechniqueStats { why: Some(*why), ..Default::default() });
        }
        for (candidate, decided) in self.candidates().zip(&self.decided) {
            found[candidate.technique()] = Some(decided.stats);
        }
        found[Technique::Adaptive] = self.allocation.as_ref().map(|allocation| *allocation.stats());
        found
    }

    /// The transport with these results.
    pub fn apply<'a>(&'a self, transport: Transport<'a>) -> Transport<'a> {
        let mut proposal = transport.proposal;
        for (candidate, decided) in self.candidates().zip(&self.decided) {
            proposal = decided.way.and_then(|way| candidate.ways(proposal).get(way).copied()).unwrap_or(proposal);
        }
        if let Some(allocation) = &self.allocation {
            proposal.emission_rays = allocation.emission_rays();
        }
        Transport { proposal, ..transport }
    }
}
