//! Learned sampling of the environment: from which of its regions light arrives in which part of the scene. It is for the
//! environment what [`learned`](super::super::learned) is for area lights, with regions of directions in place of clusters of lights.

use std::sync::Arc;

use super::regions::{REGIONS, Regions};
use super::{Density, EnvironmentSampler};
use crate::lanes::{F, LANES, V3, eight};
use crate::light::LightSampleRecord;
use crate::light::learn::{Clusters, MIN_WEIGHT, bytes_to_learn, posteriors};
use crate::light::learned::mixture;
use crate::sampling::cells::CellTree;
use crate::sampling::warp::ONE_MINUS_EPSILON;

/// The choice of a region.
#[derive(Debug, Clone, Copy)]
struct Choice {
    /// Probability of the first child of each node of the regions' tree.
    first: [f32; REGIONS],
    /// Probability of each region.
    of: [f32; REGIONS],
}

impl Choice {
    /// The choice of `regions` with these probabilities.
    fn new(regions: &Regions, probabilities: &[f32]) -> Self {
        let padded = |list: &[f32]| std::array::from_fn(|i| list.get(i).copied().unwrap_or(0.0));
        Self { first: padded(&regions.first_child_probabilities(probabilities)), of: padded(probabilities) }
    }
}

/// Probabilities of the environment's regions, for each cell in space.
#[derive(Debug)]
pub struct LearnedEnvironment {
    regions: Arc<Regions>,
    /// The density that samples follow within regions.
    pub density: Density,
    /// Cells in space; `None` while nothing is learned.
    cells: Option<CellTree>,
    /// The choice of a region, for each cell.
    choices: Vec<Choice>,
}

impl LearnedEnvironment {
    /// The environment in regions, with nothing learned.
    pub fn new(environment: &EnvironmentSampler, density: Density) -> Self {
        let regions = environment.regions(density);
        let choices = vec![Choice::new(&regions, regions.probabilities())];
        Self { regions: Arc::new(regions), density, cells: None, choices }
    }

    /// Number of cells in space.
    pub fn cells(&self) -> usize {
        self.choices.len()
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> usize {
        self.cells.as_ref().map_or(0, CellTree::bytes) + size_of_val(&*self.choices)
    }

    /// Learns from records of light samples by [`new`](Self::new)'s value. `scale` (metres) weights differences of normals against
    /// distances. `None` if there is nothing to choose or no record has a contribution.
    pub fn learn<'a>(&self, records: impl IntoIterator<Item = &'a LightSampleRecord>, scale: f32) -> Option<Self> {
        let records: Vec<_> = records.into_iter().collect();
        let by_density = self.regions.probabilities();
        if by_density.len() < 2 || !records.iter().any(|record| record.contribution > 0.0) {
            return None;
        }
        let known = |region: u32| Some(region as usize).filter(|region| *region < by_density.len());
        let clusters = Clusters { len: by_density.len(), of: known };
        let mut choices = Vec::new();
        let cells = posteriors(&clusters, &records, scale, |cells, cell, stats| {
            choices.resize(cells.leaves(), self.choices[0]);
            let roots: Vec<f32> = stats.iter().map(|stats| stats.square.sqrt()).collect();
            let mean: f32 = by_density.iter().zip(&roots).map(|(p, root)| p * root).sum();
            let weighted = |(p, root): (&f32, &f32)| if mean > 0.0 { p * (root / mean).max(MIN_WEIGHT) } else { *p };
            let weighted: Vec<f32> = by_density.iter().zip(&roots).map(weighted).collect();
            let whole: f32 = weighted.iter().sum();
            let mixed: Vec<f32> = by_density.iter().zip(&weighted).map(|(p, w)| mixture(*p, w / whole)).collect();
            choices[cell] = Choice::new(&self.regions, &mixed);
        });
        Some(Self { regions: self.regions.clone(), density: self.density, cells: Some(cells), choices })
    }

    /// Largest memory in bytes while it learns from so many records, these included.
    pub fn bytes_to_learn(records: u64) -> u64 {
        bytes_to_learn(records, REGIONS as u64, (size_of::<Choice>() / REGIONS) as u64)
    }

    /// The probability of the region of a record's choice, at its point.
    pub fn probability(&self, record: &LightSampleRecord) -> f32 {
        let cell = self.cells.as_ref().map_or(0, |cells| cells.leaf(record.position, record.normal));
        self.choices[cell as usize].of[record.emitter as usize]
    }

    /// The probabilities at eight points `p` with normals `n`, which are zero where light from both sides counts.
    #[inline]
    pub fn at(&self, p: V3, n: V3) -> RegionProbabilities<'_> {
        let cells = self.cells.as_ref().map_or([0; LANES], |cells| cells.leaves_of(p, n));
        RegionProbabilities { regions: &self.regions, choices: eight(|lane| &self.choices[cells[lane] as usize]) }
    }
}

/// The choice of a region at eight points.
#[derive(Debug, Clone, Copy)]
pub struct RegionProbabilities<'a> {
    pub(super) regions: &'a Regions,
    choices: [&'a Choice; LANES],
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
