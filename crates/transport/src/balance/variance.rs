//! Shares by measured variance: what the pixels of a tile learn from a pilot of equal counts.
//!
//! The shares of a pixel follow from its neighbours' pilots, never from its own. They do not depend on the pixel's own
//! samples, so all of these, including the pilot's, can be weighted by the total counts in one balance heuristic: no sample
//! is lost to the pilot, and the points of a low-discrepancy sequence stay one set. (Reweighting a pixel's samples by a share
//! that follows from them is biased.)
//!
//! Variances are measured, not modelled: between the means of aligned blocks of consecutive samples, which is the variance
//! that remains after fixed counts and stratified points. The pilot is reweighted for each of a few candidate shares.

use glam::Vec3;

use super::{Contribution, Cost, Counts, PixelFeatures, Shares, Technique};
use crate::lanes::{F, LANES, eight};

/// The light shares to choose from. Eighths keep counts multiples of the sequence's small blocks, and the second moment
/// below four times that of ½ for any integrand.
pub const LIGHT_SHARES: [f32; 7] = [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];

/// Largest number of samples in a block; a block is at most a quarter of a technique's pilot.
const MAX_BLOCK_SAMPLES: u32 = 8;
/// Distance in pixels, along each axis, up to which a pixel learns from its neighbours.
const NEIGHBOUR_RADIUS: usize = 3;

/// How much evidence is needed to leave the prior shares.
#[derive(Debug, Clone, Copy)]
pub struct Caution {
    /// Pseudo-observations: samples with large contributions, as typical as those seen, that each technique alone finds.
    kappa: f32,
    /// Standard errors of the gain, over the neighbours, that are subtracted from it.
    doubt: f32,
    /// Least relative gain in variance.
    min_gain: f32,
    /// Maximum of variance times cost at the shares that neighbours choose, over that at the prior shares, by the variances of
    /// a tile's pixels themselves. Blocks as short as a pilot's show too little of what stratification does for ½.
    max_remaining: f32,
}

impl Caution {
    /// For direct lighting.
    pub const DIRECT: Self = Self { kappa: 2.0, doubt: 1.0, min_gain: 0.05, max_remaining: 1.0 };
    /// For paths with indirect light, which is occasionally far stronger than a pilot shows.
    pub const INDIRECT: Self = Self { kappa: 4.0, doubt: 2.0, min_gain: 0.1, max_remaining: 0.85 };
}

/// A colour channel below this fraction of the strongest is weighted as if it had this fraction.
const MIN_CHANNEL: f32 = 0.05;
/// Degrees of freedom of a pixel's variance: four blocks per technique.
const DEGREES_OF_FREEDOM: f32 = 3.0;

/// The shares that a pixel may have, and the counts of the pilot from which it chooses.
#[derive(Debug)]
pub struct Candidates {
    shares: Vec<Shares>,
    /// Index of the shares that are used without evidence.
    prior: usize,
    /// Samples per path relative to the pilot's: light or environment, area lights, BSDF. Eight candidates at a time; the
    /// last one is repeated.
    ratios: Vec<[F; 3]>,
    /// Samples per path of the pilot; 0 for techniques that do not exist.
    pilot: [f32; 3],
    caution: Caution,
    /// The relative increase of the variance by contributions that only one technique can find, against the prior shares:
    /// Σ u_i²/n_i / Σ u_i − 1 with counts n_i, where u_i are the counts of the prior shares. These minimise it for the same
    /// Σ n_i, so that nothing moves without evidence. Eight candidates at a time.
    unseen: Vec<F>,
}

impl Candidates {
    /// Light and BSDF samples; the prior light share is ½.
    pub fn light_and_bsdf(caution: Caution) -> Self {
        let shares = LIGHT_SHARES.map(|light_share| Shares { light_share, environment_share: None }).to_vec();
        Self::new(shares, Shares { light_share: 0.5, environment_share: None }, [1.0, 0.0, 1.0], caution)
    }

    /// Environment, area-light and BSDF samples. The prior light share is ½, and the prior environment share is the eighth
    /// nearest to `environment_probability`.
    pub fn environment_area_and_bsdf(environment_probability: f32, caution: Caution) -> Self {
        let all = LIGHT_SHARES.into_iter().flat_map(|light| LIGHT_SHARES.map(|environment| (light, environment)));
        // The total includes the pilot: half a light sample of each kind per path, in a quarter of the paths.
        let reached = all.filter(|(light, environment)| 2.0 * light * environment.min(1.0 - environment) >= 0.125);
        let shares = reached
            .map(|(light_share, environment)| Shares { light_share, environment_share: Some(environment) })
            .collect();
        let environment_share = Some((8.0 * environment_probability).round().clamp(1.0, 7.0) / 8.0);
        Self::new(shares, Shares { light_share: 0.5, environment_share }, [0.5, 0.5, 1.0], caution)
    }

    fn new(shares: Vec<Shares>, prior: Shares, pilot: [f32; 3], caution: Caution) -> Self {
        let ratios = |chunk: &[Shares]| {
            let shares = eight(|lane| chunk[lane.min(chunk.len() - 1)]);
            let lanes = |ratio: &dyn Fn(Shares) -> f32| F::from(shares.map(ratio));
            let environment = |s: Shares| s.environment_share.unwrap_or(1.0);
            [
                lanes(&|s| 2.0 * s.light_share * environment(s) / pilot[0]),
                lanes(&|s| {
                    if pilot[1] > 0.0 { 2.0 * s.light_share * (1.0 - environment(s)) / pilot[1] } else { 1.0 }
                }),
                lanes(&|s| 2.0 * (1.0 - s.light_share) / pilot[2]),
            ]
        };
        let prior = shares.iter().position(|s| *s == prior).unwrap_or(0);
        let ratios: Vec<_> = shares.chunks(LANES).map(ratios).collect();
        let techniques = || (0..3).filter(|&t| pilot[t] > 0.0);
        let at_prior = ratios[prior / LANES].map(|ratio| ratio.as_array()[prior % LANES]);
        let all: f32 = techniques().map(|t| pilot[t] * at_prior[t]).sum();
        let unseen = |ratios: &[F; 3]| {
            let term = |t: usize| F::splat(pilot[t] * at_prior[t] * at_prior[t]) / ratios[t];
            techniques().map(term).fold(F::ZERO, |sum, x| sum + x) * F::splat(1.0 / all) - F::ONE
        };
        Self { prior, unseen: ratios.iter().map(unseen).collect(), ratios, shares, pilot, caution }
    }

    /// The shares that are used without evidence.
    pub fn prior(&self) -> Shares {
        self.shares[self.prior]
    }

    /// The counts of a pilot of `paths` paths, an even number.
    pub fn pilot(&self, paths: u32) -> Counts {
        let environment = (self.pilot[1] > 0.0).then_some(paths / 2);
        Counts { environment, ..Counts::half(paths) }
    }
}

/// The measured variances of some pixels at each of the candidate shares.
#[derive(Debug)]
pub struct BlockVariances<'a> {
    candidates: &'a Candidates,
    /// For each pixel and candidate, the variance of the pixel's mean over its squared mean, up to a common factor.
    variance: Vec<F>,
    /// The same of each pixel at the prior shares; zero for pixels without measured variance.
    prior: Vec<f32>,
}

impl<'a> BlockVariances<'a> {
    /// Measures the variances of `pixels` pixels by a pilot of `paths` ≥ 4 paths with the counts of [`Candidates::pilot`].
    pub fn new(candidates: &'a Candidates, contributions: &[Contribution], pixels: usize, paths: u32) -> Self {
        let chunks = candidates.ratios.len();
        // The block size is the same for all techniques, so that the stratification of longer blocks favours none.
        let fewest = candidates.pilot.iter().filter(|a| **a > 0.0).fold(1.0, |a: f32, b| a.min(*b));
        let block = ((fewest * paths as f32) as u32 / 4).clamp(1, MAX_BLOCK_SAMPLES);
        let blocks = candidates.pilot.map(|a| ((a * paths as f32) as u32 / block) as usize);
        let all_blocks: usize = blocks.iter().sum();
        let first_block = [0, blocks[0], blocks[0] + blocks[1]];
        // Channels count by their relative error. By absolute error the strongest would decide, at the expense of the others
        // where techniques find different colours.
        let mut radiance = vec![Vec3::ZERO; pixels];
        for contribution in contributions {
            radiance[contribution.pixel as usize] += contribution.radiance;
        }
        let weight = |pixel: u32| {
            let radiance = radiance[pixel as usize];
            if !radiance.is_finite() {
                return Vec3::NAN;
            }
            radiance.max(Vec3::splat(MIN_CHANNEL * radiance.max_element())).recip()
        };
        // Sums of the weighted channels over each block: by pixel, technique, block and candidate.
        let mut sums = vec![F::ZERO; pixels * all_blocks * chunks];
        for contribution in contributions {
            let area = usize::from(contribution.area);
            let technique = if contribution.technique == Technique::Light { area } else { 2 };
            let at = (contribution.index / block) as usize;
            if at >= blocks[technique] {
                continue;
            }
            let y = F::splat(2.0 * contribution.radiance.dot(weight(contribution.pixel)));
            let (light, bsdf) = (F::splat(1.0 + contribution.r), F::splat(1.0 - contribution.r));
            let at = (contribution.pixel as usize * all_blocks + first_block[technique] + at) * chunks;
            for (sum, ratios) in sums[at..at + chunks].iter_mut().zip(&candidates.ratios) {
                *sum += y / (ratios[area] * light + ratios[2] * bsdf);
            }
        }
        let mut variances = Self { candidates, variance: Vec::with_capacity(pixels * chunks), prior: Vec::new() };
        for sums in sums.chunks_exact(all_blocks * chunks) {
            variances.add_pixel(sums, blocks, first_block);
        }
        variances
    }

    /// Adds the variances of a pixel, from the sums over its blocks.
    fn add_pixel(&mut self, sums: &[F], blocks: [usize; 3], first_block: [usize; 3]) {
        let candidates = self.candidates;
        let chunks = candidates.ratios.len();
        let start = self.variance.len();
        self.variance.resize(start + chunks, F::ZERO);
        let mut mean_at_prior = 0.0;
        let prior = (candidates.prior / LANES, candidates.prior % LANES);
        for technique in (0..3).filter(|&t| candidates.pilot[t] > 0.0) {
            let n = blocks[technique];
            let sums = &sums[first_block[technique] * chunks..][..n * chunks];
            let a = candidates.pilot[technique];
            for chunk in 0..chunks {
                let of_chunk = || sums.iter().skip(chunk).step_by(chunks);
                let mean = of_chunk().fold(F::ZERO, |a, b| a + *b) * F::splat(1.0 / n as f32);
                let squares = of_chunk().fold(F::ZERO, |a, b| (*b - mean).mul_add(*b - mean, a));
                // n_i samples of variance V_i add n_i V_i, where n_i ∝ a_i times the ratio.
                let scale = F::splat(a / (n as f32 - 1.0));
                self.variance[start + chunk] += squares * scale * candidates.ratios[chunk][technique];
                if chunk == prior.0 {
                    mean_at_prior +=
                        a * mean.as_array()[prior.1] * candidates.ratios[chunk][technique].as_array()[prior.1];
                }
            }
        }
        let scale = 1.0 / (mean_at_prior * mean_at_prior);
        let variances = &mut self.variance[start..];
        variances.iter_mut().for_each(|v| *v *= F::splat(scale));
        let at_prior = variances[prior.0].as_array()[prior.1];
        let finite = scale.is_finite() && variances.iter().all(|v| v.is_finite().to_bitmask() == (1 << LANES) - 1);
        self.prior.push(if finite { at_prior } else { 0.0 });
    }

    /// The shares of each pixel of a tile with `width` pixels per row, by the other pixels' variances alone: those that its
    /// neighbours choose, or the prior where such shares leave too much of variance times `cost` at the pixels that are no
    /// neighbours of it. These judge by their own variances what their neighbours have chosen. `features` has one entry per pixel.
    /// With `shared` paths, a pixel learns nothing from columns of its own parity ([`Sampler::pilot`](super::Sampler::pilot)).
    pub fn choose(&self, width: usize, features: &[PixelFeatures], cost: Cost, shared: bool) -> Vec<Shares> {
        let Candidates { shares, prior, caution, .. } = self.candidates;
        let pixels = self.prior.len();
        let informs = |other: usize, pixel: usize| !shared || (other % width + pixel % width) % 2 == 1;
        let by_neighbours = |pixel| self.by_neighbours(pixel, width, features, cost, |other| informs(other, pixel));
        let chosen: Vec<_> = (0..pixels).map(by_neighbours).collect();
        let work: Vec<_> = chosen.iter().enumerate().map(|(pixel, at)| self.work(pixel, *at, cost)).collect();
        // Whole sums without these pixels, not less them: rounding would leave a trace of the pixel itself.
        let of_parity = |row: &[[f64; 2]], parity| {
            sum(row.iter().enumerate().filter(|(column, _)| informs(*column, parity)).map(|(_, work)| *work))
        };
        let rows: Vec<_> = work.chunks(width).map(|row| (row, [0, 1].map(|parity| of_parity(row, parity)))).collect();
        let is_far = |a: usize, b: usize| a.abs_diff(b) > NEIGHBOUR_RADIUS;
        let pays = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let beside = |row: &[[f64; 2]]| {
                let counts = |column: usize| is_far(column, x) && informs(column, x);
                sum(row.iter().enumerate().filter(|(column, _)| counts(*column)).map(|(_, work)| *work))
            };
            let by_row = rows.iter().enumerate();
            let [chosen, prior] =
                sum(by_row.map(|(row, (work, all))| if is_far(row, y) { all[x % 2] } else { beside(work) }));
            chosen <= f64::from(caution.max_remaining) * prior
        };
        let share = |(pixel, at): (usize, usize)| shares[if at != *prior && pays(pixel) { at } else { *prior }];
        chosen.into_iter().enumerate().map(share).collect()
    }

    /// Variance times cost of a pixel at candidate `at`, and at the prior shares; zero if that is its candidate.
    fn work(&self, pixel: usize, at: usize, cost: Cost) -> [f64; 2] {
        let Candidates { shares, ratios, prior, .. } = self.candidates;
        if at == *prior || self.prior[pixel] == 0.0 {
            return [0.0; 2];
        }
        let variance = self.variance[pixel * ratios.len() + at / LANES].as_array()[at % LANES];
        let cost = [at, *prior].map(|at| cost.at(shares[at].light_share));
        [variance * cost[0], self.prior[pixel] * cost[1]].map(f64::from)
    }

    /// The candidate for pixel `pixel` by the variances of its neighbours alone. Among those with less variance than the prior,
    /// pseudo-observations and doubt included, it is the one with the least variance times `cost`; the prior if there is none.
    fn by_neighbours(
        &self,
        pixel: usize,
        width: usize,
        features: &[PixelFeatures],
        cost: Cost,
        informs: impl Fn(usize) -> bool,
    ) -> usize {
        let chunks = self.candidates.ratios.len();
        let similar = |other: &usize| {
            *other != pixel
                && informs(*other)
                && self.prior[*other] > 0.0
                && features[pixel].is_similar(&features[*other])
        };
        let mut neighbours = [0; (2 * NEIGHBOUR_RADIUS + 1).pow(2)];
        let mut found = 0;
        for other in around(pixel, width, self.prior.len(), NEIGHBOUR_RADIUS).filter(similar) {
            neighbours[found] = other;
            found += 1;
        }
        let neighbours = &neighbours[..found];
        if found < 2 {
            return self.candidates.prior;
        }
        let count = found as f32;
        let (mut prior, mut prior2) = (0.0f32, 0.0f32);
        for &other in neighbours {
            prior += self.prior[other];
            prior2 += self.prior[other] * self.prior[other];
        }
        let Caution { kappa, doubt, min_gain, .. } = self.candidates.caution;
        let unseen = kappa * prior2 / (prior * count * DEGREES_OF_FREEDOM);
        let prior = prior / count;
        let threshold = -min_gain * prior;
        let mut best = (f32::INFINITY, self.candidates.prior);
        for chunk in 0..chunks {
            // Sums over neighbours of the difference to the prior's variance, and of its square.
            let (mut gain, mut gain2) = (F::ZERO, F::ZERO);
            for &other in neighbours {
                let d = self.variance[other * chunks + chunk] - F::splat(self.prior[other]);
                gain += d;
                gain2 = d.mul_add(d, gain2);
            }
            let mean = gain * F::splat(1.0 / count);
            let error = (gain2 * F::splat(1.0 / count) - mean * mean).fast_max(F::ZERO);
            let error = (error * F::splat(1.0 / (count - 1.0))).sqrt();
            let score = mean + F::splat(doubt) * error + F::splat(unseen) * self.candidates.unseen[chunk];
            for (lane, score) in score.to_array().into_iter().enumerate() {
                let at = chunk * LANES + lane;
                let Some(shares) = self.candidates.shares.get(at) else { break };
                let work = (prior + score) * cost.at(shares.light_share);
                if score < threshold && work < best.0 {
                    best = (work, at);
                }
            }
        }
        best.1
    }
}

fn sum(pairs: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    pairs.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d])
}

/// The pixels within `radius` of `pixel` along each axis, `pixel` included, row by row, in a tile of `pixels` pixels with
/// `width` per row.
pub fn around(pixel: usize, width: usize, pixels: usize, radius: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let rows = y.saturating_sub(radius)..=(y + radius).min(pixels / width - 1);
    let columns = x.saturating_sub(radius)..=(x + radius).min(width - 1);
    rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

#[cfg(test)]
mod tests;
