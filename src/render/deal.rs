//! Adaptive sampling within a tile: how a pass is dealt to the tile's pixels, by the deviations of the paths of its pilot.
//!
//! The pixels of a tile are divided into nine classes, the positions in blocks of 3 x 3 pixels. The paths of a class are as
//! many as ever, so those of the tile are too, and how they are divided within the class follows from pixels of the other
//! classes alone. No sample of a pixel has an effect on the number of its paths, so the picture stays unbiased.

use crate::balance::variance::around;
use crate::film::PixelStats;
use crate::film::compare::relative_to;

/// Side of the blocks whose positions are the classes. The nearest pixels of the same class lie just outside of
/// [`NEIGHBOUR_RADIUS`].
const BLOCK: usize = 3;
/// Distance in pixels, along each axis, up to which a pixel learns from its neighbours.
const NEIGHBOUR_RADIUS: usize = 2;
/// Weight of the mean over the other classes beside that of the neighbours, which are few.
const WEIGHT_OF_ALL: f64 = 0.3;
/// Largest number of a pixel's paths over the mean, and of the mean over a pixel's.
pub const MAX_RATIO: u32 = 2;
/// Counts differ from the mean by multiples of the first of these that divides the mean, else of the last: blocks of the
/// low-discrepancy sequence.
const UNITS: [u32; 2] = [8, 4];
/// Smallest weight over the largest, far below what [`MAX_RATIO`] lets through.
const MIN_WEIGHT: f64 = 1e-6;
/// Halvings of the interval in which a scale lies: more than it takes to divide [`MIN_WEIGHT`] to the last bit.
const HALVINGS: u32 = 80;

/// The pixels of each class, in a tile of `pixels` pixels, `width` a row.
fn classes(pixels: usize, width: usize) -> [Vec<usize>; BLOCK * BLOCK] {
    let mut classes: [Vec<usize>; BLOCK * BLOCK] = Default::default();
    (0..pixels).for_each(|i| classes[class(i, width)].push(i));
    classes
}

fn class(pixel: usize, width: usize) -> usize {
    pixel / width % BLOCK * BLOCK + pixel % width % BLOCK
}

/// The paths of each pixel in a pass of `paths` paths in the mean, by what the pixels of a tile, `width` a row, have found so
/// far. Within a class they are proportional to the root of the relative variance of a path in the pixels around.
pub fn by_neighbours(stats: &[PixelStats], width: usize, paths: u32) -> Vec<u32> {
    let deviations: Vec<f64> = stats.iter().map(deviation).collect();
    let mean = |(sum, n): (f64, u32)| if n > 0 { sum / f64::from(n) } else { 0.0 };
    let add = |(sum, n): (f64, u32), i: usize| (sum + deviations[i], n + 1);
    let mut dealt = vec![paths; stats.len()];
    for own in classes(stats.len(), width).iter().filter(|own| own.len() > 1) {
        let others = (0..stats.len()).filter(|i| class(*i, width) != class(own[0], width));
        let of_all = mean(others.fold((0.0, 0), add));
        let weight = |pixel: &usize| {
            let near = around(*pixel, width, stats.len(), NEIGHBOUR_RADIUS).filter(|i| i != pixel);
            WEIGHT_OF_ALL * of_all + (1.0 - WEIGHT_OF_ALL) * mean(near.fold((0.0, 0), add))
        };
        let weights: Vec<f64> = own.iter().map(weight).collect();
        own.iter().zip(apportioned(&weights, paths)).for_each(|(i, n)| dealt[*i] = n);
    }
    dealt
}

/// The paths of each pixel in a pass of `paths` paths in the mean, in proportion to those that it has.
pub fn as_before(stats: &[PixelStats], width: usize, paths: u32) -> Vec<u32> {
    let mut dealt = vec![paths; stats.len()];
    for own in classes(stats.len(), width) {
        let weights: Vec<f64> = own.iter().map(|i| f64::from(stats[*i].samples)).collect();
        own.iter().zip(apportioned(&weights, paths)).for_each(|(i, n)| dealt[*i] = n);
    }
    dealt
}

/// Root of the relative variance of a path, the mean of the channels; 0 where it is not known.
fn deviation(stats: &PixelStats) -> f64 {
    if stats.samples < 2 {
        return 0.0;
    }
    let n = f64::from(stats.samples);
    let of = |c: usize| {
        let mean = stats.sum[c] / n;
        (stats.sum_squared[c] - n * mean * mean).max(0.0) / ((n - 1.0) * relative_to(mean))
    };
    let found = ((of(0) + of(1) + of(2)) / 3.0).sqrt();
    if found.is_finite() { found } else { 0.0 }
}

/// Numbers with a mean of exactly `paths`, in proportion to `weights` as far as [`MAX_RATIO`] and [`UNITS`] allow.
fn apportioned(weights: &[f64], paths: u32) -> Vec<u32> {
    let largest = weights.iter().fold(0.0, |a: f64, b| a.max(*b));
    if largest <= 0.0 {
        return vec![paths; weights.len()];
    }
    let unit = UNITS.into_iter().find(|unit| paths.is_multiple_of(*unit)).unwrap_or(UNITS[UNITS.len() - 1]);
    // From here on in units, and less the mean.
    let mean = f64::from(paths) / f64::from(unit);
    let ratio = f64::from(MAX_RATIO);
    let [least, most] = [(mean / ratio - mean).ceil(), (ratio * mean - mean).floor()];
    let wanted = |scale: f64, weight: f64| (scale * (weight / largest).max(MIN_WEIGHT) - mean).clamp(least, most);
    let is_too_much = |scale: f64| weights.iter().map(|weight| wanted(scale, *weight)).sum::<f64>() > 0.0;
    let (mut low, mut high) = (0.0, ratio * mean / MIN_WEIGHT);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        *(if is_too_much(middle) { &mut high } else { &mut low }) = middle;
    }
    let wanted: Vec<f64> = weights.iter().map(|weight| wanted(low, *weight)).collect();
    // The largest remainders are rounded up.
    let mut units: Vec<i64> = wanted.iter().map(|wanted| wanted.floor() as i64).collect();
    let remainder = |i: usize| wanted[i] - wanted[i].floor();
    let mut order: Vec<usize> = (0..weights.len()).filter(|i| wanted[*i] < most).collect();
    order.sort_by(|a, b| remainder(*b).total_cmp(&remainder(*a)).then(a.cmp(b)));
    let left = -units.iter().sum::<i64>();
    order.iter().take(left.max(0) as usize).for_each(|i| units[*i] += 1);
    if units.iter().sum::<i64>() != 0 {
        return vec![paths; weights.len()];
    }
    units.iter().map(|more| (i64::from(paths) + i64::from(unit) * more) as u32).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Pixels of a mean of 1 after 16 paths, whose variances these are.
    fn pixels(variances: &[f64]) -> Vec<PixelStats> {
        let of = |variance: &f64| PixelStats {
            samples: 16,
            sum: [16.0; 3],
            sum_squared: [16.0 + 15.0 * variance; 3],
            ..PixelStats::EMPTY
        };
        variances.iter().map(of).collect()
    }

    fn some_tile() -> impl Strategy<Value = (usize, Vec<f64>)> {
        (1usize..=16, 1usize..=16).prop_flat_map(|(width, height)| {
            let variance = prop_oneof![1 => Just(0.0), 4 => (-6.0f64..6.0).prop_map(f64::exp2), 1 => Just(f64::NAN)];
            (Just(width), prop::collection::vec(variance, width * height))
        })
    }

    proptest! {
        #[test]
        fn each_class_has_as_many_paths_as_ever_in_blocks((width, variances) in some_tile(), paths in 32u32..=128) {
            let stats = pixels(&variances);
            let unit = if paths % 8 == 0 { 8 } else { 4 };
            let dealt = by_neighbours(&stats, width, paths);
            let more: Vec<_> = dealt.iter().map(|n| PixelStats { samples: *n, ..PixelStats::EMPTY }).collect();
            let later = [5, 20, 3 * paths].map(|paths| (as_before(&more, width, paths), paths));
            for (dealt, mean) in later.iter().chain([&(dealt.clone(), paths)]) {
                for class in classes(stats.len(), width) {
                    prop_assert_eq!(class.iter().map(|i| dealt[*i]).sum::<u32>(), class.len() as u32 * mean);
                }
            }
            for n in &dealt {
                prop_assert!(n.abs_diff(paths) % unit == 0 && *n <= 2 * paths && 2 * *n >= paths, "{} {}", n, paths);
            }
            // A pass as long as before divides as before.
            prop_assert_eq!(&as_before(&more, width, paths), &dealt);
        }

        #[test]
        fn what_a_pixel_finds_changes_nothing_of_its_own_paths((width, variances) in some_tile(), other in 0.0f64..1e4, at in 0usize..256) {
            let at = at % variances.len();
            let mut changed = variances.clone();
            changed[at] = other;
            let [before, after] = [variances, changed].map(|v| by_neighbours(&pixels(&v), width, 64));
            for i in (0..before.len()).filter(|i| class(*i, width) == class(at, width)) {
                prop_assert_eq!(before[i], after[i]);
            }
        }
    }

    #[test]
    fn noisy_pixels_get_more() {
        let variances: Vec<f64> = (0..256).map(|i| if i % 16 < 8 { 0.01 } else { 1.0 }).collect();
        let dealt = by_neighbours(&pixels(&variances), 16, 64);
        let mean = |left: bool| {
            let of: Vec<_> = (0..256).filter(|i| (i % 16 < 8) == left).map(|i| f64::from(dealt[i])).collect();
            of.iter().sum::<f64>() / of.len() as f64
        };
        assert!(mean(true) < 44.0 && mean(false) > 84.0, "{dealt:?}");
        assert_eq!(by_neighbours(&pixels(&[0.3; 256]), 16, 64), [64; 256]);
        assert_eq!(by_neighbours(&pixels(&[0.0; 256]), 16, 64), [64; 256]);
        // One pixel's fireflies are for its neighbours to follow, at most to twice the mean.
        let mut one = [0.01; 256];
        one[8 * 16 + 8] = 1e9;
        let dealt = by_neighbours(&pixels(&one), 16, 64);
        assert!(dealt[7 * 16 + 7] == 128 && dealt[9 * 16 + 8] == 128 && dealt[8 * 16 + 8] == 64, "{dealt:?}");
    }
}
