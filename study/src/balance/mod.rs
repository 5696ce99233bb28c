//! How well the balances share the work: replicas of every estimator on every scene, against a converged reference.
//!
//! Variance is measured, not estimated: R renders that differ in their seed alone give each pixel R values, whose sample
//! variance is the pixel's. Replica r of every estimator has the same seed, so that what two estimators do alike cancels
//! in their ratio (a pixel that stays at ½ has the ratio 1 exactly). The control `half-again` is `half` with other seeds:
//! whatever it shows is noise.

pub mod cell;
pub mod key;
pub mod measure;
pub mod oracle;
pub mod page;
pub mod ratio;
pub mod resample;
pub mod scene;
pub mod table;

use std::path::PathBuf;

use bismar::balance::Balance;
use bismar::render::Integrator;

pub use measure::{Measured, Portrait, measure, portrait};
pub use page::{SceneResults, write};
pub use scene::StudyScene;
pub use table::Row;

/// What to measure, on each scene.
#[derive(Debug, Clone)]
pub struct Design {
    /// Where everything goes; measurements in its folder `cells`.
    pub folder: PathBuf,
    /// Besides `half`, which is always measured.
    pub estimators: Vec<Estimator>,
    /// Paths a pixel, rising.
    pub spp: Vec<u32>,
    /// R ≥ 4, of everything but the reference.
    pub replicas: u32,
    /// Paths a pixel of the reference.
    pub reference_spp: u32,
    /// Light transport.
    pub integrator: Integrator,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Estimator {
    /// One of `--balance`.
    Method(Balance),
    /// The best fixed share of each pixel, found by brute force beforehand: the limit, not a method.
    Oracle,
}

impl Estimator {
    /// All of them, `half` first.
    pub fn all() -> Vec<Self> {
        let others = Balance::all().iter().filter(|b| **b != Balance::Half);
        let methods = std::iter::once(&Balance::Half).chain(others).map(|&b| Estimator::Method(b));
        methods.chain([Estimator::Oracle]).collect()
    }

    /// As on the command line.
    pub fn name(self) -> String {
        match self {
            Estimator::Method(balance) => balance.name().to_owned(),
            Estimator::Oracle => "oracle".to_owned(),
        }
    }

    /// By its name.
    pub fn named(name: &str) -> Option<Self> {
        Self::all().into_iter().find(|e| e.name() == name)
    }

    /// The one to show beside `half`: the default, if it is studied.
    pub fn shown(estimators: &[Self]) -> Balance {
        let methods = estimators.iter().filter_map(|e| if let Self::Method(b) = e { Some(*b) } else { None });
        let default = bismar::render::RenderSettings::default().balance;
        let mut methods = methods.collect::<Vec<_>>();
        methods.sort_by_key(|&b| (b != default, b == Balance::Half));
        methods.first().copied().unwrap_or(default)
    }

    /// Does it find a share for each pixel from samples?
    pub fn learns(self) -> bool {
        matches!(self, Estimator::Method(balance) if balance.method().learns())
    }
}

/// The control's name: `half` with other seeds.
pub const CONTROL: &str = "half-again";
