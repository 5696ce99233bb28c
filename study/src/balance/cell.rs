//! One measurement on disk: the replicas of one estimator at one sample count on one scene.

use std::path::Path;

use bismar::render::TechniqueStats;
use bismar::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::files;
use crate::statistics::{median, median_error};

#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// CPU seconds of all threads.
    pub cpu: f64,
    /// CPU seconds of `half` in the same round, where it was rendered then.
    pub half_cpu: Option<f64>,
    /// Of the pre-pass of `--guiding`, if requested.
    pub prepass: Option<Prepass>,
    /// Error × time that `--adaptive` expected, over that without it, if requested; 1 where it decided against itself.
    pub allocation: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prepass {
    pub on: bool,
    /// The error × time that it expected to be left, over that without guiding.
    pub left: f64,
    /// Wall seconds that it took.
    pub seconds: f64,
}

impl Prepass {
    pub fn of(stats: &TechniqueStats) -> Self {
        Self { on: stats.on, left: stats.remaining.unwrap_or(1.0), seconds: stats.seconds }
    }
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Replica {
    pub times: Times,
    pub values: Vec<f32>,
    pub shares: Vec<f32>,
    pub paths: Vec<f32>,
}

/// Replicas of one estimator at one sample count.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    pub pixels: usize,
    pub times: Vec<Times>,
    /// Radiance, replica by replica, row by row, linear RGB.
    pub values: Vec<f32>,
    /// Each pixel's share of light samples after the last pass, replica by replica.
    pub shares: Vec<f32>,
    /// Each pixel's paths, replica by replica.
    pub paths: Vec<f32>,
}

impl Cell {
    /// Nothing yet, of pictures of so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { pixels, ..Self::default() }
    }

    pub fn replicas(&self) -> usize {
        self.times.len()
    }

    /// One replica's picture, three numbers a pixel.
    pub fn picture(&self, replica: usize) -> &[f32] {
        &self.values[replica * self.pixels * 3..][..self.pixels * 3]
    }

    /// One replica's shares, one number a pixel.
    pub fn shares_of(&self, replica: usize) -> &[f32] {
        &self.shares[replica * self.pixels..][..self.pixels]
    }

    /// One replica's paths, one number a pixel; none of what is no render.
    pub fn paths_of(&self, replica: usize) -> &[f32] {
        self.paths.get(replica * self.pixels..).map_or(&[], |rest| &rest[..self.pixels])
    }

    pub(crate) fn mean_shares(&self) -> Vec<f32> {
        let mut mean = vec![0.0; self.pixels];
        for r in 0..self.replicas() {
            mean.iter_mut().zip(self.shares_of(r)).for_each(|(m, s)| *m += s / self.replicas() as f32);
        }
        mean
    }

    /// Mean picture, three numbers a pixel.
    pub fn mean(&self) -> Vec<f64> {
        let mut mean = vec![0.0; self.pixels * 3];
        for r in 0..self.replicas() {
            mean.iter_mut().zip(self.picture(r)).for_each(|(m, &x)| *m += f64::from(x) / self.replicas() as f64);
        }
        mean
    }

    /// Medians over the first replicas: CPU seconds of all threads, CPU time over that of `half` in the same round; and the
    /// standard error of the latter.
    pub(crate) fn timing(&self, replicas: usize) -> [f64; 3] {
        let times = &self.times[..replicas];
        let cpu = times.iter().map(|t| t.cpu).collect::<Vec<_>>();
        let to_half = times.iter().filter_map(|t| Some(t.cpu / t.half_cpu?)).collect::<Vec<_>>();
        [median(&cpu), median(&to_half), median_error(&to_half)]
    }

    pub fn push(&mut self, replica: &Replica) {
        debug_assert!(replica.values.len() == self.pixels * 3 && replica.shares.len() == self.pixels);
        self.times.push(replica.times);
        self.values.extend_from_slice(&replica.values);
        self.shares.extend_from_slice(&replica.shares);
        self.paths.extend_from_slice(&replica.paths);
    }

    /// Reads a cell of pictures of so many pixels; `None` when there is none, or one of other pictures or damaged.
    pub fn read(path: &Path, pixels: usize) -> Result<Option<Self>> {
        match files::kept::<Self>(path) {
            Err(Error::Missing(_)) => Ok(None),
            cell => Ok(cell?.filter(|cell| cell.pixels == pixels)),
        }
    }

    /// Writes it whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::keep(path, self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_replicas_and_a_cell_is_read_as_it_was_written() {
        let mut cell = Cell::new(2);
        for x in [0.0, 1.0, 2.0] {
            let prepass = Some(Prepass { on: x == 1.0, left: 0.5, seconds: 0.1 });
            let times = Times { cpu: 0.1, half_cpu: (x > 0.0).then_some(0.3), prepass, ..Times::default() };
            let values = vec![x, 1.0, 2.0, 3.0 * x, 4.0, f32::MIN_POSITIVE];
            cell.push(&Replica { times, values, shares: vec![0.25 * x, 0.5], paths: vec![64.0, x] });
        }
        let mean = cell.mean();
        assert!((mean[0] - 1.0).abs() < 1e-12 && (mean[3] - 3.0).abs() < 1e-12);
        assert_eq!(cell.mean_shares(), [0.25, 0.5]);
        assert_eq!(cell.paths_of(2), [64.0, 2.0]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.cell");
        assert_eq!(Cell::read(&path, 2).unwrap(), None);
        cell.write(&path).unwrap();
        assert_eq!(Cell::read(&path, 2).unwrap(), Some(cell));
        assert_eq!(Cell::read(&path, 3).unwrap(), None);
    }
}
