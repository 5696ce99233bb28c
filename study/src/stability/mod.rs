//! Failure modes of adaptive balances: every estimator in every mode, with positive controls.
//!
//! Exact cases are images of discrete integrands. A replica simulates the estimator's passes sample by sample, with the
//! functions of [`bismar::balance`]; its mean is tested against the exact value. The variance of its estimate follows
//! exactly from the shares that it chose, so only the shares are random. Scenes are small renders whose variances are
//! measured over replicas with the same seeds. [`guiding`] has its own modes.

pub mod cases;
pub mod domain;
pub mod facts;
pub mod guiding;
pub mod judge;
pub mod page;
pub mod renders;
pub mod scenes;
pub mod sharing;
pub mod simulate;
mod tables;

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::{Balance, Counts, Heuristic};
use bismar::sampling::SplitMix64;
use rayon::prelude::*;
use serde::Serialize;

use cases::Case;
use facts::Fact;
use judge::{Control, Outcome, Tally, Verdict, z_limit};
use scenes::{Estimator, SceneCase};
use simulate::{Subject, replica};

/// A failure mode and the results of the estimators in it.
#[derive(Debug, Clone, Serialize)]
pub struct ModeResult {
    /// F1 … F18, F24 … F29.
    pub mode: &'static str,
    pub name: &'static str,
    /// Description of the case.
    pub construct: &'static str,
    /// Whether variances come from renders; otherwise they are exact.
    pub rendered: bool,
    pub paths: u32,
    pub replicas: u32,
    /// Largest variance ratio to `half` with which an estimator survives.
    pub bar: f64,
    /// Mean over pixels of the least variance of any fixed share over that of `half`; `None` in renders.
    pub best: Option<f64>,
    /// One per estimator. Renders lack the estimators that exist only in simulation.
    pub outcomes: Vec<Outcome>,
}

/// Results of the exact cases and scenes.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Largest |z| allowed of one test.
    pub z_limit: f64,
    /// Number of z-tests.
    pub tests: usize,
    /// Upper bound of the probability of a false alarm in any test.
    pub false_alarm: f64,
    pub modes: Vec<ModeResult>,
    pub facts: Vec<Fact>,
    pub controls: Vec<Control>,
}

impl Results {
    /// Number of replicas per estimator and mode.
    pub fn replicas(&self) -> u32 {
        self.modes.first().map_or(0, |m| m.replicas)
    }

    /// Judges an estimator in a mode.
    pub fn verdict(&self, mode: &ModeResult, outcome: &Outcome) -> Verdict {
        outcome.verdict(mode.bar, self.z_limit)
    }

    /// Whether every control is caught.
    pub fn controls_caught(&self) -> bool {
        self.controls.iter().all(|c| c.caught)
    }

    /// Estimators with a wrong mean or a value that is not finite, each with the mode.
    pub fn wrong(&self) -> Vec<(&str, &ModeResult)> {
        let wrong = |m| move |o| (self.verdict(m, o) == Verdict::Wrong).then_some((o.estimator.as_str(), m));
        self.modes.iter().flat_map(|m| m.outcomes.iter().filter_map(wrong(m))).collect()
    }
}

/// Results of a run of the study: of balances, of guiding, or of both.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Found {
    /// F1 … F18, F24, F25.
    #[serde(flatten)]
    pub balance: Option<Results>,
    /// F19 … F23.
    pub guiding: Option<guiding::Results>,
    /// F26 … F29.
    pub path_reuse: Option<Results>,
}

impl Found {
    /// Results without those of guiding, which have a form of their own.
    fn of_balances(&self) -> impl Iterator<Item = &Results> {
        self.balance.iter().chain(&self.path_reuse)
    }

    /// Number of replicas per estimator and mode.
    pub fn replicas(&self) -> u32 {
        let guiding = || self.guiding.as_ref().map_or(0, |r| r.replicas);
        self.of_balances().next().map_or_else(guiding, Results::replicas)
    }

    pub fn controls(&self) -> impl Iterator<Item = &Control> {
        let of_balance = self.of_balances().flat_map(|r| &r.controls);
        of_balance.chain(self.guiding.iter().flat_map(|r| &r.controls))
    }

    /// Estimator, mode and name of the mode for each wrong mean or value that is not finite.
    pub fn wrong(&self) -> Vec<(&str, &str, &str)> {
        let of_balance = self.of_balances().flat_map(Results::wrong).map(|(estimator, m)| (estimator, m.mode, m.name));
        let of_guiding =
            self.guiding.iter().flat_map(guiding::Results::wrong).map(|(estimator, m)| (estimator, m.mode, m.name));
        of_balance.chain(of_guiding).collect()
    }
}

/// Number of steps of [`measure`].
pub fn steps(scenes: bool) -> usize {
    let exact = cases::cases().len() * Subject::shown().len() + 2;
    exact + if scenes { scenes::SCENES * (Balance::all().len() + 1) } else { 0 }
}

/// Measures all exact cases with `replicas` ≥ 2, and all scenes with `scene_replicas` ≥ 2 unless that is `None`. Calls `done`
/// after each of [`steps`]; `done` may stop the measurement with an error, and must once `stop` is raised.
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
        let (rendered, best) = (false, Some(best));
        modes.push(ModeResult { mode, name, construct, rendered, paths, replicas, bar, best, outcomes });
    }
    if let Some(replicas) = scene_replicas {
        let estimators: Vec<_> = Balance::all().iter().map(|balance| (*balance).into()).collect();
        for case in scenes::scene_cases()? {
            modes.push(rendered(&case, &estimators, replicas, stop, done)?);
        }
    }
    modes.sort_by_key(|m| m.mode[1..].parse::<u32>().unwrap_or(u32::MAX));
    let (biased, unsafe_case) = (cases::biased_control(), cases::unsafe_control());
    let biased_outcome = exact(&biased, Subject::Biased, replicas);
    done()?;
    let unsafe_outcome = exact(&unsafe_case, Subject::Unsafe, replicas);
    done()?;
    let all = modes.iter().flat_map(|m| &m.outcomes).chain([&biased_outcome, &unsafe_outcome]);
    let tests = all.map(|o| o.tests).sum();
    let z_limit = z_limit(tests);
    let control =
        |Case { mode, name, .. }: Case, check, caught, outcome| Control { mode, name, check, outcome, caught };
    let unsafe_caught = unsafe_outcome.verdict(unsafe_case.bar, z_limit) == Verdict::Fails;
    let controls = vec![
        control(biased, "z-test of the mean", biased_outcome.z > z_limit, biased_outcome),
        control(unsafe_case, "worst pixel's variance", unsafe_caught, unsafe_outcome),
    ];
    Ok(Results { z_limit, tests, false_alarm: judge::FALSE_ALARM, modes, facts: facts::facts(), controls })
}

/// Measures a scene, as [`SceneCase::outcomes`].
fn rendered(
    case: &SceneCase,
    estimators: &[Estimator],
    replicas: u32,
    stop: &AtomicBool,
    done: &mut dyn FnMut() -> Result<()>,
) -> Result<ModeResult> {
    let outcomes = case.outcomes(estimators, replicas, stop, done)?;
    let SceneCase { mode, name, construct, .. } = *case;
    let (rendered, bar, best, paths) = (true, cases::BAR, None, scenes::PATHS);
    Ok(ModeResult { mode, name, construct, rendered, paths, replicas, bar, best, outcomes })
}

/// Replicas that one task adds up. Tasks' sums are added in order, so that the result does not depend on threads.
const REPLICAS_PER_TASK: u32 = 250;

/// Simulates one estimator on one exact case.
fn exact(case: &Case, subject: Subject, replicas: u32) -> Outcome {
    let truth: Vec<_> = case.image.pixels.iter().map(|d| d.total()).collect();
    let half: Vec<_> =
        case.image.pixels.iter().map(|d| d.variance(Heuristic::Balance, Counts::half(case.paths))).collect();
    let starts: Vec<u32> = (0..replicas).step_by(REPLICAS_PER_TASK as usize).collect();
    let tallies: Vec<_> = starts
        .into_par_iter()
        .map(|start| {
            let mut tally = Tally::new(&truth);
            for r in start..(start + REPLICAS_PER_TASK).min(replicas) {
                // Mixed seeds: consecutive states would make overlapping streams.
                let mut random = SplitMix64(SplitMix64(u64::from(r)).bits());
                tally.add(&replica(&case.image, subject, case.paths, &mut random));
            }
            tally
        })
        .collect();
    let none = Tally::new(&truth);
    tallies.iter().fold(none, |sum, tally| sum.join(tally)).outcome(subject.name(), &half, case.bar)
}
