//! MIS weights and the per-pixel balance: pure mathematics, knows no scene.
//!
//! Notation: light pdf p_l, BSDF pdf p_b (both in solid angle), share of light samples α, t = 2α − 1,
//! r = (p_l − p_b)/(p_l + p_b), Y = 2f/(p_l + p_b) the contribution at α = ½, Z = f/p_α the one at the α in use.
//! M(α) = ∫ f²/p_α = Σ_k (−t)^k m_k with m_k = E_½[Y² r^k].

pub mod contribution;
pub mod cost;
pub mod counts;
pub mod heuristic;
pub mod method;
pub mod methods;
pub mod moments;
pub mod sampler;
pub mod spread;

pub use contribution::{Contribution, Observer, Technique};
pub use cost::Cost;
pub use counts::{Counts, Share, deal};
pub use heuristic::Heuristic;
pub use method::Method;
pub use methods::Balance;
pub use methods::second_order::HALF_PILOT;
pub use moments::{Moments, pilot_then_rest};
pub use sampler::{Learned, Sampler};
