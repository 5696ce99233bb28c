//! Repeatable random numbers and tileable noise. Everything is in f64 and rounded to f32 at the very end, so that a
//! mathematics library that differs in its last bit still gives the same file.

use std::f64::consts::TAU;

use bismar::sampling::random::{mix, split_mix64};
use glam::{DVec3, dvec3};

/// SplitMix64.
pub struct Random(pub u64);

fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

impl Random {
    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        unit(split_mix64(&mut self.0))
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let y = self.between(-1.0, 1.0);
        let (sin, cos) = (TAU * self.unit()).sin_cos();
        let r = (1.0 - y * y).sqrt();
        dvec3(r * cos, y, r * sin)
    }
}

/// A number in [0, 1) for a lattice point.
pub fn hash(x: i64, y: i64, seed: u64) -> f64 {
    let at = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ mix((y as u64).wrapping_add(seed << 32));
    unit(mix(at))
}

/// Smooth noise in [0, 1] that repeats after `periods` lattice cells; (x, y) in cells.
pub fn noise(x: f64, y: f64, periods: (i64, i64), seed: u64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (fx, fy) = (ease(x - x0), ease(y - y0));
    let at =
        |dx: i64, dy: i64| hash((x0 as i64 + dx).rem_euclid(periods.0), (y0 as i64 + dy).rem_euclid(periods.1), seed);
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    lerp(lerp(at(0, 0), at(1, 0), fx), lerp(at(0, 1), at(1, 1), fx), fy)
}

/// Octaves of [`noise`] over (u, v) in [0, 1)², `periods` cells in the first, each next one twice as fine and half as
/// strong; in [0, 1].
pub fn fractal(u: f64, v: f64, periods: (i64, i64), octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for octave in 0..octaves {
        let (px, py) = (periods.0 << octave, periods.1 << octave);
        let w = 0.5f64.powi(octave as i32);
        sum += w * noise(u * px as f64, v * py as f64, (px, py), seed + u64::from(octave));
        weight += w;
    }
    sum / weight
}
