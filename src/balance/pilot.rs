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

/// How a contribution was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Technique {
    /// A light sample.
    Light,
    /// A BSDF sample that met a light.
    Bsdf,
    /// A BSDF sample that met a surface: the light that came on from there, which no light sample can find.
    Indirect,
}

/// A contribution that a first surface's sample found.
#[derive(Debug, Clone, Copy)]
pub struct Finding {
    /// Pixel of the tile.
    pub pixel: u32,
    /// How.
    pub technique: Technique,
    /// Index of the sample in its technique's sequence.
    pub index: u32,
    /// r = (p_l − p_b)/(p_l + p_b), in [−1, 1].
    pub r: f32,
    /// f/(p_l + p_b): what it adds to the pilot's sum over paths.
    pub radiance: Vec3,
}

impl Finding {
    /// What it adds when weighed by a share `alpha` of light samples in (0, 1) among two a path: f/(2 p_α).
    #[inline]
    pub fn at(&self, alpha: f32) -> Vec3 {
        self.radiance / (1.0 + (2.0 * alpha - 1.0) * self.r)
    }
}

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
const N: usize = SHARES.len();
const HALF: usize = N / 2;

/// Samples of a block, but a quarter of the pilot at most.
const BLOCK: u32 = 8;
/// Pixels to each side that a pixel learns from.
const RADIUS: usize = 2;
/// Pseudo-observations: heavy samples, as typical as those seen, that each technique alone could have found.
const KAPPA: f32 = 4.0;
/// Standard errors of the gain, over the neighbours, that are held against it.
const DOUBT: f32 = 1.0;
/// Least gain in variance, as a share, for which ½ is left.
const LEAST_GAIN: f32 = 0.1;

/// A channel below this share of the strongest counts as if it had that much.
const WEAKEST: f32 = 0.05;

/// How much a pixel's blocks vary.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spread {
    /// Variance of the pixel's mean at each of [`SHARES`], relative to its squared mean, but for a common factor.
    variance: [f32; N],
    /// Did it see anything vary?
    any: bool,
}

/// The spreads of `pixels` pixels after a pilot of `paths` ≥ 4 paths with one light and one BSDF sample each.
pub fn spreads(findings: &[Finding], pixels: usize, paths: u32) -> Vec<Spread> {
    let block = (paths / 4).clamp(1, BLOCK);
    let blocks = (paths / block) as usize;
    // Channels count by their relative error: else the strongest decides, and where techniques find different colours
    // the weak ones pay.
    let mut found = vec![Vec3::ZERO; pixels];
    for finding in findings {
        found[finding.pixel as usize] += finding.radiance;
    }
    let weight = |pixel: u32| {
        let found = found[pixel as usize];
        if !found.is_finite() {
            return Vec3::NAN;
        }
        found.max(Vec3::splat(WEAKEST * found.max_element())).recip()
    };
    // Means of each pixel's light blocks, then of its BSDF blocks, at each share, summed over the weighed channels.
    let mut means = vec![[0.0f32; N]; pixels * 2 * blocks];
    for finding in findings {
        let at = (finding.index / block) as usize;
        let bsdf = usize::from(finding.technique != Technique::Light);
        if at < blocks {
            let y = finding.radiance.dot(weight(finding.pixel));
            let mean = &mut means[(2 * finding.pixel as usize + bsdf) * blocks + at];
            for (mean, share) in mean.iter_mut().zip(SHARES) {
                *mean += y / (1.0 + (2.0 * share - 1.0) * finding.r);
            }
        }
    }
    means.chunks_exact(2 * blocks).map(Spread::new).collect()
}

impl Spread {
    /// From as many light blocks as BSDF blocks.
    fn new(means: &[[f32; N]]) -> Self {
        let blocks = means.len() / 2;
        let mut spread = Self::default();
        let mut at_half = 0.0;
        for (means, of_light) in [(&means[..blocks], true), (&means[blocks..], false)] {
            for (j, share) in SHARES.into_iter().enumerate() {
                let mean = means.iter().map(|m| m[j]).sum::<f32>() / blocks as f32;
                let squares = means.iter().map(|m| (m[j] - mean) * (m[j] - mean)).sum::<f32>();
                // n_i samples weigh α_i: α_i² V_i/n_i with n_i ∝ α_i.
                spread.variance[j] += squares * if of_light { share } else { 1.0 - share };
                if j == HALF {
                    at_half += mean;
                }
            }
        }
        let scale = 1.0 / (at_half * at_half);
        spread.variance.iter_mut().for_each(|v| *v *= scale);
        spread.any = scale.is_finite() && spread.variance.iter().all(|v| v.is_finite()) && spread.variance[HALF] > 0.0;
        spread
    }
}

/// The share of light samples for pixel `pixel` of a tile with rows of `width`, from its neighbours' spreads alone: the
/// one with the least variance, pseudo-observations and doubt included, or ½ where that gains too little. `spreads` and
/// `guides` have one entry a pixel.
pub fn choose(pixel: usize, width: usize, spreads: &[Spread], guides: &[Guide]) -> f32 {
    let (x, y) = (pixel % width, pixel / width);
    let rows = y.saturating_sub(RADIUS)..=(y + RADIUS).min(spreads.len() / width - 1);
    let columns = x.saturating_sub(RADIUS)..=(x + RADIUS).min(width - 1);
    // Sums over neighbours of the difference to ½ at each share and its square, and of the variance at ½.
    let (mut gain, mut gain2) = ([0.0f32; N], [0.0f32; N]);
    let (mut half, mut half2, mut count) = (0.0f32, 0.0f32, 0.0f32);
    for other in rows.flat_map(|row| columns.clone().map(move |column| row * width + column)) {
        let spread = &spreads[other];
        if other == pixel || !spread.any || !guides[pixel].is_like(&guides[other]) {
            continue;
        }
        let at_half = spread.variance[HALF];
        for j in 0..N {
            let d = spread.variance[j] - at_half;
            gain[j] += d;
            gain2[j] += d * d;
        }
        half += at_half;
        half2 += at_half * at_half;
        count += 1.0;
    }
    if count < 2.0 {
        return 0.5;
    }
    let unseen = KAPPA * half2 / (half * count * DEGREES);
    let score = |j: usize| {
        let mean = gain[j] / count;
        let error = ((gain2[j] / count - mean * mean).max(0.0) / (count - 1.0)).sqrt();
        let alpha = SHARES[j];
        mean + DOUBT * error + unseen * (0.25 / alpha + 0.25 / (1.0 - alpha) - 1.0)
    };
    let best = (0..N).min_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap_or(HALF);
    if score(best) < -LEAST_GAIN * half / count { SHARES[best] } else { 0.5 }
}

/// Degrees of freedom of one pixel's spread: four blocks a technique.
const DEGREES: f32 = 3.0;

#[cfg(test)]
mod tests;
