//! What short renders of a smaller picture of the same view decide before the first pass: how the environment is drawn
//! ([`compensation`]), how lamps are ([`lamps`]), whether paths are guided ([`guiding`]). What they find depends on the scene, the
//! view, the seed and settings alone, so that every part, crop and session decides alike.

pub mod compensation;
pub mod guiding;
pub mod learned_lights;
mod low_resolution;

use super::RenderSettings;
use super::driver::transport;
use crate::integrator::{PreparedScene, Transport};
use crate::light::{Density, Drawing};

/// What the pilots of a render have found.
#[derive(Debug, Default)]
pub struct Prepasses {
    /// How light samples toward the environment are drawn.
    pub density: Density,
    /// Of lamps.
    pub learned_lights: Option<learned_lights::LearnedLightsResult>,
    /// Of guiding.
    pub guiding: Option<guiding::Learned>,
}

impl Prepasses {
    /// Sends those that `settings` ask for, each with what those before it have found.
    pub fn run(scene: &PreparedScene, settings: &RenderSettings) -> Self {
        let mut found = Self::default();
        found.density = compensation::density(scene, settings, &found.apply(transport(scene, settings)));
        found.learned_lights = learned_lights::learned(scene, settings, &found.apply(transport(scene, settings)));
        found.guiding = guiding::learned(scene, settings, &found.apply(transport(scene, settings)));
        found
    }

    /// Paths that go by what was found.
    pub fn apply<'a>(&'a self, transport: Transport<'a>) -> Transport<'a> {
        let learned = self.learned_lights.as_ref().and_then(|result| result.lights.as_ref());
        let field = self.guiding.as_ref().and_then(|guiding| guiding.field.as_ref());
        Transport { drawing: Drawing { density: self.density, learned }, field, ..transport }
    }
}
