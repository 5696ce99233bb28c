//! Per-pixel variances of replicas, their ratio to another estimator's, and how sure that is.

use bismar::film::compare::relative_to;
use rayon::prelude::*;

use super::cell::Cell;

/// A pixel is worse when its variance ratio is above this.
const WORSE: f64 = 1.05;
/// Expected false discovery rate among the pixels that are surely worse.
const FALSE_DISCOVERIES: f64 = 0.05;

/// Replicas about their mean, weighted as relMSE weighs: 1/√(3 (reference² + 0.01)) a channel, so that a pixel's sum of
/// squares over R − 1 is its contribution to relMSE.
pub struct Deviations {
    replicas: usize,
    /// Pixel by pixel, replica by replica: the three channels and their sum of squares.
    values: Vec<[f64; 4]>,
}

impl Deviations {
    /// Deviations of the first `replicas` replicas of a cell.
    pub fn new(cell: &Cell, replicas: usize, reference: &[f64]) -> Self {
        let values = (0..cell.pixels).into_par_iter().flat_map_iter(|pixel| {
            let weight: [f64; 3] =
                std::array::from_fn(|c| (3.0 * relative_to(reference[3 * pixel + c])).sqrt().recip());
            let at = move |r: usize, c: usize| f64::from(cell.picture(r)[3 * pixel + c]);
            let mean: [f64; 3] =
                std::array::from_fn(|c| (0..replicas).map(|r| at(r, c)).sum::<f64>() / replicas as f64);
            (0..replicas).map(move |r| {
                let y: [f64; 3] = std::array::from_fn(|c| (at(r, c) - mean[c]) * weight[c]);
                [y[0], y[1], y[2], y.iter().map(|y| y * y).sum()]
            })
        });
        Self { replicas, values: values.collect() }
    }

    pub fn replicas(&self) -> usize {
        self.replicas
    }

    pub fn pixels(&self) -> usize {
        self.values.len() / self.replicas
    }

    pub fn pixel(&self, pixel: usize) -> &[[f64; 4]] {
        &self.values[pixel * self.replicas..][..self.replicas]
    }

    pub(crate) fn variance_of_all(&self, pixel: usize) -> f64 {
        self.pixel(pixel).iter().map(|y| y[3]).sum::<f64>() / (self.replicas - 1) as f64
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Ratio {
    pub pixel: usize,
    /// Variance over the other's.
    pub ratio: f64,
    /// The same with the bias of order 1/R taken off (jackknife): noise in the divisor lifts the mean of plain ratios.
    pub corrected: f64,
    /// Standard error of the ratio's logarithm (jackknife over replicas); infinite where one replica has all the variance.
    pub log_error: f64,
}

impl Ratio {
    /// Standard errors of the logarithm above that of `threshold`.
    pub fn z(&self, threshold: f64) -> f64 {
        match (self.ratio / threshold).ln() {
            d if d == 0.0 || self.log_error == f64::INFINITY => 0.0,
            // Avoids division by zero where nothing varies between replicas.
            d => d / self.log_error.max(1e-9),
        }
    }
}

/// Which pixels can be judged, by `half` and its control alone: the same for every estimator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Judgeable {
    /// The pixels whose variance is known well enough to be divided by.
    pub pixels: Vec<usize>,
    pub constant: usize,
    /// Number of pixels whose variance comes from few replicas: events too rare to judge. They count in relMSE and
    /// in the ratio of means.
    pub undetermined: usize,
}

/// Variance below which a pixel counts as constant: a relative error of 1e-5.
const CONSTANT: f64 = 1e-10;
/// Largest standard error of a variance's logarithm that can be judged: as that of normal values with 6 replicas. Normal
/// values with 32 replicas have 0.25.
const MOST_LOG_ERROR: f64 = 0.6;

/// Standard errors that the logarithms of `half`'s and its control's variance are apart at most. The errors are themselves
/// estimates: of normal values with 32 replicas one in 1000 goes beyond 4, none of 4000 beyond this.
const MOST_APART: f64 = 6.0;

impl Judgeable {
    /// Selects pixels by `half` and its control.
    pub fn new(base: &Deviations, control: &Deviations) -> Self {
        let mut judgeable = Self { pixels: Vec::new(), constant: 0, undetermined: 0 };
        for pixel in 0..base.pixels() {
            let both = [base.pixel(pixel), control.pixel(pixel)].map(squares);
            let [(own, own_error), (other, other_error)] = both;
            // The two have the same true variance: where they differ more than their errors say, one has met events that
            // the other has not.
            let alike = (own / other).ln().abs() <= MOST_APART * own_error.hypot(other_error);
            if both.iter().all(|(mean, _)| *mean <= CONSTANT) {
                judgeable.constant += 1;
            } else if alike && both.iter().all(|(_, log_error)| *log_error <= MOST_LOG_ERROR) {
                judgeable.pixels.push(pixel);
            } else {
                judgeable.undetermined += 1;
            }
        }
        judgeable
    }
}

/// Mean of the squared deviations and the standard error of its logarithm: its relative standard error.
fn squares(values: &[[f64; 4]]) -> (f64, f64) {
    let n = values.len() as f64;
    let (sum, fourth) = values.iter().fold((0.0, 0.0), |(s, f), y| (s + y[3], f + y[3] * y[3]));
    (sum / n, ((fourth / (sum * sum) - 1.0 / n).max(0.0) * n / (n - 1.0)).sqrt())
}

/// The ratios of `own` to `base` in some pixels.
pub fn ratios(own: &Deviations, base: &Deviations, pixels: &[usize]) -> Vec<Ratio> {
    pixels.par_iter().filter_map(|&pixel| ratio(own.pixel(pixel), base.pixel(pixel), pixel)).collect()
}

fn ratio(own: &[[f64; 4]], base: &[[f64; 4]], pixel: usize) -> Option<Ratio> {
    let n = own.len() as f64;
    let total = |y: &[[f64; 4]]| y.iter().map(|y| y[3]).sum::<f64>();
    let (own_sum, base_sum) = (total(own), total(base));
    if base_sum <= 0.0 {
        return None;
    }
    let ratio = own_sum / base_sum;
    let without = n / (n - 1.0);
    let one_out = |i: usize| {
        let (a, b) = (own_sum - without * own[i][3], base_sum - without * base[i][3]);
        // Rounding, where the left-out replica has all the variance.
        if b <= 1e-9 * base_sum { f64::INFINITY } else { (a / b).max(0.0) }
    };
    let (mut sum, mut logs, mut squares) = (0.0, 0.0, 0.0);
    for i in 0..own.len() {
        let r = one_out(i);
        sum += r;
        logs += r.ln();
        squares += r.ln().powi(2);
    }
    let variance = (n - 1.0) / n * (squares - logs * logs / n).max(0.0);
    let corrected = n * ratio - (n - 1.0) * sum / n;
    Some(Ratio {
        pixel,
        ratio,
        // Far from normal replicas can carry the correction too far: never beyond the range of the estimates.
        corrected: if corrected.is_finite() { corrected.clamp(0.0, ratio.max(sum / n)) } else { ratio },
        log_error: if variance.is_finite() { variance.sqrt() } else { f64::INFINITY },
    })
}

/// Mean of the bias-corrected ratios.
pub fn mean(ratios: &[Ratio]) -> f64 {
    ratios.iter().map(|r| r.corrected).sum::<f64>() / ratios.len() as f64
}

/// The pixels that are worse beyond what noise explains: their z above [`WORSE`] is beyond what the control's ratios
/// (whose true value is 1) show, with at most [`FALSE_DISCOVERIES`] of wrong finds expected (Benjamini and Hochberg 1995,
/// with the control's z as the null distribution).
pub(crate) fn surely_worse<'a>(ratios: &'a [Ratio], control: &[Ratio]) -> Vec<&'a Ratio> {
    // The control's ratio is as good upside down.
    let mut null = control.iter().map(|r| r.z(1.0).abs()).collect::<Vec<_>>();
    null.sort_by(f64::total_cmp);
    let tail = |z: f64| {
        let beyond = null.len() - null.partition_point(|&x| x < z);
        (0.5 * beyond as f64 + 0.5) / (null.len() as f64 + 0.5)
    };
    let mut found = ratios.iter().map(|r| (r.z(WORSE), r)).filter(|(z, _)| *z > 0.0).collect::<Vec<_>>();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let n = ratios.len() as f64;
    let passes = |(rank, (z, _)): &(usize, &(f64, &Ratio))| tail(*z) <= FALSE_DISCOVERIES * (*rank + 1) as f64 / n;
    let most = found.iter().enumerate().filter(passes).map(|(rank, _)| rank + 1).max().unwrap_or(0);
    found[..most].iter().map(|(_, r)| *r).collect()
}

/// The pixels that look worst in one half of the replicas, judged by the other half: the geometric mean of their ratios
/// there, averaged over both ways round, and its standard error. What noise alone made worst is 1 there.
pub(crate) fn worst_held_out(own: &Deviations, base: &Deviations, pixels: &[usize], share: f64) -> Option<(f64, f64)> {
    let half = own.replicas() / 2;
    let log_ratio = |pixel: usize, first: bool| {
        let range = if first { 0..half } else { half..own.replicas() };
        let [a, b] = [own, base].map(|of| variance(&of.pixel(pixel)[range.clone()]));
        (a > 0.0 && b > 0.0).then(|| (a / b).ln())
    };
    let pairs: Vec<[f64; 2]> =
        pixels.par_iter().filter_map(|&p| Some([log_ratio(p, true)?, log_ratio(p, false)?])).collect();
    let n = ((share * pairs.len() as f64).ceil() as usize).min(pairs.len());
    if n < 2 {
        return None;
    }
    let (mut mean, mut variance) = (0.0, 0.0);
    for (seen, held_out) in [(0, 1), (1, 0)] {
        let mut sorted = pairs.iter().collect::<Vec<_>>();
        sorted.sort_by(|a, b| b[seen].total_cmp(&a[seen]));
        let values = sorted[..n].iter().map(|pair| pair[held_out]).collect::<Vec<_>>();
        let average = values.iter().sum::<f64>() / n as f64;
        let squares = values.iter().map(|x| (x - average).powi(2)).sum::<f64>();
        mean += 0.5 * average;
        variance += 0.25 * squares / (n * (n - 1)) as f64;
    }
    Some((mean.exp(), mean.exp() * variance.sqrt()))
}

/// Sample variance of some of a pixel's replicas.
fn variance(replicas: &[[f64; 4]]) -> f64 {
    let n = replicas.len() as f64;
    let mut sums = [0.0; 4];
    for y in replicas {
        sums.iter_mut().zip(y).for_each(|(s, y)| *s += y);
    }
    let [a, b, c, squares] = sums;
    ((squares - (a * a + b * b + c * c) / n) / (n - 1.0)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::cell::Replica;

    /// Grey replicas of `pixels` pixels, normal with the deviations of `of`, from `seed`.
    fn cell(seed: u64, replicas: usize, pixels: usize, of: impl Fn(usize) -> f64) -> Cell {
        let mut state = seed;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let mut normal = move || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        let mut cell = Cell::new(pixels);
        for _ in 0..replicas {
            let values = (0..pixels).flat_map(|p| [(1.0 + of(p) * normal()) as f32; 3]).collect();
            cell.push(&Replica { values, shares: vec![0.5; pixels], ..Replica::default() });
        }
        cell
    }

    fn deviations(seed: u64, pixels: usize, of: impl Fn(usize) -> f64) -> Deviations {
        Deviations::new(&cell(seed, 32, pixels, of), 32, &vec![1.0; 3 * pixels])
    }

    #[test]
    fn known_variances_give_their_ratio_within_the_stated_error() {
        let n = 4000;
        let (half, again) = (deviations(1, n, |_| 0.1), deviations(2, n, |_| 0.1));
        let judgeable = Judgeable::new(&half, &again);
        assert_eq!(judgeable.pixels.len(), n);
        let ratios = ratios(&deviations(3, n, |_| 0.08), &half, &judgeable.pixels);
        // Variances 0.64: 1. Errors of 4000 log ratios of standard error 0.37 or so: 0.006 of their mean.
        let mean_error = ratios.iter().map(|r| r.log_error).sum::<f64>() / n as f64 / (n as f64).sqrt();
        assert!((mean(&ratios) / 0.64 - 1.0).abs() < 5.0 * mean_error, "{} ± {mean_error}", mean(&ratios));
        // F with 31 and 31 degrees of freedom: the logarithm's deviation is 0.366.
        assert!((mean_error * (n as f64).sqrt() - 0.366).abs() < 0.03, "{}", mean_error * (n as f64).sqrt());
        let plain = ratios.iter().map(|r| r.ratio).sum::<f64>() / n as f64;
        assert!(plain / mean(&ratios) > 1.03, "the correction does something");
    }

    #[test]
    fn noise_makes_no_pixel_surely_worse_and_a_bad_estimator_does() {
        let n = 2000;
        let (half, again) = (deviations(11, n, |_| 0.1), deviations(12, n, |_| 0.1));
        let pixels = Judgeable::new(&half, &again).pixels;
        let control = ratios(&again, &half, &pixels);
        let like = ratios(&deviations(13, n, |_| 0.1), &half, &pixels);
        assert!(surely_worse(&like, &control).len() <= 2);
        // One pixel in twenty has eight times the variance, the others are better.
        let bad = |p: usize| if p.is_multiple_of(20) { 0.1 * 8f64.sqrt() } else { 0.09 };
        let unsafe_one = deviations(14, n, bad);
        let found =
            surely_worse(&ratios(&unsafe_one, &half, &pixels), &control).iter().map(|r| r.pixel).collect::<Vec<_>>();
        let right = found.iter().filter(|p| p.is_multiple_of(20)).count();
        assert!(right > 90 && found.len() - right < 12, "{right} of 100 found, {} in all", found.len());
        let (worst, error) = worst_held_out(&unsafe_one, &half, &pixels, 0.01).unwrap();
        assert!((worst - 8.0).abs() < 5.0 * error, "{worst} ± {error}");
        let (worst, error) = worst_held_out(&again, &half, &pixels, 0.01).unwrap();
        assert!((worst - 1.0).abs() < 5.0 * error, "{worst} ± {error}");
    }

    #[test]
    fn constant_pixels_and_rare_events_are_not_judged() {
        let mut half = cell(5, 32, 3, |p| if p == 0 { 0.1 } else { 0.0 });
        // A single event in one replica.
        half.values[3 * 3 * 7 + 6] = 30.0;
        let half = Deviations::new(&half, 32, &[1.0; 9]);
        let judgeable = Judgeable::new(&half, &deviations(6, 3, |p| if p == 0 { 0.1 } else { 0.0 }));
        assert_eq!(judgeable, Judgeable { pixels: vec![0], constant: 1, undetermined: 1 });
    }
}
