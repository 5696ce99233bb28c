//! Significance tests: verdicts with a bounded rate of false alarms.

use serde::Serialize;

use super::simulate::Shot;
use crate::statistics::{Sums, mean_of};

/// Upper bound of the probability that any test of the family raises a false alarm.
pub const FALSE_ALARM: f64 = 1e-4;

/// The largest |z| that one of `tests` two-sided tests may show (Bonferroni): the normal tail is bounded by
/// P(|Z| > z) ≤ √(2/π) exp(−z²/2)/z, so the rate is at most [`FALSE_ALARM`].
pub fn z_limit(tests: usize) -> f64 {
    let level = FALSE_ALARM / tests.max(1) as f64;
    let tail = |z: f64| (2.0 / std::f64::consts::PI).sqrt() * (-0.5 * z * z).exp() / z;
    let (mut low, mut high) = (0.5, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tail(middle) > level { low = middle } else { high = middle }
    }
    high
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The worst pixel is within the bar.
    Survives,
    /// The worst pixel exceeds the bar, but no pixel significantly.
    Unsure,
    /// A pixel exceeds the bar significantly.
    Fails,
    /// The mean is significantly wrong, or a value is not finite.
    Wrong,
}

#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    pub estimator: String,
    /// Whether all values are finite and all shares in [0, 1].
    pub finite: bool,
    /// Largest |mean − truth| in standard errors, over pixels, channels and the picture's mean.
    pub z: f64,
    pub tests: usize,
    /// Relative bias of the picture's mean.
    pub bias: f64,
    /// Mean over pixels and channels of the variance over that of `half`.
    pub mean_ratio: f64,
    pub worst_ratio: f64,
    pub worst_se: f64,
    /// Largest excess of a pixel and channel over the mode's bar, in standard errors.
    pub excess: f64,
    /// Mean share of light samples in the last pass.
    pub share: f64,
    /// Standard deviation of the share over replicas, root mean square over pixels.
    pub share_sd: f64,
    /// Fraction of renders that were guided by a field; of guiding alone.
    #[serde(rename = "led", skip_serializing_if = "Option::is_none")]
    pub guided_fraction: Option<f64>,
}

impl Outcome {
    /// Judges by the mode's bar and the limit of |z| of all tests.
    pub fn verdict(&self, bar: f64, limit: f64) -> Verdict {
        match () {
            () if !self.finite || self.z.is_nan() || self.z > limit => Verdict::Wrong,
            () if self.worst_ratio <= with_tolerance(bar) => Verdict::Survives,
            () if self.excess <= limit => Verdict::Unsure,
            () => Verdict::Fails,
        }
    }
}

/// The bar with a tolerance for rounding errors.
fn with_tolerance(bar: f64) -> f64 {
    bar * (1.0 + 1e-6)
}

/// An estimator in one mode under test: its means, and its variances over those of `half`.
#[derive(Debug)]
pub struct Trial {
    bar: f64,
    /// The largest |z| of the tests of means, and their number.
    z: f64,
    tests: usize,
    /// Variance ratios, pixel by pixel and channel by channel.
    ratios: Sums,
    /// The largest and its standard error.
    worst: (f64, f64),
    /// The largest excess over the bar, in standard errors.
    excess: f64,
}

impl Trial {
    /// No tests and ratios, with a mode's bar.
    pub fn new(bar: f64) -> Self {
        Self { bar, z: 0.0, tests: 0, ratios: Sums::default(), worst: (0.0, 0.0), excess: 0.0 }
    }

    /// Tests a mean's deviation from the truth, which should be zero, by its standard error.
    pub fn test(&mut self, off: f64, error: f64, truth: f64) {
        // Weights are f32.
        let error = error.hypot(4.0 * f64::from(f32::EPSILON) * truth);
        let own = if off == 0.0 { 0.0 } else { off.abs() / error };
        self.z = if own.is_nan() { own } else { self.z.max(own) };
        self.tests += 1;
    }

    /// Adds the ratio of two variances, of which those up to `nothing` are rounding, with its standard error.
    pub fn ratio(&mut self, own: f64, base: f64, nothing: f64, error: impl FnOnce() -> f64) {
        let (ratio, error) = match base > nothing {
            true => (own / base, error()),
            false if own <= nothing => (1.0, 0.0),
            false => (f64::INFINITY, 0.0),
        };
        self.ratios.add(ratio);
        if ratio > self.worst.0 {
            self.worst = (ratio, error);
        }
        let beyond = ratio - with_tolerance(self.bar);
        if beyond > 0.0 {
            self.excess = self.excess.max(beyond / error);
        }
    }

    /// Ends, given the picture's relative bias and each pixel's shares.
    pub fn outcome(self, estimator: String, finite: bool, bias: f64, shares: &[Sums]) -> Outcome {
        let mean = |of: fn(&Sums) -> f64| mean_of(shares.iter().map(of));
        Outcome {
            estimator,
            finite,
            z: self.z,
            tests: self.tests,
            bias,
            mean_ratio: self.ratios.mean(),
            worst_ratio: self.worst.0,
            worst_se: self.worst.1,
            excess: self.excess,
            share: mean(Sums::mean),
            share_sd: mean(Sums::variance).sqrt(),
            guided_fraction: None,
        }
    }
}

/// Sums over many replicas of an image with a known true value.
#[derive(Debug, Clone)]
pub struct Tally {
    truth: Vec<[f64; 3]>,
    /// Per pixel and channel: estimate − truth, exact variance.
    estimate: Vec<[Sums; 3]>,
    variance: Vec<[Sums; 3]>,
    picture: [Sums; 3],
    share: Vec<Sums>,
    finite: bool,
}

impl Tally {
    pub fn new(truth: &[[f64; 3]]) -> Self {
        let none = vec![[Sums::default(); 3]; truth.len()];
        Self {
            truth: truth.to_vec(),
            estimate: none.clone(),
            variance: none,
            picture: [Sums::default(); 3],
            share: vec![Sums::default(); truth.len()],
            finite: true,
        }
    }

    /// Adds a replica, one shot a pixel.
    pub fn add(&mut self, shots: &[Shot]) {
        let mut picture = [0.0; 3];
        for (i, shot) in shots.iter().enumerate() {
            for (c, sum) in picture.iter_mut().enumerate() {
                let off = shot.estimate[c] - self.truth[i][c];
                self.estimate[i][c].add(off);
                self.variance[i][c].add(shot.variance[c]);
                *sum += off / shots.len() as f64;
                self.finite &= off.is_finite() && shot.variance[c].is_finite();
            }
            self.share[i].add(f64::from(shot.share));
            self.finite &= (0.0..=1.0).contains(&shot.share);
        }
        (0..3).for_each(|c| self.picture[c].add(picture[c]));
    }

    pub fn join(mut self, other: &Self) -> Self {
        for (a, b) in [(&mut self.estimate, &other.estimate), (&mut self.variance, &other.variance)] {
            a.iter_mut().flatten().zip(b.iter().flatten()).for_each(|(a, b)| a.join(b));
        }
        self.picture.iter_mut().zip(&other.picture).for_each(|(a, b)| a.join(b));
        self.share.iter_mut().zip(&other.share).for_each(|(a, b)| a.join(b));
        self.finite &= other.finite;
        self
    }

    /// Compares with the exact variances of `half` (by pixel and channel) and the mode's bar.
    pub fn outcome(&self, estimator: String, half: &[[f64; 3]], bar: f64) -> Outcome {
        let mut trial = Trial::new(bar);
        let truth: [f64; 3] = std::array::from_fn(|c| mean_of(self.truth.iter().map(|t| t[c])));
        for (i, half) in half.iter().enumerate() {
            for (c, &base) in half.iter().enumerate() {
                let estimate = &self.estimate[i][c];
                trial.test(estimate.mean(), estimate.error(), self.truth[i][c]);
                let own = self.variance[i][c];
                // Rounding: a relative error of 1e-7.
                let nothing = 1e-14 * self.truth[i][c].powi(2);
                trial.ratio(own.mean(), base, nothing, || own.error() / base);
            }
        }
        self.picture.iter().zip(truth).for_each(|(sums, truth)| trial.test(sums.mean(), sums.error(), truth));
        let total: f64 = truth.iter().sum();
        let off: f64 = self.picture.iter().map(Sums::mean).sum();
        let bias = if total > 0.0 { off / total } else { off };
        trial.outcome(estimator, self.finite, bias, &self.share)
    }
}

#[derive(Debug, Clone, Serialize)]
pub struct Control {
    pub mode: &'static str,
    pub name: &'static str,
    /// The check that must catch it.
    pub check: &'static str,
    pub outcome: Outcome,
    pub caught: bool,
}
