//! The environment in regions of directions: rectangles of the map, within which samples follow the density of the environment.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f32::consts::PI;

use super::table::{SampledCell, Table, row_extent};
use crate::lanes::{F, LANES, eight};
use crate::sampling::Discrete;
use crate::sampling::warp::ONE_MINUS_EPSILON;

/// Largest number of regions.
pub const REGIONS: usize = 64;
/// Largest number of blocks of cells in a column and in a row of the map. Regions are made of whole blocks.
const BLOCKS: [usize; 2] = [64, 128];

/// A division of an environment's cells into regions.
#[derive(Debug)]
pub struct Regions {
    /// Rows and columns of cells per block.
    block: [usize; 2],
    /// Blocks per row of blocks.
    width: usize,
    /// The region of each block.
    of_block: Vec<u8>,
    regions: Vec<Region>,
    /// The tree by which a region is chosen, one node fewer than regions. Children come after their parents.
    nodes: Vec<Node>,
    /// Probability of each region by the density of the environment.
    probabilities: Vec<f32>,
}

/// A rectangle of cells.
#[derive(Debug)]
struct Region {
    /// First row of cells.
    first_row: u32,
    /// Columns of cells: the first, and the one after the last.
    columns: (u32, u32),
    /// The rows; `None` if the region is never sampled.
    rows: Option<Discrete>,
}

/// A node of the tree over regions.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    /// Is it divided by columns, or by rows?
    pub by_column: bool,
    /// The children: another node, or the complement of a region's index.
    pub children: [i32; 2],
}

/// Blocks from a row and column to a row and column.
type Rectangle = [[usize; 2]; 2];

impl Regions {
    /// Divides the cells of a table.
    pub(super) fn new(table: &Table, width: usize) -> Self {
        let rows = table.rows_of_cells();
        let block = [rows.div_ceil(BLOCKS[0]), width.div_ceil(BLOCKS[1])];
        let [high, wide] = [rows.div_ceil(block[0]), width.div_ceil(block[1])];
        // Half by probability, half by solid angle: both a sun and a dim sky are divided.
        let mut sums = vec![[0.0f64; 2]; (high + 1) * (wide + 1)];
        for y in 0..high {
            for x in 0..wide {
                let columns = ((x * block[1]) as u32, ((x + 1) * block[1]).min(width) as u32);
                let mut own = [0.0; 2];
                for row in y * block[0]..((y + 1) * block[0]).min(rows) {
                    let (top, bottom) = row_extent(row, rows - 1);
                    own[0] += f64::from(table.probability(row, columns));
                    own[1] +=
                        f64::from((PI * top).cos() - (PI * bottom).cos()) * 0.5 * f64::from(columns.1 - columns.0)
                            / width as f64;
                }
                let at = |y: usize, x: usize| y * (wide + 1) + x;
                for k in 0..2 {
                    sums[at(y + 1, x + 1)][k] =
                        own[k] + sums[at(y, x + 1)][k] + sums[at(y + 1, x)][k] - sums[at(y, x)][k];
                }
            }
        }
        let sum = |[[top, left], [bottom, right]]: Rectangle, k: usize| {
            let at = |y: usize, x: usize| sums[y * (wide + 1) + x][k];
            (at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left)).max(0.0)
        };
        let measure = |r: Rectangle| 0.5 * (sum(r, 0) + sum(r, 1));
        let (nodes, rectangles) = divide([[0, 0], [high, wide]], &measure);
        let mut all = Self {
            block,
            width: wide,
            of_block: vec![0; high * wide],
            regions: Vec::with_capacity(rectangles.len()),
            nodes,
            probabilities: Vec::with_capacity(rectangles.len()),
        };
        for rectangle in rectangles {
            let [[top, left], [bottom, right]] = rectangle;
            (top..bottom).for_each(|y| all.of_block[y * wide + left..y * wide + right].fill(all.regions.len() as u8));
            let rows = top * block[0]..(bottom * block[0]).min(rows);
            let columns = ((left * block[1]) as u32, (right * block[1]).min(width) as u32);
            let first_row = rows.start as u32;
            let rows = Discrete::new(rows.map(|row| table.probability(row, columns)));
            all.probabilities.push(if rows.is_some() { sum(rectangle, 0) as f32 } else { 0.0 });
            all.regions.push(Region { first_row, columns, rows });
        }
        all
    }

    /// The probability of each node's first child, where regions have the probabilities of `regions`.
    pub fn first_child_probabilities(&self, regions: &[f32]) -> Vec<f32> {
        let mut sums = vec![0.0; self.nodes.len()];
        let mut first = vec![0.0; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate().rev() {
            let of = |child: i32| if child < 0 { regions[!child as usize] } else { sums[child as usize] };
            let [a, b] = node.children.map(of);
            (sums[i], first[i]) = (a + b, if a + b > 0.0 { a / (a + b) } else { 0.5 });
        }
        first
    }

    /// Probability of each region by the density of the environment.
    pub fn probabilities(&self) -> &[f32] {
        &self.probabilities
    }

    /// Samples a cell of a region by `u` and `v` in [0, 1).
    #[inline]
    pub(super) fn sample(&self, table: &Table, region: usize, [u, v]: [f32; 2]) -> SampledCell {
        let Region { first_row, columns, rows } = &self.regions[region];
        let (row, v) = rows.as_ref().map_or((0, v), |rows| rows.sample(v));
        let at = (first_row + row) as usize;
        let (column, u) = table.sample_column(at, *columns, u);
        let at = [at, column as usize];
        SampledCell { at, probability: self.probability_within(table, region, at), rest: [u, v] }
    }

    /// The region of a cell, and the cell's probability within it.
    #[inline]
    pub(super) fn cell(&self, table: &Table, [row, column]: [usize; 2]) -> (usize, f32) {
        let region = usize::from(self.of_block[row / self.block[0] * self.width + column / self.block[1]]);
        (region, self.probability_within(table, region, [row, column]))
    }

    /// The probability of a cell within its region.
    #[inline(always)]
    fn probability_within(&self, table: &Table, region: usize, [row, column]: [usize; 2]) -> f32 {
        let Region { first_row, columns, rows: Some(rows) } = &self.regions[region] else { return 0.0 };
        let [own, whole] = [(column as u32, column as u32 + 1), *columns].map(|columns| table.share(row, columns));
        if whole > 0.0 { rows.pmf(row as u32 - first_row) * (own / whole) } else { 0.0 }
    }
}

/// Divides a rectangle into at most [`REGIONS`], those with the largest measure first: the tree, and the regions.
fn divide(whole: Rectangle, measure: &impl Fn(Rectangle) -> f64) -> (Vec<Node>, Vec<Rectangle>) {
    let (mut nodes, mut regions) = (Vec::new(), Vec::new());
    // Parts that have not been divided, and where their parents refer to them. Numbers >= 0 have the order of their bits; of equal
    // ones the first is divided.
    let mut parts = vec![(whole, None)];
    let mut open = BinaryHeap::from([(0, Reverse(0))]);
    while let Some((_, Reverse(part))) = open.pop() {
        let (rectangle, parent) = parts[part];
        let divided = if nodes.len() + 1 < REGIONS { halves(rectangle, measure) } else { None };
        let own = match divided {
            Some((by_column, halves)) => {
                for (side, half) in halves.into_iter().enumerate() {
                    open.push((measure(half).to_bits(), Reverse(parts.len())));
                    parts.push((half, Some((nodes.len(), side))));
                }
                nodes.push(Node { by_column, children: [0; 2] });
                nodes.len() as i32 - 1
            }
            None => {
                regions.push(rectangle);
                !(regions.len() as i32 - 1)
            }
        };
        if let Some((parent, side)) = parent {
            let parent: &mut Node = &mut nodes[parent];
            parent.children[side] = own;
        }
    }
    (nodes, regions)
}

/// Divides a rectangle near the middle of its measure, along its longer side: whether by columns, and the halves. `None` for a
/// single block.
fn halves(r: Rectangle, measure: &impl Fn(Rectangle) -> f64) -> Option<(bool, [Rectangle; 2])> {
    let [[top, left], [bottom, right]] = r;
    // Blocks are about as high as they are wide, but for the narrowing towards the poles.
    let axis = usize::from(right - left > bottom - top);
    let (from, to) = (r[0][axis], r[1][axis]);
    if to - from < 2 {
        return None;
    }
    let parts = |at: usize| {
        let (mut a, mut b) = (r, r);
        (a[1][axis], b[0][axis]) = (at, at);
        [a, b]
    };
    let whole = measure(r);
    let at = (from + 1..to - 1).find(|&at| measure(parts(at)[0]) >= 0.5 * whole).unwrap_or(to - 1);
    // The block that crosses the middle goes to the part that becomes more even.
    let before = (at - 1).max(from + 1);
    let uneven = |at: usize| (measure(parts(at)[0]) - 0.5 * whole).abs();
    let at = if uneven(before) < uneven(at) { before } else { at };
    Some((axis == 1, parts(at)))
}

/// The choice of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Choice {
    /// Probability of the first child of each node of the regions' tree.
    first: [f32; REGIONS],
    /// Probability of each region.
    pub(super) of: [f32; REGIONS],
}

impl Choice {
    /// The choice of `regions` with these probabilities.
    pub(super) fn new(regions: &Regions, probabilities: &[f32]) -> Self {
        let padded = |list: &[f32]| std::array::from_fn(|i| list.get(i).copied().unwrap_or(0.0));
        Self { first: padded(&regions.first_child_probabilities(probabilities)), of: padded(probabilities) }
    }
}

/// The choice of a region at eight points.
#[derive(Debug, Clone, Copy)]
pub struct RegionProbabilities<'a> {
    pub(super) regions: &'a Regions,
    pub(super) choices: [&'a Choice; LANES],
}

impl RegionProbabilities<'_> {
    /// Chooses a region at each point by numbers in [0, 1) for columns and rows: the regions, their probabilities, and new numbers
    /// in [0, 1). Each number is divided along its own axis only, which keeps the strata of both.
    #[inline(always)]
    pub(super) fn sample(&self, numbers: [F; 2]) -> ([u32; LANES], F, [F; 2]) {
        let mut at = [0i32; LANES];
        // The interval of each number that leads to the current nodes.
        let (mut low, mut width) = ([F::ZERO; 2], [F::ONE; 2]);
        while at.iter().any(|&node| node >= 0) {
            let nodes = eight(|lane| &self.regions.nodes[at[lane].max(0) as usize]);
            let first = F::from(eight(|lane| self.choices[lane].first[at[lane].max(0) as usize]));
            let inner = F::from(eight(|lane| f32::from(u8::from(at[lane] >= 0)))).simd_gt(F::ZERO);
            let by_column = F::from(eight(|lane| f32::from(u8::from(nodes[lane].by_column)))).simd_gt(F::ZERO);
            let part = by_column.select(width[0], width[1]) * first;
            let middle = by_column.select(low[0], low[1]) + part;
            let is_first = by_column.select(numbers[0], numbers[1]).simd_lt(middle);
            for (axis, mask) in [by_column & inner, !by_column & inner].into_iter().enumerate() {
                let rest = is_first.select(part, width[axis] - part);
                low[axis] = (mask & !is_first).select(middle, low[axis]);
                width[axis] = mask.select(rest, width[axis]);
            }
            let is_first = is_first.to_bitmask();
            for lane in 0..LANES {
                if at[lane] >= 0 {
                    at[lane] = nodes[lane].children[1 - (is_first >> lane & 1) as usize];
                }
            }
        }
        let regions = at.map(|region| !region as u32);
        let rest = [0, 1].map(|axis| {
            let rest = (numbers[axis] - low[axis]) / width[axis];
            rest.fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON))
        });
        (regions, F::from(eight(|lane| self.probability(lane, regions[lane] as usize))), rest)
    }

    /// The probability of a region at the point in `lane`.
    #[inline(always)]
    pub(super) fn probability(&self, lane: usize, region: usize) -> f32 {
        self.choices[lane].of[region]
    }
}
