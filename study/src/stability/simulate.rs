//! Estimators on discrete images: the methods of the balance as they are, on a [`Sampler`] whose means and variances are
//! known exactly.

use bismar::balance::PixelFeatures;
use bismar::balance::method::{pass_within_goal, take_pass};
use bismar::balance::sampler::LightInfo;
use bismar::balance::{
    Contribution, Cost, Counts, Heuristic, LearnedPixels, Method, Moments, Observer, Sampler, Shares, Technique,
};
use bismar::sampling::SplitMix64;
use glam::Vec3;

use super::domain::{Atom, Image};

/// Positive control of unbiasedness: a pixel's own pilot is reweighted by a share that was estimated from it.
pub struct Biased;

impl Method for Biased {
    fn name(&self) -> &'static str {
        "biased control"
    }

    fn about(&self) -> &'static str {
        "for studies"
    }

    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        pass_within_goal(goal, done, u32::MAX)
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        let pilot = Counts::half(paths / 4);
        let mut moments = vec![Moments::default(); sampler.pixels()];
        for found in sampler.pilot(pilot) {
            moments[found.pixel as usize].add(found.w, found.r, found.z());
        }
        // Counts must be able to reach the total.
        let total: Vec<_> = moments.iter().map(|m| Counts::new(m.second_order().clamp(0.25, 0.75), paths)).collect();
        sampler.reweight(&total);
        let rest: Vec<_> = total.iter().map(|total| total.after(pilot)).collect();
        sampler.take(&rest, &total, None);
        learned.shares.iter_mut().zip(&total).for_each(|(share, total)| share.light_share = total.light_share());
    }
}

/// Positive control of safety: after a pilot of a quarter, the share that minimises the second moment of the pixel's own
/// samples, without pseudo-observations.
pub struct Unsafe;

impl Method for Unsafe {
    fn name(&self) -> &'static str {
        "unguarded control"
    }

    fn about(&self) -> &'static str {
        "for studies"
    }

    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        pass_within_goal(goal, done, if done == 0 { goal.unwrap_or(32) / 4 } else { u32::MAX })
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, done: u32, paths: u32) {
        if done > 0 {
            return take_pass(learned, sampler, paths);
        }
        let (half, mut found) = (vec![Counts::half(paths); sampler.pixels()], Vec::new());
        sampler.take(&half, &half, Some(&mut found));
        for (pixel, share) in learned.shares.iter_mut().enumerate() {
            let own = || found.iter().filter(|f: &&Contribution| f.pixel as usize == pixel);
            let one = |alpha: f32, f: &Contribution| f.radiance.length_squared() / (1.0 + (2.0 * alpha - 1.0) * f.r);
            let moment = |alpha: f32| own().map(|f| one(alpha, f)).sum::<f32>();
            let shares = (0..=64).map(|i| (i as f32 / 64.0).clamp(1e-3, 1.0 - 1e-3));
            let best = shares.min_by(|&a, &b| moment(a).total_cmp(&moment(b))).unwrap_or(0.5);
            share.light_share = if own().next().is_none() { 0.5 } else { best };
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Shot {
    pub estimate: [f64; 3],
    /// Its exact variance at the shares that were chosen: Σ_k (n_k/N)² V(α_k), as passes are uncorrelated. Without meaning
    /// for the biased control.
    pub variance: [f64; 3],
    /// Share of light samples of the last pass.
    pub share: f32,
}

/// One picture of `paths` paths a pixel.
pub fn replica(image: &Image, method: &dyn Method, paths: u32, random: &mut SplitMix64) -> Vec<Shot> {
    let n = image.pixels.len();
    let mut exact =
        Exact { image, heuristic: method.heuristic(), random, sums: vec![Default::default(); n], pilot: vec![] };
    let mut shares = vec![Shares { light_share: 0.5, environment_share: None }; n];
    let mut moments = vec![Moments::default(); if method.sums_moments() { n } else { 0 }];
    let mut done = 0;
    while let Some(pass) = method.next_pass(done, Some(paths), None) {
        method.pass(&mut LearnedPixels { shares: &mut shares, moments: &mut moments }, &mut exact, done, pass);
        done += pass;
    }
    let n = f64::from(paths);
    let shot = |(s, share): (&Sums, &Shares)| Shot {
        estimate: s.sum.map(|x| x / n),
        variance: s.variance.map(|v| v / (n * n)),
        share: share.light_share,
    };
    exact.sums.iter().zip(&shares).map(shot).collect()
}

/// Samples of either technique cost the same here.
pub(crate) const EQUAL_COST: Cost = Cost { fixed: 1.0, light: 1.0, bsdf: 1.0 };

#[derive(Debug, Clone, Default)]
struct Sums {
    sum: [f64; 3],
    variance: [f64; 3],
}

struct Exact<'a> {
    image: &'a Image,
    heuristic: Heuristic,
    random: &'a mut SplitMix64,
    sums: Vec<Sums>,
    pilot: Vec<Contribution>,
}

impl Sampler for Exact<'_> {
    fn pixels(&self) -> usize {
        self.image.pixels.len()
    }

    fn width(&self) -> usize {
        self.image.width
    }

    fn lights(&self) -> Option<LightInfo> {
        Some(LightInfo { environment_probability: None, indirect: false, selection_cost: 0.0 })
    }

    fn max_paths(&self) -> u32 {
        u32::MAX
    }

    fn take(&mut self, counts: &[Counts], weighed: &[Counts], mut observer: Option<&mut dyn Observer>) {
        for pixel in 0..self.sums.len() {
            let heuristic = self.heuristic;
            self.trace(pixel, counts[pixel], weighed[pixel], |sums, atom, by_light, contribution| {
                let found = atom.contribution(heuristic, weighed[pixel], by_light);
                sums.sum.iter_mut().zip(found).for_each(|(s, x)| *s += x);
                if let Some(observer) = &mut observer {
                    observer.contribution(&contribution);
                }
            });
            let variance = self.image.pixels[pixel].variance(self.heuristic, weighed[pixel]);
            let n = f64::from(weighed[pixel].paths);
            self.sums[pixel].variance.iter_mut().zip(variance).for_each(|(sum, v)| *sum += n * n * v);
        }
    }

    fn pilot(&mut self, counts: Counts) -> &[Contribution] {
        let mut found = Vec::new();
        for pixel in 0..self.sums.len() {
            self.trace(pixel, counts, counts, |_, _, _, contribution| found.push(contribution));
        }
        self.pilot = found;
        &self.pilot
    }

    fn reweight(&mut self, total: &[Counts]) {
        // One of each technique a path.
        let half = Counts::half(1);
        for found in self.pilot.iter().filter(|f| f.radiance.is_finite() && f.radiance.max_element() > 0.0) {
            let pixel = found.pixel as usize;
            let added = found.reweighted(total[pixel].relative_to(half));
            self.sums[pixel].sum.iter_mut().zip(added.to_array()).for_each(|(s, x)| *s += f64::from(x));
        }
    }

    fn features(&mut self) -> Vec<PixelFeatures> {
        self.image.guides.clone()
    }

    fn cost(&self) -> Cost {
        EQUAL_COST
    }
}

impl Exact<'_> {
    /// Takes `counts` samples, weighed by `weighed`, and hands over the places where something is.
    fn trace(
        &mut self,
        pixel: usize,
        counts: Counts,
        weighed: Counts,
        mut found: impl FnMut(&mut Sums, &Atom, bool, Contribution),
    ) {
        for (by_light, n) in [(true, counts.light), (false, counts.bsdf)] {
            for index in 0..n {
                let atom: &Atom = self.image.pixels[pixel].sample(by_light, self.random.f64());
                if atom.f == [0.0; 3] {
                    continue;
                }
                // Invalid values are passed on: the balance must handle them.
                let (a_l, a_b) = (f64::from(weighed.light_per_path()), f64::from(weighed.bsdf_per_path()));
                let z = atom.f.map(|f| 2.0 * f / (a_l * atom.light + a_b * atom.bsdf));
                let y = atom.f.map(|f| 2.0 * f / (atom.light + atom.bsdf));
                let w = (0..3).map(|c| y[c] * z[c]).sum::<f64>() as f32;
                let technique = if by_light { Technique::Light } else { Technique::Bsdf };
                let (r, radiance) = (atom.r() as f32, Vec3::from_array(z.map(|z| (0.5 * z) as f32)));
                let (of, area) = (pixel as u32, false);
                let contribution = Contribution { pixel: of, technique, area, layer: 0, index, r, w, radiance };
                found(&mut self.sums[pixel], atom, by_light, contribution);
            }
        }
    }
}
