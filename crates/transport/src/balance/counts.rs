//! Sample counts of a pass, and their distribution over its paths.

use serde::{Deserialize, Serialize};

/// How the samples of a pixel divide among the techniques.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shares {
    /// Fraction of all samples that are light samples: α in [0, 1].
    pub light_share: f32,
    /// Fraction of the light samples that go to the environment, in (0, 1), where environment and area lights are techniques
    /// of their own. `None` where each light sample chooses its kind of light at random, or there is only one kind.
    pub environment_share: Option<f32>,
}

/// Light and BSDF samples of one pixel in one pass of N ≥ 1 paths. Where both techniques exist, each count is ≥ 1 and they
/// add up to 2N.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Light samples n_l.
    pub light: u32,
    /// Number of light samples, the first ones, that go to the environment; the others go to area lights. `None` where each
    /// light sample chooses its kind at random.
    pub environment: Option<u32>,
    /// BSDF samples n_b.
    pub bsdf: u32,
    /// Paths N.
    pub paths: u32,
}

impl Counts {
    /// The counts nearest to `light_share` among the 2N samples of `paths` = N ≥ 1 paths.
    pub fn new(light_share: f32, paths: u32) -> Self {
        let total = 2 * paths;
        let light = ((light_share * total as f32).round() as u32).clamp(1, total - 1);
        Self { light, environment: None, bsdf: total - light, paths }
    }

    /// The counts nearest to `shares` among the 2N samples of `paths` = N ≥ 1 paths.
    pub fn from_shares(shares: Shares, paths: u32) -> Self {
        let all = Self::new(shares.light_share, paths);
        // A single light sample cannot be divided: it chooses its kind at random.
        let split = |environment: f32| ((environment * all.light as f32).round() as u32).clamp(1, all.light - 1);
        Self { environment: shares.environment_share.filter(|_| all.light > 1).map(split), ..all }
    }

    /// One sample of each technique per path.
    pub fn half(paths: u32) -> Self {
        Self { light: paths, environment: None, bsdf: paths, paths }
    }

    /// One BSDF sample per path, for scenes without lights that can be sampled.
    pub fn bsdf_only(paths: u32) -> Self {
        Self { light: 0, environment: None, bsdf: paths, paths }
    }

    /// The nearest counts of as many samples that have no less of any technique than a pilot, which has fewer samples.
    pub fn at_least(self, pilot: Self) -> Self {
        let all = self.light + self.bsdf;
        let light = self.light.clamp(pilot.light, all - pilot.bsdf);
        let split = |(own, pilots): (u32, u32)| own.clamp(pilots, light - (pilot.light - pilots));
        Self { light, environment: self.environment.zip(pilot.environment).map(split), bsdf: all - light, ..self }
    }

    /// The counts that remain of these after a pilot.
    pub fn after(self, pilot: Self) -> Self {
        Self {
            light: self.light.saturating_sub(pilot.light),
            environment: self.environment.zip(pilot.environment).map(|(all, pilot)| all.saturating_sub(pilot)),
            bsdf: self.bsdf.saturating_sub(pilot.bsdf),
            paths: self.paths - pilot.paths,
        }
    }

    /// The counts of the paths `from..to` of these, as [`deal`] deals them.
    pub fn of_paths(self, from: u32, to: u32) -> Self {
        let (from, to) = (from.min(self.paths), to.min(self.paths));
        let until = |n: u32, path: u32| path * (n / self.paths) + path.min(n % self.paths);
        let dealt = |n: u32| if self.paths > 0 { until(n, to) - until(n, from) } else { 0 };
        let toward = |environment: u32, path: u32| {
            (u64::from(environment) * u64::from(until(self.light, path)) / u64::from(self.light.max(1))) as u32
        };
        let environment = self.environment.map(|all| toward(all, to) - toward(all, from));
        Self { light: dealt(self.light), environment, bsdf: dealt(self.bsdf), paths: to - from }
    }

    /// Light samples per path: a_l = n_l/N.
    #[inline]
    pub fn light_per_path(self) -> f32 {
        self.light as f32 / self.paths as f32
    }

    /// BSDF samples per path: a_b = n_b/N.
    #[inline]
    pub fn bsdf_per_path(self) -> f32 {
        self.bsdf as f32 / self.paths as f32
    }

    /// Samples per path toward the environment, toward area lights and of the BSDF. Where each light sample chooses its kind
    /// at random, it goes to the environment with probability `environment_probability`.
    pub fn samples_per_path(self, environment_probability: f32) -> [f32; 3] {
        let light = self.light_per_path();
        let environment = self
            .environment
            .map_or(light * environment_probability, |environment| environment as f32 / self.paths as f32);
        [environment, light - environment, self.bsdf_per_path()]
    }

    /// Ratios of the samples per path to those of a pilot with the counts of [`Candidates::pilot`]: environment, area
    /// lights, BSDF. The first two are equal where each light sample chooses its kind at random.
    ///
    /// [`Candidates::pilot`]: super::variance::Candidates::pilot
    pub fn relative_to(self, pilot: Self) -> [f32; 3] {
        // The probability of the environment cancels.
        let (own, pilot) = (self.samples_per_path(0.5), pilot.samples_per_path(0.5));
        [0, 1, 2].map(|t| own[t] / pilot[t])
    }

    /// The light share that these counts have: MIS weights must use it.
    pub fn light_share(self) -> f32 {
        self.light as f32 / (self.light + self.bsdf) as f32
    }
}

/// The number of a pass's `n` samples that path `path` of `paths` ≥ 1 takes: ⌊n/N⌋, and one more for the first paths. The
/// number depends only on the path's index, and each point of a scrambled sequence is uniform, so the sum over a pass is
/// unbiased. The paths with one more sample are consecutive points of the sequence, which are better stratified over the
/// pixel than a random choice.
#[inline]
pub fn deal(n: u32, paths: u32, path: u32) -> u8 {
    (n / paths + u32::from(path < n % paths)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_are_near_the_share_and_never_leave_a_technique_out(light_share in 0.0f32..=1.0, paths in 1u32..300) {
            let c = Counts::new(light_share, paths);
            prop_assert_eq!(c.light + c.bsdf, 2 * paths);
            prop_assert!(c.light >= 1 && c.bsdf >= 1);
            // Half a sample of rounding, one of the floor.
            prop_assert!((c.light_share() - light_share).abs() <= 1.0 / (2 * paths) as f32 + 1e-6);
        }

        #[test]
        fn counts_that_hold_a_pilot_can_be_taken_after_it(
            light_share in 0.0f32..=1.0, environment in prop::option::of(0.0f32..=1.0), pilot in 2u32..64, more in 0u32..300
        ) {
            let shares = Shares { light_share, environment_share: environment };
            let half = Counts { environment: environment.map(|_| pilot / 2), ..Counts::half(pilot) };
            let total = Counts::from_shares(shares, 2 * pilot + more);
            let held = total.at_least(half);
            let rest = held.after(half);
            prop_assert_eq!([rest.light + half.light, rest.bsdf + half.bsdf], [held.light, held.bsdf]);
            prop_assert_eq!(held.light + held.bsdf, 2 * held.paths);
            if let Some((all, rest)) = held.environment.zip(rest.environment) {
                prop_assert!(all == rest + pilot / 2 && held.light - all >= pilot - pilot / 2);
            }
            prop_assert_eq!(held.at_least(half), held);
            prop_assert!(total.light < pilot || total.bsdf < pilot || environment.is_some() || total == held);
        }

        #[test]
        fn exactly_n_samples_are_dealt_and_evenly(paths in 1u32..200, share in 0.0f64..=1.0) {
            let n = (share * 2.0 * f64::from(paths)) as u32;
            let dealt: Vec<u8> = (0..paths).map(|i| deal(n, paths, i)).collect();
            prop_assert_eq!(dealt.iter().map(|&c| u32::from(c)).sum::<u32>(), n);
            let (low, high) = (dealt.iter().min().unwrap(), dealt.iter().max().unwrap());
            prop_assert!(high - low <= 1);
        }
    }
}
