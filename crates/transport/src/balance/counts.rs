//! Fixed sample counts and how they are dealt to a pass's paths.

/// How a pixel's samples divide among the techniques.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Of all samples, light samples: α in [0, 1].
    pub light: f32,
    /// Of the light samples, those toward the environment, in (0, 1), where environment and area lights are techniques of
    /// their own; `None` where each light sample draws which light it is toward, or there is one kind alone.
    pub environment: Option<f32>,
}

/// Light and BSDF samples of one pixel in one pass of N ≥ 1 paths; where there are two techniques, together 2N and
/// each ≥ 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Light samples n_l.
    pub light: u32,
    /// How many of the light samples, the first ones, are toward the environment, all others toward area lights; `None` where
    /// each draws.
    pub environment: Option<u32>,
    /// BSDF samples n_b.
    pub bsdf: u32,
    /// Paths N.
    pub paths: u32,
}

impl Counts {
    /// The counts nearest to a share `alpha` of light samples among the 2N of `paths` = N ≥ 1 paths.
    pub fn new(alpha: f32, paths: u32) -> Self {
        let total = 2 * paths;
        let light = ((alpha * total as f32).round() as u32).clamp(1, total - 1);
        Self { light, environment: None, bsdf: total - light, paths }
    }

    /// The counts nearest to `share` among the 2N samples of `paths` = N ≥ 1 paths.
    pub fn of(share: Share, paths: u32) -> Self {
        let all = Self::new(share.light, paths);
        // A single light sample cannot be divided: it draws.
        let split = |environment: f32| ((environment * all.light as f32).round() as u32).clamp(1, all.light - 1);
        Self { environment: share.environment.filter(|_| all.light > 1).map(split), ..all }
    }

    /// One sample of each technique a path.
    pub fn half(paths: u32) -> Self {
        Self { light: paths, environment: None, bsdf: paths, paths }
    }

    /// One BSDF sample a path: where no light can be sampled.
    pub fn bsdf_only(paths: u32) -> Self {
        Self { light: 0, environment: None, bsdf: paths, paths }
    }

    /// What is left of these counts after those of a pilot.
    pub fn after(self, pilot: Self) -> Self {
        Self {
            light: self.light.saturating_sub(pilot.light),
            environment: self.environment.zip(pilot.environment).map(|(all, pilot)| all.saturating_sub(pilot)),
            bsdf: self.bsdf.saturating_sub(pilot.bsdf),
            paths: self.paths - pilot.paths,
        }
    }

    /// a_l = n_l/N.
    #[inline]
    pub fn light_a_path(self) -> f32 {
        self.light as f32 / self.paths as f32
    }

    /// a_b = n_b/N.
    #[inline]
    pub fn bsdf_a_path(self) -> f32 {
        self.bsdf as f32 / self.paths as f32
    }

    /// Samples a path: toward the environment, toward area lights, of the BSDF. Where light samples draw, they go to the
    /// environment with probability `environment_probability`.
    pub fn rates(self, environment_probability: f32) -> [f32; 3] {
        let light = self.light_a_path();
        let environment = self
            .environment
            .map_or(light * environment_probability, |environment| environment as f32 / self.paths as f32);
        [environment, light - environment, self.bsdf_a_path()]
    }

    /// Samples a path over those of a pilot at [`Candidates::pilot`](super::spread::Candidates::pilot)'s counts; the same
    /// for environment and area lights where light samples draw.
    pub fn over(self, pilot: Self) -> [f32; 3] {
        // Any chance does: it cancels.
        let (own, pilot) = (self.rates(0.5), pilot.rates(0.5));
        [0, 1, 2].map(|t| own[t] / pilot[t])
    }

    /// The share of light samples that the counts stand for: what weights must use.
    pub fn alpha(self) -> f32 {
        self.light as f32 / (self.light + self.bsdf) as f32
    }
}

/// How many of a pass's `n` samples path `path` of `paths` ≥ 1 takes: ⌊n/N⌋, the first paths one more. A path's count
/// depends on its place alone and the place says nothing about where the path goes (points of a scrambled sequence are
/// each uniform), so the sum over a pass is unbiased; and the paths that take more are a run of the sequence, which is
/// better spread over the pixel than a random choice of them.
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
        fn counts_are_near_the_share_and_never_leave_a_technique_out(alpha in 0.0f32..=1.0, paths in 1u32..300) {
            let c = Counts::new(alpha, paths);
            prop_assert_eq!(c.light + c.bsdf, 2 * paths);
            prop_assert!(c.light >= 1 && c.bsdf >= 1);
            // Half a sample of rounding, one of the floor.
            prop_assert!((c.alpha() - alpha).abs() <= 1.0 / (2 * paths) as f32 + 1e-6);
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
