//! Random numbers of tests.

use std::f32::consts::PI;

use glam::{Vec3, vec3};

/// Independent random numbers (SplitMix64; Steele, Lea and Flood 2014): a low-discrepancy sequence is too even for
/// tests that assume chance.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn bits(&mut self) -> u32 {
        (self.next() >> 32) as u32
    }

    /// Uniform in [0, 1), on the grid of 24 bits.
    pub fn f32(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    /// Below `n`, which may be 0: then 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    /// In [-1, 1)³.
    pub fn point(&mut self) -> Vec3 {
        vec3(self.f32(), self.f32(), self.f32()) * 2.0 - 1.0
    }

    /// Uniform on the sphere.
    pub fn direction(&mut self) -> Vec3 {
        let (z, phi) = (self.f32() * 2.0 - 1.0, self.f32() * 2.0 * PI);
        let r = (1.0 - z * z).max(0.0).sqrt();
        vec3(r * phi.cos(), r * phi.sin(), z)
    }
}
