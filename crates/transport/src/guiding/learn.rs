//! From a pilot's samples to a field.

use glam::Vec3;
use rayon::prelude::*;

use super::directions::{BINS, Histogram, SIDE, bins, from_square, steradians};
use super::field::Field;
use crate::lanes::{F, V3};
use crate::sampling::cells::Tree;

/// A direction that the pilot took from a surface, and what it found there.
#[derive(Debug, Clone, Copy)]
pub struct TrainingSample {
    /// Of the surface.
    pub position: Vec3,
    /// Unit geometric normal on the side that was met.
    pub normal: Vec3,
    /// Unit.
    pub wi: Vec3,
    /// f·L/p in luminance, > 0: L without the part that MIS leaves to light samples.
    pub found: f32,
    /// Square of what it added to its pixel, over what relMSE divides the pixel by.
    pub weight: f32,
    /// p: the density with which it was drawn.
    pub pdf: f32,
    /// The BSDF's.
    pub bsdf_pdf: f32,
    /// The earlier field's; 0 without one.
    pub field_pdf: f32,
}

/// Training samples of a cell, about: the more, the more there are. A cell of fewer is not parted; but where little is found, near lights
/// are seen in other directions from everywhere, and one cell for all leads nobody.
const TRAINING_SAMPLES_PER_CELL: [usize; 2] = [24, 256];
/// Bytes of a cell while it learns: its sums, those of two nodes of the tree, and what comes of it.
pub const LEARNING_CELL_BYTES: usize = size_of::<Sums>() + 2 * (BINS + 1) * size_of::<f32>() + Field::CELL_BYTES;
/// Cells, about, before they hold more training samples than the fewest.
const FIRST_CELLS: usize = 64;
/// Training samples of a node that count as much as all that its parent knows.
const OWN: f64 = 48.0;
/// Training samples that have a say in the tree, at most.
const PLACES: usize = 1 << 15;
/// Shares among which cells choose.
pub const SHARES: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 0.875];
/// The share while a field is learned.
const LEARNING: f32 = 0.5;

/// What a field is worth, by the last training samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gain {
    /// Sum over training samples of the second moments of what paths add to their pixels, over what relMSE divides these by: without
    /// guiding.
    pub without: f64,
    /// With it.
    pub with: f64,
    /// As they were taken.
    pub taken: f64,
    /// Mean share, by training samples.
    pub share: f32,
}

impl Gain {
    /// The variance with guiding over that without it, of paths whose variance was `taken` in the same units.
    pub fn variance(&self, taken: f64) -> f32 {
        let [with, without] = [self.with, self.without].map(|moment| (taken + moment - self.taken).max(0.0));
        if without > 0.0 { (with / without) as f32 } else { 1.0 }
    }
}

/// A field of all `training_samples`, in a scene whose normals are worth `scale` metres, of at most `most_cells` cells; each cell's
/// share is found from the training samples from `fresh` on, whose [`TrainingSample::field_pdf`] is of a field that did not know them.
/// Without such the share is ½.
pub fn learn(training_samples: &[TrainingSample], fresh: usize, scale: f32, most_cells: usize) -> (Field, Gain) {
    let step = training_samples.len().div_ceil(PLACES).max(1);
    let places = training_samples.iter().step_by(step).map(|l| Tree::place(l.position, l.normal, scale)).collect();
    let of_cell =
        (training_samples.len() / FIRST_CELLS).clamp(TRAINING_SAMPLES_PER_CELL[0], TRAINING_SAMPLES_PER_CELL[1]);
    let tree = Tree::new(places, scale, of_cell.div_ceil(step), most_cells);
    let cells = sums(&tree, training_samples, fresh);
    let histograms = histograms(&tree, &cells);
    let all = cells.iter().fold(ShareSums::default(), |all, cell| all.plus(&cell.shares));
    let mut gain = Gain::default();
    let share = |cell: &Sums| {
        if fresh >= training_samples.len() {
            return LEARNING;
        }
        let best = cell.shares.best(&all);
        gain.without += cell.shares.moments[0];
        gain.with += cell.shares.moments[best];
        gain.taken += cell.shares.taken;
        gain.share += SHARES[best] * cell.shares.n / all.n.max(1.0);
        SHARES[best]
    };
    let shares = cells.iter().map(share).collect();
    (Field::new(tree, histograms, shares), gain)
}

/// What a cell's training samples sum up to.
#[derive(Debug, Clone)]
struct Sums {
    /// ∫ (f L)² dω over each bin.
    moments: [f32; BINS],
    n: f32,
    shares: ShareSums,
}

impl Default for Sums {
    fn default() -> Self {
        Self { moments: [0.0; BINS], n: 0.0, shares: ShareSums::default() }
    }
}

impl Sums {
    fn add(&mut self, training_sample: &TrainingSample, fresh: bool) {
        let moment = training_sample.found * training_sample.found * training_sample.pdf;
        if moment.is_finite() {
            self.moments[bins(V3::splat(training_sample.wi))[0] as usize] += moment;
            self.n += 1.0;
        }
        if fresh {
            self.shares.add(training_sample);
        }
    }
}

/// What the training samples of each leaf sum up to.
fn sums(tree: &Tree, training_samples: &[TrainingSample], fresh: usize) -> Vec<Sums> {
    let leaves: Vec<_> = training_samples
        .par_iter()
        .map(|training_sample| tree.leaf(training_sample.position, training_sample.normal))
        .collect();
    let mut of_leaf = vec![Vec::new(); tree.leaves()];
    for (training_sample, leaf) in (0u32..).zip(leaves) {
        of_leaf[leaf as usize].push(training_sample);
    }
    let sum = |own: Vec<u32>| {
        let mut sums = Sums::default();
        own.into_iter().for_each(|i| sums.add(&training_samples[i as usize], i as usize >= fresh));
        sums
    };
    of_leaf.into_par_iter().map(sum).collect()
}

/// Levels of the tree above those whose parts are worked at side by side.
const LEVELS: u32 = 5;

/// A histogram of each leaf: of what its own training samples say, and the less these are, of what its parents' do.
fn histograms(tree: &Tree, cells: &[Sums]) -> Vec<Histogram> {
    let areas = areas();
    let mut nodes = vec![([0.0f32; BINS], 0.0f32); tree.nodes()];
    for node in (0..nodes.len()).rev() {
        nodes[node] = match tree.below(node) {
            Err(leaf) => (cells[leaf as usize].moments, cells[leaf as usize].n),
            Ok([a, b]) => (std::array::from_fn(|bin| nodes[a].0[bin] + nodes[b].0[bin]), nodes[a].1 + nodes[b].1),
        };
    }
    let weights = |node: usize, parent: &[f64; BINS]| -> [f64; BINS] {
        let (moments, n) = &nodes[node];
        let own = best(&moments.map(f64::from), &areas);
        let (known, told): (f64, f64) = (own.iter().sum(), parent.iter().sum());
        let trust = if known > 0.0 { f64::from(*n) / (f64::from(*n) + OWN) } else { 0.0 };
        std::array::from_fn(|bin| trust * own[bin] / known.max(f64::MIN_POSITIVE) + (1.0 - trust) * parent[bin] / told)
    };
    // From the top down; what the root's parent would know is nothing: all directions alike.
    let mut parts = vec![(0, areas)];
    for _ in 0..LEVELS {
        let below = |(node, parent)| match tree.below(node) {
            Err(_) => vec![(node, parent)],
            Ok(children) => {
                let weights = weights(node, &parent);
                children.map(|child| (child, weights)).to_vec()
            }
        };
        parts = parts.into_iter().flat_map(below).collect();
    }
    let of_part = |part| {
        let (mut open, mut found) = (vec![part], Vec::new());
        while let Some((node, parent)) = open.pop() {
            let weights = weights(node, &parent);
            match tree.below(node) {
                Err(leaf) => found.push((leaf, Histogram::new(&weights))),
                Ok(children) => open.extend(children.map(|child| (child, weights))),
            }
        }
        found
    };
    let mut found: Vec<_> = parts.into_par_iter().flat_map_iter(of_part).collect();
    found.sort_unstable_by_key(|(leaf, _)| *leaf);
    found.into_iter().map(|(_, histogram)| histogram).collect()
}

/// Solid angles of the bins.
fn areas() -> [f64; BINS] {
    std::array::from_fn(|bin| {
        let middle = |i: usize| F::splat((i as f32 + 0.5) / SIDE as f32);
        let w = from_square(middle(bin / SIDE), middle(bin % SIDE));
        f64::from(steradians(w).to_array()[0]) / BINS as f64
    })
}

/// In proportion to the root of the second moment's density, by which the variance is least (Rath et al. 2020, equation 9).
fn best(moments: &[f64; BINS], areas: &[f64; BINS]) -> [f64; BINS] {
    let smooth = smoothed(moments);
    std::array::from_fn(|bin| (smooth[bin] * areas[bin]).sqrt())
}

/// Each bin's sum shared a little with those beside it: training samples are few.
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

/// Sums of which a cell's share is found.
#[derive(Debug, Clone, Copy, Default)]
struct ShareSums {
    /// Second moment at each of [`SHARES`].
    moments: [f64; SHARES.len()],
    /// Sum of squares at a share of ½, over its moment: what a heavy sample weighs.
    squares: f64,
    /// Second moment as the samples were taken.
    taken: f64,
    n: f32,
}

/// Heavy samples of all cells' kind that a cell is taken to have seen besides its own.
const PRIOR: f64 = 4.0;

impl ShareSums {
    fn add(&mut self, training_sample: &TrainingSample) {
        let p = f64::from(training_sample.pdf);
        let of = |c: f32| {
            p / f64::from(c.mul_add(training_sample.field_pdf - training_sample.bsdf_pdf, training_sample.bsdf_pdf))
        };
        for (sum, c) in self.moments.iter_mut().zip(SHARES) {
            *sum += f64::from(training_sample.weight) * of(c).min(1e6);
        }
        self.squares += (f64::from(training_sample.weight) * of(0.5)).powi(2);
        self.taken += f64::from(training_sample.weight);
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

    /// The place of the share with the least second moment, of this cell and a few samples of all.
    fn best(&self, all: &Self) -> usize {
        let heavy = if self.moments[2] > 0.0 { self.squares / self.moments[2] } else { 1.0 };
        let scale = if all.moments[2] > 0.0 { PRIOR * heavy / all.moments[2] } else { 0.0 };
        let of = |i: usize| self.moments[i] + scale * all.moments[i];
        (0..SHARES.len()).min_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap_or(0)
    }
}
