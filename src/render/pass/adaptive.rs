//! The stop rule for noise goals: when the pixels of a tile take no more paths.
//!
//! A stop rule that looks at the samples that it stops is biased: pictures that have missed rare bright paths look clean,
//! end early and are too dark. The pixels of a tile are therefore divided into eight groups, the positions in blocks of 2 x
//! 4 pixels, and the number of paths of a group follows from the error of the next group. A pixel's own samples can affect
//! it only through all eight groups, after as many decisions. So no paths are shared between groups either, and each group
//! goes on to the most paths that are allowed, even if others have them. Decisions are few: a group takes at once what it is
//! expected to need, from half of its paths to three times as many.
//!
//! Where paths have found next to nothing, the estimate of the error says nothing: a pixel without a find has none, one with
//! a find counts 1 at most. Such a group goes on until light that its paths could have missed is below the goal.

use crate::film::PixelStats;
use crate::film::compare::{REL_MSE_EPSILON, relative_to};
use crate::render::settings::noise::NoiseGoal;

/// Groups of pixels.
const GROUPS: usize = 8;
/// Maximum paths of a pass, over those already taken.
pub const GROWTH: u32 = 3;
/// Minimum paths that an unfinished group takes in a pass, over those already taken.
const MIN_GROWTH: f64 = 0.5;
/// Finds of a group, below which its error is not judged by its samples.
const MIN_FINDS: f64 = 4.0;
/// Radiance of a path, up to which rare light must not be missed.
const RARE_RADIANCE: f64 = 1000.0;
/// What occurs less than three times in as many paths as these is not found with a chance of 5 % (the rule of three).
const RULE_OF_THREE: f64 = 3.0;
/// Paths are taken in blocks of the low-discrepancy sequence.
const PATHS_PER_BLOCK: f64 = 4.0;

/// The group of a pixel of a tile, `width` a row.
pub fn group_of(i: usize, width: usize) -> usize {
    2 * (i / width % 4) + i % width % 2
}

/// The statistics of a tile's pixels, row by row.
#[derive(Clone, Copy)]
pub struct TileStats<'a> {
    /// One a pixel.
    pub stats: &'a [PixelStats],
    /// Pixels a row.
    pub width: usize,
}

impl<'a> TileStats<'a> {
    /// Indices of a group's pixels.
    fn group(self, group: usize) -> impl Iterator<Item = usize> + Clone + 'a {
        (0..self.stats.len()).filter(move |i| group_of(*i, self.width) == group)
    }

    /// Paths of each of a group's pixels; 0 if it has none.
    fn paths_of(self, group: usize) -> u32 {
        self.group(group).next().map_or(0, |i| self.stats[i].samples)
    }

    /// Most paths of a pixel.
    pub fn paths(self) -> u32 {
        (0..GROUPS).map(|group| self.paths_of(group)).max().unwrap_or(0)
    }

    /// Have the pixels of each group as many paths?
    pub fn is_whole(self) -> bool {
        (0..self.stats.len()).all(|i| self.stats[i].samples == self.paths_of(group_of(i, self.width)))
    }

    /// Paths that each pixel of a group should have, by the error of the next group that has pixels.
    fn required_paths(self, group: usize, goal: &NoiseGoal) -> f64 {
        let others = (1..=GROUPS).map(|step| (group + step) % GROUPS);
        let Some(other) = others.into_iter().find(|g| self.group(*g).next().is_some()) else { return 0.0 };
        let (sum, n) = self.group(other).fold((0.0, 0.0), |(sum, n), i| (sum + self.error(i), n + 1.0));
        let required = sum / n * f64::from(self.paths_of(other)) / (goal.error * goal.error);
        if self.finds(other) >= MIN_FINDS { required } else { required.max(self.paths_to_rule_out_light(goal)) }
    }

    /// Paths of a group that have found light, or nothing that could be lit; an effective number (Kish 1965, *Survey
    /// Sampling*): that of equal finds with as large a sum and sum of squares.
    fn finds(self, group: usize) -> f64 {
        let (mut sum, mut squared, mut open) = (0.0, 0.0, 0.0);
        for pixel in self.group(group).map(|i| &self.stats[i]) {
            sum += pixel.sum.iter().sum::<f64>();
            squared += 3.0 * pixel.sum_squared.iter().sum::<f64>();
            open += f64::from(pixel.samples - pixel.covered);
        }
        open + if squared > 0.0 { sum * sum / squared } else { 0.0 }
    }

    /// Paths per pixel of a tile without a find, after which the mean of what it may have missed is probably (95 %) below the
    /// goal: below the error times the square root of [`REL_MSE_EPSILON`].
    fn paths_to_rule_out_light(self, goal: &NoiseGoal) -> f64 {
        let mean = goal.error * REL_MSE_EPSILON.sqrt();
        RULE_OF_THREE * RARE_RADIANCE / (mean * self.stats.len() as f64)
    }

    /// Variance of the mean over the square of the mean ([`relative_to`]), the mean of the channels.
    fn error(self, i: usize) -> f64 {
        let (mean, variance) = (self.stats[i].mean(), self.stats[i].variance_of_mean());
        (0..3).map(|c| f64::from(variance[c]) / relative_to(f64::from(mean[c]))).sum::<f64>() / 3.0
    }

    /// How many of a pass's `paths` paths the pixels of each group take. Without a goal, all groups reach the same number.
    pub fn paths_for(self, paths: u32, goal: Option<&NoiseGoal>) -> [u32; GROUPS] {
        let most = self.paths();
        std::array::from_fn(|group| {
            let own = self.paths_of(group);
            let Some(goal) = goal else { return paths + most - own };
            let paths = paths.min(goal.max_paths.saturating_sub(own));
            if own < goal.min_paths {
                return paths;
            }
            let (own, required) = (f64::from(own), self.required_paths(group, goal));
            let more = (required - own).max(MIN_GROWTH * own);
            if required > own {
                ((more / PATHS_PER_BLOCK).ceil() * PATHS_PER_BLOCK).min(f64::from(paths)) as u32
            } else {
                0
            }
        })
    }

    /// The same for each pixel.
    pub fn deal(self, groups: [u32; GROUPS]) -> Vec<u32> {
        (0..self.stats.len()).map(|i| groups[group_of(i, self.width)]).collect()
    }

    /// Fewest paths of a group that goes on; `None` if none does.
    pub fn open_paths(self, goal: &NoiseGoal) -> Option<u32> {
        let more = self.paths_for(1, Some(goal));
        let present = (0..GROUPS).filter(|&group| self.group(group).next().is_some());
        present.filter(|&group| more[group] > 0).map(|group| self.paths_of(group)).min()
    }

    /// Has every group reached the goal?
    pub fn is_clean(self, goal: &NoiseGoal) -> bool {
        self.open_paths(&NoiseGoal { max_paths: u32::MAX, ..*goal }).is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SplitMix64;

    /// A pixel with a mean of 1 and this variance of its paths, after `n` of them.
    fn pixel(variance: f64, n: u32) -> PixelStats {
        let m = f64::from(n);
        PixelStats { samples: n, sum: [m; 3], sum_squared: [m + variance * (m - 1.0); 3], ..PixelStats::EMPTY }
    }

    const GOAL: NoiseGoal = NoiseGoal { error: 0.1, min_paths: 32, max_paths: u32::MAX };

    #[test]
    fn a_group_takes_what_the_next_one_asks_for_whatever_its_own_pixels_show() {
        // Relative variance 1.01 v over paths must come to 0.01: 100 v paths.
        let variances = [1e9, 0.3, 1.0, 4.0, 0.1, 0.1, 0.1, 0.1];
        let stats: Vec<_> = (0..256).map(|i| pixel(1.01 * variances[2 * (i / 16 % 4) + i % 2], 64)).collect();
        let tile = TileStats { stats: &stats, width: 16 };
        assert!(tile.is_whole() && tile.paths() == 64);
        // Enough, 36 more, as much as the pass has.
        assert_eq!(tile.paths_for(192, Some(&GOAL)), [0, 36, 192, 0, 0, 0, 0, 192]);
        assert!(!tile.is_clean(&GOAL));
        let dealt = tile.deal([0, 36, 192, 7, 1, 2, 3, 4]);
        assert_eq!([dealt[0], dealt[1], dealt[16], dealt[17], dealt[48], dealt[65]], [0, 36, 192, 7, 3, 36]);
        // A little more is half of what there is; nobody looks too early.
        let goal = NoiseGoal { error: 0.1 * f64::sqrt(99.0 / 64.0), ..GOAL };
        assert_eq!(tile.paths_for(192, Some(&goal))[1], 32);
        assert_eq!(tile.paths_for(5, Some(&NoiseGoal { min_paths: 65, ..GOAL })), [5; 8]);
        assert!(tile.is_clean(&NoiseGoal { error: 1e6, ..GOAL }));
    }

    #[test]
    fn tiles_that_have_found_nothing_yet_go_on_and_black_ones_end() {
        let tile_of = |found: u32, paths: u32, covered: u32| -> Vec<_> {
            let black = PixelStats { samples: paths, covered, ..PixelStats::EMPTY };
            let mut stats = vec![black; 256];
            for pixel in stats.iter_mut().step_by(37).take(found as usize) {
                (pixel.sum, pixel.sum_squared) = ([1e4; 3], [1e8; 3]);
            }
            stats
        };
        let is_clean = |stats: &[PixelStats]| TileStats { stats, width: 16 }.is_clean(&GOAL);
        for found in 0..4 {
            assert!(!is_clean(&tile_of(found, 64, 64)), "{found}");
        }
        // 3 * 1000 / (0.1 * 0.1 * 256) = 1172 paths. No surface is in the picture: nothing can be lit.
        assert!(!is_clean(&tile_of(0, 1171, 1171)));
        assert!(is_clean(&tile_of(0, 1172, 1172)));
        assert!(is_clean(&tile_of(0, 32, 0)));
    }

    #[test]
    fn tiles_of_few_pixels_ask_whom_there_is() {
        for (pixels, width) in [(1, 1), (2, 1), (2, 2), (3, 1)] {
            for (variance, clean) in [(1e-3, true), (1e3, false)] {
                let stats = vec![pixel(variance, 64); pixels];
                let tile = TileStats { stats: &stats, width };
                assert_eq!(tile.is_clean(&GOAL), clean, "{pixels} {width} {variance}");
            }
        }
    }

    /// z of the mean of 10 000 tiles of 8 x 8 pixels against what it should be, whose paths are 1 and, with a chance of
    /// 1/4000, a hundred more; `next` deals passes after the first of 32 paths.
    fn z(next: impl Fn(TileStats, u32) -> Vec<u32>) -> f64 {
        const TILES: u32 = 10_000;
        let (mut sum, mut sum2) = (0.0, 0.0);
        let mut random = SplitMix64(7);
        for _ in 0..TILES {
            let mut stats = vec![PixelStats::EMPTY; 64];
            let mut dealt = vec![32; 64];
            while dealt.iter().any(|n| *n > 0) {
                for (pixel, n) in stats.iter_mut().zip(&dealt) {
                    for _ in 0..*n {
                        let bright = random.f64() < 1.0 / 4000.0;
                        pixel.add(glam::Vec3::splat(if bright { 101.0 } else { 1.0 }), true);
                    }
                }
                let seen = TileStats { stats: &stats, width: 8 };
                dealt = next(seen, GROWTH * seen.paths());
            }
            let mean = stats.iter().map(|s| f64::from(s.mean()[0])).sum::<f64>() / 64.0;
            (sum, sum2) = (sum + mean, sum2 + mean * mean);
        }
        let n = f64::from(TILES);
        let (mean, variance) = (sum / n, (sum2 / n - (sum / n).powi(2)) / (n - 1.0));
        (mean - 1.025) / variance.sqrt()
    }

    /// |z| > 4 by chance: one in 16 000.
    #[test]
    fn rare_bright_paths_make_no_tile_darker() {
        let goal = NoiseGoal { error: 0.05, max_paths: 512, ..GOAL };
        let own = |seen: TileStats, paths: u32| {
            let error = (0..64).map(|i| seen.error(i)).sum::<f64>() / 64.0;
            vec![if error > 0.05 * 0.05 { paths.min(512 - seen.paths()) } else { 0 }; 64]
        };
        let (groups, own) = (z(|seen, paths| seen.deal(seen.paths_for(paths, Some(&goal)))), z(own));
        assert!(groups.abs() < 4.0, "{groups} {own}");
        // What must be found: tiles that end by their own samples.
        assert!(own < -8.0, "{own}");
    }
}
