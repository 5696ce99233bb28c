//! How often vertices take a light sample and paths go on: by what it is worth (Rath et al. 2022, *EARS: Efficiency-Aware
//! Russian Roulette and Splitting*; without splitting).
//!
//! A sample that is taken with chance q has 1/q of its second moment, and q of its cost. Relative variance times cost of the
//! whole path is least where q² = β² m/d · C/(V c): β the throughput, m the second moment of what the sample finds for
//! a throughput of one, c its cost, d what relMSE divides by, V and C the path's relative variance and cost. Cells
//! know m; a floor keeps what a pilot did not find.

use glam::Vec3;

use crate::lanes::{F, LANES, eight};
use crate::sampling::cells::Tree;

/// What the samples of a vertex beyond the first found.
#[derive(Debug, Clone, Copy)]
pub struct VertexRecord {
    /// Of the surface.
    pub position: Vec3,
    /// Unit geometric normal on the side that was met.
    pub normal: Vec3,
    /// Squares of the luminance that the light sample and all that came of the BSDF sample found, over the throughput's, had
    /// they been taken for sure.
    pub found: [f32; 2],
}

/// Means over a pilot's paths.
#[derive(Debug, Clone, Copy)]
pub struct Paths {
    /// Rays of a path.
    pub cost: f64,
    /// A path's variance, over what relMSE divides its pixel by.
    pub variance: f64,
    /// One over what relMSE divides pixels by.
    pub inverse: f64,
}

/// Least chances of a light sample, and of going on.
const LEAST: [f32; 2] = [0.125, 0.4];
/// What a light sample costs, in rays.
const LIGHT_COST: f64 = 1.2;
/// What going on costs, of all a path's rays.
const REST: f64 = 0.5;
/// Visits of a cell that count as much as the mean of all cells.
const COMMON: f64 = 8.0;
/// Largest root of q²/β²: far above all that β can do about it.
const MOST: f64 = 1e18;

/// The chances at the cells of a field.
#[derive(Debug, Clone)]
pub struct Roulette {
    /// Over the throughput's luminance.
    chances: Vec<[f32; 2]>,
}

impl Roulette {
    /// Bytes of a cell.
    pub const CELL_BYTES: usize = size_of::<[f32; 2]>();

    /// From what a pilot's vertices found in the leaves of a tree.
    pub(super) fn learn(tree: &Tree, vertex_records: &[VertexRecord], paths: Paths) -> Self {
        let mut cells = vec![[0.0; 3]; tree.leaves()];
        let mut all = [0.0; 3];
        for vertex_record in vertex_records {
            let of = [1.0, vertex_record.found[0], vertex_record.found[1]].map(f64::from);
            for sums in [&mut cells[tree.leaf(vertex_record.position, vertex_record.normal) as usize], &mut all] {
                (0..3).for_each(|i| sums[i] += of[i]);
            }
        }
        let costs = [LIGHT_COST, REST * paths.cost];
        let chances = |[n, light, on]: [f64; 3]| {
            std::array::from_fn(|i| {
                let mean = all[i + 1] / all[0].max(1.0);
                let moment = ([light, on][i] + COMMON * mean) / (n + COMMON);
                let root = (moment * paths.inverse * paths.cost / (paths.variance * costs[i])).sqrt();
                // Where nothing varies nothing is left out.
                if root < MOST { root as f32 } else { MOST as f32 }
            })
        };
        Self { chances: cells.into_iter().map(chances).collect() }
    }

    /// Chances in (0, 1] of a light sample and of going on, in cells, for luminances of throughputs.
    #[inline(always)]
    pub fn chances(&self, cells: [u32; LANES], beta: F) -> [F; 2] {
        [0, 1].map(|i| {
            let chance = F::from(eight(|lane| self.chances[cells[lane] as usize][i]));
            (chance * beta).fast_max(F::splat(LEAST[i])).fast_min(F::ONE)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(found: [f32; 2], n: usize, x: f32) -> Vec<VertexRecord> {
        vec![VertexRecord { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y, found }; n]
    }

    #[test]
    fn chances_follow_what_was_found_and_never_end() {
        let places = (0..400).map(|i| Tree::place(Vec3::new((i % 2) as f32, 0.0, 0.0), Vec3::Y, 1.0)).collect();
        let tree = Tree::new(places, 1.0, 200, 100);
        let cells = [0.0, 1.0].map(|x| tree.leaf(Vec3::new(x, 0.0, 0.0), Vec3::Y));
        assert_ne!(cells[0], cells[1]);
        let vertex_records = [at([0.04, 1.0], 4000, 0.0), at([0.0, 0.0], 4000, 1.0)].concat();
        let paths = Paths { cost: 6.0, variance: 4.0, inverse: 2.0 };
        let roulette = Roulette::learn(&tree, &vertex_records, paths);
        let chances = |cell, beta: f32| roulette.chances([cell; LANES], F::splat(beta)).map(|c| c.as_array()[0]);
        let [light, on] = chances(cells[0], 0.5);
        // √(0.04 · 2 · 6 / (4 · 1.2)) / 2 and √(2 · 6 / (4 · 3)) / 2, but for the mean of all.
        assert!((light - 0.158).abs() < 2e-3 && (on - 0.5).abs() < 2e-3, "{light} {on}");
        assert_eq!(chances(cells[1], 0.5), LEAST);
        assert_eq!(chances(cells[0], 1e30), [1.0, 1.0]);
        for odd in [f64::NAN, 0.0, f64::INFINITY] {
            let roulette = Roulette::learn(&tree, &vertex_records, Paths { variance: odd, ..paths });
            for beta in [0.0, 1e-30, 1.0, f32::MAX] {
                let all = roulette.chances(cells.repeat(4).try_into().unwrap(), F::splat(beta));
                assert!(all.iter().flat_map(|c| c.to_array()).all(|c| c > 0.0 && c <= 1.0), "{odd} {beta}: {all:?}");
            }
        }
    }
}
