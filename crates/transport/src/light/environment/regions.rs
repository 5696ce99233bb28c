//! The environment in regions of directions: rectangles of the map, as the leaves of a binary tree. A sample descends the tree
//! by the probabilities of the regions, then follows the density of the environment within one.

use std::collections::BinaryHeap;
use std::f32::consts::PI;

use super::{Table, row_extent};
use crate::sampling::Discrete;

/// Number of regions.
const REGIONS: usize = 64;
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
    /// Node 0 is the root; children come after their parents.
    nodes: Vec<Node>,
    /// Probability of each node by the density of the environment.
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
    /// Its node.
    node: u32,
}

/// A node of the tree over regions.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// Index of the first of two adjacent children; 0 for a leaf.
    children: u32,
    /// The axis along which the children are divided: 0 for rows, 1 for columns. Of a leaf: the region.
    next: u32,
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
                    own[1] += f64::from((PI * top).cos() - (PI * bottom).cos()) * 0.5 * f64::from(columns.1 - columns.0)
                        / width as f64;
                }
                let at = |y: usize, x: usize| y * (wide + 1) + x;
                for k in 0..2 {
                    sums[at(y + 1, x + 1)][k] = own[k] + sums[at(y, x + 1)][k] + sums[at(y + 1, x)][k] - sums[at(y, x)][k];
                }
            }
        }
        let sum = |[[top, left], [bottom, right]]: Rectangle, k: usize| {
            let at = |y: usize, x: usize| sums[y * (wide + 1) + x][k];
            (at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left)).max(0.0)
        };
        let measure = |r: Rectangle| 0.5 * (sum(r, 0) + sum(r, 1));
        let mut nodes = vec![Node { children: 0, next: 0 }];
        let mut rectangles: Vec<Rectangle> = vec![[[0, 0], [high, wide]]];
        let mut open = BinaryHeap::from([(u64::MAX, 0usize)]);
        let mut leaves = 1;
        while let Some((_, node)) = open.pop().filter(|_| leaves < REGIONS) {
            let Some((axis, [a, b])) = halves(rectangles[node], &measure) else { continue };
            nodes[node] = Node { children: nodes.len() as u32, next: axis };
            for part in [a, b] {
                open.push((measure(part).to_bits(), nodes.len()));
                nodes.push(Node { children: 0, next: 0 });
                rectangles.push(part);
            }
            leaves += 1;
        }
        let mut all = Self { block, width: wide, of_block: vec![0; high * wide], regions: Vec::new(), nodes, probabilities: Vec::new() };
        all.probabilities = rectangles.iter().map(|&r| sum(r, 0) as f32).collect();
        for (node, rectangle) in rectangles.iter().enumerate() {
            if all.nodes[node].children > 0 {
                continue;
            }
            let region = all.regions.len();
            all.nodes[node].next = region as u32;
            let [[top, left], [bottom, right]] = *rectangle;
            (top..bottom).for_each(|y| all.of_block[y * wide + left..y * wide + right].fill(region as u8));
            let rows = top * block[0]..(bottom * block[0]).min(rows);
            let columns = ((left * block[1]) as u32, (right * block[1]).min(width) as u32);
            all.regions.push(Region {
                first_row: rows.start as u32,
                columns,
                rows: Discrete::new(rows.map(|row| table.probability(row, columns))),
                node: node as u32,
            });
            if all.regions[region].rows.is_none() {
                all.probabilities[node] = 0.0;
            }
        }
        let mut probabilities = std::mem::take(&mut all.probabilities);
        all.sum_up(&mut probabilities);
        all.probabilities = probabilities;
        all
    }

    /// Sets the values of inner nodes to the sums of their leaves' values, and scales all so that the root has 1.
    fn sum_up(&self, values: &mut [f32]) {
        for node in (0..self.nodes.len()).rev() {
            let children = self.nodes[node].children as usize;
            if children > 0 {
                values[node] = values[children] + values[children + 1];
            }
        }
        let whole = values[0];
        values.iter_mut().for_each(|value| *value /= whole);
    }

    /// Number of regions.
    pub fn len(&self) -> usize {
        self.regions.len()
    }

    /// Number of nodes of the tree.
    pub fn nodes(&self) -> usize {
        self.nodes.len()
    }

    /// Probability of each node by the density of the environment.
    pub fn probabilities(&self) -> &[f32] {
        &self.probabilities
    }

    /// Probability of each region by the density of the environment.
    pub fn region_probabilities(&self) -> impl Iterator<Item = f32> {
        self.regions.iter().map(|region| self.probabilities[region.node as usize])
    }

    /// The probabilities of nodes from those of regions, up to a factor.
    pub fn of_nodes(&self, weights: &[f32], nodes: &mut [f32]) {
        self.regions.iter().zip(weights).for_each(|(region, weight)| nodes[region.node as usize] = *weight);
        self.sum_up(nodes);
    }

    /// The probability of a region, from those of the nodes.
    #[inline]
    pub fn probability(&self, region: u32, nodes: &[f32]) -> f32 {
        nodes[self.regions[region as usize].node as usize]
    }

    /// Samples a cell of the map by `u` and `v` in [0, 1), and by the probabilities of the nodes: row, column, and new numbers in
    /// [0, 1) for the position in the cell; and the region.
    #[inline]
    pub(super) fn sample(&self, table: &Table, nodes: &[f32], [mut u, mut v]: [f32; 2]) -> ([u32; 2], [f32; 2], u32) {
        let mut node = self.nodes[0];
        while node.children > 0 {
            let left = node.children as usize;
            let (a, b) = (nodes[left], nodes[left + 1]);
            let p = a / (a + b);
            let x = if node.next == 0 { &mut v } else { &mut u };
            let goes_left = *x < p;
            *x = if goes_left { *x / p } else { (*x - p) / (1.0 - p) }.clamp(0.0, crate::sampling::warp::ONE_MINUS_EPSILON);
            node = self.nodes[left + usize::from(!goes_left)];
        }
        let region = &self.regions[node.next as usize];
        let (row, v) = region.rows.as_ref().map_or((0, v), |rows| rows.sample(v));
        let row = region.first_row + row;
        let (column, u) = table.sample_column(row as usize, region.columns, u);
        ([row, column], [u, v], node.next)
    }

    /// The region of a cell, and the cell's probability within it.
    #[inline]
    pub(super) fn cell(&self, table: &Table, row: usize, column: usize) -> (u32, f32) {
        let region = u32::from(self.of_block[row / self.block[0] * self.width + column / self.block[1]]);
        let Region { first_row, columns, rows: Some(rows), .. } = &self.regions[region as usize] else { return (region, 0.0) };
        let whole = table.share(row, *columns);
        let own = table.share(row, (column as u32, column as u32 + 1));
        (region, if whole > 0.0 { rows.pmf(row as u32 - first_row) * (own / whole) } else { 0.0 })
    }
}

/// Divides a rectangle of more than one block near the middle of its measure, along its longer side: the axis, and both parts.
fn halves(r: Rectangle, measure: &impl Fn(Rectangle) -> f64) -> Option<(u32, [Rectangle; 2])> {
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
    Some((axis as u32, parts(at)))
}
