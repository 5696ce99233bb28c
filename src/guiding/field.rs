//! The field: cells in space, in each a histogram of directions and the share of samples that follow it.

use super::directions::{Histogram, bins, from_square, steradians};
use super::roulette::{Paths, Roulette, Visit};
use super::tree::Tree;
use crate::lanes::{F, LANES, V3, eight};

/// The cell of a vertex where nothing guides.
pub const NOWHERE: u32 = u32::MAX;

/// Where light comes from.
#[derive(Debug, Clone)]
pub struct Field {
    tree: Tree,
    histograms: Vec<Histogram>,
    /// Share c of samples that are drawn from the histogram, in [0, 1).
    shares: Vec<f32>,
    /// How often light samples are taken and paths go on, once it is learned.
    roulette: Option<Roulette>,
}

impl Field {
    /// A histogram and a share for each leaf of a tree.
    pub(super) fn new(tree: Tree, histograms: Vec<Histogram>, shares: Vec<f32>) -> Self {
        debug_assert!(tree.leaves() == histograms.len() && tree.leaves() == shares.len());
        Self { tree, histograms, shares, roulette: None }
    }

    /// How many cells.
    pub fn cells(&self) -> usize {
        self.histograms.len()
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.cells() * Self::CELL_BYTES
    }

    /// Bytes of a cell.
    pub const CELL_BYTES: usize = size_of::<Histogram>() + size_of::<f32>() + Roulette::CELL_BYTES;

    /// Learns how often light samples are to be taken and paths to go on, from what a pilot's vertices found.
    pub fn learn_roulette(&mut self, visits: &[Visit], paths: Paths) {
        self.roulette = Some(Roulette::learn(&self.tree, visits, paths));
    }

    /// Does it know how often light samples are to be taken and paths to go on?
    pub fn has_roulette(&self) -> bool {
        self.roulette.is_some()
    }

    /// The cells at eight positions with normals.
    #[inline]
    pub fn cells_at(&self, position: V3, normal: V3) -> [u32; LANES] {
        self.tree.leaves_of(position, normal)
    }

    /// Of these cells those that guide, [`NOWHERE`] where the share is 0.
    #[inline]
    pub fn guiding(&self, cells: [u32; LANES]) -> [u32; LANES] {
        cells.map(|cell| if self.shares[cell as usize] > 0.0 { cell } else { NOWHERE })
    }

    /// Chances in (0, 1] of a light sample and of going on in cells, for luminances of throughputs; `None` until they are
    /// learned.
    #[inline(always)]
    pub fn chances(&self, cells: [u32; LANES], beta: F) -> Option<[F; 2]> {
        self.roulette.as_ref().map(|roulette| roulette.chances(cells, beta))
    }

    /// The shares of cells; 0 of [`NOWHERE`].
    #[inline(always)]
    pub fn shares(&self, cells: [u32; LANES]) -> F {
        F::from(eight(|lane| self.shares.get(cells[lane] as usize).copied().unwrap_or(0.0)))
    }

    /// Densities per solid angle with which cells draw unit directions; 0 of [`NOWHERE`].
    #[inline(always)]
    pub fn pdf(&self, cells: [u32; LANES], w: V3) -> F {
        let bins = bins(w);
        let density = |lane: usize| self.histograms.get(cells[lane] as usize).map_or(0.0, |h| h.density(bins[lane]));
        F::from(eight(density)) / steradians(w)
    }

    /// Unit directions drawn by cells from two numbers in [0, 1); any direction of [`NOWHERE`].
    #[inline(always)]
    pub fn draw(&self, cells: [u32; LANES], u: F, v: F) -> V3 {
        let (u, v) = (u.to_array(), v.to_array());
        let drawn = eight(|lane| match self.histograms.get(cells[lane] as usize) {
            Some(histogram) => histogram.draw(u[lane], v[lane]),
            None => (0.5, 0.5),
        });
        from_square(F::from(eight(|lane| drawn[lane].0)), F::from(eight(|lane| drawn[lane].1)))
    }
}
