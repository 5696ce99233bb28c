//! MIS weights and the per-pixel balance: pure mathematics, knows no scene.
//!
//! Notation: light pdf p_l, BSDF pdf p_b (both in solid angle), share of light samples α, t = 2α − 1,
//! r = (p_l − p_b)/(p_l + p_b), Y = 2f/(p_l + p_b) the contribution at α = ½, Z = f/p_α the one at the α in use.
//! M(α) = ∫ f²/p_α = Σ_k (−t)^k m_k with m_k = E_½[Y² r^k].

pub mod cost;
pub mod deal;
pub mod efficiency;
pub mod heuristic;
pub mod method;
pub mod moments;
pub mod pilot;

pub use cost::Cost;
pub use deal::{Counts, Share, deal};
pub use heuristic::Heuristic;
pub use method::{Balance, HALF_PILOT};
pub use moments::{Moments, pilot_then_rest};
pub use pilot::{Finding, Technique};
