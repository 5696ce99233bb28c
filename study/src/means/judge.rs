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
use crate::statistics::{mean_of, moments};

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

/// A region's mean over many scenes, of which each has a term whose mean is zero where there is no fault: the difference of one half
/// of the seeds, as a fraction of the reference and weighted by the precision that the other half tells, and the reverse. What a
/// weight is made of is independent of the difference that it weighs, so that it favours neither sign: by the scatter of the same
/// pictures, those that met less light would count for more.
#[derive(Debug, Clone, Default)]
pub struct Together {
    /// Terms, weights, and the terms' variances as the pictures tell them.
    terms: Vec<[f64; 3]>,
}

/// Relative error of a scene's mean below which more weight would leave the sum to few scenes.
const LEAST_ERROR: f64 = 0.01;
/// Paths of the brightest light that pictures are taken to have missed, in the mean. A few pictures without rare light have little
/// scatter; with the weight of that, a single path of the other half would hide what all other scenes tell. With m such paths it
/// counts for at most 1 / (2 √m) standard errors of another scene.
const MISSED: f64 = 0.25;

/// Near a light without a size a path's light has no bound: n paths have a chance of about 1/k to meet k times the most that n others
/// have met. Where one is brighter than this many times the brightest light, so many times as much is taken for the most.
const UNBOUNDED: [f64; 2] = [2.0, 10.0];

/// The pictures of the first half of the seeds, or of the second.
fn half(pictures: &[Picture], second: bool) -> &[Picture] {
    let (a, b) = pictures.split_at(pictures.len() / 2);
    if second { b } else { a }
}

/// Mean square error of a region's mean, of the first half of the seeds and of the second, over all ways of a scene: what some meet
/// rarely, others show. `brightest` is the most light of a path, `pixels` the region's size.
pub fn mean_squares(region: usize, all: &[&[Picture]], brightest: f64, pixels: f64) -> [f64; 2] {
    let [least, times] = UNBOUNDED;
    [false, true].map(|second| {
        let pictures = || all.iter().map(|pictures| half(pictures, second));
        let peaks = pictures().flatten().flat_map(|picture| picture.peaks_of(region));
        let peak = f64::from(peaks.copied().fold(0.0, f32::max));
        let most = if peak > least * brightest { times * peak } else { brightest };
        let square = |pictures| {
            let sample = Sample::new(pictures, &|picture| picture.regions[region]);
            let path = most / (sample.n * sample.paths * pixels);
            sample.variance / sample.n + MISSED * path * path
        };
        mean_of(pictures().map(square))
    })
}

impl Together {
    /// Adds a scene, with its [`mean_squares`].
    pub fn add(&mut self, region: usize, (own, of): (&[Picture], OfPicture), reference: &[Picture], squares: [f64; 2]) {
        let test = |second| Test::new(region, (half(own, second), of), half(reference, second), (0.0, 1.0, 1.0));
        let tests = [false, true].map(test);
        let mut sums = [0.0; 3];
        for (test, (other, square)) in tests.iter().zip(tests.iter().zip(squares).rev()) {
            if other.reference > 0.0 {
                let scale = other.reference;
                let square = other.error.powi(2).max(square) / scale.powi(2);
                let weight = 1.0 / (square + LEAST_ERROR.powi(2));
                sums[0] += weight * test.difference / scale;
                sums[1] += weight;
                sums[2] += weight * weight * square;
            }
        }
        if sums[1] > 0.0 {
            self.terms.push(sums);
        }
    }

    /// Mean relative difference and its standard error, of more than two scenes. The error is what the terms' scatter tells or what
    /// the pictures tell, the larger: where most scenes have missed rare light, their terms scatter too little.
    pub fn difference(&self) -> Option<(f64, f64)> {
        let n = self.terms.len() as f64;
        let [terms, weights, told] = [0, 1, 2].map(|i| self.terms.iter().map(|term| term[i]).sum::<f64>());
        let mean = terms / weights;
        let squares = self.terms.iter().map(|[term, weight, _]| (term - mean * weight).powi(2)).sum::<f64>();
        (n > 2.0).then(|| (mean, (squares * n / (n - 1.0)).max(told).sqrt() / weights))
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

    /// Pictures whose light is smooth with some noise, but for a part that arrives in rare paths of one brightness, so many per
    /// picture, or evenly.
    #[derive(Clone, Copy)]
    struct Light {
        smooth: f64,
        noise: f64,
        rare: f64,
        per_picture: f64,
        evenly: bool,
    }

    impl Light {
        fn pictures(&self, times: f64, random: &mut SplitMix64) -> Vec<Picture> {
            let one = |_| {
                let noise = self.noise / times.sqrt() * ((0..12).map(|_| random.f64()).sum::<f64>() - 6.0);
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
            let rare = Light { smooth: 1.0, noise: 0.05, rare: 0.3, per_picture, evenly: false };
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
        let smooth = |smooth| Light { smooth, noise: 0.05, rare: 1e-9, per_picture: 1.0, evenly: false };
        assert!(smooth(1.0).found(&smooth(1.0)) <= 2);
        // Four standard errors would be 0.065.
        assert!(smooth(0.87).found(&smooth(1.0)) > 390 && smooth(1.13).found(&smooth(1.0)) > 390);
    }

    /// Is the mean over scenes of these lights wrong, as one of so many, where a part of the light is lost?
    fn wrong_together(lights: &[Light], kept: f64, tests: usize, random: &mut SplitMix64) -> bool {
        let mut together = Together::default();
        for light in lights {
            let (own, reference) = (light.pictures(1.0, random), light.pictures(4.0, random));
            let squares = mean_squares(0, &[&own, &reference], light.brightest(), 1.0);
            together.add(0, (&own, &|picture| kept * picture.regions[0]), &reference, squares);
        }
        together.is_wrong(tests)
    }

    #[test]
    fn a_hundredth_of_the_light_is_found_by_all_scenes_together_and_rare_light_hides_nothing() {
        let mut random = SplitMix64(2);
        let plain = Light { smooth: 1.0, noise: 0.02, rare: 0.02, per_picture: 1.0, evenly: false };
        // A hundred times the variance, of which most pictures show nothing.
        let rare = |per_picture: f64| Light { rare: 0.2 * per_picture.sqrt(), per_picture, ..plain };
        for others in [vec![], vec![rare(0.1)], vec![rare(0.003)], [0.3, 0.1, 0.03, 0.01, 0.003].map(rare).to_vec()] {
            let lights = [vec![plain; 40], others].concat();
            let mut found =
                |kept, tests| (0..200).filter(|_| wrong_together(&lights, kept, tests, &mut random)).count();
            let [lost, none] = [found(0.99, 9), found(1.0, 1)];
            assert!(lost >= 190 && none <= 2, "{lost} {none}");
        }
        // Where all light is rare, no more false alarms than it says.
        let all: Vec<_> = (0..40).map(|i| rare([0.3, 0.1, 0.03, 0.01][i % 4])).collect();
        let none = (0..500).filter(|_| wrong_together(&all, 1.0, 1, &mut random)).count();
        assert!(none <= 3, "{none}");
    }
}
