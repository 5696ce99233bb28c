//! Path guiding: a field of where light comes from, learned from a pilot's paths, and drawn from at every surface that is
//! broad enough beside its BSDF: one density, a mixture, which MIS weighs as it weighed the BSDF's.
//!
//! A tree over positions and normals has cells ([`cells`](crate::sampling::cells)); each has a histogram of directions ([`directions`]) and the
//! share c of samples that follow it ([`field`]), both from the pilot's samples ([`mod@learn`]): the histogram goes by the root
//! of the second moments of f·L (Rath et al. 2020, *Variance-Aware Path Guiding*; cells after Müller et al. 2017,
//! *Practical Path Guiding*), c by the second moments of the mixture, which is the balance's estimator in space
//! instead of over pixels. Cells also know how often light samples and going on are worth their time ([`roulette`]).

pub mod directions;
pub mod field;
pub mod learn;
pub mod roulette;

pub use field::{Field, NOWHERE};
pub use learn::{Gain, TrainingSample, learn};
pub use roulette::{Paths, VertexRecord};

use serde::{Deserialize, Serialize};

/// Is there a field?
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Guiding {
    /// No pilot, no field.
    #[default]
    Off,
    /// Always.
    On,
    /// Where the pilot finds that it pays.
    Auto,
}
