//! The field: cells in space, in each a histogram of directions and the share of samples that follow it.

use super::directions::{Histogram, bins, from_square};
use super::roulette::{Paths, Roulette, VertexRecord};
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::cells::Tree;

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
    pub fn learn_roulette(&mut self, vertex_records: &[VertexRecord], paths: Paths) {
        self.roulette = Some(Roulette::learn(&self.tree, vertex_records, paths));
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

    /// Densities on the unit square with which cells draw unit directions, in lanes of a mask; 0 in others and of
    /// [`NOWHERE`].
    #[inline(always)]
    pub fn density(&self, cells: [u32; LANES], asked: F, w: V3) -> F {
        let bins = bins(w);
        let mut density = [0.0; LANES];
        for lane in lanes(asked) {
            if let Some(histogram) = self.histograms.get(cells[lane] as usize) {
                density[lane] = histogram.density(bins[lane]);
            }
        }
        F::from(density)
    }

    /// Unit directions drawn by cells from two numbers in [0, 1), in lanes of a mask, and with which density on the unit square;
    /// any direction and 0 in others and of [`NOWHERE`].
    #[inline(always)]
    pub fn draw(&self, cells: [u32; LANES], asked: F, u: F, v: F) -> (V3, F) {
        let (u, v) = (u.as_array(), v.as_array());
        let (mut x, mut y, mut density) = ([0.5; LANES], [0.5; LANES], [0.0; LANES]);
        for lane in lanes(asked) {
            if let Some(histogram) = self.histograms.get(cells[lane] as usize) {
                (x[lane], y[lane], density[lane]) = histogram.draw(u[lane], v[lane]);
            }
        }
        (from_square(F::from(x), F::from(y)), F::from(density))
    }
}

/// The lanes of a mask.
#[inline(always)]
fn lanes(mask: F) -> impl Iterator<Item = usize> {
    let mut bits = mask.to_bitmask();
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}
