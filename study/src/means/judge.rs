//! The test of two means whose light may be rare.
//!
//! No test of means is safe without a bound of the tails, and scatter alone is none: light that is met once in a million paths may
//! be in neither a mean nor its scatter. So a difference counts only beyond what either side may have missed, by the level p of the
//! test ([`Test::allowed`]):
//!
//! - Where a way is darker: light that `half` has met in so few paths that a way of fewer paths meets none, with a probability of
//!   p. That is the light of the r ln(1/p) brightest paths of `half`, where r is how many times as many paths it has.
//! - Where a way is brighter: light that `half` has not met at all with a probability of p. Its paths carry at most the brightest
//!   radiance of the scene's lights: ln(1/p) times that, over its paths.
//!
//! Light that a way itself makes rare is no excuse: where its picture is dark but for a few fireflies, it is found.

use statrs::distribution::{ContinuousCDF, StudentsT};

use super::ways::Picture;
use crate::statistics::moments;

/// A number of a picture.
type OfPicture<'a> = &'a dyn Fn(&Picture) -> f64;

/// Chance that a scene without a fault is rendered again, at most.
pub const FIRST: f64 = 0.05;
/// Chance that a scene without a fault that is rendered again is called wrong, at most.
pub const AGAIN: f64 = 2e-4;
/// Chance that a mean over all scenes, of a way and a region, raises a false alarm, at most.
pub const TOGETHER: f64 = 1e-3;
/// Differences that are rounding, relative to the mean.
const ROUNDING: f64 = 1e-5;

/// Comparison of a way with the reference, in one region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Test {
    pub region: usize,
    /// Mean of the way less that of the reference, and the latter.
    pub difference: f64,
    pub reference: f64,
    /// Standard error of the difference.
    pub error: f64,
    /// Light that the way may have missed, and light that the reference may have missed.
    pub allowed: [f64; 2],
    freedom: f64,
}

/// Mean, scatter and paths of some pictures' region.
struct Sample {
    mean: f64,
    variance: f64,
    n: f64,
    paths: f64,
}

impl Sample {
    fn new(pictures: &[Picture], of: &dyn Fn(&Picture) -> f64) -> Self {
        let values: Vec<_> = pictures.iter().map(of).collect();
        let (mean, variance) = moments(&values);
        let n = pictures.len() as f64;
        Self { mean, variance, n, paths: pictures.iter().map(|picture| picture.paths).sum::<f64>() / n }
    }
}

impl Test {
    /// Compares `of` a way's pictures with a region of the reference's. `brightest` is the most light of a path, `pixels` the
    /// region's size, `level` the chance that a test may raise a false alarm.
    pub fn new(
        region: usize,
        (own, of): (&[Picture], OfPicture),
        reference: &[Picture],
        (brightest, pixels, level): (f64, f64, f64),
    ) -> Self {
        let (own, base) = (Sample::new(own, of), Sample::new(reference, &|picture| picture.regions[region]));
        let [a, b] = [&own, &base].map(|sample| sample.variance / sample.n);
        let (rare, paths) = (-level.ln(), base.n * base.paths * pixels);
        let mut peaks: Vec<f32> = reference.iter().flat_map(|picture| picture.peaks_of(region)).copied().collect();
        peaks.sort_unstable_by(|a, b| b.total_cmp(a));
        let met = (rare * base.n * base.paths / (own.n * own.paths)).ceil() as usize;
        let most = peaks.iter().take(met).map(|peak| f64::from(*peak)).sum::<f64>();
        // Welch and Satterthwaite.
        let freedom = (a + b).powi(2) / (a * a / (own.n - 1.0) + b * b / (base.n - 1.0));
        Self {
            region,
            difference: own.mean - base.mean,
            reference: base.mean,
            error: (a + b).sqrt().hypot(ROUNDING * base.mean),
            allowed: [most / paths, rare * brightest / paths],
            freedom: if freedom.is_finite() { freedom } else { own.n + base.n - 2.0 },
        }
    }

    /// The difference beyond what is allowed, in standard errors.
    pub fn t(&self) -> f64 {
        let allowed = self.allowed[usize::from(self.difference > 0.0)];
        let beyond = (self.difference.abs() - allowed).max(0.0);
        if beyond == 0.0 { 0.0 } else { beyond.copysign(self.difference) / self.error }
    }

    /// A value over the reference's mean; 0 where that is black.
    pub fn relative(&self, value: f64) -> f64 {
        if self.reference > 0.0 { value / self.reference } else { 0.0 }
    }

    /// Chance of a value of [`Self::t`] so far from zero.
    pub fn chance(&self) -> f64 {
        let t = self.t();
        let tail = |of: StudentsT| 2.0 * of.cdf(-t.abs());
        if t.is_finite() { StudentsT::new(0.0, 1.0, self.freedom).map_or(1.0, tail) } else { 0.0 }
    }
}

/// A region's mean over many scenes, of which each has a term whose mean is zero where there is no fault: the difference of one half of
/// the seeds, weighted by the errors that the other half tells, and the reverse.
#[derive(Debug, Clone, Default)]
pub struct Together {
    /// Terms and weights.
    terms: Vec<[f64; 2]>,
}

/// Relative error of a scene's mean below which more weight would leave the sum to few scenes.
const LEAST_ERROR: f64 = 0.01;

impl Together {
    pub fn add(&mut self, region: usize, (own, of): (&[Picture], OfPicture), reference: &[Picture]) {
        let [a, b] = [own, reference].map(|pictures| pictures.split_at(pictures.len() / 2));
        let tests = [(a.0, b.0), (a.1, b.1)].map(|(a, b)| Test::new(region, (a, of), b, (0.0, 1.0, 1.0)));
        let scale = 0.5 * (tests[0].reference + tests[1].reference);
        if scale > 0.0 {
            let [a, b] = tests.map(|test| test.difference / scale);
            let [v, w] = tests.map(|test| 1.0 / ((test.error / scale).powi(2) + LEAST_ERROR * LEAST_ERROR));
            self.terms.push([w * a + v * b, v + w]);
        }
    }

    /// Mean relative difference and its standard error, of more than two scenes.
    pub fn difference(&self) -> Option<(f64, f64)> {
        let n = self.terms.len() as f64;
        let [terms, weights] = [0, 1].map(|i| self.terms.iter().map(|term| term[i]).sum::<f64>());
        let mean = terms / weights;
        let squares = self.terms.iter().map(|[term, weight]| (term - mean * weight).powi(2)).sum::<f64>();
        (n > 2.0).then(|| (mean, (squares * n / (n - 1.0)).sqrt() / weights))
    }

    /// Is the mean wrong, as one of so many?
    pub fn is_wrong(&self, tests: usize) -> bool {
        let Some((mean, error)) = self.difference() else { return false };
        let t = StudentsT::new(0.0, 1.0, self.terms.len() as f64 - 1.0);
        t.is_ok_and(|t| 2.0 * t.cdf(-(mean / error).abs()) * tests as f64 <= TOGETHER)
    }
}

#[cfg(test)]
mod tests {
    use bismar::sampling::SplitMix64;

    use super::*;

    const PATHS: f64 = 64.0;
    const LEVEL: f64 = 1e-3;

    /// Pictures whose light is smooth but for a part that arrives in rare paths of one brightness, so many per picture, or evenly.
    struct Light {
        smooth: f64,
        rare: f64,
        per_picture: f64,
        evenly: bool,
    }

    impl Light {
        fn pictures(&self, times: f64, random: &mut SplitMix64) -> Vec<Picture> {
            let one = |_| {
                let noise = 0.05 / times.sqrt() * ((0..12).map(|_| random.f64()).sum::<f64>() - 6.0);
                // Poisson's distribution, by products of uniform numbers.
                let (mut met, mut product) = (-1.0, 1.0);
                while product > (-self.per_picture * times).exp() {
                    product *= random.f64();
                    met += 1.0;
                }
                let mut picture = Picture::new(0);
                let events = if self.evenly { 0 } else { met as usize };
                picture.peaks[0] = vec![self.brightest() as f32; events];
                let met = if self.evenly { 1.0 } else { met / (self.per_picture * times) };
                picture.regions[0] = self.smooth + noise + self.rare * met;
                picture.paths = PATHS * times;
                picture
            };
            (0..12).map(one).collect()
        }

        /// The most light of a path, of pictures of one pixel.
        fn brightest(&self) -> f64 {
            self.rare / self.per_picture * PATHS
        }

        /// How many of 400 comparisons with a reference of four times the paths find a difference.
        fn found(&self, reference: &Self) -> usize {
            let mut random = SplitMix64(1);
            let mut differs = |_: &usize| {
                let (own, base) = (self.pictures(1.0, &mut random), reference.pictures(4.0, &mut random));
                let test = Test::new(0, (&own, &|p| p.regions[0]), &base, (reference.brightest(), 1.0, LEVEL));
                test.chance() <= LEVEL
            };
            (0..400).filter(&mut differs).count()
        }
    }

    #[test]
    fn rare_light_is_no_fault_and_a_lost_share_is_one() {
        for per_picture in [0.003, 0.03, 0.1, 0.3, 1.0, 10.0] {
            let rare = Light { smooth: 1.0, rare: 0.3, per_picture, evenly: false };
            // As rare, and found by every picture where `half` may not have met it at all.
            assert!(rare.found(&rare) <= 2, "{per_picture}");
            let even = Light { evenly: true, ..rare };
            assert!(even.found(&rare) <= 2, "{per_picture}: {}", even.found(&rare));
            // Light that is met now and then, and lost.
            let lost = Light { rare: 1e-9, ..rare };
            assert!(per_picture < 3.0 || lost.found(&rare) == 400, "{per_picture}");
            // A share of the smooth light is missing.
            let dark = Light { smooth: 0.5, ..rare };
            assert!(per_picture < 10.0 || dark.found(&rare) == 400, "{per_picture}");
        }
        let smooth = |smooth| Light { smooth, rare: 1e-9, per_picture: 1.0, evenly: false };
        assert!(smooth(1.0).found(&smooth(1.0)) <= 2);
        // Four standard errors would be 0.065.
        assert!(smooth(0.87).found(&smooth(1.0)) > 390 && smooth(1.13).found(&smooth(1.0)) > 390);
    }

    #[test]
    fn a_hundredth_of_the_light_is_missed_by_no_scene_but_by_all_together() {
        let mut random = SplitMix64(2);
        let light = |smooth| Light { smooth, rare: 0.1, per_picture: 1.0, evenly: false };
        let mut found = [0; 2];
        for _ in 0..50 {
            let mut together = [Together::default(), Together::default()];
            for _ in 0..40 {
                let reference = light(1.0).pictures(4.0, &mut random);
                for (together, smooth) in together.iter_mut().zip([1.0, 0.95]) {
                    together.add(0, (&light(smooth).pictures(1.0, &mut random), &|p| p.regions[0]), &reference);
                }
            }
            found.iter_mut().zip(&together).for_each(|(found, together)| *found += usize::from(together.is_wrong(9)));
        }
        assert_eq!(found[0], 0);
        assert!(found[1] > 40, "{found:?}");
    }
}
