//! Learned sampling of the environment: from which of its regions light arrives in which part of the scene. It is for the
//! environment what [`learned`](super::super::learned) is for area lights, with regions of directions in place of clusters of lights.

use super::{Density, EnvironmentSampler, Regions, Table};
use crate::light::LightSampleRecord;
use crate::light::learn::{Clusters, MIN_WEIGHT, posteriors};
use crate::light::learned::mixture;
use crate::lanes::{LANES, V3};
use crate::sampling::cells::CellTree;
use std::sync::Arc;

/// Probabilities of the environment's regions, for each cell in space.
#[derive(Debug, Clone)]
pub struct LearnedEnvironment {
    regions: Arc<Regions>,
    /// The density that samples follow within regions.
    pub density: Density,
    /// Cells in space; `None` while nothing is learned.
    cells: Option<CellTree>,
    /// Probabilities of the nodes of the regions' tree, for each cell.
    probabilities: Vec<f32>,
}

impl LearnedEnvironment {
    /// The environment in regions, with nothing learned.
    pub fn new(environment: &EnvironmentSampler, density: Density) -> Self {
        let regions = environment.regions(density);
        let probabilities = regions.probabilities().to_vec();
        Self { regions: Arc::new(regions), density, cells: None, probabilities }
    }

    /// Number of cells in space.
    pub fn cells(&self) -> usize {
        self.cells.as_ref().map_or(1, CellTree::leaves)
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> usize {
        self.cells.as_ref().map_or(0, CellTree::bytes) + size_of_val(&*self.probabilities)
    }

    /// Learns from records of light samples by this or another value for the same regions. `scale` (metres) weights differences of
    /// normals against distances. `None` if there is nothing to choose or no record has a contribution.
    pub fn learn(&self, records: &[LightSampleRecord], scale: f32) -> Option<Self> {
        let count = self.regions.len();
        if count < 2 || !records.iter().any(|record| record.contribution > 0.0) {
            return None;
        }
        let by_density: Vec<f32> = self.regions.region_probabilities().collect();
        let nodes = self.regions.nodes();
        let clusters = Clusters { len: count, of: |region: u32| Some(region as usize) };
        let mut probabilities = Vec::new();
        let cells = posteriors(&clusters, records, scale, |cells, leaf, stats| {
            probabilities.resize(cells.leaves() * nodes, 0.0);
            let root = |region: usize| stats[region].square.sqrt();
            let mean: f32 = by_density.iter().enumerate().map(|(region, p)| p * root(region)).sum();
            let weight = |region: usize| if mean > 0.0 { (root(region) / mean).max(MIN_WEIGHT) } else { 1.0 };
            let sum: f32 = by_density.iter().enumerate().map(|(region, p)| p * weight(region)).sum();
            let mixed: Vec<f32> =
                by_density.iter().enumerate().map(|(region, p)| mixture(*p, p * weight(region) / sum)).collect();
            self.regions.of_nodes(&mixed, &mut probabilities[leaf * nodes..][..nodes]);
        });
        Some(Self { regions: self.regions.clone(), density: self.density, cells: Some(cells), probabilities })
    }

    /// The probabilities of a region at a record's point: by the density alone, and as learned.
    pub fn probabilities_of(&self, record: &LightSampleRecord) -> [f32; 2] {
        let leaf = self.cells.as_ref().map_or(0, |cells| cells.leaf(record.position, record.normal)) as usize;
        let nodes = self.regions.nodes();
        [self.regions.probabilities(), &self.probabilities[leaf * nodes..][..nodes]]
            .map(|nodes| self.regions.probability(record.emitter, nodes))
    }

    /// The probabilities at eight points `p` with normals `n`, which are zero where light from both sides counts.
    #[inline]
    pub fn at(&self, p: V3, n: V3) -> EnvironmentCells<'_> {
        EnvironmentCells { environment: self, cells: self.cells.as_ref().map_or([0; LANES], |cells| cells.leaves_of(p, n)) }
    }
}

/// The learned probabilities at eight points.
#[derive(Debug, Clone, Copy)]
pub struct EnvironmentCells<'a> {
    environment: &'a LearnedEnvironment,
    cells: [u32; LANES],
}

impl EnvironmentCells<'_> {
    #[inline(always)]
    fn nodes(&self, lane: usize) -> &[f32] {
        let count = self.environment.regions.nodes();
        &self.environment.probabilities[self.cells[lane] as usize * count..][..count]
    }

    /// Samples a cell of the map: its row and column, and new numbers in [0, 1) for the column and row within it.
    #[inline(always)]
    pub(super) fn sample(&self, lane: usize, table: &Table, numbers: [f32; 2]) -> ([u32; 2], [f32; 2]) {
        let (cell, rest, _) = self.environment.regions.sample(table, self.nodes(lane), numbers);
        (cell, rest)
    }

    /// The region of a cell of the map, and the cell's probability.
    #[inline(always)]
    pub(super) fn cell(&self, lane: usize, table: &Table, row: usize, column: usize) -> (u32, f32) {
        let (region, within) = self.environment.regions.cell(table, row, column);
        (region, within * self.environment.regions.probability(region, self.nodes(lane)))
    }
}
