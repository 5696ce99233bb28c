//! Learns a field from the training samples of a pre-pass.

use std::collections::HashMap;

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

/// Largest memory in bytes while a field is learned from so many training samples, without these.
pub fn bytes_to_learn(training_samples: u64) -> u64 {
    let per_sample = size_of::<&TrainingSample>() + size_of::<u32>();
    // Cells are halved while they have too many training samples. Histograms are collected from parts of the tree.
    let [cells, first] = [training_samples / TRAINING_SAMPLES_PER_CELL[1] as u64 + 1, 2 * FIRST_CELLS as u64];
    let cells = if cells > first { cells.next_power_of_two() } else { first };
    let per_cell = 2 * Field::CELL_BYTES + size_of::<ProbabilitySums>();
    // Of the nodes at the top: moments in two maps, and weights.
    let per_node = 3 * size_of::<Moments>() + 2 * size_of::<[f64; BINS]>();
    let nodes = cells.min(1 << SEQUENTIAL_LEVELS);
    training_samples * per_sample as u64 + cells * per_cell as u64 + nodes * per_node as u64
}

/// Learns a field of at most `max_cells` cells from all `training_samples`. `scale` (metres) weights differences of normals
/// against distances. The guiding probability of each cell follows from the training samples from index `fresh` on, whose
/// [`TrainingSample::field_pdf`] is the density of a field that was learned without them. Without such samples it is ½.
pub fn learn<'a>(
    training_samples: impl IntoIterator<Item = &'a TrainingSample>,
    fresh: usize,
    scale: f32,
    max_cells: usize,
) -> (Field, Gain) {
    let training_samples: Vec<_> = training_samples.into_iter().collect();
    let step = training_samples.len().div_ceil(MAX_TREE_SAMPLES).max(1);
    let keys = training_samples.iter().step_by(step).map(|s| CellTree::key(s.position, s.normal, scale)).collect();
    let per_cell =
        (training_samples.len() / FIRST_CELLS).clamp(TRAINING_SAMPLES_PER_CELL[0], TRAINING_SAMPLES_PER_CELL[1]);
    let tree = CellTree::new(keys, scale, per_cell.div_ceil(step), max_cells);
    let (order, ends) = by_leaf(&tree, &training_samples);
    let of_leaf = |leaf: usize| {
        let begin = if leaf > 0 { ends[leaf - 1] } else { 0 };
        order[begin..ends[leaf]].iter().map(|&i| i as usize)
    };
    let histograms = histograms(&tree, &|leaf| Moments::of(of_leaf(leaf).map(|i| training_samples[i])));
    let probability_sums = |leaf| {
        let mut sums = ProbabilitySums::default();
        of_leaf(leaf).filter(|&i| i >= fresh).for_each(|i| sums.add(training_samples[i]));
        sums
    };
    let cells: Vec<_> = (0..tree.leaves()).into_par_iter().map(probability_sums).collect();
    let all = cells.iter().fold(ProbabilitySums::default(), |all, cell| all.plus(cell));
    let mut gain = Gain::default();
    let probability = |cell: &ProbabilitySums| {
        if fresh >= training_samples.len() {
            return LEARNING_PROBABILITY;
        }
        let best = cell.best(&all);
        gain.without += cell.moments[0];
        gain.with += cell.moments[best];
        gain.taken += cell.taken;
        gain.guiding_probability += GUIDING_PROBABILITIES[best] * cell.n / all.n.max(1.0);
        GUIDING_PROBABILITIES[best]
    };
    let probabilities = cells.iter().map(probability).collect();
    (Field::new(tree, histograms, probabilities), gain)
}

/// Sums over the training samples of a node.
#[derive(Debug, Clone)]
struct Moments {
    /// ∫ (f L)² dω over each bin.
    bins: [f32; BINS],
    n: f32,
}

impl Moments {
    fn of<'a>(training_samples: impl Iterator<Item = &'a TrainingSample>) -> Self {
        let mut sums = Self { bins: [0.0; BINS], n: 0.0 };
        for training_sample in training_samples {
            let moment = training_sample.contribution * training_sample.contribution * training_sample.pdf;
            if moment.is_finite() {
                sums.bins[bins(V3::splat(training_sample.wi))[0] as usize] += moment;
                sums.n += 1.0;
            }
        }
        sums
    }

    fn plus(&self, other: &Self) -> Self {
        Self { bins: std::array::from_fn(|bin| self.bins[bin] + other.bins[bin]), n: self.n + other.n }
    }
}

/// Indices of the training samples, leaf by leaf, and where in the list each leaf ends.
fn by_leaf(tree: &CellTree, training_samples: &[&TrainingSample]) -> (Vec<u32>, Vec<usize>) {
    let leaf = |sample: &&TrainingSample| tree.leaf(sample.position, sample.normal);
    let leaves: Vec<_> = training_samples.par_iter().map(leaf).collect();
    let mut begins = vec![0; tree.leaves() + 1];
    leaves.iter().for_each(|leaf| begins[*leaf as usize + 1] += 1);
    (0..tree.leaves()).for_each(|leaf| begins[leaf + 1] += begins[leaf]);
    let mut order = vec![0; training_samples.len()];
    for (i, leaf) in (0u32..).zip(leaves) {
        let next = &mut begins[leaf as usize];
        order[*next] = i;
        *next += 1;
    }
    // Each has come to its end.
    (order, begins)
}

/// Levels at the top of the tree that one thread works at; the subtrees below are worked at in parallel.
const SEQUENTIAL_LEVELS: u32 = 6;

/// The histogram of each leaf, by its own training samples and, the fewer these are, by those of its parents. The moments of
/// all nodes would take more memory than the training samples: those of a subtree are summed twice, once for the nodes above it.
fn histograms(tree: &CellTree, of_leaf: &(impl Fn(usize) -> Moments + Sync)) -> Vec<Histogram> {
    let of_leaf = |node: usize| tree.children(node).err().map(|leaf| of_leaf(leaf as usize));
    let below = |node: usize| tree.children(node).map_or_else(|_| vec![node], |children| children.to_vec());
    let mut roots = vec![0];
    for _ in 0..SEQUENTIAL_LEVELS {
        roots = roots.into_iter().flat_map(below).collect();
    }
    let of_root = |root: usize| Some((root, moments_below(tree, root, of_leaf).remove(&root)?));
    let mut of_roots: HashMap<_, _> = roots.into_par_iter().filter_map(of_root).collect();
    let top = moments_below(tree, 0, |node| of_roots.remove(&node));
    let areas = areas();
    let weights = |moments: &HashMap<usize, Moments>, node: usize, parent: &[f64; BINS]| -> [f64; BINS] {
        let Moments { bins, n } = &moments[&node];
        let own = best(&bins.map(f64::from), &areas);
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
                let weights = weights(&top, node, &parent);
                children.map(|child| (child, weights)).to_vec()
            }
        };
        parts = parts.into_iter().flat_map(below).collect();
    }
    let of_part = |part: (usize, _)| {
        let moments = moments_below(tree, part.0, of_leaf);
        let (mut open, mut histograms) = (vec![part], Vec::new());
        while let Some((node, parent)) = open.pop() {
            let weights = weights(&moments, node, &parent);
            match tree.children(node) {
                Err(_) => histograms.push(Histogram::new(&weights)),
                // The first child is next, as leaves are counted.
                Ok([a, b]) => open.extend([(b, weights), (a, weights)]),
            }
        }
        histograms
    };
    parts.into_par_iter().flat_map_iter(of_part).collect()
}

/// Moments of a node and of those below it, as far as down to nodes of which `known` tells them.
fn moments_below(
    tree: &CellTree,
    root: usize,
    mut known: impl FnMut(usize) -> Option<Moments>,
) -> HashMap<usize, Moments> {
    let (mut open, mut parents, mut moments) = (vec![root], Vec::new(), HashMap::new());
    while let Some(node) = open.pop() {
        if let Some(known) = known(node) {
            moments.insert(node, known);
        } else if let Ok(children) = tree.children(node) {
            parents.push((node, children));
            open.extend(children);
        }
    }
    // Children come after their parents.
    for (node, [a, b]) in parents.into_iter().rev() {
        let sum = moments[&a].plus(&moments[&b]);
        moments.insert(node, sum);
    }
    moments
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
