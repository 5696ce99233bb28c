//! The pre-pass: a short render of the same view at low resolution before the first pass. It decides how the environment is
//! sampled ([`compensation`]), how emissive triangles are ([`learned_lights`]) and whether paths are guided ([`guiding`]): the
//! last two learn from the same paths ([`rounds`]). Then it decides whether paths are re-used ([`path_reuse`]). Results
//! depend only on the scene, the view and settings but the seed, so that every part, crop, session and seed decides alike.

pub mod allocation;
mod comparison;
pub mod compensation;
pub mod default_light;
mod effort;
pub mod guiding;
pub mod learned_lights;
pub(super) mod low_resolution;
pub mod path_reuse;
pub mod rounds;
mod visible_emission;

use std::sync::atomic::AtomicBool;

use crate::integrator::{PreparedScene, Transport};
use crate::render::pass::decisions::Found;
use crate::render::settings::RenderSettings;
use crate::render::settings::transport::transport;
use crate::scene::Scene;
use allocation::Allocation;
use compensation::Compensation;
use guiding::GuidingLearner;
use learned_lights::LightsLearner;
use path_reuse::PathReuse;
use rounds::{Decided, Learner};

/// The seed of all pre-passes, whose decisions are then those of all seeds. A picture with this one has other scrambles.
pub const SEED: u32 = 4;

/// The results of a render's pre-passes.
#[derive(Default)]
pub struct Prepasses<'s> {
    decided: Vec<Box<dyn Decided + 's>>,
    /// Paths of each tile, if they have their own numbers.
    pub allocation: Option<Allocation>,
}

impl<'s> Prepasses<'s> {
    /// Runs the pre-passes that `settings` ask for. First the density of the environment is chosen, then the paths of the same
    /// rounds teach all learners, then it is decided whether paths are re-used, then paths are allocated.
    /// The results mean nothing if `stop` is raised: the rest then ends within a tile's time.
    pub fn run(scene: &'s PreparedScene, settings: &RenderSettings, stop: &AtomicBool) -> Self {
        let mut found = Self::default();
        let plain = Transport { seed: SEED, ..transport(scene, settings) };
        // Paths end at unlit surfaces, and in a scene without light they find nothing: there is nothing to sample better.
        let Scene { instances, materials, .. } = &*scene.scene;
        if !instances.is_empty() && materials.iter().any(|material| !material.unlit) && scene.scene.is_lit() {
            found.learn(scene, settings, &plain, stop);
            let path_reuse = PathReuse::decide(&found.apply(plain.clone()), settings, stop);
            found.decided.extend(path_reuse.map(|decided| Box::new(decided) as Box<dyn Decided>));
        }
        let allocation = Allocation::new(&found.apply(plain), settings, stop);
        Self { allocation, ..found }
    }

    /// Decides how lights and directions are sampled.
    fn learn(&mut self, scene: &'s PreparedScene, settings: &RenderSettings, plain: &Transport, stop: &AtomicBool) {
        if let Some(decided) = Compensation::decide(scene, settings, plain, stop) {
            self.decided.push(Box::new(decided));
        }
        let untaught = self.apply(plain.clone());
        let mut learners: Vec<Box<dyn Learner + 's>> = Vec::new();
        LightsLearner::new(scene, settings).into_iter().for_each(|learner| learners.push(Box::new(learner)));
        GuidingLearner::new(scene, settings, plain).into_iter().for_each(|learner| learners.push(Box::new(learner)));
        let mut all: Vec<_> = learners.iter_mut().map(|learner| &mut **learner as &mut dyn Learner).collect();
        if rounds::run(scene, settings, &untaught, &mut all, stop).is_none() {
            return;
        }
        for i in 0..learners.len() {
            let (before, rest) = learners.split_at_mut(i);
            let Some((own, after)) = rest.split_first_mut() else { break };
            let others = before.iter().chain(after.iter());
            let proposal = others.fold(untaught.proposal, |proposal, other| other.apply(proposal));
            own.compare(settings, &Transport { proposal, ..untaught.clone() }, stop);
        }
        self.decided.extend(learners.into_iter().map(|learner| learner as Box<dyn Decided>));
    }

    fn all(&self) -> impl Iterator<Item = &dyn Decided> {
        let allocation = self.allocation.iter().map(|allocation| allocation as &dyn Decided);
        self.decided.iter().map(|decided| &**decided as &dyn Decided).chain(allocation)
    }

    /// What they found, for reports.
    pub fn stats(&self) -> Found {
        let mut found = Found::default();
        self.all().map(Decided::stats).for_each(|(technique, stats)| found[technique] = Some(stats));
        found
    }

    /// The transport with these results.
    pub fn apply<'a>(&'a self, transport: Transport<'a>) -> Transport<'a> {
        let proposal = self.all().fold(transport.proposal, |proposal, decided| decided.apply(proposal));
        Transport { proposal, ..transport }
    }
}
