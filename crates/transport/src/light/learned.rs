//! Which lights matter from where, as a pilot's light samples found out: those that are hidden, or that BSDF samples find anyway,
//! matter little. After Vévoda, Kondapaneni and Křivánek 2018, *Bayesian online regression for adaptive direct
//! illumination sampling*: cells in space, and a cut of the light tree.
//!
//! The tree chooses cluster c with probability P(c) at a point. The second moment of what a sample brings is least for
//! probabilities in proportion to P(c) √m(c), where m(c) is the mean square of what samples bring that chose c: so importances are
//! multiplied by √m, which cells know. The tree alone keeps a part of the choices, so that no light is sampled less than half
//! as often as without, whatever a pilot has missed.

use glam::Vec3;
use rayon::prelude::*;

use super::tree::LightTree;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::cells::Tree;

/// A light sample that a pilot took.
#[derive(Debug, Clone, Copy)]
pub struct LightSampleRecord {
    /// As [`LightTree::sample`] was given it.
    pub position: Vec3,
    /// As [`LightTree::sample`] was given it.
    pub normal: Vec3,
    /// What it chose.
    pub emitter: u32,
    /// Pixel of the pilot.
    pub pixel: u32,
    /// Luminance that it added to its path, weighed by MIS, over the root of what relMSE divides its pixel by; 0 if it was hidden.
    pub found: f32,
}

/// Part of choices that the tree alone makes.
const BY_TREE: f32 = 0.5;
/// Nodes of the light tree that cells know, at most.
const NODES: usize = 127;
/// Attempts of a cell, about; one of fewer is not parted.
const RECORDS_PER_CELL: usize = 256;
/// Attempts that have a say in the cells, at most.
const PLACES: usize = 1 << 14;
/// Cells, at most.
const CELLS: usize = 2048;
/// Attempts of a cell that count as much as all that is known where it is a part.
const OWN: f32 = 16.0;
/// Least weight of a node, over the mean of the cell.
const LEAST: f32 = 0.02;
/// Larger squares are no numbers to learn from.
const LARGEST: f32 = 1e30;

/// Cells, and what each knows of the first nodes of the light tree.
#[derive(Debug)]
pub struct LearnedLights {
    cells: Tree,
    /// Nodes that cells know.
    nodes: usize,
    /// What importances are multiplied by, > 0: cell by cell, node by node, and 1 for all nodes that are not known.
    weights: Vec<f32>,
}

/// What is known of a cluster.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    /// How many light-sample records chose it, or which part of them.
    n: f32,
    /// Sum of the squares of what they found, or their mean.
    square: f32,
}

impl Known {
    fn plus(self, other: Self) -> Self {
        Self { n: self.n + other.n, square: self.square + other.square }
    }
}

impl LearnedLights {
    /// Learns from `light_sample_records` with lights of a `tree`, in a scene whose normals are worth `scale` metres. `None` where there is
    /// nothing to choose or nothing was found.
    pub fn learn(tree: &LightTree, light_sample_records: &[LightSampleRecord], scale: f32) -> Option<Self> {
        let nodes = tree.top(NODES);
        if nodes < 3 || !light_sample_records.iter().any(|light_sample_record| light_sample_record.found > 0.0) {
            return None;
        }
        let place = |light_sample_record: &LightSampleRecord| {
            Tree::place(light_sample_record.position, light_sample_record.normal, scale)
        };
        let step = light_sample_records.len().div_ceil(PLACES);
        let places = light_sample_records.iter().step_by(step).map(place).collect();
        let cells = Tree::new(places, scale, RECORDS_PER_CELL.div_ceil(step), CELLS);
        let known = sums(tree, &cells, nodes, light_sample_records);
        let mut weights = vec![1.0; cells.leaves() * (nodes + 1)];
        // From the whole to its parts; what the whole would be a part of knows nothing but a mean.
        let all = known[..nodes].iter().copied().fold(Known::default(), Known::plus);
        let mean = Known { n: 1.0 / nodes as f32, square: all.square / all.n };
        let mut open = vec![(0, vec![mean; nodes])];
        while let Some((cell, above)) = open.pop() {
            let own = &known[cell * nodes..][..nodes];
            let n: f32 = own.iter().map(|known| known.n).sum();
            let better = |(own, above): (&Known, &Known)| Known {
                n: (own.n + OWN * above.n) / (n + OWN),
                square: (own.square + OWN * above.square) / (own.n + OWN),
            };
            let here: Vec<_> = own.iter().zip(&above).map(better).collect();
            match cells.below(cell) {
                Err(leaf) => weigh(tree, &here, &mut weights[leaf as usize * (nodes + 1)..][..nodes]),
                Ok(parts) => open.extend(parts.map(|part| (part, here.clone()))),
            }
        }
        Some(Self { cells, nodes, weights })
    }

    /// How many cells.
    pub fn cells(&self) -> usize {
        self.cells.leaves()
    }

    /// Bytes of memory while it learns from so many light-sample records, at most, these included.
    pub fn bytes_to_learn(light_sample_records: u64) -> u64 {
        let cells = (2 * light_sample_records).div_ceil(RECORDS_PER_CELL as u64).clamp(1, CELLS as u64);
        let a_node = 3 * size_of::<Known>() + size_of::<f32>();
        light_sample_records * 3 * size_of::<LightSampleRecord>() as u64 + cells * (NODES * a_node) as u64
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        self.cells.bytes() + size_of_val(&*self.weights)
    }

    /// What is known at eight points with normals, as [`LightTree::sample`] is given them.
    #[inline]
    pub fn from(&self, p: V3, n: V3) -> Walk<'_> {
        Walk { lights: self, cells: self.cells.leaves_of(p, n), by_tree: F::splat(BY_TREE) }
    }
}

/// The way of eight points down the light tree.
#[derive(Debug, Clone, Copy)]
pub struct Walk<'a> {
    lights: &'a LearnedLights,
    cells: [u32; LANES],
    /// Of the choices that lead here, the part that the tree alone makes.
    by_tree: F,
}

impl Walk<'_> {
    /// What the importances of nodes are multiplied by; 1 of those that nobody knows.
    #[inline(always)]
    pub fn weights(&self, nodes: [u32; LANES]) -> F {
        let LearnedLights { nodes: known, weights, .. } = self.lights;
        let row = known + 1;
        F::from(eight(|lane| weights[self.cells[lane] as usize * row + (nodes[lane] as usize).min(*known)]))
    }

    /// Does a cell know some of these nodes?
    #[inline(always)]
    pub fn knows(&self, nodes: [u32; LANES]) -> bool {
        nodes.iter().any(|&node| (node as usize) < self.lights.nodes)
    }

    /// The share of the left of two nodes of importance `a` and `b`, of which the tree alone gives it `of_tree`.
    #[inline(always)]
    pub fn share(&self, left: [u32; LANES], right: [u32; LANES], [a, b]: [F; 2], of_tree: F) -> F {
        let (a, b) = (a * self.weights(left), b * self.weights(right));
        let led = a / (a + b);
        self.by_tree.mul_add(of_tree - led, led)
    }

    /// Goes on to nodes that the tree alone chooses with probability `of_tree`, and the mixture with `chance`.
    #[inline(always)]
    pub fn went(&mut self, of_tree: F, chance: F) {
        self.by_tree = self.by_tree * of_tree / chance;
    }
}

/// The probability of a light that the tree alone chooses with probability `by_tree`, and learned weights with `led`.
pub fn mixed(by_tree: f32, led: f32) -> f32 {
    BY_TREE.mul_add(by_tree - led, led)
}

/// What light-sample records say of each known node that has no known one below, for every cell and what cells are parts of.
fn sums(tree: &LightTree, cells: &Tree, nodes: usize, light_sample_records: &[LightSampleRecord]) -> Vec<Known> {
    let of_attempt = |light_sample_record: &LightSampleRecord| {
        let cell = cells.leaf(light_sample_record.position, light_sample_record.normal) as usize;
        Some((
            cell * nodes + tree.above(light_sample_record.emitter, nodes)?,
            light_sample_record.found * light_sample_record.found,
        ))
    };
    let places: Vec<_> = light_sample_records.par_iter().map(of_attempt).collect();
    let mut of_leaf = vec![Known::default(); cells.leaves() * nodes];
    for (place, square) in places.into_iter().flatten().filter(|(_, square)| *square < LARGEST) {
        of_leaf[place] = of_leaf[place].plus(Known { n: 1.0, square });
    }
    let mut known = vec![Known::default(); cells.nodes() * nodes];
    for cell in (0..cells.nodes()).rev() {
        for node in 0..nodes {
            known[cell * nodes + node] = match cells.below(cell) {
                Err(leaf) => of_leaf[leaf as usize * nodes + node],
                Ok(parts) => {
                    parts.map(|part| known[part * nodes + node]).into_iter().fold(Known::default(), Known::plus)
                }
            };
        }
    }
    known
}

/// Weights of nodes, from what is known of those that have no known one below: the root of the mean square there, and of others the
/// mean over what is below by how often it is chosen, which is what an optimal choice leaves of it; all over the cell's mean.
fn weigh(tree: &LightTree, known: &[Known], weights: &mut [f32]) {
    let mut inner = vec![false; known.len()];
    (1..known.len()).for_each(|node| inner[tree.parent(node)] = true);
    let root = |known: &Known| known.square.sqrt();
    let leaves = || known.iter().zip(&inner).filter(|(_, inner)| !**inner).map(|(known, _)| known);
    let mean = leaves().map(|known| known.n * root(known)).sum::<f32>() / leaves().map(|known| known.n).sum::<f32>();
    // Where nothing was found all are alike.
    let over_mean = |known| if mean > 0.0 { (root(known) / mean).max(LEAST) } else { 1.0 };
    let mut sums = vec![[0.0; 2]; known.len()];
    for node in (0..known.len()).rev() {
        if !inner[node] {
            sums[node] = [known[node].n, known[node].n * over_mean(&known[node])];
        }
        weights[node] = sums[node][1] / sums[node][0];
        if node > 0 {
            let [n, sum] = sums[node];
            let above = &mut sums[tree.parent(node)];
            *above = [above[0] + n, above[1] + sum];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::tree::Emitter;
    use crate::sampling::SplitMix64;

    /// Lamps in a row above the floor, all alike.
    fn lamps(n: u32) -> LightTree {
        let lamp = |i: u32| {
            let low = Vec3::new(i as f32, 2.0, 0.0);
            Emitter { low, high: low + 0.1, normal: Vec3::NEG_Y, spread: 0.0, power: 1.0, two_sided: false }
        };
        LightTree::new(&(0..n).map(lamp).collect::<Vec<_>>()).unwrap()
    }

    /// Attempts all over a floor, one lamp as often as the other, which find what `found` says of a place and a lamp.
    fn light_sample_records(lamps: u32, found: impl Fn(Vec3, u32) -> f32) -> Vec<LightSampleRecord> {
        let mut random = SplitMix64(3);
        let one = |i: u32| {
            let position = Vec3::new(random.f32(), 0.0, random.f32());
            let emitter = i % lamps;
            LightSampleRecord { position, normal: Vec3::Y, emitter, pixel: 0, found: found(position, emitter) }
        };
        (0..20_000).map(one).collect()
    }

    #[test]
    fn choices_follow_the_root_of_mean_squares_and_the_tree_keeps_half() {
        let tree = lamps(2);
        // One lamp is hidden from the left half; from the right it brings three times what the other does.
        let found = |p: Vec3, lamp| {
            if lamp == 1 {
                1.0
            } else if p.x < 0.5 {
                0.0
            } else {
                3.0
            }
        };
        let lights = LearnedLights::learn(&tree, &light_sample_records(2, found), 1.0).unwrap();
        assert!(lights.cells() > 20 && lights.bytes() > lights.cells() * 3 * size_of::<f32>());
        for (x, ratio) in [(0.2, 0.0), (0.8, 3.0)] {
            let [[by_tree, mixed], [_, other]] =
                [0, 1].map(|lamp| tree.pmfs(Vec3::new(x, 0.0, 0.5), Vec3::Y, lamp, Some(&lights)));
            let led = by_tree * ratio / (by_tree * ratio + 1.0 - by_tree);
            // What is known where a cell is a part has some say.
            assert!((mixed - 0.5 * (by_tree + led)).abs() < 0.1, "{x}: {mixed}, {by_tree} {led}");
            assert!((mixed + other - 1.0).abs() < 1e-5, "{mixed} {other}");
        }
    }

    #[test]
    fn what_is_not_to_be_learned_from_harms_nothing() {
        let tree = lamps(300);
        assert_eq!(tree.top(NODES), NODES);
        assert!(LearnedLights::learn(&tree, &[], 1.0).is_none());
        assert!(LearnedLights::learn(&tree, &light_sample_records(300, |_, _| 0.0), 1.0).is_none());
        assert!(LearnedLights::learn(&lamps(1), &light_sample_records(1, |_, _| 1.0), 1.0).is_none());
        let odd = [f32::INFINITY, f32::NAN, 1e30, f32::MAX, 1e-30, f32::from_bits(1)];
        for odd in odd {
            let Some(lights) =
                LearnedLights::learn(&tree, &light_sample_records(300, |_, i| if i == 7 { odd } else { 0.0 }), 1.0)
            else {
                assert!(odd.is_nan());
                continue;
            };
            assert!(lights.weights.iter().all(|weight| *weight > 0.0 && weight.is_finite()), "{odd}");
            let all: f32 = (0..300).map(|i| tree.pmfs(Vec3::ZERO, Vec3::Y, i, Some(&lights))[1]).sum();
            assert!((all - 1.0).abs() < 1e-4, "{odd}: {all}");
        }
    }
}
