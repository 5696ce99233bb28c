//! Random numbers and what is made of them: low-discrepancy sequences, warps from the unit square, discrete
//! distributions, pixel filters. Everything is a pure function of (pixel, index, dimension, seed).

pub mod discrete;
pub mod filter;
pub mod sequence;
pub mod warp;

pub use discrete::Discrete;
pub use filter::{FilterSampler, PixelFilter};
pub use sequence::{PixelSequence, hash, hashes, keys, pixel_seed, samples};
