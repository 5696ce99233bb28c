//! Learns a field from the training samples of a pre-pass.

use glam::Vec3;
use rayon::prelude::*;

use super::directions::{BINS, Histogram, SIDE, bins, from_square, steradians};
use super::field::Field;
use crate::lanes::{F, V3};
use crate::sampling::cells::CellTree;

/// A direction that a pre-pass sampled at a surface, and the radiance that it found.
#[derive(Debug, Clone, Copy)]
pub struct TrainingSample {
    /// Position of the surface in world space.
    pub position: Vec3,
    /// Unit geometric normal on the side of the incident ray.
    pub normal: Vec3,
    /// Unit direction in world space.
    pub wi: Vec3,
    /// Luminance of f·L/p, > 0, where L excludes the part that MIS leaves to light samples.
    pub contribution: f32,
    /// Square of the sample's contribution to its pixel, divided by the pixel's divisor of relMSE.
    pub weight: f32,
    /// Density p with which the direction was sampled.
    pub pdf: f32,
    /// Density of the BSDF.
    pub bsdf_pdf: f32,
    /// Density of the earlier field; 0 without one.
    pub field_pdf: f32,
    /// Density of light samples if the direction ends at a light that MIS shares with them, otherwise 0.
    pub light_pdf: f32,
}

/// Approximate number of training samples per cell: it grows with the total between these limits. A cell with fewer is not
/// split. The lower limit is small because near lights are seen in other directions from every position, so that one large
/// cell guides badly.
const TRAINING_SAMPLES_PER_CELL: [usize; 2] = [24, 256];
/// Memory of a cell in bytes while it learns: its sums, those of two nodes of the tree, and its part of the field.
pub const LEARNING_CELL_BYTES: usize = size_of::<Sums>() + 2 * (BINS + 1) * size_of::<f32>() + Field::CELL_BYTES;
/// Approximate number of cells up to which cells hold the lower limit of training samples.
const FIRST_CELLS: usize = 64;
/// Number of training samples by which a node's parent is weighted in the node's histogram.
const PRIOR_SAMPLES: f64 = 48.0;
/// Largest number of training samples from which the tree is built.
const MAX_TREE_SAMPLES: usize = 1 << 15;
/// The guiding probabilities among which cells choose.
pub const GUIDING_PROBABILITIES: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 0.875];
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
}

impl Gain {
    /// The variance with guiding relative to that without, for paths with the variance `taken` in the same units.
    pub fn variance(&self, taken: f64) -> f32 {
        let [with, without] = [self.with, self.without].map(|moment| (taken + moment - self.taken).max(0.0));
        if without > 0.0 { (with / without) as f32 } else { 1.0 }
    }
}

/// Learns a field of at most `max_cells` cells from all `training_samples`. `scale` (metres) weights differences of normals
/// against distances. The guiding probability of each cell follows from the training samples from index `fresh` on, whose
/// [`TrainingSample::field_pdf`] is the density of a field that was learned without them. Without such samples it is ½.
pub fn learn(training_samples: &[TrainingSample], fresh: usize, scale: f32, max_cells: usize) -> (Field, Gain) {
    let step = training_samples.len().div_ceil(MAX_TREE_SAMPLES).max(1);
    let keys = training_samples.iter().step_by(step).map(|s| CellTree::key(s.position, s.normal, scale)).collect();
    let per_cell =
        (training_samples.len() / FIRST_CELLS).clamp(TRAINING_SAMPLES_PER_CELL[0], TRAINING_SAMPLES_PER_CELL[1]);
    let tree = CellTree::new(keys, scale, per_cell.div_ceil(step), max_cells);
    let cells = sums(&tree, training_samples, fresh);
    let histograms = histograms(&tree, &cells);
    let all = cells.iter().fold(ProbabilitySums::default(), |all, cell| all.plus(&cell.probabilities));
    let mut gain = Gain::default();
    let probability = |cell: &Sums| {
        if fresh >= training_samples.len() {
            return LEARNING_PROBABILITY;
        }
        let best = cell.probabilities.best(&all);
        gain.without += cell.probabilities.moments[0];
        gain.with += cell.probabilities.moments[best];
        gain.taken += cell.probabilities.taken;
        gain.guiding_probability += GUIDING_PROBABILITIES[best] * cell.probabilities.n / all.n.max(1.0);
        GUIDING_PROBABILITIES[best]
    };
    let probabilities = cells.iter().map(probability).collect();
    (Field::new(tree, histograms, probabilities), gain)
}

/// Sums over the training samples of a cell.
#[derive(Debug, Clone)]
struct Sums {
    /// ∫ (f L)² dω over each bin.
    moments: [f32; BINS],
    n: f32,
    probabilities: ProbabilitySums,
}

impl Default for Sums {
    fn default() -> Self {
        Self { moments: [0.0; BINS], n: 0.0, probabilities: ProbabilitySums::default() }
    }
}

impl Sums {
    fn add(&mut self, training_sample: &TrainingSample, fresh: bool) {
        let moment = training_sample.contribution * training_sample.contribution * training_sample.pdf;
        if moment.is_finite() {
            self.moments[bins(V3::splat(training_sample.wi))[0] as usize] += moment;
            self.n += 1.0;
        }
        if fresh {
            self.probabilities.add(training_sample);
        }
    }
}

/// Sums over the training samples of each leaf.
fn sums(tree: &CellTree, training_samples: &[TrainingSample], fresh: usize) -> Vec<Sums> {
    let leaves: Vec<_> = training_samples
        .par_iter()
        .map(|training_sample| tree.leaf(training_sample.position, training_sample.normal))
        .collect();
    let mut of_leaf = vec![Vec::new(); tree.leaves()];
    for (training_sample, leaf) in (0u32..).zip(leaves) {
        of_leaf[leaf as usize].push(training_sample);
    }
    let sum = |indices: Vec<u32>| {
        let mut sums = Sums::default();
        indices.into_iter().for_each(|i| sums.add(&training_samples[i as usize], i as usize >= fresh));
        sums
    };
    of_leaf.into_par_iter().map(sum).collect()
}

/// Levels at the top of the tree that one thread works at; the subtrees below are worked at in parallel.
const SEQUENTIAL_LEVELS: u32 = 5;

/// The histogram of each leaf, by its own training samples and, the fewer these are, by those of its parents.
fn histograms(tree: &CellTree, cells: &[Sums]) -> Vec<Histogram> {
    let areas = areas();
    let mut nodes = vec![([0.0f32; BINS], 0.0f32); tree.nodes()];
    for node in (0..nodes.len()).rev() {
        nodes[node] = match tree.children(node) {
            Err(leaf) => (cells[leaf as usize].moments, cells[leaf as usize].n),
            Ok([a, b]) => (std::array::from_fn(|bin| nodes[a].0[bin] + nodes[b].0[bin]), nodes[a].1 + nodes[b].1),
        };
    }
    let weights = |node: usize, parent: &[f64; BINS]| -> [f64; BINS] {
        let (moments, n) = &nodes[node];
        let own = best(&moments.map(f64::from), &areas);
        let (own_sum, parent_sum): (f64, f64) = (own.iter().sum(), parent.iter().sum());
        let trust = if own_sum > 0.0 { f64::from(*n) / (f64::from(*n) + PRIOR_SAMPLES) } else { 0.0 };
        std::array::from_fn(|bin| {
            trust * own[bin] / own_sum.max(f64::MIN_POSITIVE) + (1.0 - trust) * parent[bin] / parent_sum
        })
    };
    // From the top down. The root's prior is uniform over directions.
    let mut parts = vec![(0, areas)];
    for _ in 0..SEQUENTIAL_LEVELS {
        let below = |(node, parent)| match tree.children(node) {
            Err(_) => vec![(node, parent)],
            Ok(children) => {
                let weights = weights(node, &parent);
                children.map(|child| (child, weights)).to_vec()
            }
        };
        parts = parts.into_iter().flat_map(below).collect();
    }
    let of_part = |part| {
        let (mut open, mut leaves) = (vec![part], Vec::new());
        while let Some((node, parent)) = open.pop() {
            let weights = weights(node, &parent);
            match tree.children(node) {
                Err(leaf) => leaves.push((leaf, Histogram::new(&weights))),
                Ok(children) => open.extend(children.map(|child| (child, weights))),
            }
        }
        leaves
    };
    let mut leaves: Vec<_> = parts.into_par_iter().flat_map_iter(of_part).collect();
    leaves.sort_unstable_by_key(|(leaf, _)| *leaf);
    leaves.into_iter().map(|(_, histogram)| histogram).collect()
}

/// Solid angles of the bins in steradians.
fn areas() -> [f64; BINS] {
    std::array::from_fn(|bin| {
        let middle = |i: usize| F::splat((i as f32 + 0.5) / SIDE as f32);
        let w = from_square(middle(bin / SIDE), middle(bin % SIDE));
        f64::from(steradians(w).to_array()[0]) / BINS as f64
    })
}

/// Bin weights in proportion to the root of the density of the second moment, which minimise the variance (Rath et al. 2020,
/// equation 9).
fn best(moments: &[f64; BINS], areas: &[f64; BINS]) -> [f64; BINS] {
    let smooth = smoothed(moments);
    std::array::from_fn(|bin| (smooth[bin] * areas[bin]).sqrt())
}

/// Smooths the sums over neighbouring bins, because training samples are few.
fn smoothed(sums: &[f64; BINS]) -> [f64; BINS] {
    let mut smooth = [0.0; BINS];
    for (bin, sum) in sums.iter().enumerate().filter(|(_, sum)| **sum > 0.0) {
        let (row, column) = ((bin / SIDE) as isize, (bin % SIDE) as isize);
        for (dr, dc) in (-1..=1isize).flat_map(|dr| (-1..=1isize).map(move |dc| (dr, dc))) {
            let inside = |i: isize| i.clamp(0, SIDE as isize - 1) as usize;
            let weight = [8.0, 1.0, 0.5][dr.unsigned_abs() + dc.unsigned_abs()] / 14.0;
            smooth[inside(row + dr) * SIDE + inside(column + dc)] += sum * weight;
        }
    }
    smooth
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
