//! What a pixel learns from its samples, and the balance that follows from it.

use serde::{Deserialize, Serialize};

/// Streaming sums of W = Y·Z and r over a pixel's samples. Sums of passes with different α add up: each is an
/// unbiased estimate of the same m_k (times the number of samples).
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Σ W.
    pub s0: f64,
    /// Σ W r.
    pub s1: f64,
    /// Σ W r².
    pub s2: f64,
    /// Σ W², for the ridge.
    pub q0: f64,
    /// Σ Z r, Z summed over channels.
    pub k1: f64,
    /// Σ Z r².
    pub k2: f64,
}

impl Moments {
    /// Adds one sample with weight `w` = Σ_c Y_c Z_c (over colour channels; ≥ 0), `r` in [−1, 1] and `z` = Σ_c Z_c. A
    /// sample that found nothing adds nothing. Non-finite samples are dropped.
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

    /// Adds another pixel's or pass's sums.
    pub fn merge(&mut self, other: &Moments) {
        self.s0 += other.s0;
        self.s1 += other.s1;
        self.s2 += other.s2;
        self.q0 += other.q0;
        self.k1 += other.k1;
        self.k2 += other.k2;
    }

    /// The share that brings p_α nearest to f in Kullback-Leibler divergence, linearised at ½: t = K₁/K₂ with
    /// K_k = E[Z r^k] (Sbert and Szirmay-Kalos 2023 minimise the same divergence; the linear step is derived here from
    /// its stationarity condition E_½[Y r/(1 + t r)] = 0). Exact for f = a p_l + b p_b. ½ when nothing was seen.
    pub fn kl_linear(&self) -> f32 {
        alpha_of(self.k1 / self.k2)
    }

    /// The paper's second-order share of light samples: t = m₁/(2 m₂), α = ½ + m₁/(4 m₂), clamped to [0, 1] (Lu,
    /// Pacanowski and Granier 2013, *Second-Order Approximation for Variance Reduction in Multiple Importance
    /// Sampling*). ½ when nothing was seen.
    pub fn second_order(&self) -> f32 {
        alpha_of(self.s1 / (2.0 * self.s2))
    }

    /// [`second_order`](Self::second_order) with a ridge of `kappa` pseudo-observations: half a heavy sample at each
    /// end r = ±1, of the typical size c = Q₀/S₀ of the heavy ones. It vanishes as samples accumulate, and holds α in
    /// while a single sample carries the weight: |t| ≤ 1/(2(1 + κ)) for one firefly.
    pub fn second_order_ridge(&self, kappa: f64) -> f32 {
        if self.s0 <= 0.0 {
            return 0.5;
        }
        let ridge = kappa * self.q0 / self.s0;
        alpha_of(self.s1 / (2.0 * (self.s2 + ridge)))
    }

    /// The share that is best against the worst integrand with these m₀, m₁, m₂ (a two-atom measure, by Chebyshev and
    /// Markov), with the same ridge: with exact moments never worse than ½ in second moment, whatever the integrand.
    pub fn minimax_ridge(&self, kappa: f64) -> f32 {
        if self.s0 <= 0.0 {
            return 0.5;
        }
        let ridge = kappa * self.q0 / self.s0;
        let (m0, m1, m2) = (self.s0 + ridge, self.s1.abs(), self.s2 + ridge);
        // Atoms at r = −1 (mass w) and r = ξ (mass v), for m₁ ≥ 0; mirrored otherwise.
        let v = (m0 + m1) * (m0 + m1) / (m0 + 2.0 * m1 + m2);
        let xi = (m1 + m2) / (m0 + m1);
        let w = (m0 - v).max(0.0);
        let (heavy, light) = ((v * xi).sqrt(), w.sqrt());
        let denominator = heavy + xi * light;
        let t = if denominator > 0.0 { ((heavy - light) / denominator).max(0.0) } else { 0.0 };
        alpha_of(t.copysign(self.s1))
    }
}

/// α of t = 2α − 1, clamped; ½ for 0/0, where M is flat.
fn alpha_of(t: f64) -> f32 {
    if t.is_nan() { 0.5 } else { (0.5 + 0.5 * t.clamp(-1.0, 1.0)) as f32 }
}

/// Variance of a pilot of `pilot` of `n` samples at ½ followed by the rest at α, relative to all at ½, when V(α)/V(½)
/// is `ratio`: passes are uncorrelated and weighted by their counts.
pub fn pilot_then_rest(pilot: f64, n: f64, ratio: f64) -> f64 {
    pilot / n + (1.0 - pilot / n) * ratio
}

#[cfg(test)]
mod tests;
