//! The model of all materials: which lobes it has, in which order.

use super::clearcoat::Clearcoat;
use super::diffuse_transmission::DiffuseTransmission;
use super::general_microfacet::GeneralMicrofacet;
use super::glass::Glass;
use super::lambert::Lambert;
use super::layered::Layered;
use super::lobe::Lobe;
use super::lobe_set::LobeSet;
use super::microfacet::Microfacet;
use super::parameters::{One, Parameters};
use super::sheen::Sheen;
use crate::lanes::LANES;

/// The lobes of all materials, from the outermost in: the one list of them. What follows from it takes no columns and
/// no time for lobes that a scene does not use.
pub type Bsdf<W = One> = Layered<Clearcoat<W>, Layered<Sheen<W>, Layered<Glass<W>, BelowGlass<W>>>>;

/// What is left of a surface besides its glass.
pub type BelowGlass<W> = Layered<GeneralMicrofacet<W>, BelowGeneralMicrofacet<W>>;

/// And without a finish.
pub type BelowGeneralMicrofacet<W> = Layered<DiffuseTransmission<W>, Core<W>>;

/// glTF's core model, which most surfaces have and nothing more: what is compiled once more, without the rest.
pub type Core<W = One> = Layered<Microfacet<W>, Lambert<W>>;

impl Bsdf {
    /// Which lobes it has.
    pub fn lobes(&self) -> LobeSet {
        Self::gather([self; LANES]).lobes()
    }

    /// A batch's columns of the core model.
    pub fn core_mut(columns: &mut <Self as Parameters>::Columns) -> &mut <Core as Parameters>::Columns {
        &mut columns.base.base.base.base.base
    }

    /// A batch's columns of the core model, where it has no others.
    pub fn core(columns: &<Self as Parameters>::Columns) -> Option<&<Core as Parameters>::Columns> {
        let Layered { top: None, base: Layered { top: None, base: Layered { top: None, base } } } = columns else {
            return None;
        };
        match base {
            Layered { top: None, base: Layered { top: None, base } } => Some(base),
            _ => None,
        }
    }
}
