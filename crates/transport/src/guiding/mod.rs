//! Path guiding: a field of incident light, learned from the paths of a pre-pass. At every surface that is diffuse enough,
//! directions are sampled from a mixture of the field and the BSDF, which MIS weights as one technique.
//!
//! A tree over positions and normals has cells ([`cells`](crate::sampling::cells)). Each cell has a histogram of directions
//! ([`directions`]) and the probability c of sampling from it ([`field`]), both from training samples ([`mod@learn`]; those of
//! other cells are turned toward what they met). The histogram follows the root of the second moments of f·L (Rath et al. 2020,
//! *Variance-Aware Path Guiding*; cells after Müller et al. 2017, *Practical Path Guiding*). c follows from the second moments
//! of the mixture, by the estimator of the balance over space instead of pixels. Cells also have probabilities of light samples
//! and of path continuation ([`roulette`]).

pub mod directions;
pub mod field;
mod histograms;
pub mod learn;
pub mod roulette;
mod training_sample;

pub use field::{Field, NO_CELL};
pub use learn::{Gain, learn};
pub use roulette::{PathStatistics, VertexRecord};
pub use training_sample::TrainingSample;
