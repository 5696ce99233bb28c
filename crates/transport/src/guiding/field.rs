//! The guiding field: cells in space, each with a histogram of directions and the probability of sampling from it.

use super::directions::{Histogram, Row, bins, from_square};
use super::roulette::{PathStatistics, Roulette, VertexRecord};
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::cells::CellTree;

/// The cell index of a vertex that is not guided.
pub const NO_CELL: u32 = u32::MAX;

/// The distribution of incident light in space and direction.
#[derive(Debug, Clone)]
pub struct Field {
    tree: CellTree,
    histograms: Vec<Histogram>,
    /// The probability c of sampling a direction from the histogram, for each cell, in [0, 1).
    guiding_probabilities: Vec<f32>,
    /// Probabilities of light samples and of path continuation, once they are learned.
    roulette: Option<Roulette>,
}

impl Field {
    /// A field with a histogram and a guiding probability for each leaf of a tree.
    pub(super) fn new(tree: CellTree, histograms: Vec<Histogram>, guiding_probabilities: Vec<f32>) -> Self {
        debug_assert!(tree.leaves() == histograms.len() && tree.leaves() == guiding_probabilities.len());
        Self { tree, histograms, guiding_probabilities, roulette: None }
    }

    pub fn cells(&self) -> usize {
        self.histograms.len()
    }

    pub fn bytes(&self) -> usize {
        self.tree.bytes() + self.cells() * Self::CELL_BYTES
    }

    /// Memory of a cell in bytes.
    pub(crate) const CELL_BYTES: usize = size_of::<Histogram>() + size_of::<f32>() + Roulette::CELL_BYTES;

    /// Learns the probabilities of light samples and of path continuation from the vertex records of a pre-pass.
    pub fn learn_roulette<'a>(
        &mut self,
        vertex_records: impl IntoIterator<Item = &'a VertexRecord>,
        paths: PathStatistics,
    ) {
        self.roulette = Some(Roulette::learn(&self.tree, vertex_records, paths));
    }

    /// Whether it has learned probabilities of light samples and of path continuation.
    pub(crate) fn has_roulette(&self) -> bool {
        self.roulette.is_some()
    }

    /// The cells of eight positions with normals.
    #[inline]
    pub fn cells_at(&self, position: V3, normal: V3) -> [u32; LANES] {
        self.tree.leaves_of(position, normal)
    }

    /// The cells that guide; [`NO_CELL`] in place of those with guiding probability 0.
    #[inline]
    pub fn guiding_cells(&self, cells: [u32; LANES]) -> [u32; LANES] {
        eight(|lane| if self.guiding_probabilities[cells[lane] as usize] > 0.0 { cells[lane] } else { NO_CELL })
    }

    /// Probabilities in (0, 1] of a light sample and of path continuation in eight cells, for the luminances `beta` of the
    /// throughputs; `None` until they are learned.
    #[inline(always)]
    pub fn roulette_probabilities(&self, cells: [u32; LANES], beta: F) -> Option<[F; 2]> {
        self.roulette.as_ref().map(|roulette| roulette.probabilities(cells, beta))
    }

    /// The guiding probabilities of cells; 0 for [`NO_CELL`].
    #[inline(always)]
    pub(crate) fn guiding_probabilities(&self, cells: [u32; LANES]) -> F {
        F::from(eight(|lane| self.guiding_probabilities.get(cells[lane] as usize).copied().unwrap_or(0.0)))
    }

    /// Densities, on the unit square, with which cells sample unit directions `w`; 0 outside the lanes of `mask` and for
    /// [`NO_CELL`].
    #[inline(always)]
    pub fn density(&self, cells: [u32; LANES], mask: F, w: V3) -> F {
        let bins = bins(w);
        let mut density = [0.0; LANES];
        for lane in lanes(mask) {
            if let Some(histogram) = self.histograms.get(cells[lane] as usize) {
                density[lane] = histogram.density(bins[lane]);
            }
        }
        F::from(density)
    }

    /// Unit directions that cells sample by two random numbers in [0, 1), and their densities on the unit square. Outside the
    /// lanes of `mask` and for [`NO_CELL`] the density is 0 and the direction has no meaning.
    #[inline(always)]
    pub fn draw(&self, cells: [u32; LANES], mask: F, u: F, v: F) -> (V3, F) {
        let (u, v) = (u.as_array(), v.as_array());
        let (mut x, mut y, mut density) = ([0.5; LANES], [0.5; LANES], [0.0; LANES]);
        // Rows of all lanes, then columns: memory is read for several lanes at a time.
        let mut rows = [Row::default(); LANES];
        for lane in lanes(mask) {
            if let Some(histogram) = self.histograms.get(cells[lane] as usize) {
                rows[lane] = histogram.draw_row(u[lane]);
            }
        }
        for lane in lanes(mask) {
            if let Some(histogram) = self.histograms.get(cells[lane] as usize) {
                (x[lane], y[lane], density[lane]) = histogram.draw_in(rows[lane], v[lane]);
            }
        }
        (from_square(F::from(x), F::from(y)), F::from(density))
    }
}

/// The lanes that are set in a mask.
#[inline(always)]
fn lanes(mask: F) -> impl Iterator<Item = usize> {
    let mut bits = mask.to_bitmask();
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}
