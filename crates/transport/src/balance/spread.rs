//! What a tile learns from a pilot of equal counts, and the share of light samples that follows for each of its pixels.
//!
//! A pixel's share is found from its neighbours' pilots, never from its own. So it does not depend on the pixel's own
//! samples, and all of them, the pilot's too, can be weighed by the total counts in one balance heuristic: nothing is
//! lost to the pilot, and the points of a low-discrepancy sequence stay one set of points. (Reweighing a pixel's samples
//! by a share that they had a part in is biased.)
//!
//! Variances are measured, not modelled: between the means of aligned blocks of consecutive samples, which is what
//! fixed counts and stratified points leave over, for each of a few candidate shares, by reweighing the pilot.

use glam::Vec3;

use super::{Contribution, Cost, Counts, Share, Technique};
use crate::lanes::{F, LANES, eight};

/// What the centre of a pixel shows: neighbours that show the same learn from each other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Guide {
    /// Which object and material; 0 where there is nothing.
    pub object: u32,
    /// As `object`.
    pub material: u32,
    /// Unit, or zero.
    pub normal: Vec3,
    /// Distance from the camera.
    pub depth: f32,
    /// Perceptual roughness in [0, 1].
    pub roughness: f32,
}

/// Normals of alike pixels are at most 20° apart.
const MIN_COS: f32 = 0.94;
/// Depths of alike pixels differ by this share at most.
const DEPTH: f32 = 0.05;
/// Roughnesses of alike pixels differ by this share at most.
const ROUGHNESS: f32 = 0.2;

impl Guide {
    fn is_like(&self, other: &Self) -> bool {
        self.object > 0
            && (self.object, self.material) == (other.object, other.material)
            && self.normal.dot(other.normal) > MIN_COS
            && (self.depth - other.depth).abs() < DEPTH * self.depth
            && (self.roughness - other.roughness).abs() <= ROUGHNESS * self.roughness
    }
}

/// Shares of light samples to choose from. Eighths keep counts multiples of the sequence's small blocks, and hold the
/// second moment below four times that of ½ whatever the integrand.
pub const SHARES: [f32; 7] = [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];

/// Samples of a block, but a quarter of a technique's pilot at most.
const BLOCK: u32 = 8;
/// Pixels to each side that a pixel learns from.
const RADIUS: usize = 3;

/// How much evidence it takes to leave the prior share.
#[derive(Debug, Clone, Copy)]
pub struct Caution {
    /// Pseudo-observations: heavy samples, as typical as those seen, that each technique alone could have found.
    kappa: f32,
    /// Standard errors of the gain, over the neighbours, that are held against it.
    doubt: f32,
    /// Least gain in variance, as a share.
    least_gain: f32,
}

impl Caution {
    /// For light that comes straight from where it shines.
    pub const DIRECT: Self = Self { kappa: 2.0, doubt: 1.0, least_gain: 0.05 };
    /// For light that may come by other surfaces: now and then it is far stronger than a pilot shows.
    pub const INDIRECT: Self = Self { kappa: 4.0, doubt: 2.0, least_gain: 0.1 };
}

/// A channel below this share of the strongest counts as if it had that much.
const WEAKEST: f32 = 0.05;
/// Degrees of freedom of one pixel's spread: four blocks a technique.
const DEGREES: f32 = 3.0;

/// The shares that a pixel may have, and the pilot from which it chooses.
#[derive(Debug)]
pub struct Candidates {
    shares: Vec<Share>,
    /// Which of them is taken without evidence.
    prior: usize,
    /// Samples a path over the pilot's: light or environment, area lights, BSDF; eight shares at a time, the last one repeated.
    rates: Vec<[F; 3]>,
    /// Samples a path of the pilot; 0 for what is not there.
    pilot: [f32; 3],
    caution: Caution,
    /// Eight shares at a time: what heavy samples that one technique alone could find would add to the variance, over
    /// what they add at the prior share: Σ u_i²/n_i / Σ u_i − 1 with counts n_i, and u_i at the prior share, which is the
    /// least for the same Σ n_i: without evidence nothing moves.
    unseen: Vec<F>,
}

impl Candidates {
    /// Light and BSDF samples, ½ without evidence.
    pub fn two(caution: Caution) -> Self {
        let shares = SHARES.map(|light| Share { light, environment: None }).to_vec();
        Self::new(shares, Share { light: 0.5, environment: None }, [1.0, 0.0, 1.0], caution)
    }

    /// Environment, area lights and BSDF; without evidence, half of all samples are light samples and the eighth nearest to
    /// `sky` of these go to the environment.
    pub fn three(environment: f32, caution: Caution) -> Self {
        let all = SHARES.into_iter().flat_map(|light| SHARES.map(|environment| (light, environment)));
        // The pilot's are part of the samples: half a light sample a path of each kind, in a quarter of the paths.
        let reached = all.filter(|(light, environment)| 2.0 * light * environment.min(1.0 - environment) >= 0.125);
        let shares = reached.map(|(light, environment)| Share { light, environment: Some(environment) }).collect();
        let prior = Share { light: 0.5, environment: Some((8.0 * environment).round().clamp(1.0, 7.0) / 8.0) };
        Self::new(shares, prior, [0.5, 0.5, 1.0], caution)
    }

    fn new(shares: Vec<Share>, prior: Share, pilot: [f32; 3], caution: Caution) -> Self {
        let rates = |chunk: &[Share]| {
            let share = eight(|lane| chunk[lane.min(chunk.len() - 1)]);
            let of = |rate: &dyn Fn(Share) -> f32| F::from(share.map(rate));
            let environment = |s: Share| s.environment.unwrap_or(1.0);
            [
                of(&|s| 2.0 * s.light * environment(s) / pilot[0]),
                of(&|s| if pilot[1] > 0.0 { 2.0 * s.light * (1.0 - environment(s)) / pilot[1] } else { 1.0 }),
                of(&|s| 2.0 * (1.0 - s.light) / pilot[2]),
            ]
        };
        let prior = shares.iter().position(|s| *s == prior).unwrap_or(0);
        let rates: Vec<_> = shares.chunks(LANES).map(rates).collect();
        let there = || (0..3).filter(|&t| pilot[t] > 0.0);
        let at_prior = rates[prior / LANES].map(|rate| rate.as_array()[prior % LANES]);
        let all: f32 = there().map(|t| pilot[t] * at_prior[t]).sum();
        let unseen = |rates: &[F; 3]| {
            let of = |t: usize| F::splat(pilot[t] * at_prior[t] * at_prior[t]) / rates[t];
            there().map(of).fold(F::ZERO, |sum, x| sum + x) * F::splat(1.0 / all) - F::ONE
        };
        Self { prior, unseen: rates.iter().map(unseen).collect(), rates, shares, pilot, caution }
    }

    /// The share that is taken without evidence.
    pub fn prior(&self) -> Share {
        self.shares[self.prior]
    }

    /// The samples of a pilot of `paths` paths, an even number.
    pub fn pilot(&self, paths: u32) -> Counts {
        let environment = (self.pilot[1] > 0.0).then_some(paths / 2);
        Counts { environment, ..Counts::half(paths) }
    }
}

/// How much the blocks of some pixels vary, at each of the candidates.
#[derive(Debug)]
pub struct Spreads<'a> {
    candidates: &'a Candidates,
    /// Pixel by pixel: variance of the pixel's mean relative to its squared mean, but for a common factor.
    variance: Vec<F>,
    /// Of each pixel at the prior share; zero for those that saw nothing vary.
    prior: Vec<f32>,
}

impl<'a> Spreads<'a> {
    /// The spreads of `pixels` pixels after the candidates' pilot of `paths` ≥ 4 paths.
    pub fn new(candidates: &'a Candidates, contributions: &[Contribution], pixels: usize, paths: u32) -> Self {
        let chunks = candidates.rates.len();
        // The same for all techniques: what a longer block's stratification takes away is then taken from each.
        let fewest = candidates.pilot.iter().filter(|a| **a > 0.0).fold(1.0, |a: f32, b| a.min(*b));
        let block = ((fewest * paths as f32) as u32 / 4).clamp(1, BLOCK);
        let blocks = candidates.pilot.map(|a| ((a * paths as f32) as u32 / block) as usize);
        let all_blocks: usize = blocks.iter().sum();
        let first_block = [0, blocks[0], blocks[0] + blocks[1]];
        // Channels count by their relative error: else the strongest decides, and where techniques find different
        // colours the weak ones pay.
        let mut found = vec![Vec3::ZERO; pixels];
        for contribution in contributions {
            found[contribution.pixel as usize] += contribution.radiance;
        }
        let weight = |pixel: u32| {
            let found = found[pixel as usize];
            if !found.is_finite() {
                return Vec3::NAN;
            }
            found.max(Vec3::splat(WEAKEST * found.max_element())).recip()
        };
        // Sums of each pixel's blocks, technique by technique, at each candidate, over the weighed channels.
        let mut sums = vec![F::ZERO; pixels * all_blocks * chunks];
        for contribution in contributions {
            let area = usize::from(contribution.area);
            let technique = if contribution.technique == Technique::Light { area } else { 2 };
            let at = (contribution.index / block) as usize;
            if at >= blocks[technique] {
                continue;
            }
            let y = F::splat(2.0 * contribution.radiance.dot(weight(contribution.pixel)));
            let (of_light, of_bsdf) = (F::splat(1.0 + contribution.r), F::splat(1.0 - contribution.r));
            let at = (contribution.pixel as usize * all_blocks + first_block[technique] + at) * chunks;
            for (sum, rates) in sums[at..at + chunks].iter_mut().zip(&candidates.rates) {
                *sum += y / (rates[area] * of_light + rates[2] * of_bsdf);
            }
        }
        let mut spreads = Self { candidates, variance: Vec::with_capacity(pixels * chunks), prior: Vec::new() };
        for sums in sums.chunks_exact(all_blocks * chunks) {
            spreads.add(sums, blocks, first_block);
        }
        spreads
    }

    /// A pixel, from its blocks' sums.
    fn add(&mut self, sums: &[F], blocks: [usize; 3], first_block: [usize; 3]) {
        let candidates = self.candidates;
        let chunks = candidates.rates.len();
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
                // n_i samples of variance V_i, weighed together: n_i V_i with n_i ∝ a_i times the rate.
                let scale = F::splat(a / (n as f32 - 1.0));
                self.variance[start + chunk] += squares * scale * candidates.rates[chunk][technique];
                if chunk == prior.0 {
                    mean_at_prior +=
                        a * mean.as_array()[prior.1] * candidates.rates[chunk][technique].as_array()[prior.1];
                }
            }
        }
        let scale = 1.0 / (mean_at_prior * mean_at_prior);
        let own = &mut self.variance[start..];
        own.iter_mut().for_each(|v| *v *= F::splat(scale));
        let at_prior = own[prior.0].as_array()[prior.1];
        let sound = scale.is_finite() && own.iter().all(|v| v.is_finite().to_bitmask() == (1 << LANES) - 1);
        self.prior.push(if sound { at_prior } else { 0.0 });
    }

    /// The share for pixel `pixel` of a tile with rows of `width`, from its neighbours' spreads alone. Of those with less
    /// variance than the prior one, pseudo-observations and doubt included, it is the one with the least variance times
    /// `cost`; the prior one if there are none. `guides` has one entry a pixel.
    pub fn choose(&self, pixel: usize, width: usize, guides: &[Guide], cost: Cost) -> Share {
        let chunks = self.candidates.rates.len();
        let alike =
            |other: &usize| *other != pixel && self.prior[*other] > 0.0 && guides[pixel].is_like(&guides[*other]);
        let mut neighbours = [0; (2 * RADIUS + 1).pow(2)];
        let mut found = 0;
        for other in around(pixel, width, self.prior.len(), RADIUS).filter(alike) {
            neighbours[found] = other;
            found += 1;
        }
        let neighbours = &neighbours[..found];
        if found < 2 {
            return self.candidates.prior();
        }
        let count = found as f32;
        let (mut prior, mut prior2) = (0.0f32, 0.0f32);
        for &other in neighbours {
            prior += self.prior[other];
            prior2 += self.prior[other] * self.prior[other];
        }
        let Caution { kappa, doubt, least_gain } = self.candidates.caution;
        let unseen = kappa * prior2 / (prior * count * DEGREES);
        let prior = prior / count;
        let enough = -least_gain * prior;
        let mut best = (f32::INFINITY, self.candidates.prior());
        for chunk in 0..chunks {
            // Sums over neighbours of the difference to the prior share, and of its square.
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
                let Some(&share) = self.candidates.shares.get(chunk * LANES + lane) else { break };
                let work = (prior + score) * cost.at(share.light);
                if score < enough && work < best.0 {
                    best = (work, share);
                }
            }
        }
        best.1
    }
}

/// The pixels up to `radius` to each side of `pixel`, itself too, row by row, in a tile of `pixels` pixels with rows of
/// `width`.
pub fn around(pixel: usize, width: usize, pixels: usize, radius: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let rows = y.saturating_sub(radius)..=(y + radius).min(pixels / width - 1);
    let columns = x.saturating_sub(radius)..=(x + radius).min(width - 1);
    rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

#[cfg(test)]
mod tests;
