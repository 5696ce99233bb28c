//! Learned sampling of the environment: from which of its regions light arrives in which part of the scene. It is for the
//! environment what [`learned`](super::super::learned) is for area lights, with regions of directions in place of clusters of lights.

use std::sync::Arc;

use super::regions::{Choice, REGIONS, RegionProbabilities, Regions};
use super::table::Density;
use crate::lanes::{LANES, V3, eight};
use crate::light::LightSampleRecord;
use crate::light::learn::{Clusters, MIN_WEIGHT, bytes_to_learn, posteriors};
use crate::light::learned::mixture;
use crate::sampling::cells::CellTree;

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
    pub(super) fn new(regions: Regions, density: Density) -> Self {
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

    /// Learns from records of light samples by what [`in_regions`](super::EnvironmentSampler::in_regions) gives. `scale`
    /// (metres) weights differences of normals against distances. `None` if there is nothing to choose or no record has a contribution.
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
