//! One measurement on disk: the replicas of one estimator at one sample count on one scene.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::Path;

use bismar::film::atomic;
use bismar::{Error, Result};
use serde::{Deserialize, Serialize};

/// What is known of a cell besides its numbers; the file's first line.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Header {
    pixels: usize,
    times: Vec<Times>,
}

/// What one replica took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// CPU seconds of all threads.
    pub cpu: f64,
    /// Wall seconds.
    pub wall: f64,
    /// CPU seconds of `half` in the same round, where it was rendered then.
    pub half_cpu: Option<f64>,
}

/// Replicas of one estimator at one sample count.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// Pixels of a picture.
    pub pixels: usize,
    /// One a replica.
    pub times: Vec<Times>,
    /// Radiance, replica by replica, row by row, linear RGB.
    pub values: Vec<f32>,
    /// Each pixel's share of light samples after the last pass, replica by replica.
    pub shares: Vec<f32>,
}

impl Cell {
    /// Nothing yet, of pictures of so many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { pixels, ..Self::default() }
    }

    /// How many replicas there are.
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

    /// Each pixel's mean share over the replicas.
    pub fn mean_shares(&self) -> Vec<f32> {
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

    /// Adds a replica.
    pub fn push(&mut self, times: Times, values: &[f32], shares: &[f32]) {
        debug_assert!(values.len() == self.pixels * 3 && shares.len() == self.pixels);
        self.times.push(times);
        self.values.extend_from_slice(values);
        self.shares.extend_from_slice(shares);
    }

    /// Reads a cell of pictures of so many pixels; `None` when there is none, or one of other pictures or cut off.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Permission`] as the system says.
    pub fn read(path: &Path, pixels: usize) -> Result<Option<Self>> {
        let bytes = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Error::reading(path, &e)),
        };
        Ok(Self::parse(&bytes).filter(|cell| cell.pixels == pixels))
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let end = bytes.iter().position(|&b| b == b'\n')?;
        let Header { pixels, times } = serde_json::from_slice(&bytes[..end]).ok()?;
        let numbers = &bytes[end + 1..];
        let floats = pixels.checked_mul(4)?.checked_mul(times.len())?;
        if numbers.len() != floats.checked_mul(4)? {
            return None;
        }
        let mut all = numbers.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let values = all.by_ref().take(floats / 4 * 3).collect();
        Some(Self { pixels, times, values, shares: all.collect() })
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// As [`atomic::write`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let header = Header { pixels: self.pixels, times: self.times.clone() };
        let header = serde_json::to_string(&header).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
        atomic::write(path, |file| {
            writeln!(file, "{header}")?;
            for x in self.values.iter().chain(&self.shares) {
                file.write_all(&x.to_le_bytes())?;
            }
            Ok(Ok(()))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell() -> Cell {
        let mut cell = Cell::new(2);
        for r in 0..3 {
            let x = r as f32;
            let times = Times { cpu: 0.1 * f64::from(r), wall: 1.0, half_cpu: (r > 0).then_some(0.3) };
            cell.push(times, &[x, 1.0, 2.0, 3.0 * x, 4.0, f32::MIN_POSITIVE], &[0.25 * x, 0.5]);
        }
        cell
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.cell");
        assert_eq!(Cell::read(&path, 2).unwrap(), None);
        cell().write(&path).unwrap();
        assert_eq!(Cell::read(&path, 2).unwrap(), Some(cell()));
        assert_eq!(Cell::read(&path, 3).unwrap(), None);
        let whole = fs::read(&path).unwrap();
        for len in [0, 5, whole.len() - 1] {
            fs::write(&path, &whole[..len]).unwrap();
            assert_eq!(Cell::read(&path, 2).unwrap(), None, "{len} bytes");
        }
    }

    #[test]
    fn means_are_over_replicas() {
        let mean = cell().mean();
        assert!((mean[0] - 1.0).abs() < 1e-12 && (mean[3] - 3.0).abs() < 1e-12);
        assert_eq!(cell().mean_shares(), [0.25, 0.5]);
    }
}
