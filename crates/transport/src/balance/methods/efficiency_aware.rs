//! `efficiency-aware`: the light share with the least second moment times cost among a few candidates (Grittmann, Yazici,
//! Georgiev and Slusallek 2022, *Efficiency-Aware Multiple Importance Sampling for Bidirectional Rendering Algorithms*, for
//! two techniques and with rays as cost).

use crate::balance::method::{EARLY_PATHS, FIRST_PASS_PATHS, MAX_PASS_PATHS, pass_within_goal, take_pass};
use crate::balance::variance::{LIGHT_SHARES, around};
use crate::balance::{Contribution, Cost, Counts, LearnedPixels, Method, Sampler};

/// Paths per pixel of the first pass, from which the shares follow.
const PILOT_PATHS: u32 = 4 * FIRST_PASS_PATHS;

/// The method of [`light_shares`].
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
        pass_within_goal(goal, done, done.clamp(PILOT_PATHS, MAX_PASS_PATHS))
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, done: u32, paths: u32) {
        if done > EARLY_PATHS || sampler.lights().is_none() {
            return take_pass(learned, sampler, paths);
        }
        let (counts, mut contributions) = (vec![Counts::half(paths); sampler.pixels()], Vec::new());
        sampler.take(&counts, &counts, Some(&mut contributions));
        let light_shares = light_shares(&contributions, sampler.pixels(), sampler.width(), sampler.cost());
        learned.shares.iter_mut().zip(light_shares).for_each(|(shares, light_share)| shares.light_share = light_share);
    }
}

const N: usize = LIGHT_SHARES.len();
/// Distance in pixels, along each axis, over which second moments are averaged: those of a single pixel are too noisy.
const NEIGHBOUR_RADIUS: usize = 2;

/// The light shares of the `pixels` pixels of a tile with `width` per row, from a pilot of equal counts. Each minimises
/// M(α) C(α) with M(α) = Σ Y²/(1 + (2α − 1) r) over the pilots of the pixel and its neighbours, each relative to its own
/// squared mean; ½ without contributions. Only later passes may use them: a pilot weighted by shares that follow from it
/// is biased.
pub fn light_shares(contributions: &[Contribution], pixels: usize, width: usize, cost: Cost) -> Vec<f32> {
    let mut moments = vec![([0.0f32; N], 0.0f32); pixels];
    for contribution in contributions {
        let (moments, sum) = &mut moments[contribution.pixel as usize];
        let square = contribution.radiance.length_squared();
        *sum += contribution.radiance.element_sum();
        for (moment, share) in moments.iter_mut().zip(LIGHT_SHARES) {
            *moment += square / (1.0 + (2.0 * share - 1.0) * contribution.r);
        }
    }
    for (moments, sum) in &mut moments {
        let scale = 1.0 / (*sum * *sum);
        moments
            .iter_mut()
            .for_each(|m| *m = if scale.is_finite() && (*m * scale).is_finite() { *m * scale } else { 0.0 });
    }
    let best_share = |pixel: usize| {
        let mut score = [0.0f32; N];
        for at in around(pixel, width, pixels, NEIGHBOUR_RADIUS) {
            score.iter_mut().zip(moments[at].0).for_each(|(s, m)| *s += m);
        }
        score.iter_mut().zip(LIGHT_SHARES).for_each(|(s, share)| *s *= cost.at(share));
        let best = (0..N).min_by(|&a, &b| score[a].total_cmp(&score[b])).unwrap_or(N / 2);
        if score[best] > 0.0 { LIGHT_SHARES[best] } else { 0.5 }
    };
    (0..pixels).map(best_share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::Technique;
    use glam::Vec3;

    const EQUAL: Cost = Cost { fixed: 1.0, light: 1.0, bsdf: 1.0 };

    fn one(technique: Technique, r: f32, y: f32) -> Contribution {
        Contribution { pixel: 0, technique, area: false, layer: 0, index: 0, r, w: 0.0, radiance: Vec3::splat(y) }
    }

    #[test]
    fn disjoint_techniques_share_by_the_root_of_their_second_moments() {
        // Y²-masses 9 and 1: α = √9/(√9 + √1).
        let seen = [one(Technique::Light, 1.0, 3.0), one(Technique::Bsdf, -1.0, 1.0)];
        assert_eq!(light_shares(&seen, 1, 1, EQUAL), [0.75]);
    }

    #[test]
    fn the_dearer_technique_gets_less() {
        let seen = [one(Technique::Light, 1.0, 1.0), one(Technique::Bsdf, -1.0, 1.0)];
        assert_eq!(light_shares(&seen, 1, 1, EQUAL), [0.5]);
        assert!(light_shares(&seen, 1, 1, Cost { bsdf: 9.0, ..EQUAL })[0] > 0.5);
    }

    #[test]
    fn black_pixels_and_bad_numbers_stay_at_half() {
        assert_eq!(light_shares(&[], 4, 2, EQUAL), [0.5; 4]);
        for y in [f32::NAN, f32::INFINITY, 1e38] {
            assert_eq!(light_shares(&[one(Technique::Light, 0.5, y)], 1, 1, EQUAL), [0.5]);
        }
    }
}
