//! Learned light selection: which area lights matter in which part of the scene. [`learn`](super::learn) makes it from the light
//! samples of a pre-pass. After Vévoda, Kondapaneni and Křivánek 2018, *Bayesian online regression for adaptive direct
//! illumination sampling*: cells in space, and a cut of the light tree.
//!
//! At a point the light tree chooses cluster c with probability P(c). The second moment of the contributions is least for
//! probabilities in proportion to P(c) √m(c), where m(c) is the mean squared contribution of the samples that chose c. So the
//! importances of clusters are multiplied by √m, which cells store. A fixed fraction of the choices follows the tree alone, so
//! that no light is sampled less than half as often as without learning, whatever the pre-pass has missed.

use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::cells::CellTree;

/// Fraction of choices that follow the light tree alone.
const TREE_FRACTION: f32 = 0.5;

/// Weights of the first nodes of the light tree, for each cell.
#[derive(Debug)]
pub struct LearnedLights {
    pub(super) cells: CellTree,
    /// Number of the tree's nodes that have weights.
    pub(super) nodes: usize,
    /// Factors > 0 of importances: `nodes` per cell, and a 1 for all other nodes.
    pub(super) weights: Vec<f32>,
}

impl LearnedLights {
    pub fn cells(&self) -> usize {
        self.cells.leaves()
    }

    pub fn bytes(&self) -> usize {
        self.cells.bytes() + size_of_val(&*self.weights)
    }

    /// Begins a descent of the light tree at eight points `p` with normals `n` as for
    /// [`LightTree::sample`](super::tree::LightTree::sample).
    #[inline]
    pub fn from(&self, p: V3, n: V3) -> Descent<'_> {
        Descent { lights: self, cells: self.cells.leaves_of(p, n), tree_fraction: F::splat(TREE_FRACTION) }
    }
}

/// The descent of the light tree at eight points.
#[derive(Debug, Clone, Copy)]
pub struct Descent<'a> {
    lights: &'a LearnedLights,
    cells: [u32; LANES],
    /// The fraction, among the choices that lead to the current nodes, that follow the tree alone.
    tree_fraction: F,
}

impl Descent<'_> {
    /// Factors of the importances of nodes; 1 for nodes without learned weight.
    #[inline(always)]
    pub fn weights(&self, nodes: [u32; LANES]) -> F {
        let LearnedLights { nodes: known, weights, .. } = self.lights;
        let row = known + 1;
        F::from(eight(|lane| weights[self.cells[lane] as usize * row + (nodes[lane] as usize).min(*known)]))
    }

    /// Whether any of these nodes has a learned weight.
    #[inline(always)]
    pub(crate) fn has_weights(&self, nodes: [u32; LANES]) -> bool {
        nodes.iter().any(|&node| (node as usize) < self.lights.nodes)
    }

    /// The probability of the left of two nodes with importances `a` and `b`, which the tree alone chooses with
    /// `tree_probability`.
    #[inline(always)]
    pub(crate) fn left_probability(
        &self,
        left: [u32; LANES],
        right: [u32; LANES],
        [a, b]: [F; 2],
        tree_probability: F,
    ) -> F {
        let (a, b) = (a * self.weights(left), b * self.weights(right));
        let learned = a / (a + b);
        self.tree_fraction.mul_add(tree_probability - learned, learned)
    }

    /// Descends to nodes that the tree alone chooses with `tree_probability`, and the mixture with `probability`.
    #[inline(always)]
    pub fn descend(&mut self, tree_probability: F, probability: F) {
        self.tree_fraction = self.tree_fraction * tree_probability / probability;
    }
}

/// The probability of a light that the tree alone chooses with probability `by_tree`, and the learned weights with `learned`.
pub fn mixture(by_tree: f32, learned: f32) -> f32 {
    TREE_FRACTION.mul_add(by_tree - learned, learned)
}
