//! Statistics of many renders of one picture by one estimator.

use super::cases::BAR;
use super::judge::{Outcome, Ratios, Tests};
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
        let own = self;
        let pixels = own.green[0].len();
        let sums = |values: &mut dyn Iterator<Item = f64>| {
            let mut sums = Sums::default();
            values.for_each(|x| sums.add(x));
            sums
        };
        let (mut tests, mut ratios, mut shares) = (Tests::default(), Ratios::new(BAR), Vec::new());
        let mut test = |a: Sums, b: Sums| {
            let rounding = 4.0 * f64::from(f32::EPSILON) * b.mean();
            tests.add(a.mean() - b.mean(), a.error().hypot(b.error()).hypot(rounding));
        };
        for i in 0..pixels {
            let pixel = |r: &Renders| sums(&mut r.green.iter().map(|p| p[i]));
            let (a, b) = (pixel(own), pixel(half));
            test(a, pixel(truth));
            let nothing = 1e-10 * b.mean().powi(2);
            ratios.add(a.variance(), b.variance(), nothing, || {
                // Influence of each replica on the logarithm of the ratio; both estimators have the same seeds.
                let mut influence = own.green.iter().zip(&half.green).map(|(x, y)| {
                    (x[i] - a.mean()).powi(2) / a.variance().max(nothing) - (y[i] - b.mean()).powi(2) / b.variance()
                });
                a.variance() / b.variance() * sums(&mut influence).error()
            });
            shares.push(sums(&mut own.shares.iter().map(|s| f64::from(s[i]))));
        }
        let picture = |r: &Renders| sums(&mut r.green.iter().map(|p| p.iter().sum::<f64>() / pixels as f64));
        let (a, b) = (picture(own), picture(truth));
        test(a, b);
        let finite = own.green.iter().flatten().all(|x| x.is_finite())
            && own.shares.iter().flatten().all(|s| (0.0..=1.0).contains(s));
        Outcome::new(estimator, finite, &tests, a.mean() / b.mean() - 1.0, &ratios, &shares)
    }
}
