//! Fixed sample counts and how they are dealt to a pass's paths.

/// Light and BSDF samples of one pixel in one pass of N ≥ 1 paths; where there are two techniques, together 2N and
/// each ≥ 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Light samples n_l.
    pub light: u32,
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
        Self { light, bsdf: total - light, paths }
    }

    /// One sample of each technique a path.
    pub fn half(paths: u32) -> Self {
        Self { light: paths, bsdf: paths, paths }
    }

    /// One BSDF sample a path: where no light can be sampled.
    pub fn bsdf_only(paths: u32) -> Self {
        Self { light: 0, bsdf: paths, paths }
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

    /// The share of light samples that the counts stand for: what weights must use.
    pub fn alpha(self) -> f32 {
        self.light as f32 / (self.light + self.bsdf) as f32
    }
}

/// Deals `n` samples (≤ 2N) to N = `keys.len()` paths: each gets ⌊n/N⌋ or ⌈n/N⌉, exactly `n` in all, who gets more is
/// decided by the rank of the path's random `key`. A path's count does not depend on where the path goes, so the sum
/// over a pass is unbiased. `dealt` receives one count a path; `order` is scratch memory.
pub fn deal(n: u32, keys: &[f32], order: &mut Vec<u32>, dealt: &mut [u8]) {
    let paths = keys.len() as u32;
    debug_assert_eq!(keys.len(), dealt.len());
    if paths == 0 {
        return;
    }
    let (each, extra) = (n / paths, n % paths);
    dealt.fill(each as u8);
    if extra == 0 {
        return;
    }
    order.clear();
    order.extend(0..paths);
    order.select_nth_unstable_by(extra as usize - 1, |&a, &b| {
        keys[a as usize].total_cmp(&keys[b as usize]).then(a.cmp(&b))
    });
    for &path in &order[..extra as usize] {
        dealt[path as usize] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::PixelSequence;
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
        fn exactly_n_samples_are_dealt_and_evenly(paths in 1usize..200, share in 0.0f64..1.0, pixel in 0u32..1000) {
            let n = (share * 2.0 * paths as f64) as u32;
            let sequence = PixelSequence::new(pixel, 0, 0);
            let keys: Vec<f32> = (0..paths as u32).map(|i| sequence.sample(i, 0)[2]).collect();
            let mut dealt = vec![0; paths];
            deal(n, &keys, &mut Vec::new(), &mut dealt);
            prop_assert_eq!(dealt.iter().map(|&c| u32::from(c)).sum::<u32>(), n);
            let (low, high) = (dealt.iter().min().unwrap(), dealt.iter().max().unwrap());
            prop_assert!(high - low <= 1);
        }
    }
}
