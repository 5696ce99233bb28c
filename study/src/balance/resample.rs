//! Standard errors of summaries over pixels, by the bootstrap over replicas.

use bismar::sampling::hash;
use rayon::prelude::*;

use super::ratio::{Deviations, Ratio};
use crate::statistics::{mean_of, median, moments};

const RESAMPLES: u32 = 200;

/// Summary of a picture's ratios: their mean, the mean variance over the other's mean variance, and their median.
pub type Summary = [f64; 3];

fn of_ratios(ratios: &[f64], own: f64, base: f64) -> Summary {
    [mean_of(ratios.iter().copied()), own / base, median(ratios)]
}

/// The summary of plain (not bias-corrected) ratios.
pub fn summary(own: &Deviations, base: &Deviations, ratios: &[Ratio]) -> Summary {
    let total = |d: &Deviations| (0..d.pixels()).map(|p| d.variance_of_all(p)).sum::<f64>();
    of_ratios(&ratios.iter().map(|r| r.ratio).collect::<Vec<_>>(), total(own), total(base))
}

/// Standard errors of the summary: its standard deviation over resampled replicas, drawn for both alike (their replicas
/// share seeds).
pub(crate) fn standard_errors(own: &Deviations, base: &Deviations, ratios: &[Ratio]) -> Summary {
    let n = own.replicas();
    let draw = |b: u32| {
        let replica = |i: usize| hash(b ^ hash(i as u32 ^ 0x2545_f491)) as usize % n;
        let mut times = vec![0.0; n];
        (0..n).for_each(|i| times[replica(i)] += 1.0);
        let variance = |d: &Deviations, pixel: usize| {
            let mut sums = [0.0; 4];
            for (times, y) in times.iter().zip(d.pixel(pixel)) {
                sums.iter_mut().zip(y).for_each(|(s, y)| *s += times * y);
            }
            let [a, b, c, squares] = sums;
            (squares - (a * a + b * b + c * c) / n as f64).max(0.0)
        };
        let (mut all_own, mut all_base) = (0.0, 0.0);
        let of = |ratio: &Ratio| {
            let (a, b) = (variance(own, ratio.pixel), variance(base, ratio.pixel));
            (all_own, all_base) = (all_own + a, all_base + b);
            // A pixel whose variance few replicas make can lose all of it.
            (b > 0.01 * (n - 1) as f64 * base.variance_of_all(ratio.pixel)).then(|| a / b)
        };
        let values = ratios.iter().filter_map(of).collect::<Vec<_>>();
        of_ratios(&values, all_own, all_base)
    };
    let draws = (0..RESAMPLES).into_par_iter().map(draw).collect::<Vec<_>>();
    let deviation = |i: usize| moments(&draws.iter().map(|d| d[i]).collect::<Vec<_>>()).1.sqrt();
    std::array::from_fn(deviation)
}
