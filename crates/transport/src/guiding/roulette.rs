//! Probabilities of light samples and of path continuation at vertices, by estimated efficiency (Rath et al. 2022, *EARS:
//! Efficiency-Aware Russian Roulette and Splitting*; without splitting).
//!
//! A sample that is taken with probability q has 1/q of its second moment and q of its cost. The relative variance times cost
//! of the path is least for q² = β² m/d · C/(V c): β is the throughput, m the second moment of the sample's contribution for
//! a throughput of one, c its cost, d the divisor of relMSE, V and C the relative variance and the cost of the path. Cells
//! know m; minimum probabilities account for contributions that a pre-pass did not find.

use glam::Vec3;

use crate::lanes::{F, LANES, eight};
use crate::sampling::cells::CellTree;

/// The contributions of the samples at a vertex beyond the first.
#[derive(Debug, Clone, Copy)]
pub struct VertexRecord {
    /// Position of the surface in world space.
    pub position: Vec3,
    /// Unit geometric normal on the side of the incident ray.
    pub normal: Vec3,
    /// Squared luminances that the light sample and the continued path contribute, divided by the luminance of the
    /// throughput, as if both were taken with probability one.
    pub squared_contributions: [f32; 2],
}

/// Means over the paths of a pre-pass.
#[derive(Debug, Clone, Copy)]
pub struct PathStatistics {
    pub cost: f64,
    /// Variance of a path, divided by its pixel's divisor of relMSE.
    pub variance: f64,
    /// Mean of 1/d over pixels, where d is a pixel's divisor of relMSE.
    pub inverse: f64,
}

/// Minimum probabilities of a light sample and of path continuation.
const MIN_PROBABILITIES: [f32; 2] = [0.125, 0.4];
/// Cost of a light sample in rays.
const LIGHT_SAMPLE_RAYS: f64 = 1.2;
/// Cost of path continuation as a fraction of all rays of a path.
const CONTINUATION_FRACTION: f64 = 0.5;
/// Number of vertex records by which the mean over all cells is weighted in each cell.
const PRIOR_RECORDS: f64 = 8.0;
/// Largest q/β, far above any 1/β.
const MAX_RATIO: f64 = 1e18;

/// The probabilities in the cells of a field.
#[derive(Debug, Clone)]
pub struct Roulette {
    /// q/β of light samples and of path continuation, where β is the luminance of the throughput.
    ratios: Vec<[f32; 2]>,
}

impl Roulette {
    /// Memory of a cell in bytes.
    pub(crate) const CELL_BYTES: usize = size_of::<[f32; 2]>();

    /// Learns from the vertex records of a pre-pass in the leaves of a tree.
    pub(super) fn learn<'a>(
        tree: &CellTree,
        vertex_records: impl IntoIterator<Item = &'a VertexRecord>,
        paths: PathStatistics,
    ) -> Self {
        let mut cells = vec![[0.0; 3]; tree.leaves()];
        let mut all = [0.0; 3];
        for record in vertex_records {
            let [light, rest] = record.squared_contributions;
            let terms = [1.0, light, rest].map(f64::from);
            for sums in [&mut cells[tree.leaf(record.position, record.normal) as usize], &mut all] {
                (0..3).for_each(|i| sums[i] += terms[i]);
            }
        }
        let costs = [LIGHT_SAMPLE_RAYS, CONTINUATION_FRACTION * paths.cost];
        let ratios = |[n, light, rest]: [f64; 3]| {
            std::array::from_fn(|i| {
                let mean = all[i + 1] / all[0].max(1.0);
                let moment = ([light, rest][i] + PRIOR_RECORDS * mean) / (n + PRIOR_RECORDS);
                let ratio = (moment * paths.inverse * paths.cost / (paths.variance * costs[i])).sqrt();
                // NaN, too, becomes the largest: without variance every sample is taken.
                if ratio < MAX_RATIO { ratio as f32 } else { MAX_RATIO as f32 }
            })
        };
        Self { ratios: cells.into_iter().map(ratios).collect() }
    }

    /// Probabilities in (0, 1] of a light sample and of path continuation in eight cells, for the luminances `beta` of the
    /// throughputs.
    #[inline(always)]
    pub fn probabilities(&self, cells: [u32; LANES], beta: F) -> [F; 2] {
        [0, 1].map(|i| {
            let ratio = F::from(eight(|lane| self.ratios[cells[lane] as usize][i]));
            (ratio * beta).fast_max(F::splat(MIN_PROBABILITIES[i])).fast_min(F::ONE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(squared_contributions: [f32; 2], n: usize, x: f32) -> Vec<VertexRecord> {
        vec![VertexRecord { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y, squared_contributions }; n]
    }

    #[test]
    fn probabilities_follow_contributions_and_are_never_zero() {
        let keys = (0..400).map(|i| CellTree::key(Vec3::new((i % 2) as f32, 0.0, 0.0), Vec3::Y, 1.0)).collect();
        let tree = CellTree::new(keys, 1.0, 200, 100);
        let cells = [0.0, 1.0].map(|x| tree.leaf(Vec3::new(x, 0.0, 0.0), Vec3::Y));
        assert_ne!(cells[0], cells[1]);
        let vertex_records = [at([0.04, 1.0], 4000, 0.0), at([0.0, 0.0], 4000, 1.0)].concat();
        let paths = PathStatistics { cost: 6.0, variance: 4.0, inverse: 2.0 };
        let roulette = Roulette::learn(&tree, &vertex_records, paths);
        let probabilities =
            |cell, beta: f32| roulette.probabilities([cell; LANES], F::splat(beta)).map(|c| c.as_array()[0]);
        let [light, rest] = probabilities(cells[0], 0.5);
        // √(0.04 · 2 · 6 / (4 · 1.2)) / 2 and √(2 · 6 / (4 · 3)) / 2, but for the mean of all.
        assert!((light - 0.158).abs() < 2e-3 && (rest - 0.5).abs() < 2e-3, "{light} {rest}");
        assert_eq!(probabilities(cells[1], 0.5), MIN_PROBABILITIES);
        assert_eq!(probabilities(cells[0], 1e30), [1.0, 1.0]);
        for odd in [f64::NAN, 0.0, f64::INFINITY] {
            let roulette = Roulette::learn(&tree, &vertex_records, PathStatistics { variance: odd, ..paths });
            for beta in [0.0, 1e-30, 1.0, f32::MAX] {
                let all = roulette.probabilities(cells.repeat(4).try_into().unwrap(), F::splat(beta));
                assert!(all.iter().flat_map(|c| c.to_array()).all(|c| c > 0.0 && c <= 1.0), "{odd} {beta}: {all:?}");
            }
        }
    }
}
