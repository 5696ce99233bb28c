//! Path re-use ([`reuse`](crate::integrator::reuse)) as a candidate, in groups of several sizes.

use super::trial::Candidate;
use crate::integrator::{Proposal, Reuse, Transport};
use crate::render::pass::decisions::RuledOut;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};

/// Groups of these sizes.
pub struct PathReuse(Vec<Reuse>);

impl PathReuse {
    /// # Errors
    /// Why nothing is shared.
    pub fn new(transport: &Transport, settings: &RenderSettings) -> Result<Self, RuledOut> {
        let whys = [
            (transport.max_depth < 3, RuledOut::Direct),
            (transport.geometry.moves, RuledOut::Moves),
            (transport.limits[1] < f32::INFINITY, RuledOut::Clamp),
            (settings.light_groups.is_some(), RuledOut::LightGroups),
        ];
        if let Some((_, why)) = whys.into_iter().find(|(applies, _)| *applies) {
            return Err(why);
        }
        Ok(Self(match settings.techniques[Technique::PathReuse] {
            Choice::On => vec![settings.reuse_sizes.unwrap_or_default()],
            _ => Reuse::usual(settings.expected_spp()).to_vec(),
        }))
    }
}

impl Candidate for PathReuse {
    fn technique(&self) -> Technique {
        Technique::PathReuse
    }

    fn ways<'a>(&'a self, of: Proposal<'a>) -> Vec<Proposal<'a>> {
        self.0.iter().map(|sizes| Proposal { reuse: Some(*sizes), ..of }).collect()
    }
}
