//! MIS weights and the per-pixel division of samples between light and BSDF sampling. Pure mathematics that knows no scene.
//!
//! Notation: light pdf p_l, BSDF pdf p_b (both per solid angle), light share α (the fraction of samples that are light
//! samples), t = 2α − 1, r = (p_l − p_b)/(p_l + p_b), Y = 2f/(p_l + p_b) the contribution at α = ½, Z = f/p_α the one at the
//! α in use. The second moment is M(α) = ∫ f²/p_α = Σ_k (−t)^k m_k with m_k = E_½[Y² r^k].

pub mod contribution;
pub mod cost;
pub mod counts;
pub mod features;
pub mod heuristic;
pub mod method;
pub mod methods;
pub mod moments;
pub mod sampler;
pub mod variance;

pub use contribution::{Contribution, Observer, Technique};
pub use cost::Cost;
pub use counts::{Counts, Shares, deal};
pub use features::PixelFeatures;
pub use heuristic::Heuristic;
pub use method::Method;
pub use methods::second_order::DEFAULT_PILOT_FRACTION;
pub use methods::{Balance, CustomMethod};
pub use moments::Moments;
pub use sampler::{LearnedPixels, Sampler};
