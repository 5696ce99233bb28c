//! What the variance of a picture's mean follows from. That of independent paths, which pixels sum, leaves out that points are
//! stratified, and that pixels share paths ([`reuse`](crate::integrator::reuse)).

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::integrator::data::context::WaveContext;
use crate::integrator::events::{BorrowedLight, PathEvents};

/// Levels of blocks: the two halves of a pass of 128 paths are the last.
const LEVELS: usize = 7;
/// Factors by which the variance of a mean falls as its paths double: independent paths have the largest. Smooth light falls faster than
/// by the smallest, but not for long.
const DECAY: [f64; 2] = [0.125, 0.5];

/// Sums over the pixels of a tile, of linear RGB.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct BlockSums {
    /// By level k, over pairs of neighbouring blocks of 2^k paths of a pixel: the squares of half the differences of their means.
    squares: [[f64; 3]; LEVELS],
    /// The number of these pairs.
    pairs: [u64; LEVELS],
    /// Covariances of what paths of the same number borrow, over pairs of pixels, i, j and j, i, and over numbers.
    shared: [f64; 3],
    /// How many more sets of independent paths were joined.
    joined: u32,
}

impl BlockSums {
    /// Adds those of independent paths of the same pixels.
    pub fn join(&mut self, other: &Self) {
        for level in 0..LEVELS {
            add(&mut self.squares[level], other.squares[level].into());
            self.pairs[level] += other.pairs[level];
        }
        add(&mut self.shared, other.shared.into());
        self.joined += other.joined + 1;
    }

    /// The mean square at a level: what doubling the paths takes from the variance of blocks of 2^level.
    fn at(&self, level: usize) -> DVec3 {
        DVec3::from(self.squares[level]) / self.pairs[level].max(1) as f64
    }

    /// The highest level that half of so many pixels have reached.
    fn top(&self, pixels: usize) -> Option<usize> {
        (0..LEVELS).rev().find(|level| 2 * self.pairs[*level] >= (pixels as u64).max(1))
    }
}

fn add(sum: &mut [f64; 3], more: DVec3) {
    *sum = (DVec3::from(*sum) + more).into();
}

/// A tile for [`mean_variance`].
#[derive(Debug, Clone, Copy)]
pub struct TileVariance<'a> {
    pub sums: &'a BlockSums,
    /// Number of its pixels, ≥ 1.
    pub pixels: usize,
    /// Mean paths of a pixel.
    pub paths: f64,
    /// Sum over pixels of the variances of their means, estimated as of independent paths.
    pub independent: DVec3,
}

/// The variance of a picture's mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanVariance {
    /// Over the sum of the pixels' variances of independent paths, of R, G and B; ≥ 0.
    pub over_independent: [f64; 3],
    /// Over that of unrelated pixels, ≥ 1.
    pub related: f64,
}

/// Estimates the variance of the mean of these tiles. `one_set`: do all passes continue one stratified set of points? `None` where
/// pixels have less than two paths.
///
/// A block's variance falls by d_k, the mean square of level k, as its 2^k paths double. Beyond the last level that there is, the falls
/// go on as a geometric series. Its factor lies half way between that of the last two levels, over the whole picture, and that of
/// independent paths: factors differ from level to level, and that alone states too little. The covariances of pixels are those of what
/// they borrow, path number by path number: all other light is each pixel's own.
pub fn mean_variance<'a>(tiles: impl Iterator<Item = TileVariance<'a>> + Clone, one_set: bool) -> Option<MeanVariance> {
    let tiles = tiles.filter_map(|tile| Some((tile, tile.sums.top(tile.pixels)?))).filter(|(tile, _)| {
        let all = tile.sums.squares.into_iter().chain([tile.sums.shared, tile.independent.into()]);
        all.flatten().all(f64::is_finite)
    });
    let falls = tiles
        .clone()
        .filter(|(_, top)| *top >= 2)
        .map(|(tile, top)| [top, top - 2].map(|level| tile.pixels as f64 * tile.sums.at(level).element_sum()));
    let [last, before] = falls.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    let fall = if before > 0.0 { (last / before).sqrt().clamp(DECAY[0], DECAY[1]) } else { DECAY[1] };
    let decay = (fall * DECAY[1]).sqrt();
    let (mut independent, mut alone, mut shared) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for (tile, top) in tiles {
        let TileVariance { sums, paths, .. } = tile;
        let after = sums.at(top) * decay / (1.0 - decay);
        let of_path = (0..=top).map(|level| sums.at(level)).sum::<DVec3>() + after;
        let paths = paths / f64::from(sums.joined + 1);
        let doublings = (paths.log2() - (top + 1) as f64).max(0.0);
        let of_mean = after * if one_set { decay } else { DECAY[1] }.powf(doublings);
        // Of the pixels' own estimates, which count the paths of each.
        let fraction = |of: DVec3, all: DVec3| DVec3::select(all.cmpgt(DVec3::ZERO), of / all, DVec3::ZERO);
        independent += tile.independent;
        alone += tile.independent * fraction(of_mean * paths, of_path);
        // Pairs of single paths: their squares are a quarter of the variance of as many paths as they have.
        shared += tile.independent * fraction(sums.shared.into(), 4.0 * DVec3::from(sums.squares[0]));
    }
    let together = alone + shared.max(DVec3::ZERO);
    let ratio = |a: f64, b: f64, none: f64| if b > 0.0 { a / b } else { none };
    (independent.element_sum() > 0.0).then(|| MeanVariance {
        over_independent: std::array::from_fn(|c| ratio(together[c], independent[c], 1.0)),
        related: ratio(together.element_sum(), alone.element_sum(), 1.0),
    })
}

/// What [`MeanVarianceSums`] keeps in a pass.
#[derive(Debug, Default)]
pub struct MeanVarianceColumns {
    /// By pixel of the tile, its first path in the pass, and by level the mean of the last block.
    blocks: Vec<(u32, [Vec3; LEVELS])>,
    /// By path, what it borrows; empty where nothing is shared.
    borrowed: Vec<Vec3>,
    /// By path number, the deviation of all pixels.
    deviations: Vec<DVec3>,
}

impl MeanVarianceColumns {
    /// Begins a pass over pixels that have taken these paths before.
    pub fn begin(&mut self, paths: impl Iterator<Item = u32>) {
        self.blocks.clear();
        self.blocks.extend(paths.map(|first| (first, [Vec3::ZERO; LEVELS])));
    }
}

/// Adds the waves of a pass to a tile's sums.
#[derive(Debug)]
pub struct MeanVarianceSums<'a> {
    pub sums: &'a mut BlockSums,
    pub columns: &'a mut MeanVarianceColumns,
}

impl MeanVarianceSums<'_> {
    /// Adds the covariances of what the pixels of a class borrow.
    fn add_shared(&mut self, at: &WaveContext, class: u32) {
        let MeanVarianceColumns { borrowed, deviations, .. } = &mut *self.columns;
        let mut own = DVec3::ZERO;
        deviations.clear();
        for (_, paths) in at.by_pixel(borrowed).filter(|(task, paths)| task.class == class && paths.len() > 1) {
            let mean = paths.iter().sum::<Vec3>() / paths.len() as f32;
            deviations.resize(deviations.len().max(paths.len()), DVec3::ZERO);
            for (sum, path) in deviations.iter_mut().zip(paths) {
                let deviation = (*path - mean).as_dvec3();
                *sum += deviation;
                own += deviation * deviation;
            }
        }
        // One degree of freedom is the mean's.
        let n = deviations.len() as f64;
        let all = deviations.iter().map(|sum| sum * sum).sum::<DVec3>();
        if n > 1.0 {
            add(&mut self.sums.shared, (all - own) * n / (n - 1.0));
        }
    }
}

impl PathEvents for MeanVarianceSums<'_> {
    fn begin(&mut self, at: &WaveContext) {
        let n = at.transport.proposal.reuse.map_or(0, |_| at.paths.len());
        self.columns.borrowed.clear();
        self.columns.borrowed.resize(n, Vec3::ZERO);
    }

    fn borrowed(&mut self, _: &WaveContext, light: &BorrowedLight) {
        self.columns.borrowed[light.path as usize] += light.radiance;
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        let (sums, blocks) = (&mut *self.sums, &mut self.columns.blocks);
        for (task, paths) in at.by_pixel(radiance) {
            let (first, blocks) = &mut blocks[task.number as usize];
            for (number, path) in (task.first_path..).zip(paths) {
                let mut mean = *path;
                for (level, before) in blocks.iter_mut().enumerate() {
                    let block = number >> level;
                    // Its neighbour follows, or was not in this pass.
                    if block % 2 == 0 || (block - 1) << level < *first {
                        *before = mean;
                        break;
                    }
                    let half = 0.5 * (mean - *before);
                    add(&mut sums.squares[level], (half * half).as_dvec3());
                    sums.pairs[level] += 1;
                    mean = 0.5 * (mean + *before);
                }
            }
        }
        if !self.columns.borrowed.is_empty() {
            let classes = at.tasks.iter().map(|task| task.class + 1).max().unwrap_or(0);
            (0..classes).for_each(|class| self.add_shared(at, class));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums whose squares fall by such factors from level to level.
    fn falling(by: f64, levels: usize) -> BlockSums {
        let square = |level: usize| if level < levels { [by.powi(level as i32); 3] } else { [0.0; 3] };
        BlockSums {
            squares: std::array::from_fn(square),
            pairs: std::array::from_fn(|level| u64::from(level < levels)),
            ..Default::default()
        }
    }

    fn of(sums: &BlockSums, paths: f64, one_set: bool) -> Option<MeanVariance> {
        let tile = TileVariance { sums, pixels: 1, paths, independent: DVec3::ONE };
        mean_variance([tile; 3].into_iter(), one_set)
    }

    #[test]
    fn variances_fall_as_they_have_fallen_before() {
        // Independent paths, of as many as there are or more: what pixels estimate.
        for paths in [32.0, 50.0, 512.0] {
            let found = of(&falling(0.5, 5), paths, true).unwrap();
            assert!(
                found.over_independent.iter().all(|x| (x - 1.0).abs() < 1e-12) && found.related == 1.0,
                "{found:?}"
            );
        }
        // 1/n² in place of 1/n, for 32 paths, for 16 sets of 32, and for two.
        let mut twice = falling(0.25, 5);
        twice.join(&falling(0.25, 5));
        for (sums, paths, one_set) in
            [(falling(0.25, 5), 32.0, true), (falling(0.25, 5), 512.0, false), (twice, 64.0, true)]
        {
            let found = of(&sums, paths, one_set).unwrap().over_independent[1];
            assert!((1.0 / 32.0..2.0 / 32.0).contains(&found), "{found}");
        }
        let [more, sets] =
            [true, false].map(|one_set| of(&falling(0.25, 5), 512.0, one_set).unwrap().over_independent[1]);
        assert!(more < 0.3 * sets, "{more} {sets}");
        assert_eq!(of(&BlockSums::default(), 1.0, true), None);
    }

    #[test]
    fn what_is_shared_counts_beside_what_stratification_leaves() {
        let alone = of(&falling(0.25, 5), 32.0, true).unwrap().over_independent[0];
        // Twice the variance of independent paths.
        let sums = BlockSums { shared: [8.0; 3], ..falling(0.25, 5) };
        let MeanVariance { over_independent, related } = of(&sums, 32.0, true).unwrap();
        assert!((over_independent[0] - 2.0 - alone).abs() < 1e-9, "{over_independent:?}");
        assert!((related * alone - over_independent[0]).abs() < 1e-9, "{related}");
        // Less than nothing is chance.
        let sums = BlockSums { shared: [-8.0; 3], ..falling(0.5, 5) };
        assert_eq!(of(&sums, 32.0, true).unwrap().related, 1.0);
    }
}
