//! Statistics of many renders of one picture by one estimator.

use super::cases::BAR;
use super::judge::{Outcome, Trial};
use crate::statistics::Sums;

/// Green channel and shares of light samples of all replicas.
#[derive(Debug, Clone)]
pub struct Renders {
    /// Green channel, by replica and pixel.
    pub green: Vec<Vec<f64>>,
    /// Share of light samples, by replica and pixel.
    pub shares: Vec<Vec<f32>>,
}

impl Renders {
    /// Compares variances with those of `half` with the same seeds, and means with those of `half` with other seeds (`truth`).
    pub fn outcome(&self, estimator: String, half: &Self, truth: &Self) -> Outcome {
        let pixels = self.green[0].len();
        let sums = |values: &mut dyn Iterator<Item = f64>| {
            let mut sums = Sums::default();
            values.for_each(|x| sums.add(x));
            sums
        };
        let (mut trial, mut shares) = (Trial::new(BAR), Vec::new());
        let test = |trial: &mut Trial, a: Sums, b: Sums| {
            trial.test(a.mean() - b.mean(), a.error().hypot(b.error()), b.mean());
        };
        for i in 0..pixels {
            let pixel = |r: &Renders| sums(&mut r.green.iter().map(|p| p[i]));
            let (a, b) = (pixel(self), pixel(half));
            test(&mut trial, a, pixel(truth));
            let nothing = 1e-10 * b.mean().powi(2);
            trial.ratio(a.variance(), b.variance(), nothing, || {
                // Influence of each replica on the logarithm of the ratio; both estimators have the same seeds.
                let mut influence = self.green.iter().zip(&half.green).map(|(x, y)| {
                    (x[i] - a.mean()).powi(2) / a.variance().max(nothing) - (y[i] - b.mean()).powi(2) / b.variance()
                });
                a.variance() / b.variance() * sums(&mut influence).error()
            });
            shares.push(sums(&mut self.shares.iter().map(|s| f64::from(s[i]))));
        }
        let picture = |r: &Renders| sums(&mut r.green.iter().map(|p| p.iter().sum::<f64>() / pixels as f64));
        let (a, b) = (picture(self), picture(truth));
        test(&mut trial, a, b);
        let finite = self.green.iter().flatten().all(|x| x.is_finite())
            && self.shares.iter().flatten().all(|s| (0.0..=1.0).contains(s));
        trial.outcome(estimator, finite, a.mean() / b.mean() - 1.0, &shares)
    }
}
