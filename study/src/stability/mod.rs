//! Where methods fail: every estimator through the failure modes of adaptive balances, with positive controls.
//!
//! Exact cases are images of discrete integrands. A replica goes through the estimator's passes sample by sample, with
//! `balance`'s own functions; its mean is tested against the exact truth. The variance of its estimate follows exactly
//! from the shares that it chose, so only the shares are left to chance, not the variance. Scenes are small renders; there
//! variances are measured over replicas with the same seeds. [`guiding`] has modes of its own.

pub mod cases;
pub mod domain;
pub mod facts;
pub mod guiding;
pub mod judge;
pub mod page;
pub mod regularised;
pub mod renders;
pub mod scenes;
pub mod simulate;

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::{Balance, Counts, Heuristic};
use bismar::sampling::SplitMix64;
use rayon::prelude::*;
use serde::Serialize;

use cases::Case;
use facts::Fact;
use judge::{Outcome, Tally, Verdict, z_limit};
use simulate::{Subject, replica};

/// A mode and how the estimators came through it.
#[derive(Debug, Clone, Serialize)]
pub struct ModeResult {
    /// F1 … F18, F24.
    pub mode: &'static str,
    /// In a few words.
    pub name: &'static str,
    /// How it is posed.
    pub construct: &'static str,
    /// Rendered, or exact?
    pub rendered: bool,
    /// Paths a pixel.
    pub paths: u32,
    /// Replicas.
    pub replicas: u32,
    /// Largest variance ratio that counts as survived.
    pub bar: f64,
    /// Mean over pixels of the least variance of any fixed share, over that of `half`; where that is known exactly.
    pub best: Option<f64>,
    /// One an estimator; those that cannot render are missing in renders.
    pub outcomes: Vec<Outcome>,
}

/// A positive control.
#[derive(Debug, Clone, Serialize)]
pub struct Control {
    /// The mode, and what it did.
    pub mode: &'static str,
    /// What is wrong with it.
    pub name: &'static str,
    /// The check that has to catch it.
    pub check: &'static str,
    /// What it did.
    pub outcome: Outcome,
    /// Was it caught?
    pub caught: bool,
}

/// All that was found.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Largest |z| allowed of one test.
    pub z_limit: f64,
    /// How many z-tests there were.
    pub tests: usize,
    /// Chance of a false alarm among all of them.
    pub false_alarm: f64,
    /// In the order of their numbers.
    pub modes: Vec<ModeResult>,
    /// Answers that need no chance.
    pub facts: Vec<Fact>,
    /// What had to be caught.
    pub controls: Vec<Control>,
}

impl Results {
    /// Replicas of each kind.
    pub fn replicas(&self) -> u32 {
        self.modes.first().map_or(0, |m| m.replicas)
    }

    /// How an estimator came through a mode.
    pub fn verdict(&self, mode: &ModeResult, outcome: &Outcome) -> Verdict {
        outcome.verdict(mode.bar, self.z_limit)
    }

    /// Is every control caught?
    pub fn controls_caught(&self) -> bool {
        self.controls.iter().all(|c| c.caught)
    }

    /// Estimators with a wrong mean or a value that is not finite, each with the mode.
    pub fn wrong(&self) -> Vec<(&str, &ModeResult)> {
        let of = |m| move |o| (self.verdict(m, o) == Verdict::Wrong).then_some((o.estimator.as_str(), m));
        self.modes.iter().flat_map(|m| m.outcomes.iter().filter_map(of(m))).collect()
    }
}

/// What a run of the study found: of balances, of guiding, or of both.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Found {
    /// F1 … F18, F24.
    #[serde(flatten)]
    pub balance: Option<Results>,
    /// F19 … F23.
    pub guiding: Option<guiding::Results>,
}

impl Found {
    /// Replicas of each kind.
    pub fn replicas(&self) -> u32 {
        let guiding = || self.guiding.as_ref().map_or(0, |r| r.replicas);
        self.balance.as_ref().map_or_else(guiding, Results::replicas)
    }

    /// Of both.
    pub fn controls(&self) -> impl Iterator<Item = &Control> {
        let of_balance = self.balance.iter().flat_map(|r| &r.controls);
        of_balance.chain(self.guiding.iter().flat_map(|r| &r.controls))
    }

    /// Who has a wrong mean or a value that is not finite, and in which mode.
    pub fn wrong(&self) -> Vec<(&str, &str, &str)> {
        let of_balance = self.balance.iter().flat_map(Results::wrong).map(|(who, m)| (who, m.mode, m.name));
        let of_guiding = self.guiding.iter().flat_map(guiding::Results::wrong).map(|(who, m)| (who, m.mode, m.name));
        of_balance.chain(of_guiding).collect()
    }
}

/// How many pieces of work a measurement has.
pub fn steps(scenes: bool) -> usize {
    let exact = cases::cases().len() * Subject::shown().len() + 2;
    exact + if scenes { scenes::SCENES * (Balance::all().len() + 1) } else { 0 }
}

/// Takes everything. Exact cases and scenes have their own numbers of replicas, ≥ 2; none of scenes leaves them out.
/// `done` is called after each of [`steps`] and may stop with an error; it must, once `stop` is raised.
///
/// # Errors
/// Those of `done`, and of building the scenes.
pub fn measure(
    replicas: u32,
    scene_replicas: Option<u32>,
    stop: &AtomicBool,
    done: &mut dyn FnMut() -> Result<()>,
) -> Result<Results> {
    let mut modes = Vec::new();
    for case in cases::cases() {
        let mut outcomes = Vec::new();
        for subject in Subject::shown() {
            outcomes.push(exact(&case, subject, replicas));
            done()?;
        }
        let best = case.image.pixels.iter().map(|d| d.best(case.paths)).sum::<f64>() / case.image.pixels.len() as f64;
        let Case { mode, name, construct, paths, bar, .. } = case;
        modes.push(ModeResult {
            mode,
            name,
            construct,
            rendered: false,
            paths,
            replicas,
            bar,
            best: Some(best),
            outcomes,
        });
    }
    if let Some(replicas) = scene_replicas {
        for case in scenes::scene_cases()? {
            let outcomes = case.outcomes(Balance::all(), replicas, stop, done)?;
            let (mode, name, construct, paths) = (case.mode, case.name, case.construct, scenes::PATHS);
            modes.push(ModeResult {
                mode,
                name,
                construct,
                rendered: true,
                paths,
                replicas,
                bar: cases::BAR,
                best: None,
                outcomes,
            });
        }
    }
    modes.sort_by_key(|m| m.mode[1..].parse::<u32>().unwrap_or(u32::MAX));
    let (biased, careless) = (cases::biased_control(), cases::unsafe_control());
    let of_biased = exact(&biased, Subject::Biased, replicas);
    done()?;
    let of_careless = exact(&careless, Subject::Unsafe, replicas);
    done()?;
    let all = modes.iter().flat_map(|m| &m.outcomes).chain([&of_biased, &of_careless]);
    let tests = all.map(|o| o.tests).sum();
    let z_limit = z_limit(tests);
    let controls = vec![
        Control {
            mode: biased.mode,
            name: biased.name,
            check: "z-test of the mean",
            caught: of_biased.z > z_limit,
            outcome: of_biased,
        },
        Control {
            mode: careless.mode,
            name: careless.name,
            check: "worst pixel's variance",
            caught: of_careless.verdict(careless.bar, z_limit) == Verdict::Fails,
            outcome: of_careless,
        },
    ];
    Ok(Results { z_limit, tests, false_alarm: judge::FALSE_ALARM, modes, facts: facts::facts(), controls })
}

/// Replicas that are added up one after another; sums of these are added in order, so that threads do not matter.
const TOGETHER: u32 = 250;

/// One estimator on one exact case.
fn exact(case: &Case, subject: Subject, replicas: u32) -> Outcome {
    let truth: Vec<_> = case.image.pixels.iter().map(|d| d.total()).collect();
    let half: Vec<_> =
        case.image.pixels.iter().map(|d| d.variance(Heuristic::Balance, Counts::half(case.paths))).collect();
    let starts: Vec<u32> = (0..replicas).step_by(TOGETHER as usize).collect();
    let tallies: Vec<_> = starts
        .into_par_iter()
        .map(|start| {
            let mut tally = Tally::new(&truth);
            for r in start..(start + TOGETHER).min(replicas) {
                // Neighbouring states make overlapping streams.
                let mut random = SplitMix64(SplitMix64(u64::from(r)).bits());
                tally.add(&replica(&case.image, subject, case.paths, &mut random));
            }
            tally
        })
        .collect();
    let none = Tally::new(&truth);
    tallies.iter().fold(none, |sum, tally| sum.join(tally)).outcome(subject.name(), &half, case.bar)
}
