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

/// The lobes of all materials, outermost first. Lobes that no material of a scene has take no memory and no time in its
/// batches.
pub type Bsdf<W = One> = Layered<Clearcoat<W>, Layered<Sheen<W>, Layered<Glass<W>, BelowGlass<W>>>>;

/// The lobes beneath [`Glass`].
pub type BelowGlass<W> = Layered<GeneralMicrofacet<W>, BelowGeneralMicrofacet<W>>;

/// The lobes beneath [`GeneralMicrofacet`].
pub type BelowGeneralMicrofacet<W> = Layered<DiffuseTransmission<W>, Core<W>>;

/// The core model of glTF 2.0, without extensions. Scenes that need nothing else run a second, smaller instantiation of the
/// shading code.
pub type Core<W = One> = Layered<Microfacet<W>, Lambert<W>>;

impl Bsdf {
    /// The lobes that are present.
    pub fn lobes(&self) -> LobeSet {
        Self::gather([self; LANES]).lobes()
    }

    /// The core model's part of a batch's columns.
    pub(crate) fn core_mut(columns: &mut <Self as Parameters>::Columns) -> &mut <Core as Parameters>::Columns {
        &mut columns.base.base.base.base.base
    }

    /// The core model's columns, if the batch has no others.
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
