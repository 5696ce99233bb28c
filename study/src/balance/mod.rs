//! Variance and error of every balance: replicas of each estimator on each scene, against a converged reference.
//!
//! Variance is measured, not estimated: R renders that differ in their seed alone give each pixel R values, whose sample
//! variance is the pixel's. Replica r of every estimator has the same seed, so that what two estimators do alike cancels
//! in their ratio (a pixel that stays at ½ has the ratio 1 exactly). The control `half-again` is `half` with other seeds:
//! whatever it shows is noise.

mod campaign;
pub mod cell;
pub mod key;
pub mod measure;
pub mod mosaic;
pub mod page;
pub mod ratio;
pub mod resample;
pub mod scene;
pub mod table;
pub mod whole;

use std::path::PathBuf;

use bismar::Result;
use bismar::balance::Balance;
use bismar::render::{Choice, Choices, Integrator, Technique};

pub use measure::{Measured, measure};
pub use mosaic::Mosaic;
pub use page::write;
pub use scene::StudyScene;
pub use table::{Row, SceneResults};

use crate::report::plural;

#[derive(Debug, Clone)]
pub struct Design {
    /// Output folder; measurements are in its folder `cells`.
    pub folder: PathBuf,
    /// Besides `half`, which is always measured.
    pub estimators: Vec<Estimator>,
    /// Paths a pixel, rising.
    pub spp: Vec<u32>,
    /// R ≥ 4, of everything but the reference.
    pub replicas: u32,
    /// Paths a pixel of the reference.
    pub reference_spp: u32,
    pub integrator: Integrator,
    /// Measured pixels a row.
    pub width: u32,
    pub height: u32,
    /// Size of the picture whose tiles are measured; `None`: that of the measured pixels, which are all of it.
    pub footprint: Option<[u32; 2]>,
    /// Whether to measure the error of whole pictures against seconds instead of pixels' variances.
    pub whole: bool,
}

impl Design {
    pub fn mosaic(&self) -> Result<Mosaic> {
        Mosaic::new([self.width, self.height], self.footprint)
    }

    /// What was measured on so many scenes, in words.
    fn measured(&self, scenes: usize) -> String {
        let Self { width, height, replicas, .. } = self;
        let pixels = match self.footprint {
            Some([w, h]) if [w, h] != [*width, *height] => format!(" of {w}x{h} (whole tiles, spread over the view)"),
            _ => String::new(),
        };
        let light = match self.integrator {
            Integrator::Direct => "direct light",
            Integrator::Path => "path-traced light",
        };
        format!(
            "{scenes} scene{}, {width}x{height} pixels{pixels}, {light}, {replicas} replicas of every picture. \
             `docs/study-balance.md` says how this was measured, and what the columns mean.",
            plural(scenes)
        )
    }

    pub fn reference(&self) -> Estimator {
        let guided = self.whole && self.estimators.iter().any(|e| e.is_guided());
        if guided { Estimator::named("half+guiding").unwrap_or(HALF) } else { HALF }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Estimator {
    /// One of `--balance`.
    Method(Balance),
    /// One of `--balance` with other techniques than settings have that name none.
    With(Balance, Choices),
}

/// The choices that `text` makes, as in `+guiding-compensation`; `None` if there is no such technique.
fn choices(mut text: &str) -> Option<Choices> {
    let mut choices = Choices::even();
    while let Some(sign) = text.chars().next() {
        let flag = text.strip_prefix(['+', '-'])?;
        let technique = Technique::ALL.into_iter().find(|technique| flag.starts_with(technique.row().flag))?;
        choices[technique] = if sign == '+' { Choice::Auto } else { Choice::Off };
        text = &flag[technique.row().flag.len()..];
    }
    Some(choices)
}

pub const HALF: Estimator = Estimator::Method(Balance::Half);

impl Estimator {
    /// All of them, `half` first.
    pub fn all() -> Vec<Self> {
        let others = Balance::all().iter().filter(|b| **b != Balance::Half);
        std::iter::once(&Balance::Half).chain(others).map(|&b| Estimator::Method(b)).collect()
    }

    pub fn name(self) -> String {
        match self {
            Estimator::Method(balance) => balance.name().to_owned(),
            Estimator::With(balance, choices) => {
                let sign = |choice: Choice| if choice == Choice::Off { '-' } else { '+' };
                let named = choices.iter().filter(|(technique, choice)| **choice != technique.row().even);
                let words = named.map(|(technique, choice)| format!("{}{}", sign(*choice), technique.row().flag));
                words.fold(balance.name().to_owned(), |name, word| name + &word)
            }
        }
    }

    /// The estimator of this name. After a balance, `+` and `-` add and leave out techniques: `progressive+guiding-compensation`.
    pub fn named(name: &str) -> Option<Self> {
        let with = |balance: &Balance| Some(Self::With(*balance, choices(name.strip_prefix(balance.name())?)?));
        Self::all().into_iter().find(|e| e.name() == name).or_else(|| Balance::all().iter().find_map(with))
    }

    pub fn parts(self) -> (Balance, Choices) {
        match self {
            Self::Method(balance) => (balance, Choices::even()),
            Self::With(balance, choices) => (balance, choices),
        }
    }

    /// Are its paths guided where that pays?
    fn is_guided(self) -> bool {
        self.parts().1[Technique::Guiding] != Choice::Off
    }
}

/// The control's name: `half` with other seeds.
pub(crate) const CONTROL: &str = "half-again";
