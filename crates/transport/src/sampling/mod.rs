//! Low-discrepancy sequences, warps from the unit square, discrete distributions, pixel filters, and cells in space. All
//! random numbers of a render are pure functions of (pixel, index, dimension, seed).

pub mod cells;
pub mod discrete;
pub mod filter;
pub mod random;
pub mod sequence;
pub mod warp;

pub use discrete::Discrete;
pub use filter::{FilterSampler, PixelFilter};
pub use random::SplitMix64;
pub use sequence::{PixelSequence, frame_seed, hash, hashes, keys, pixel_seed, samples};
