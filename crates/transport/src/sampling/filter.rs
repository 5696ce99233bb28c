//! Filter importance sampling: every sample belongs to one pixel and has weight one (Ernst, Stamminger and Greiner 2006,
//! *Filter Importance Sampling*). All filters are separable and ≥ 0.

use std::sync::Arc;

use crate::lanes::{F, eight};

bismar_scene::named_variants! {
    /// Pixel reconstruction filter, by importance sampling.
    pub enum PixelFilter {
        /// Gaussian of standard deviation 0.5 pixels, truncated at 1.5 pixels.
        Gaussian = "gaussian",
        /// Box of one pixel.
        Box = "box",
        /// Blackman-Harris of radius 1.5 pixels.
        BlackmanHarris = "blackman-harris",
    }
}

/// Steps of the tabulated inverse distribution.
const STEPS: usize = 512;

/// Samples offsets from the pixel's centre.
#[derive(Debug, Clone)]
pub struct FilterSampler {
    /// The distance from the centre beyond which one side's tail has the mass ½(k/[`STEPS`])²: squares, so that the
    /// thin ends are as fine as the rest. Linear in the mass between, so the density is a step function.
    beyond: Arc<[f32]>,
}

impl FilterSampler {
    pub fn new(filter: PixelFilter) -> Self {
        let (radius, density): (f64, fn(f64) -> f64) = match filter {
            PixelFilter::Box => (0.5, |_| 1.0),
            PixelFilter::Gaussian => (1.5, |x| (-2.0 * x * x).exp()),
            PixelFilter::BlackmanHarris => (1.5, blackman_harris),
        };
        // Mass from the edge inwards to the centre by the midpoint rule; all filters are even.
        const FINE: usize = 1 << 14;
        let h = radius / FINE as f64;
        let mut mass = vec![0.0; FINE + 1];
        for i in 0..FINE {
            mass[i + 1] = mass[i] + density(radius - (i as f64 + 0.5) * h);
        }
        let half = mass[FINE];
        let mut at = 0;
        let beyond = (0..=STEPS)
            .map(|k| {
                let target = half * (k as f64 / STEPS as f64).powi(2);
                while at + 1 < FINE && mass[at + 1] < target {
                    at += 1;
                }
                let fraction = ((target - mass[at]) / (mass[at + 1] - mass[at])).clamp(0.0, 1.0);
                (radius - (at as f64 + fraction) * h) as f32
            })
            .collect();
        Self { beyond }
    }

    /// Offsets from the pixel's centre along one axis, in pixels, for `u` in [0, 1).
    #[inline(always)]
    pub fn offsets(&self, u: F) -> F {
        F::from(eight(|lane| self.one(u.as_array()[lane])))
    }

    #[inline]
    fn one(&self, u: f32) -> f32 {
        let tail = u.min(1.0 - u);
        let square = tail * (2 * STEPS * STEPS) as f32;
        let k = (square.sqrt() as usize).min(STEPS - 1);
        let f = (square - (k * k) as f32) / (2 * k + 1) as f32;
        let distance = self.beyond[k] + (self.beyond[k + 1] - self.beyond[k]) * f;
        distance.copysign(u - 0.5)
    }
}

/// The four-term Blackman-Harris window over [−1.5, 1.5].
fn blackman_harris(x: f64) -> f64 {
    let t = 2.0 * std::f64::consts::PI * (x / 3.0 + 0.5);
    0.35875 - 0.48829 * t.cos() + 0.14128 * (2.0 * t).cos() - 0.01168 * (3.0 * t).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_have_the_filters_mean_and_variance() {
        // Variances: box 1/12; the two others integrated numerically over their support.
        for (filter, radius, density) in [
            (PixelFilter::Box, 0.5, (|_| 1.0) as fn(f64) -> f64),
            (PixelFilter::Gaussian, 1.5, |x| (-2.0 * x * x).exp()),
            (PixelFilter::BlackmanHarris, 1.5, blackman_harris),
        ] {
            let (mut mass, mut second) = (0.0, 0.0);
            for i in 0..30_000 {
                let x = -radius + (f64::from(i) + 0.5) * 2.0 * radius / 30_000.0;
                mass += density(x);
                second += density(x) * x * x;
            }
            let sampler = FilterSampler::new(filter);
            let (mut mean, mut square) = (0.0, 0.0);
            let n = 100_000;
            for i in 0..n {
                let x = f64::from(sampler.one((i as f32 + 0.5) / n as f32));
                mean += x / f64::from(n);
                square += x * x / f64::from(n);
            }
            // The table's steps are O(1/STEPS) wide.
            assert!(mean.abs() < 1e-4, "{filter:?} mean {mean}");
            assert!((square - second / mass).abs() < 2e-3, "{filter:?} {square} {}", second / mass);
        }
    }
}
