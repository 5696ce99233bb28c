//! The best fixed share of each pixel, by brute force: variances at a row of shares, a curve through them, its minimum.
//!
//! The seeds are not those that the oracle is judged with, so that it does not profit from the noise of its own search.

use bismar::film::compare::relative_to;
use rayon::prelude::*;

use super::Design;

/// Shares of light samples that are tried: fine fractions of powers of two, as all counts of samples that keep the gain of
/// the sequence.
pub const SHARES: [f32; 9] = [1.0 / 32.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 31.0 / 32.0];
/// The file of the result.
pub const FILE: &str = "oracle.cell";

/// Pseudo-observation of variance at either end of r, in replicas: against events that the search did not see.
const PSEUDO_REPLICAS: f64 = 1.0;

/// Paths a pixel of its renders: a quarter of the most samples.
pub fn spp(design: &Design) -> u32 {
    let most = design.spp.last().copied().unwrap_or(1);
    (most / 4).clamp(most.min(16), most)
}

/// Accumulates renders with fixed shares.
pub struct Learner {
    /// 1/(reference² + 0.01) a pixel's channel.
    weights: Vec<f64>,
    /// Count, means and sums of squared deviations a share.
    sums: Vec<(f64, Vec<f64>, Vec<f64>)>,
}

impl Learner {
    /// Weighs channels as relMSE does.
    pub fn new(reference: &[f64]) -> Self {
        let n = reference.len();
        Self {
            weights: reference.iter().map(|&x| 1.0 / relative_to(x)).collect(),
            sums: vec![(0.0, vec![0.0; n], vec![0.0; n]); SHARES.len()],
        }
    }

    /// Adds a render with all pixels at the share of index `i`.
    pub fn add(&mut self, i: usize, picture: impl Iterator<Item = f32>) {
        let (n, mean, squares) = &mut self.sums[i];
        *n += 1.0;
        for ((mean, square), x) in mean.iter_mut().zip(squares).zip(picture) {
            let d = f64::from(x) - *mean;
            *mean += d / *n;
            *square += d * (f64::from(x) - *mean);
        }
    }

    /// Each pixel's best share.
    pub fn shares(&self) -> Vec<f32> {
        let pixels = self.weights.len() / 3;
        let of = |pixel: usize| {
            let variance = |(_, _, squares): &(f64, Vec<f64>, Vec<f64>)| {
                (3 * pixel..3 * pixel + 3).map(|c| squares[c] * self.weights[c]).sum::<f64>()
            };
            best(&std::array::from_fn(|i| variance(&self.sums[i])), PSEUDO_REPLICAS / self.sums[0].0)
        };
        (0..pixels).into_par_iter().map(of).collect()
    }
}

/// The one of [`SHARES`] at which the curve V(t) = c + Σ_j W_j/(1 + t r_j), r = ±1, ±½, W_j ≥ 0, t = 2α − 1, that comes
/// nearest to noisy variances at them in relative least squares, is lowest. The family is that of ∫ f²/p_α for integrands with
/// four values of r, up to a constant: convex, so that noise cannot make it fall twice. W of r = ±1 gains `pseudo` times
/// the least variance.
fn best(variances: &[f64; SHARES.len()], pseudo: f64) -> f32 {
    const R: [f64; 4] = [-1.0, -0.5, 0.5, 1.0];
    if variances.iter().any(|v| v.is_nan() || *v <= 0.0) {
        return 0.5;
    }
    // Columns of the relative residual A w − 1; the constant comes last.
    let column = |j: usize, t: f64| if j < R.len() { 1.0 / (1.0 + t * R[j]) } else { 1.0 };
    let t = SHARES.map(|a| 2.0 * f64::from(a) - 1.0);
    let a: [[f64; SHARES.len()]; 5] = std::array::from_fn(|j| std::array::from_fn(|k| column(j, t[k]) / variances[k]));
    let mut w = [0.0; 5];
    let mut residual = [-1.0; SHARES.len()];
    // Coordinate descent: five unknowns, and a tenth of a percent is enough.
    for _ in 0..2000 {
        for j in 0..5 {
            let gradient: f64 = a[j].iter().zip(&residual).map(|(a, r)| a * r).sum();
            let curvature: f64 = a[j].iter().map(|a| a * a).sum();
            let next = w[j] - gradient / curvature;
            let next = if j < R.len() { next.max(0.0) } else { next };
            residual.iter_mut().zip(&a[j]).for_each(|(r, a)| *r += (next - w[j]) * a);
            w[j] = next;
        }
    }
    let least = variances.iter().copied().fold(f64::INFINITY, f64::min);
    w[0] += pseudo * least;
    w[3] += pseudo * least;
    let curve = |t: f64| (0..5).map(|j| w[j] * column(j, t)).sum::<f64>();
    let at = |share: &f32| curve(2.0 * f64::from(*share) - 1.0);
    SHARES.into_iter().min_by(|x, y| at(x).total_cmp(&at(y))).unwrap_or(0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(f: impl Fn(f64) -> f64) -> f32 {
        best(&SHARES.map(|a| f(f64::from(a))), 0.0)
    }

    #[test]
    fn exact_variances_give_the_known_optimum() {
        // Disjoint techniques with Y²-masses 9 and 1: α = √9/(√9 + √1).
        assert!((at(|a| 9.0 / a + 1.0 / (1.0 - a)) - 0.75).abs() < 0.01);
        // f = x² with p_l = 2x, p_b = 2(1 − x): M falls all the way to α = 1.
        assert!(at(|a| 1.0 / a) > 0.96);
        assert!((at(|a| 1.0 / a + 1.0 / (1.0 - a) - 3.0) - 0.5).abs() < 0.01);
    }

    #[test]
    fn what_was_not_seen_holds_the_share_in() {
        let variances = SHARES.map(|a| 1.0 / f64::from(a));
        let held = best(&variances, 1.0 / 16.0);
        assert!((0.7..0.95).contains(&held), "{held}");
    }

    #[test]
    fn without_variance_it_stays_at_half() {
        assert_eq!(at(|_| 0.0), 0.5);
        assert_eq!(at(|_| f64::NAN), 0.5);
    }
}
