//! Learns a field from the training samples of a pre-pass.

use rayon::prelude::*;

use super::field::Field;
use super::histograms::{ByLeaf, histograms};
use super::training_sample::TrainingSample;
use crate::sampling::cells::CellTree;

/// Approximate number of training samples per cell: it grows with the total between these limits. A cell with fewer is not
/// split. The lower limit is small because near lights are seen in other directions from every position, so that one large
/// cell guides badly.
const TRAINING_SAMPLES_PER_CELL: [usize; 2] = [24, 256];
/// Approximate number of cells up to which cells hold the lower limit of training samples.
const FIRST_CELLS: usize = 64;
/// Largest number of training samples from which the tree is built.
const MAX_TREE_SAMPLES: usize = 1 << 15;
/// The guiding probabilities among which cells choose.
const GUIDING_PROBABILITIES: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 0.875];
/// The guiding probability while a field is learned.
const LEARNING_PROBABILITY: f32 = 0.5;

/// Estimated gain by a field, from the last training samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gain {
    /// Sum of the second moments of contributions to pixels, divided by the pixels' divisors of relMSE, without guiding.
    pub without: f64,
    /// The same with guiding.
    pub with: f64,
    /// The same with the densities by which the samples were taken.
    pub taken: f64,
    /// Mean guiding probability over training samples.
    pub guiding_probability: f32,
    /// Relative standard error of the second moment at a guiding probability of ½: 1 if one sample has all of it.
    pub standard_error: f32,
}

impl Gain {
    /// The variance with guiding relative to that without, for paths with the variance `taken` in the same units.
    pub fn variance(&self, taken: f64) -> f32 {
        let [with, without] = [self.with, self.without].map(|moment| (taken + moment - self.taken).max(0.0));
        if without > 0.0 { (with / without) as f32 } else { 1.0 }
    }
}

/// Learns a field of at most `max_cells` cells from all `training_samples`. `scale` (metres) weights differences of normals
/// against distances. The training samples from index `fresh` on, whose [`TrainingSample::field_pdf`] is the density of a field
/// that was learned without them, say which guiding probability is best in each cell, and what guiding gains with these. The
/// field has these probabilities if it is `final_field` and there are such samples. Otherwise it guides half of the directions
/// everywhere: a cell with probability 0 would learn nothing more.
pub fn learn<'a>(
    training_samples: impl IntoIterator<Item = &'a TrainingSample>,
    fresh: usize,
    final_field: bool,
    scale: f32,
    max_cells: usize,
) -> (Field, Gain) {
    let training_samples: Vec<_> = training_samples.into_iter().collect();
    let step = training_samples.len().div_ceil(MAX_TREE_SAMPLES).max(1);
    let keys = training_samples.iter().step_by(step).map(|s| CellTree::key(s.position, s.normal, scale)).collect();
    let per_cell =
        (training_samples.len() / FIRST_CELLS).clamp(TRAINING_SAMPLES_PER_CELL[0], TRAINING_SAMPLES_PER_CELL[1]);
    let tree = CellTree::new(keys, scale, per_cell.div_ceil(step), max_cells);
    let by_leaf = ByLeaf::new(&tree, &training_samples);
    let histograms = histograms(&tree, &by_leaf);
    let probability_sums = |leaf| {
        let mut sums = ProbabilitySums::default();
        let indices = by_leaf.leaf(leaf).iter().map(|i| *i as usize);
        indices.filter(|i| *i >= fresh).for_each(|i| sums.add(training_samples[i]));
        sums
    };
    let cells: Vec<_> = (0..tree.leaves()).into_par_iter().map(probability_sums).collect();
    let all = cells.iter().fold(ProbabilitySums::default(), |all, cell| all.plus(cell));
    let error = if all.moments[2] > 0.0 { (all.squares.sqrt() / all.moments[2]) as f32 } else { 1.0 };
    let mut gain = Gain { standard_error: error, ..Default::default() };
    let probability = |cell: &ProbabilitySums| {
        let best = cell.best(&all);
        gain.without += cell.moments[0];
        gain.with += cell.moments[best];
        gain.taken += cell.taken;
        gain.guiding_probability += GUIDING_PROBABILITIES[best] * cell.n / all.n.max(1.0);
        if final_field && all.n > 0.0 { GUIDING_PROBABILITIES[best] } else { LEARNING_PROBABILITY }
    };
    let probabilities = cells.iter().map(probability).collect();
    (Field::new(tree, histograms, probabilities), gain)
}

/// Sums from which the guiding probability of a cell follows.
#[derive(Debug, Clone, Copy, Default)]
struct ProbabilitySums {
    /// Second moment at each of [`GUIDING_PROBABILITIES`].
    moments: [f64; GUIDING_PROBABILITIES.len()],
    /// Sum of squared second moments at a guiding probability of ½. Divided by `moments[2]` it is the typical second moment of
    /// a sample with a large contribution.
    squares: f64,
    /// Second moment with the densities by which the samples were taken.
    taken: f64,
    n: f32,
}

/// Number of samples with large contributions by which the mean over all cells is weighted in each cell.
const PRIOR_HEAVY_SAMPLES: f64 = 4.0;

impl ProbabilitySums {
    fn add(&mut self, training_sample: &TrainingSample) {
        let TrainingSample { weight, pdf, bsdf_pdf, field_pdf, light_pdf, .. } = *training_sample;
        // By the balance heuristic, light samples and scattered rays have the second moment (f L)² / (p + p_light) in all.
        let both = f64::from(pdf + light_pdf);
        let taken = f64::from(weight) * both / f64::from(pdf);
        let ratio = |c: f32| both / f64::from(c.mul_add(field_pdf - bsdf_pdf, bsdf_pdf) + light_pdf);
        for (sum, c) in self.moments.iter_mut().zip(GUIDING_PROBABILITIES) {
            *sum += taken * ratio(c).min(1e6);
        }
        self.squares += (taken * ratio(0.5)).powi(2);
        self.taken += taken;
        self.n += 1.0;
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            moments: std::array::from_fn(|i| self.moments[i] + other.moments[i]),
            squares: self.squares + other.squares,
            taken: self.taken + other.taken,
            n: self.n + other.n,
        }
    }

    /// Index of the guiding probability with the least second moment, over this cell and a few samples of all cells.
    fn best(&self, all: &Self) -> usize {
        let heavy = if self.moments[2] > 0.0 { self.squares / self.moments[2] } else { 1.0 };
        let scale = if all.moments[2] > 0.0 { PRIOR_HEAVY_SAMPLES * heavy / all.moments[2] } else { 0.0 };
        let moment = |i: usize| self.moments[i] + scale * all.moments[i];
        (0..GUIDING_PROBABILITIES.len()).min_by(|a, b| moment(*a).total_cmp(&moment(*b))).unwrap_or(0)
    }
}
