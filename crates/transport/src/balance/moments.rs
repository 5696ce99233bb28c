//! Moments of a pixel's samples, and the light shares that follow from them.

use serde::{Deserialize, Serialize};

/// Sums of W = Y·Z and r over the samples of a pixel. Sums of passes with different α add up: each is an unbiased estimate of
/// the same m_k, times the number of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Σ W.
    pub s0: f64,
    /// Σ W r.
    pub s1: f64,
    /// Σ W r².
    pub s2: f64,
    /// Σ W². Checkpoints hold it; no method of `--balance` uses it.
    pub q0: f64,
    /// Σ Z r, where Z is summed over colour channels.
    pub k1: f64,
    /// Σ Z r².
    pub k2: f64,
}

impl Moments {
    /// Adds one sample with `w` = Σ_c Y_c Z_c ≥ 0 over colour channels, `r` in [−1, 1] and `z` = Σ_c Z_c. A sample without
    /// contribution adds nothing. Samples that are not finite are dropped.
    #[inline]
    pub fn add(&mut self, w: f32, r: f32, z: f32) {
        let (w, r, z) = (f64::from(w), f64::from(r), f64::from(z));
        if w > 0.0 && w.is_finite() && z.is_finite() && r.is_finite() {
            self.s0 += w;
            self.s1 += w * r;
            self.s2 += w * r * r;
            self.q0 += w * w;
            self.k1 += z * r;
            self.k2 += z * r * r;
        }
    }

    /// The light share whose mixture p_α has the least Kullback-Leibler divergence from f, linearised at ½: t = K₁/K₂ with
    /// K_k = E[Z r^k]. Sbert and Szirmay-Kalos 2023 minimise the same divergence; the linear step follows from its
    /// stationarity condition E_½[Y r/(1 + t r)] = 0. Exact for f = a p_l + b p_b. ½ without samples.
    pub fn kl_linear(&self) -> f32 {
        light_share_of(self.k1 / self.k2)
    }

    /// The second-order light share: t = m₁/(2 m₂), α = ½ + m₁/(4 m₂), clamped to [0, 1] (Lu, Pacanowski and Granier 2013,
    /// *Second-Order Approximation for Variance Reduction in Multiple Importance Sampling*). ½ without samples.
    pub fn second_order(&self) -> f32 {
        light_share_of(self.s1 / (2.0 * self.s2))
    }
}

/// The light share α of t = 2α − 1, clamped to [0, 1]. ½ for NaN (0/0), where M is flat.
pub fn light_share_of(t: f64) -> f32 {
    if t.is_nan() { 0.5 } else { (0.5 + 0.5 * t.clamp(-1.0, 1.0)) as f32 }
}

#[cfg(test)]
mod tests;
