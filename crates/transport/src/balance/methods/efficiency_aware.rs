//! Efficiency-aware counts: the share of light samples with the least second moment times cost among a few (Grittmann,
//! Yazici, Georgiev and Slusallek 2022, *Efficiency-Aware Multiple Importance Sampling for Bidirectional Rendering
//! Algorithms*, for two techniques and with rays as cost).

use crate::balance::method::{EARLY, FIRST_PASS, LONGEST_PASS, at_once, up_to};
use crate::balance::spread::{SHARES, around};
use crate::balance::{Contribution, Cost, Counts, Learned, Method, Sampler};

/// Paths a pixel of the first pass, from which the shares follow.
const PILOT: u32 = 4 * FIRST_PASS;

/// See [`shares`].
#[derive(Debug)]
pub struct EfficiencyAware;

impl Method for EfficiencyAware {
    fn name(&self) -> &'static str {
        "efficiency-aware"
    }

    fn about(&self) -> &'static str {
        "Grittmann et al. 2022: a pilot of 32 paths, then the share with the least second moment times cost"
    }

    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        up_to(goal, done, done.clamp(PILOT, LONGEST_PASS))
    }

    fn pass(&self, learned: &mut Learned, sampler: &mut dyn Sampler, done: u32, paths: u32) {
        if done > EARLY || sampler.lights().is_none() {
            return at_once(learned, sampler, paths);
        }
        let (counts, mut found) = (vec![Counts::half(paths); sampler.pixels()], Vec::new());
        sampler.take(&counts, &counts, Some(&mut found));
        let shares = shares(&found, sampler.pixels(), sampler.width(), sampler.cost());
        learned.shares.iter_mut().zip(shares).for_each(|(own, share)| own.light = share);
    }
}

const N: usize = SHARES.len();
/// Second moments are averaged over this many pixels to each side: those of a single pixel are too noisy to choose by.
const RADIUS: usize = 2;

/// The shares of light samples for the `pixels` pixels of a tile with rows of `width`, from a pilot of equal counts: each
/// minimises M(α) C(α), M(α) = Σ Y²/(1 + (2α − 1) r) over the pilots of the pixel and its neighbours, each relative to its
/// own squared mean. ½ where nothing was found. Later passes only: the pilot must not be weighed by shares from itself.
pub fn shares(contributions: &[Contribution], pixels: usize, width: usize, cost: Cost) -> Vec<f32> {
    let mut moments = vec![([0.0f32; N], 0.0f32); pixels];
    for contribution in contributions {
        let (moments, sum) = &mut moments[contribution.pixel as usize];
        let square = contribution.radiance.length_squared();
        *sum += contribution.radiance.element_sum();
        for (moment, share) in moments.iter_mut().zip(SHARES) {
            *moment += square / (1.0 + (2.0 * share - 1.0) * contribution.r);
        }
    }
    for (moments, sum) in &mut moments {
        let scale = 1.0 / (*sum * *sum);
        moments
            .iter_mut()
            .for_each(|m| *m = if scale.is_finite() && (*m * scale).is_finite() { *m * scale } else { 0.0 });
    }
    let of = |pixel: usize| {
        let mut score = [0.0f32; N];
        for at in around(pixel, width, pixels, RADIUS) {
            score.iter_mut().zip(moments[at].0).for_each(|(s, m)| *s += m);
        }
        score.iter_mut().zip(SHARES).for_each(|(s, share)| *s *= cost.at(share));
        let best = (0..N).min_by(|&a, &b| score[a].total_cmp(&score[b])).unwrap_or(N / 2);
        if score[best] > 0.0 { SHARES[best] } else { 0.5 }
    };
    (0..pixels).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::Technique;
    use glam::Vec3;

    const EQUAL: Cost = Cost { fixed: 1.0, light: 1.0, bsdf: 1.0 };

    fn one(technique: Technique, r: f32, y: f32) -> Contribution {
        Contribution { pixel: 0, technique, area: false, index: 0, r, w: 0.0, radiance: Vec3::splat(y) }
    }

    #[test]
    fn disjoint_techniques_share_by_the_root_of_their_second_moments() {
        // Y²-masses 9 and 1: α = √9/(√9 + √1).
        let seen = [one(Technique::Light, 1.0, 3.0), one(Technique::Bsdf, -1.0, 1.0)];
        assert_eq!(shares(&seen, 1, 1, EQUAL), [0.75]);
    }

    #[test]
    fn the_dearer_technique_gets_less() {
        let seen = [one(Technique::Light, 1.0, 1.0), one(Technique::Bsdf, -1.0, 1.0)];
        assert_eq!(shares(&seen, 1, 1, EQUAL), [0.5]);
        assert!(shares(&seen, 1, 1, Cost { bsdf: 9.0, ..EQUAL })[0] > 0.5);
    }

    #[test]
    fn black_pixels_and_bad_numbers_stay_at_half() {
        assert_eq!(shares(&[], 4, 2, EQUAL), [0.5; 4]);
        for y in [f32::NAN, f32::INFINITY, 1e38] {
            assert_eq!(shares(&[one(Technique::Light, 0.5, y)], 1, 1, EQUAL), [0.5]);
        }
    }
}
