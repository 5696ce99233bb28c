//! Owen-scrambled Sobol points, four dimensions at a time.
//!
//! Each set of four dimensions is a scrambled and shuffled sequence of its own ("padding", Burley 2020, *Practical
//! Hash-based Owen Scrambling*), so any number of dimensions is to be had and no poor high Sobol dimension is used.

use std::sync::LazyLock;

use sobol_burley::parts::{Int4, hash_int4, owen_scramble_int4_rev, owen_scramble_rev, sobol_int4_rev};

/// Sample indices in one scramble of `sobol_burley`; beyond it another scramble follows.
const SEQUENCE_BITS: u32 = 16;

/// Sobol's first four dimensions for each value of the (reversed) index's upper and next byte: the point is their
/// exclusive or. `sobol_burley` loops over the index's bits, which after shuffling no branch predictor can foresee: that
/// loop took a third of all rendering time.
static SOBOL: LazyLock<[[[u32; 4]; 256]; 2]> = LazyLock::new(|| {
    [24, 16].map(|shift| std::array::from_fn(|byte| sobol_int4_rev((byte as u32) << shift, 0).into()))
});

/// A well-mixed 32-bit hash (an integer finaliser after Chris Wellons' `lowbias32`).
#[inline]
pub fn hash(mut n: u32) -> u32 {
    n ^= n >> 16;
    n = n.wrapping_mul(0x7feb_352d);
    n ^= n >> 15;
    n = n.wrapping_mul(0x846c_a68b);
    n ^ (n >> 16)
}

/// The sequence of one pixel.
#[derive(Debug, Clone, Copy)]
pub struct PixelSequence {
    seed: u32,
}

impl PixelSequence {
    /// The sequence of pixel (`x`, `y`) of the whole picture under the render's `seed`.
    #[inline]
    pub fn new(x: u32, y: u32, seed: u32) -> Self {
        Self { seed: hash(x ^ hash(y ^ hash(seed ^ 0x5bd1_e995))) }
    }

    /// Four numbers in [0, 1): set `set` of dimensions of the sequence's point `index`.
    #[inline]
    pub fn sample(self, index: u32, set: u32) -> [f32; 4] {
        sample_4d(index & ((1 << SEQUENCE_BITS) - 1), self.scramble(index, set))
    }

    /// The seed of one scramble of one set of dimensions.
    #[inline]
    fn scramble(self, index: u32, set: u32) -> u32 {
        hash(self.seed ^ hash(set.wrapping_mul(0x9e37_79b9) ^ (index >> SEQUENCE_BITS)))
    }

    /// A random number of the pixel's point `index` for choices that need no stratification.
    #[inline]
    pub fn key(self, index: u32, set: u32) -> u32 {
        hash(self.seed ^ hash(index ^ set.rotate_left(24)))
    }
}

/// `sobol_burley::sample_4d(index, 0, seed)`, by table.
#[inline]
fn sample_4d(index: u32, seed: u32) -> [f32; 4] {
    let shuffled = owen_scramble_rev(index.reverse_bits(), sobol_burley::parts::hash(seed ^ 0x79c6_8e4a));
    let table = &*SOBOL;
    let mut point: Int4 = table[0][(shuffled >> 24) as usize].into();
    point ^= table[1][(shuffled >> 16 & 255) as usize].into();
    // The library's own constants: the same numbers, to the bit.
    let seeds: Int4 = [seed.wrapping_mul(0x9c8f_2d3b); 4].into();
    let scramble = seeds ^ [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8].into();
    owen_scramble_int4_rev(point, hash_int4(scramble)).reverse_bits().to_f32_norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_gives_the_librarys_numbers() {
        for seed in [0, 1, 0xdead_beef] {
            for index in (0..1 << SEQUENCE_BITS).step_by(37) {
                assert_eq!(sample_4d(index, seed), sobol_burley::sample_4d(index, 0, seed));
            }
        }
    }

    #[test]
    fn every_aligned_block_is_stratified_in_each_dimension() {
        let sequence = PixelSequence::new(3, 7, 1);
        for set in 0..5 {
            for start in [0u32, 64, 65_536 + 64] {
                for dimension in 0..4 {
                    let mut seen = [false; 64];
                    for i in 0..64 {
                        let u = sequence.sample(start + i, set)[dimension];
                        assert!((0.0..1.0).contains(&u));
                        let cell = (u * 64.0) as usize;
                        assert!(!std::mem::replace(&mut seen[cell], true), "cell {cell} twice");
                    }
                }
            }
        }
    }

    #[test]
    fn pixels_sets_and_seeds_differ() {
        let base = PixelSequence::new(0, 0, 0).sample(0, 0);
        assert_ne!(base, PixelSequence::new(1, 0, 0).sample(0, 0));
        assert_ne!(base, PixelSequence::new(0, 1, 0).sample(0, 0));
        assert_ne!(base, PixelSequence::new(0, 0, 1).sample(0, 0));
        assert_ne!(base, PixelSequence::new(0, 0, 0).sample(0, 1));
        assert_ne!(base, PixelSequence::new(0, 0, 0).sample(1 << SEQUENCE_BITS, 0));
    }
}
