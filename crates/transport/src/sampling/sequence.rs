//! Owen-scrambled Sobol points, four dimensions at a time, in eight lanes.
//!
//! Each set of four dimensions is a scrambled and shuffled sequence of its own ("padding", Burley 2020, *Practical
//! Hash-based Owen Scrambling*). So any number of dimensions exists, and no high Sobol dimension with its poor projections
//! is used.

use crate::lanes::{F, LANES, U, unit_interval};

/// One scramble has 2^SEQUENCE_BITS points, as many as the direction numbers below have bits; then another one follows.
const SEQUENCE_BITS: u32 = 16;

/// Direction numbers of Sobol's second to fourth dimension (Joe and Kuo 2008, as in `sobol_burley`), bit-reversed, for
/// each bit of the index from the lowest up. The first dimension, bit-reversed, is the index itself.
const DIRECTIONS: [[u32; SEQUENCE_BITS as usize]; 3] = {
    // Primitive polynomials x + 1, x² + x + 1, x³ + x + 1 and initial numbers 1; 1, 3; 1, 3, 1.
    let degree = [1, 2, 3];
    let coefficients = [0, 1, 1];
    let initial = [[1, 0, 0], [1, 3, 0], [1, 3, 1]];
    let mut directions = [[0u32; SEQUENCE_BITS as usize]; 3];
    let mut d = 0;
    while d < 3 {
        let s = degree[d];
        let mut v = [0u32; SEQUENCE_BITS as usize];
        let mut i = 0;
        while i < v.len() {
            if i < s {
                v[i] = initial[d][i] << (31 - i);
            } else {
                v[i] = v[i - s] ^ (v[i - s] >> s);
                let mut k = 1;
                while k < s {
                    v[i] ^= ((coefficients[d] >> (s - 1 - k)) & 1) * v[i - k];
                    k += 1;
                }
            }
            directions[d][i] = v[i].reverse_bits();
            i += 1;
        }
        d += 1;
    }
    directions
};

/// A well-mixed 32-bit hash (an integer finaliser after Chris Wellons' `lowbias32`).
#[inline]
pub fn hash(mut n: u32) -> u32 {
    n ^= n >> 16;
    n = n.wrapping_mul(0x7feb_352d);
    n ^= n >> 15;
    n = n.wrapping_mul(0x846c_a68b);
    n ^ (n >> 16)
}

/// [`hash`] of eight lanes.
#[inline(always)]
pub fn hashes(mut n: U) -> U {
    n ^= n >> 16;
    n *= U::splat(0x7feb_352d);
    n ^= n >> 15;
    n *= U::splat(0x846c_a68b);
    n ^ (n >> 16)
}

/// The seed of pixel (`x`, `y`) of the whole picture under the render's `seed`.
#[inline]
pub fn pixel_seed(x: u32, y: u32, seed: u32) -> u32 {
    hash(x ^ hash(y ^ hash(seed ^ 0x5bd1_e995)))
}

/// The seed of a frame of an animation with seed `seed`, so that noise differs between frames.
pub fn frame_seed(seed: u32, frame: f64) -> u32 {
    let bits = frame.to_bits();
    hash(seed ^ hash(bits as u32 ^ hash((bits >> 32) as u32 ^ 0x68e3_1da4)))
}

/// Four numbers in [0, 1) per lane: set `set` of four dimensions of point `index`, in the sequence of a pixel's `seed`.
#[inline(always)]
pub fn samples(seed: U, index: U, set: u32) -> [F; 4] {
    let scramble = hashes(seed ^ hashes(U::splat(set.wrapping_mul(0x9e37_79b9)) ^ (index >> SEQUENCE_BITS)));
    let index = reverse_bits(index & U::splat((1 << SEQUENCE_BITS) - 1));
    let shuffled = owen_scramble(index, hashes(scramble ^ U::splat(0x79c6_8e4a)));
    let mut point = [reverse_bits(shuffled & U::splat(0xffff_0000)), U::ZERO, U::ZERO, U::ZERO];
    for bit in 0..SEQUENCE_BITS {
        let set = U::splat(1 << (31 - bit));
        let mask = (shuffled & set).simd_eq(set);
        for (d, directions) in DIRECTIONS.iter().enumerate() {
            point[d + 1] ^= mask & U::splat(directions[bit as usize]);
        }
    }
    let number = |d: usize| {
        let seed = hashes(scramble ^ U::splat(0x912f_69bau32.wrapping_mul(2 * d as u32 + 3)));
        unit_interval(reverse_bits(owen_scramble(point[d], seed)))
    };
    [number(0), number(1), number(2), number(3)]
}

/// 32 random bits of point `index` in the sequence of a pixel's `seed`, without stratification. Every set has a sequence of
/// its own.
#[inline(always)]
pub fn keys(seed: U, index: U, set: u32) -> U {
    hashes(index ^ hashes(seed ^ U::splat(hash(set ^ 0x6b65_7973))))
}

/// A hash-based Owen scramble of bit-reversed integers (Laine and Karras 2011 with the constants of Vegdahl 2021).
#[inline(always)]
fn owen_scramble(mut n: U, scramble: U) -> U {
    n ^= n * U::splat(0x3d20_adea);
    n += scramble;
    n *= (scramble >> 16) | U::splat(1);
    n ^= n * U::splat(0x0552_6c56);
    n ^ (n * U::splat(0x53a2_2864))
}

#[inline(always)]
fn reverse_bits(mut n: U) -> U {
    for (shift, mask) in [(1, 0x5555_5555), (2, 0x3333_3333), (4, 0x0f0f_0f0f), (8, 0x00ff_00ff)] {
        let mask = U::splat(mask);
        n = ((n >> shift) & mask) | ((n & mask) << shift);
    }
    (n >> 16) | (n << 16)
}

/// The sequence of one pixel, one point at a time.
#[derive(Debug, Clone, Copy)]
pub struct PixelSequence {
    seed: u32,
}

impl PixelSequence {
    /// The sequence of pixel (`x`, `y`) under the render's `seed`.
    pub fn new(x: u32, y: u32, seed: u32) -> Self {
        Self { seed: pixel_seed(x, y, seed) }
    }

    /// Set `set` of four dimensions of point `index`, each in [0, 1).
    pub fn sample(self, index: u32, set: u32) -> [f32; 4] {
        samples(U::splat(self.seed), U::from([index; LANES]), set).map(|n| n.as_array()[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unscrambled_points_are_sobols() {
        use sobol_burley::parts::sobol_rev;
        for index in (0..1u32 << SEQUENCE_BITS).step_by(37) {
            let reversed = index.reverse_bits();
            for (dimension, directions) in (1..).zip(&DIRECTIONS) {
                let point = (0..SEQUENCE_BITS)
                    .filter(|bit| reversed >> (31 - bit) & 1 == 1)
                    .fold(0, |p, bit| p ^ directions[bit as usize]);
                assert_eq!(point, sobol_rev(reversed, dimension), "dimension {dimension}, point {index}");
            }
            assert_eq!(index, sobol_rev(reversed, 0));
        }
    }

    #[test]
    fn pairs_of_dimensions_are_stratified_too() {
        // The first two dimensions are a (0, m, 2)-net: any 64 consecutive aligned points have one point in each of
        // 8 x 8 cells, scrambled and shuffled or not.
        for pixel in 0..50 {
            let sequence = PixelSequence::new(pixel, 1, 2);
            let mut seen = [false; 64];
            for i in 0..64 {
                let [u, v, ..] = sequence.sample(i, 1);
                let cell = (u * 8.0) as usize * 8 + (v * 8.0) as usize;
                assert!(!std::mem::replace(&mut seen[cell], true), "pixel {pixel}, cell {cell} twice");
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
        let seeds: std::collections::HashSet<u32> =
            (0..8).flat_map(|seed| (0..1000).map(move |frame| frame_seed(seed, frame.into()))).collect();
        assert_eq!(seeds.len(), 8000);
    }
}
