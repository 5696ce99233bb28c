//! What paths are sampled by.

use super::emission_rays::EmissionRayCounts;
use crate::guiding::Field;
use crate::light::{LightProposal, Lights};

/// The distributions of light samples and of directions. Any proposal gives the same mean; variance and cost differ.
#[derive(Debug, Clone, Copy)]
pub struct Proposal<'a> {
    /// Light samples: radiance or compensated density, light tree or learned selection.
    pub lights: LightProposal<'a>,
    /// Directions: a mixture of the BSDF and this guiding field, or the BSDF alone. The field also has the roulette
    /// probabilities of light samples and of path continuation beyond first surfaces.
    pub field: Option<&'a Field>,
    /// Camera rays per path for emission that the camera sees directly: these, or the path's own.
    pub emission_rays: Option<&'a EmissionRayCounts>,
}

impl<'a> Proposal<'a> {
    /// The proposal without anything learned.
    pub fn new(lights: &Lights) -> Self {
        Self { lights: lights.proposal(), field: None, emission_rays: None }
    }

    /// This proposal with another guiding field, or none.
    pub fn guided(self, field: Option<&'a Field>) -> Self {
        Self { field, ..self }
    }

    /// Does a guiding field set the roulette probabilities of light samples and of path continuation beyond first surfaces?
    pub(super) fn has_roulette(&self) -> bool {
        self.field.is_some_and(Field::has_roulette)
    }
}
