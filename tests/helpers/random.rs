//! Random numbers of tests.

use std::f32::consts::PI;

use bismar::sampling::random::split_mix64;
use glam::{Vec3, vec3};

/// Independent random numbers (SplitMix64): a low-discrepancy sequence is too even for
/// tests that assume chance.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        split_mix64(&mut self.0)
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
