//! Learns light selection from the light samples of a pre-pass: cells in space, and statistics of clusters of lights in them.

use glam::Vec3;
use rayon::prelude::*;

use super::learned::LearnedLights;
use super::tree::LightTree;
use crate::sampling::cells::CellTree;

/// A light sample that a pre-pass took toward an area light.
#[derive(Debug, Clone, Copy)]
pub struct LightSampleRecord {
    /// The point that [`LightTree::sample`] was given.
    pub position: Vec3,
    /// The normal that [`LightTree::sample`] was given.
    pub normal: Vec3,
    /// The area light that was chosen.
    pub emitter: u32,
    /// Index of the pixel in the pre-pass.
    pub pixel: u32,
    /// Luminance that the sample added to its path, weighted by MIS, over the root of its pixel's divisor of relMSE; 0 if the
    /// light was occluded.
    pub contribution: f32,
}

/// Largest number of nodes of the light tree that have weights.
const MAX_NODES: usize = 127;
/// Approximate number of records per cell. A cell with fewer is not split.
const RECORDS_PER_CELL: usize = 256;
/// Largest number of records from which the cells are built.
const MAX_CELL_RECORDS: usize = 1 << 14;
/// Records whose cells are in memory at once.
const RECORDS_AT_ONCE: usize = 1 << 14;
/// Largest number of cells.
const MAX_CELLS: usize = 2048;
/// Number of records by which a cell's parent is weighted in the cell.
const PRIOR_RECORDS: f32 = 16.0;
/// Minimum weight of a node, relative to the mean of the cell.
const MIN_WEIGHT: f32 = 0.02;
/// Records with a larger squared contribution are ignored.
const MAX_SQUARE: f32 = 1e30;

/// Statistics of a cluster of lights.
#[derive(Debug, Clone, Copy, Default)]
struct ClusterStats {
    /// Number of records that chose the cluster, or their fraction.
    n: f32,
    /// Sum of their squared contributions, or the mean.
    square: f32,
}

impl ClusterStats {
    fn plus(self, other: Self) -> Self {
        Self { n: self.n + other.n, square: self.square + other.square }
    }
}

impl LearnedLights {
    /// Learns from records of the lights of a `tree`. `scale` (metres) weights differences of normals against distances.
    /// `None` if there is nothing to choose or no record has a contribution.
    pub fn learn<'a>(
        tree: &LightTree,
        records: impl IntoIterator<Item = &'a LightSampleRecord>,
        scale: f32,
    ) -> Option<Self> {
        let nodes = tree.top(MAX_NODES);
        let records: Vec<_> = records.into_iter().collect();
        if nodes < 3 || !records.iter().any(|record| record.contribution > 0.0) {
            return None;
        }
        let mut weights = Vec::new();
        let cells = posteriors((tree, nodes), &records, scale, |cells, leaf, stats| {
            weights.resize(cells.leaves() * (nodes + 1), 1.0);
            set_weights(tree, stats, &mut weights[leaf * (nodes + 1)..][..nodes]);
        });
        Some(Self { cells, nodes, weights })
    }
}

/// Builds cells from records, and gives the statistics of the tree's first `nodes` in each cell to `leaf`, blended with those of
/// the cells around.
fn posteriors(
    (tree, nodes): (&LightTree, usize),
    records: &[&LightSampleRecord],
    scale: f32,
    mut leaf: impl FnMut(&CellTree, usize, &[ClusterStats]),
) -> CellTree {
    let step = records.len().div_ceil(MAX_CELL_RECORDS);
    let keys = records.iter().step_by(step).map(|r| CellTree::key(r.position, r.normal, scale)).collect();
    let cells = CellTree::new(keys, scale, RECORDS_PER_CELL.div_ceil(step), MAX_CELLS);
    let stats = sums((tree, nodes), &cells, records);
    // From the root of the cells down. The prior of the root is the same mean for all nodes.
    let all = stats[..nodes].iter().copied().fold(ClusterStats::default(), ClusterStats::plus);
    let mean = ClusterStats { n: 1.0 / nodes as f32, square: all.square / all.n };
    let mut open = vec![(0, vec![mean; nodes])];
    while let Some((cell, parent)) = open.pop() {
        let own = &stats[cell * nodes..][..nodes];
        let n: f32 = own.iter().map(|stats| stats.n).sum();
        let posterior = |(own, parent): (&ClusterStats, &ClusterStats)| ClusterStats {
            n: (own.n + PRIOR_RECORDS * parent.n) / (n + PRIOR_RECORDS),
            square: (own.square + PRIOR_RECORDS * parent.square) / (own.n + PRIOR_RECORDS),
        };
        let stats: Vec<_> = own.iter().zip(&parent).map(posterior).collect();
        match cells.children(cell) {
            Err(index) => leaf(&cells, index as usize, &stats),
            Ok(children) => open.extend(children.map(|child| (child, stats.clone()))),
        }
    }
    cells
}

/// Sums over the records of each known node without known children, for every cell and its parents.
fn sums((tree, nodes): (&LightTree, usize), cells: &CellTree, records: &[&LightSampleRecord]) -> Vec<ClusterStats> {
    let entry = |record: &&LightSampleRecord| {
        let cell = cells.leaf(record.position, record.normal) as usize;
        Some((cell * nodes + tree.above(record.emitter, nodes)?, record.contribution * record.contribution))
    };
    let mut of_leaf = vec![ClusterStats::default(); cells.leaves() * nodes];
    for records in records.chunks(RECORDS_AT_ONCE) {
        let entries: Vec<_> = records.par_iter().map(entry).collect();
        for (index, square) in entries.into_iter().flatten().filter(|(_, square)| *square < MAX_SQUARE) {
            of_leaf[index] = of_leaf[index].plus(ClusterStats { n: 1.0, square });
        }
    }
    let mut stats = vec![ClusterStats::default(); cells.nodes() * nodes];
    for cell in (0..cells.nodes()).rev() {
        for node in 0..nodes {
            stats[cell * nodes + node] = match cells.children(cell) {
                Err(leaf) => of_leaf[leaf as usize * nodes + node],
                Ok(children) => children
                    .map(|child| stats[child * nodes + node])
                    .into_iter()
                    .fold(ClusterStats::default(), ClusterStats::plus),
            };
        }
    }
    stats
}

/// Sets the weights of nodes. A node without known children has the root of its mean square; another node the mean over the
/// nodes below it by how often each is chosen, which is what an optimal choice below it leaves. All are relative to the mean of
/// the cell.
fn set_weights(tree: &LightTree, stats: &[ClusterStats], weights: &mut [f32]) {
    let mut inner = vec![false; stats.len()];
    (1..stats.len()).for_each(|node| inner[tree.parent(node)] = true);
    let root = |stats: &ClusterStats| stats.square.sqrt();
    let leaves = || stats.iter().zip(&inner).filter(|(_, inner)| !**inner).map(|(stats, _)| stats);
    let mean = leaves().map(|stats| stats.n * root(stats)).sum::<f32>() / leaves().map(|stats| stats.n).sum::<f32>();
    // All weights are 1 where no record has a contribution.
    let over_mean = |stats| if mean > 0.0 { (root(stats) / mean).max(MIN_WEIGHT) } else { 1.0 };
    let mut sums = vec![[0.0; 2]; stats.len()];
    for node in (0..stats.len()).rev() {
        if !inner[node] {
            sums[node] = [stats[node].n, stats[node].n * over_mean(&stats[node])];
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

    /// Equal area lights in a row above the floor.
    fn row_of_lights(n: u32) -> LightTree {
        let light = |i: u32| {
            let low = Vec3::new(i as f32, 2.0, 0.0);
            Emitter { low, high: low + 0.1, normal: Vec3::NEG_Y, spread: 0.0, power: 1.0, two_sided: false }
        };
        LightTree::new(&(0..n).map(light).collect::<Vec<_>>()).unwrap()
    }

    /// Records all over a floor, one light as often as another, with the `contribution` of a position and a light.
    fn records(lights: u32, contribution: impl Fn(Vec3, u32) -> f32) -> Vec<LightSampleRecord> {
        let mut random = SplitMix64(3);
        let one = |i: u32| {
            let position = Vec3::new(random.f32(), 0.0, random.f32());
            let emitter = i % lights;
            LightSampleRecord {
                position,
                normal: Vec3::Y,
                emitter,
                pixel: 0,
                contribution: contribution(position, emitter),
            }
        };
        (0..20_000).map(one).collect()
    }

    #[test]
    fn choices_follow_the_root_of_mean_squares_and_half_follow_the_tree() {
        let tree = row_of_lights(2);
        // One light is occluded from the left half; on the right it contributes three times as much as the other.
        let contribution = |p: Vec3, light| {
            if light == 1 {
                1.0
            } else if p.x < 0.5 {
                0.0
            } else {
                3.0
            }
        };
        let lights = LearnedLights::learn(&tree, &records(2, contribution), 1.0).unwrap();
        assert!(lights.cells() > 20 && lights.bytes() > lights.cells() * 3 * size_of::<f32>());
        for (x, ratio) in [(0.2, 0.0), (0.8, 3.0)] {
            let [[by_tree, mixed], [_, other]] =
                [0, 1].map(|light| tree.pmfs(Vec3::new(x, 0.0, 0.5), Vec3::Y, light, Some(&lights)));
            let learned = by_tree * ratio / (by_tree * ratio + 1.0 - by_tree);
            // The parents of a cell have some weight.
            assert!((mixed - 0.5 * (by_tree + learned)).abs() < 0.1, "{x}: {mixed}, {by_tree} {learned}");
            assert!((mixed + other - 1.0).abs() < 1e-5, "{mixed} {other}");
        }
    }

    #[test]
    fn what_is_not_to_be_learned_from_harms_nothing() {
        let tree = row_of_lights(300);
        assert_eq!(tree.top(MAX_NODES), MAX_NODES);
        assert!(LearnedLights::learn(&tree, &[], 1.0).is_none());
        assert!(LearnedLights::learn(&tree, &records(300, |_, _| 0.0), 1.0).is_none());
        assert!(LearnedLights::learn(&row_of_lights(1), &records(1, |_, _| 1.0), 1.0).is_none());
        let odd = [f32::INFINITY, f32::NAN, 1e30, f32::MAX, 1e-30, f32::from_bits(1)];
        for odd in odd {
            let Some(lights) = LearnedLights::learn(&tree, &records(300, |_, i| if i == 7 { odd } else { 0.0 }), 1.0)
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
