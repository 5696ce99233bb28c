//! Sample requests in packets of eight.

use super::queues::PathIds;
use crate::lanes::{F, Rows, U};

/// What a light sample is allocated to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightTarget {
    /// Any light: drawn by the sample.
    Random,
    Environment,
    AreaLight,
}

/// Up to eight samples.
pub struct RequestPacket {
    /// Number of the first sample; the others follow.
    pub first: usize,
    pub rows: Rows,
    pub path_ids: PathIds,
    /// Targets of light samples: [`LightTarget`] as a number.
    pub target: U,
    pub len: usize,
    /// Samples per path: environment, area lights, BSDF.
    pub samples_per_path: [F; 3],
}
