//! The compensated density of the environment (radiance above the mean; MIS compensation, Karlík et al. 2019) as a candidate.

use super::trial::Candidate;
use crate::integrator::{PreparedScene, Proposal};
use crate::light::{Density, LightProposal};
use crate::render::pass::decisions::RuledOut;
use crate::render::settings::techniques::Technique;

/// Light samples of the environment by the compensated density.
pub struct Compensation;

impl Compensation {
    /// # Errors
    /// Why there is nothing to decide.
    pub fn new(scene: &PreparedScene) -> Result<Self, RuledOut> {
        // The table of the compensated density is as large as the plain one: it is made only where it may be used.
        let uneven = scene.lights.environment.as_ref().is_some_and(|environment| environment.has_compensated());
        if uneven { Ok(Self) } else { Err(RuledOut::EvenEnvironment) }
    }
}

impl Candidate for Compensation {
    fn technique(&self) -> Technique {
        Technique::Compensation
    }

    fn ways<'a>(&'a self, of: Proposal<'a>) -> Vec<Proposal<'a>> {
        vec![Proposal { lights: LightProposal { density: Density::Compensated, ..of.lights }, ..of }]
    }
}
