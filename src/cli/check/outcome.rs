//! A golden picture against the new one.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::film::Picture;
use crate::film::compare::{flip_map, in_common};
use crate::film::exr_file::{ChannelBits, read_bits};
use crate::{Error, Result};

/// Default of `--max-flip` (docs/check.md has the measurement).
pub const MAX_FLIP: f64 = 0.05;

/// A golden picture and what became of it.
pub struct Check {
    pub golden: PathBuf,
    pub scene: String,
    /// Path of the new picture.
    pub new: PathBuf,
    pub seconds: f64,
    pub outcome: Outcome,
    pub updated: bool,
    /// Has the render printed its error?
    pub is_said: bool,
}

/// What is still taken as the same picture.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Limit {
    /// Percentile of the pixels' FLIP errors, 0 to 100.
    pub percentile: f64,
    /// Its largest value, 0 to 1.
    pub max_flip: f64,
}

/// A channel whose bits differ.
#[derive(Debug, Clone, Serialize)]
pub struct Differing {
    /// Its name; of a channel that only one picture has too.
    pub name: String,
    /// Number of pixels whose bits differ.
    pub pixels: usize,
}

/// What became of a golden picture.
#[derive(Debug)]
pub enum Outcome {
    Pending,
    /// Every channel has equal bits.
    Identical,
    Other {
        /// FLIP error of the beauty at the limit's percentile; 1 for pictures of different sizes.
        flip: f64,
        /// Is it within the limit?
        passes: bool,
        channels: Vec<Differing>,
        /// Why the pictures cannot be compared, if they cannot.
        unlike: Option<String>,
    },
    /// It could not be rendered or read.
    Failed {
        /// Exit code of the error.
        exit_code: u8,
        error: String,
    },
}

impl Outcome {
    pub fn failed(error: &Error) -> Self {
        Self::Failed { exit_code: error.exit_code(), error: error.to_string() }
    }

    pub(crate) fn is_identical(&self) -> bool {
        matches!(self, Self::Identical)
    }

    /// Is the new picture as good as the golden one?
    pub fn passes(&self) -> bool {
        matches!(self, Self::Identical | Self::Other { passes: true, .. })
    }

    /// Exit code of an error.
    pub fn exit_code(&self) -> Option<u8> {
        match self {
            Self::Failed { exit_code, .. } => Some(*exit_code),
            _ => None,
        }
    }

    pub fn name(&self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Identical => "identical",
            Self::Other { passes: true, .. } => "alike",
            Self::Other { .. } => "differs",
            Self::Failed { .. } => "failed",
        }
    }
}

/// Compares bits first, then FLIP.
pub fn compare(golden: &Path, new: &Path, limit: Limit) -> Result<Outcome> {
    let channels = differing(&read_bits(golden)?, &read_bits(new)?);
    if channels.is_empty() {
        return Ok(Outcome::Identical);
    }
    let (before, now) = (Picture::open(golden, None)?, Picture::open(new, None)?);
    let unlike = if before.window == now.window { None } else { in_common(&now, &before).err() };
    let unlike = unlike.or_else(|| (before.window != now.window).then(|| "the pictures have other windows".into()));
    let flip = match unlike {
        Some(_) => 1.0,
        None => percentile(flip_map(&now, &before), limit.percentile),
    };
    Ok(Outcome::Other {
        flip,
        passes: unlike.is_none() && flip <= limit.max_flip && limit.max_flip > 0.0,
        channels,
        unlike,
    })
}

fn differing(golden: &[ChannelBits], new: &[ChannelBits]) -> Vec<Differing> {
    let of = |all: &'_ [ChannelBits], name: &str| all.iter().position(|(other, _)| other == name);
    let mut channels = Vec::new();
    for (name, bits) in golden {
        let pixels = match of(new, name) {
            Some(i) if new[i].1.len() == bits.len() => bits.iter().zip(&new[i].1).filter(|(a, b)| a != b).count(),
            _ => bits.len(),
        };
        channels.push(Differing { name: name.clone(), pixels });
    }
    let added = new.iter().filter(|(name, _)| of(golden, name).is_none());
    channels.extend(added.map(|(name, bits)| Differing { name: name.clone(), pixels: bits.len() }));
    channels.retain(|channel| channel.pixels > 0);
    channels
}

/// The smallest error that this percentage of the pixels does not exceed.
fn percentile(mut errors: Vec<f32>, percent: f64) -> f64 {
    errors.sort_by(f32::total_cmp);
    let rank = (percent / 100.0 * errors.len() as f64).ceil() as usize;
    errors.get(rank.saturating_sub(1)).map_or(0.0, |e| f64::from(*e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_so_many_do_not_exceed() {
        let errors: Vec<f32> = (1..=200).rev().map(|n| n as f32).collect();
        assert_eq!(
            [0.0, 0.5, 50.0, 99.0, 99.1, 100.0].map(|p| percentile(errors.clone(), p)),
            [1.0, 1.0, 100.0, 198.0, 199.0, 200.0]
        );
        assert_eq!(percentile(Vec::new(), 50.0), 0.0);
    }

    #[test]
    fn channels_differ_by_bits_by_name_and_by_size() {
        let channel = |name: &str, bits: &[u32]| (name.to_owned(), bits.to_vec());
        let golden = [channel("R", &[1, 2, 3]), channel("Z", &[4, 5, 6]), channel("gone", &[0, 0, 0])];
        let new = [channel("R", &[1, 2, 3]), channel("Z", &[4, 0, 0]), channel("added", &[7, 7, 7])];
        let found: Vec<_> = differing(&golden, &new).into_iter().map(|c| (c.name, c.pixels)).collect();
        assert_eq!(found, [("Z".into(), 2), ("gone".into(), 3), ("added".into(), 3)]);
        assert!(differing(&golden, &golden).is_empty());
        assert_eq!(differing(&golden[..1], &[channel("R", &[1])])[0].pixels, 3);
    }
}
