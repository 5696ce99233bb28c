//! The histogram of each cell, from its own training samples and, the fewer these are, from those of the cells around it.
//!
//! A training sample at another position saw the same surface in another direction. So its direction is that from the cell's
//! mean position to the point that the sample's ray met (after the parallax-aware mixtures of Ruppert, Herholz and Lensch 2020,
//! *Robust Fitting of Parallax-Aware Mixtures for Path Guiding*; here samples are moved when histograms are made).
//!
//! Cells that have missed a light would sample its direction far too rarely. So a part of every histogram points to where the
//! most light was found in the whole scene.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::TrainingSample;
use super::directions::{BINS, Histogram, SIDE, bins, from_square, steradians};
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::cells::CellTree;

/// Number of training samples by which a node's parent is weighted in the node's weights.
const PRIOR_SAMPLES: f32 = 120.0;
/// Maximum training samples from which a cell's histogram is made, if the cell has fewer.
const MAX_SAMPLES: usize = 4096;
/// Fraction of each histogram that follows the brightest samples of the whole scene.
const SCENE_FRACTION: f32 = 0.125;
/// Maximum number of these samples.
const SCENE_SAMPLES: usize = 256;
/// Limits of the squared distance to what a training sample met, over that from the sample's own position. Its moment is divided
/// by it.
const SQUARED_DISTANCES: [f32; 2] = [0.25, 4.0];
/// Minimum cosine at a training sample's own position, and maximum squared cosine at the cell over that.
const COSINES: [f32; 2] = [0.1, 4.0];

/// Training samples in the order of the tree's leaves.
pub struct ByLeaf<'a> {
    samples: &'a [&'a TrainingSample],
    order: Vec<u32>,
    /// Where each leaf ends in `order`.
    ends: Vec<usize>,
}

impl<'a> ByLeaf<'a> {
    /// Orders training samples by the leaves of a tree.
    pub fn new(tree: &CellTree, samples: &'a [&'a TrainingSample]) -> Self {
        let leaf = |sample: &&TrainingSample| tree.leaf(sample.position, sample.normal);
        let leaves: Vec<_> = samples.par_iter().map(leaf).collect();
        let mut begins = vec![0; tree.leaves() + 1];
        leaves.iter().for_each(|leaf| begins[*leaf as usize + 1] += 1);
        (0..tree.leaves()).for_each(|leaf| begins[leaf + 1] += begins[leaf]);
        let mut order = vec![0; samples.len()];
        for (i, leaf) in (0u32..).zip(leaves) {
            let next = &mut begins[leaf as usize];
            order[*next] = i;
            *next += 1;
        }
        // Each has come to its end.
        Self { samples, order, ends: begins }
    }

    /// Indices of a leaf's training samples.
    pub fn leaf(&self, leaf: usize) -> &[u32] {
        &self.order[self.range(leaf)]
    }

    fn range(&self, leaf: usize) -> Range<usize> {
        (if leaf > 0 { self.ends[leaf - 1] } else { 0 })..self.ends[leaf]
    }

    fn at(&self, range: Range<usize>) -> impl Iterator<Item = &TrainingSample> {
        self.order[range].iter().map(|i| self.samples[*i as usize])
    }
}

/// The histogram of each leaf of the tree.
pub(crate) fn histograms(tree: &CellTree, samples: &ByLeaf) -> Vec<Histogram> {
    let mut ranges = vec![0..0; tree.nodes()];
    // Children come after their parents.
    for node in (0..tree.nodes()).rev() {
        ranges[node] = match tree.children(node) {
            Ok([a, b]) => ranges[a].start..ranges[b].end,
            Err(leaf) => samples.range(leaf as usize),
        };
    }
    let (mut open, mut roots) = (vec![0], Vec::new());
    while let Some(node) = open.pop() {
        match tree.children(node) {
            Ok([a, b]) if ranges[node].len() > MAX_SAMPLES => open.extend([b, a]),
            _ => roots.push(node),
        }
    }
    let areas = areas();
    let brightest = brightest(samples);
    let below = |root: usize| {
        let (mut open, mut histograms) = (vec![(root, Vec::new())], Vec::new());
        while let Some((node, mut nested)) = open.pop() {
            nested.push(ranges[node].clone());
            match tree.children(node) {
                Ok([a, b]) => open.extend([(b, nested.clone()), (a, nested)]),
                Err(_) => histograms.push(Histogram::new(&weights(samples, &nested, &brightest, &areas))),
            }
        }
        histograms
    };
    roots.into_par_iter().flat_map_iter(below).collect()
}

/// Samples of the whole scene, chosen by systematic resampling in proportion to the moment ∫ (f L)² dω that each contributes. Each
/// has a moment of 1, or as often as it was chosen. Light from infinity is left out: it has no point to turn to.
fn brightest(samples: &ByLeaf) -> Vec<TrainingSample> {
    let moment = |sample: &TrainingSample| {
        let moment = f64::from(sample.contribution).powi(2) * f64::from(sample.pdf);
        if moment.is_finite() && sample.distance.is_finite() { moment } else { 0.0 }
    };
    let all = || samples.at(0..samples.order.len());
    let step = all().map(moment).sum::<f64>() / SCENE_SAMPLES as f64;
    let (mut sum, mut passed) = (0.0, 0.0);
    let choose = |sample: &TrainingSample| {
        sum += moment(sample);
        let steps = (sum / step).round();
        let times = (steps - std::mem::replace(&mut passed, steps)) as f32;
        (times > 0.0).then(|| TrainingSample { contribution: (times / sample.pdf).sqrt(), ..*sample })
    };
    all().filter_map(choose).collect()
}

/// Weights of the bins of a leaf, from the training samples of nodes, of which each range contains the next and the last is the
/// leaf's own, and from the `brightest` samples of the scene.
fn weights(
    samples: &ByLeaf,
    nested: &[Range<usize>],
    brightest: &[TrainingSample],
    areas: &[f32; BINS],
) -> [f32; BINS] {
    let own = nested.last().cloned().unwrap_or_default();
    let mean =
        |of: fn(&TrainingSample) -> Vec3| samples.at(own.clone()).map(of).sum::<Vec3>() / own.len().max(1) as f32;
    let (position, normal) = (mean(|sample| sample.position), mean(|sample| sample.normal).normalize_or_zero());
    let (mut moments, mut inner) = ([0.0; BINS], own.start..own.start);
    let mut of_nodes = Vec::with_capacity(nested.len());
    for range in nested.iter().rev() {
        for outside in [range.start..inner.start, inner.end..range.end] {
            add(&mut moments, samples.at(outside), position, normal);
        }
        of_nodes.push((moments, range.len() as f32));
        inner = range.clone();
    }
    // From the outside in. The first prior is uniform over directions.
    let weights = of_nodes
        .iter()
        .rev()
        .fold(*areas, |prior, (moments, n)| mixture(&best(moments, areas), n / (n + PRIOR_SAMPLES), &prior));
    let mut moments = [0.0; BINS];
    add(&mut moments, brightest, position, normal);
    mixture(&best(&moments, areas), SCENE_FRACTION, &weights)
}

/// Weights with a `fraction` in proportion to `own`, the rest to `others`; those of `others` if `own` has none.
fn mixture(own: &[f32; BINS], fraction: f32, others: &[f32; BINS]) -> [f32; BINS] {
    let [own_sum, others_sum] = [own, others].map(sum);
    let fraction = if own_sum > 0.0 { fraction } else { 0.0 };
    let (own_scale, others_scale) = (fraction / own_sum.max(f32::MIN_POSITIVE), (1.0 - fraction) / others_sum);
    std::array::from_fn(|bin| own_scale * own[bin] + others_scale * others[bin])
}

/// Adds ∫ (f L)² dω over each bin, as seen from a position with a normal.
fn add<'a>(
    moments: &mut [f32; BINS],
    samples: impl IntoIterator<Item = &'a TrainingSample>,
    position: Vec3,
    normal: Vec3,
) {
    let (position, normal) = (V3::splat(position), V3::splat(normal));
    let mut samples = samples.into_iter();
    while let Some(first) = samples.next() {
        let (mut of, mut n) = ([first; LANES], 1);
        for (slot, sample) in of[1..].iter_mut().zip(samples.by_ref()) {
            (*slot, n) = (sample, n + 1);
        }
        let column = |value: fn(&TrainingSample) -> f32| F::from(eight(|lane| value(of[lane])));
        let vectors = |value: fn(&TrainingSample) -> Vec3| V3::gather(eight(|lane| value(of[lane])));
        let wi = vectors(|sample| sample.wi);
        // In units of the sample's own distance, which may be infinite.
        let inverse = F::ONE / column(|sample| sample.distance);
        let to = wi + (vectors(|sample| sample.position) - position) * inverse;
        let squared = to.length_squared();
        let w = to * (F::ONE / squared.fast_max(F::splat(f32::MIN_POSITIVE)).sqrt());
        let [least, most] = SQUARED_DISTANCES.map(F::splat);
        let [least_cosine, most_ratio] = COSINES.map(F::splat);
        let cosines = normal.dot(w).fast_max(F::ZERO) / vectors(|sample| sample.normal).dot(wi).fast_max(least_cosine);
        let scale = (cosines * cosines).fast_min(most_ratio) / squared.fast_max(least).fast_min(most);
        let contribution = column(|sample| sample.contribution);
        let moment = (contribution * contribution * column(|sample| sample.pdf) * scale).to_array();
        for (bin, moment) in bins(w).into_iter().zip(moment).take(n) {
            if moment.is_finite() {
                moments[bin as usize] += moment;
            }
        }
    }
}

/// Solid angles of the bins in steradians.
fn areas() -> [f32; BINS] {
    std::array::from_fn(|bin| {
        let middle = |i: usize| F::splat((i as f32 + 0.5) / SIDE as f32);
        let w = from_square(middle(bin / SIDE), middle(bin % SIDE));
        steradians(w).to_array()[0] / BINS as f32
    })
}

/// Bin weights in proportion to the root of the density of the second moment, which minimise the variance (Rath et al. 2020,
/// equation 9).
fn best(moments: &[f32; BINS], areas: &[f32; BINS]) -> [f32; BINS] {
    let smooth = smoothed(moments);
    std::array::from_fn(|bin| (smooth[bin] * areas[bin]).sqrt())
}

/// Smooths the sums over neighbouring bins, because training samples are few: weights 8, 1 and ½ of 14 for the bin, those beside
/// it and those at its corners. At the edges of the square, what would fall outside stays in the bin.
fn smoothed(sums: &[f32; BINS]) -> [f32; BINS] {
    let rows: &[[f32; SIDE]] = sums.as_chunks().0;
    // Along rows, for the bin's own row and for the ones beside it.
    let along = |row: &[f32; SIDE], middle: f32, side: f32| -> [f32; SIDE] {
        let at = |i: usize| row[i.min(SIDE - 1)];
        std::array::from_fn(|i| middle * row[i] + side * (at(i.saturating_sub(1)) + at(i + 1)))
    };
    let mut smooth = [0.0; BINS];
    for (i, out) in smooth.as_chunks_mut::<SIDE>().0.iter_mut().enumerate() {
        let own = along(&rows[i], 8.0 / 14.0, 1.0 / 14.0);
        let [above, below] =
            [i.saturating_sub(1), (i + 1).min(SIDE - 1)].map(|i| along(&rows[i], 1.0 / 14.0, 0.5 / 14.0));
        *out = std::array::from_fn(|j| own[j] + (above[j] + below[j]));
    }
    smooth
}

fn sum(bins: &[f32; BINS]) -> f32 {
    let eights = bins.as_chunks::<LANES>().0.iter().map(|eight| F::from(*eight));
    eights.fold(F::ZERO, |sum, eight| sum + eight).to_array().iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SplitMix64;

    /// Training samples on a floor of 4 x 4 m, all with light from a point 1 m above its middle.
    fn below_a_light(n: usize, distances: bool) -> Vec<TrainingSample> {
        let mut random = SplitMix64(3);
        let one = |_| {
            let position = Vec3::new(4.0 * random.f32() - 2.0, 0.0, 4.0 * random.f32() - 2.0);
            let to = Vec3::Y - position;
            let (distance, wi) = (to.length(), to.normalize());
            TrainingSample {
                position,
                normal: Vec3::Y,
                wi,
                contribution: wi.y / (distance * distance),
                weight: 1.0,
                pdf: 0.2,
                bsdf_pdf: 0.2,
                field_pdf: 0.0,
                light_pdf: 0.0,
                distance: if distances { distance } else { f32::INFINITY },
            }
        };
        (0..n).map(one).collect()
    }

    /// The tree that the samples make, and the histograms of its leaves.
    fn learned(samples: &[&TrainingSample]) -> (CellTree, Vec<Histogram>) {
        let keys = samples.iter().map(|sample| CellTree::key(sample.position, sample.normal, 1.0)).collect();
        let tree = CellTree::new(keys, 1.0, 24, 10_000);
        let histograms = histograms(&tree, &ByLeaf::new(&tree, samples));
        assert_eq!(histograms.len(), tree.leaves());
        (tree, histograms)
    }

    /// Mean over positions of the density per solid angle toward the light.
    fn density_toward_the_light(training_samples: &[TrainingSample]) -> f32 {
        let samples: Vec<_> = training_samples.iter().collect();
        let (tree, histograms) = learned(&samples);
        let density = |sample: &&TrainingSample| {
            let wi = V3::splat(sample.wi);
            let histogram = &histograms[tree.leaf(sample.position, sample.normal) as usize];
            histogram.density(bins(wi)[0]) / steradians(wi).to_array()[0]
        };
        samples.iter().map(density).sum::<f32>() / samples.len() as f32
    }

    #[test]
    fn samples_of_other_cells_point_to_what_they_met() {
        let [with, without] = [true, false].map(|distances| density_toward_the_light(&below_a_light(5000, distances)));
        assert!(with > 1.5 * without, "{with} {without}");
    }

    #[test]
    fn cells_that_have_missed_a_light_point_to_it_nevertheless() {
        let lit = below_a_light(5000, true);
        let lamp = lit[0].position + lit[0].wi * lit[0].distance;
        // As many samples 20 m away have found light from above alone, a tenth as bright.
        let far = lit.iter().map(|sample| TrainingSample {
            position: sample.position + Vec3::new(15.0, 0.0, -13.0),
            wi: Vec3::Y,
            contribution: 0.1 * sample.contribution,
            ..*sample
        });
        let training_samples: Vec<_> = lit.iter().copied().chain(far).collect();
        let samples: Vec<_> = training_samples.iter().collect();
        let (tree, histograms) = learned(&samples);
        for sample in &samples[lit.len()..] {
            let histogram = &histograms[tree.leaf(sample.position, sample.normal) as usize];
            let bin = bins(V3::splat((lamp - sample.position).normalize()))[0];
            // Smoothing leaves a part of the fraction in the bins around; and the cell's mean position is not the sample's.
            let around = [bin - SIDE as u32, bin, bin + SIDE as u32].map(|bin| [bin - 1, bin, bin + 1]);
            let probability =
                around.as_flattened().iter().map(|bin| histogram.density(*bin)).sum::<f32>() / BINS as f32;
            assert!(probability > 0.1 * SCENE_FRACTION, "{probability}");
        }
    }

    #[test]
    fn smoothing_keeps_the_sum_of_every_bin() {
        for bin in 0..BINS {
            let mut sums = [0.0; BINS];
            sums[bin] = 14.0;
            let smooth = smoothed(&sums);
            assert!((sum(&smooth) - 14.0).abs() < 1e-5, "{bin}: {}", sum(&smooth));
            // Beside an edge of the square, a bin keeps the weight of the bin that would lie outside.
            let edges = [bin / SIDE, bin % SIDE].map(|at| f32::from(u8::from(at == 0 || at == SIDE - 1)));
            let kept = 8.0 + edges[0] + edges[1] + 0.5 * edges[0] * edges[1];
            assert!((smooth[bin] - kept).abs() < 1e-5, "{bin}: {}", smooth[bin]);
        }
    }

    #[test]
    fn odd_samples_leave_histograms_that_can_be_sampled() {
        let mut training_samples = below_a_light(400, true);
        for (i, sample) in training_samples.iter_mut().enumerate() {
            match i % 6 {
                0 => sample.distance = 0.0,
                1 => sample.distance = f32::MIN_POSITIVE,
                2 => sample.contribution = f32::MAX,
                3 => sample.pdf = f32::INFINITY,
                4 => sample.normal = -Vec3::Y,
                _ => {}
            }
        }
        let density = density_toward_the_light(&training_samples);
        assert!(density.is_finite() && density >= 0.0, "{density}");
    }
}
