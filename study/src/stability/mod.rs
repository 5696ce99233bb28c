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
pub mod tables;

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::{Balance, Counts, Heuristic, Method};
use bismar::sampling::SplitMix64;
use rayon::prelude::*;
use serde::Serialize;

use cases::Case;
use facts::Fact;
use judge::{Control, Outcome, Tally, Verdict, z_limit};
use scenes::{Estimator, SceneCase};
use simulate::{Biased, Unsafe, replica};

/// A failure mode and the results of the estimators in it.
#[derive(Debug, Clone, Serialize)]
pub struct ModeResult {
    /// F1 … F34.
    pub mode: &'static str,
    pub name: &'static str,
    pub construct: &'static str,
    /// Whether variances come from renders; otherwise they are exact.
    pub rendered: bool,
    pub paths: u32,
    pub replicas: u32,
    /// Largest variance ratio to `half` with which an estimator survives.
    pub bar: f64,
    /// Mean over pixels of the least variance of any fixed share over that of `half`; `None` in renders.
    pub best: Option<f64>,
    /// Whether `--guiding on` uses an adversarial field; of guiding alone.
    #[serde(rename = "lies", skip_serializing_if = "Option::is_none")]
    pub adversarial: Option<bool>,
    /// One per estimator. Renders lack the estimators that exist only in simulation.
    pub outcomes: Vec<Outcome>,
}

impl ModeResult {
    /// Whether an adversarial field guides the renders. Their noise is not judged: the program makes no such field.
    fn misleads(&self, outcome: &Outcome) -> bool {
        self.adversarial == Some(true) && outcome.estimator == "on"
    }
}

/// Results of balances, of guiding or of path re-use.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Per estimator and mode.
    pub replicas: u32,
    /// Largest |z| allowed of one test.
    pub z_limit: f64,
    pub tests: usize,
    /// Upper bound of the probability of a false alarm in any test.
    pub false_alarm: f64,
    pub modes: Vec<ModeResult>,
    pub facts: Vec<Fact>,
    pub controls: Vec<Control>,
}

impl Results {
    /// Results of modes, and of controls with `more` tests that are not among those of the modes.
    fn new(replicas: u32, modes: Vec<ModeResult>, mut controls: Vec<Control>, more: usize) -> Self {
        let tests = modes.iter().flat_map(|m| &m.outcomes).map(|o| o.tests).sum::<usize>() + more;
        let (z_limit, false_alarm) = (z_limit(tests), judge::FALSE_ALARM);
        for control in &mut controls {
            let verdict = control.outcome.verdict(cases::BAR, z_limit);
            control.caught = verdict == if control.check.starts_with('z') { Verdict::Wrong } else { Verdict::Fails };
        }
        Self { replicas, z_limit, tests, false_alarm, modes, facts: Vec::new(), controls }
    }

    pub fn verdict(&self, mode: &ModeResult, outcome: &Outcome) -> Verdict {
        outcome.verdict(mode.bar, self.z_limit)
    }

    fn estimators(&self) -> impl Iterator<Item = &String> {
        self.modes.iter().take(1).flat_map(|mode| &mode.outcomes).map(|outcome| &outcome.estimator)
    }

    /// Estimators with a wrong mean or a value that is not finite, each with the mode.
    pub fn wrong(&self) -> Vec<(&str, &ModeResult)> {
        let wrong = |m| move |o| (self.verdict(m, o) == Verdict::Wrong).then_some((o.estimator.as_str(), m));
        self.modes.iter().flat_map(|m| m.outcomes.iter().filter_map(wrong(m))).collect()
    }
}

#[derive(Debug, Clone, Default, Serialize)]
pub struct Found {
    /// F1 … F18, F24, F25, F34.
    #[serde(flatten)]
    pub balance: Option<Results>,
    /// F19 … F23, F33.
    pub guiding: Option<Results>,
    /// F26 … F32.
    pub path_reuse: Option<Results>,
}

impl Found {
    pub fn all(&self) -> impl Iterator<Item = &Results> {
        self.balance.iter().chain(&self.guiding).chain(&self.path_reuse)
    }
}

/// Number of steps of [`measure`] with scenes.
pub fn steps() -> usize {
    let balances = Balance::all().len();
    cases::cases().len() * balances + 2 + scenes::SCENES * (balances + 1)
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
        for balance in Balance::all() {
            outcomes.push(exact(&case, balance.method(), replicas));
            done()?;
        }
        let best = case.image.pixels.iter().map(|d| d.best(case.paths)).sum::<f64>() / case.image.pixels.len() as f64;
        let Case { mode, name, construct, paths, bar, .. } = case;
        let (rendered, best, adversarial) = (false, Some(best), None);
        modes.push(ModeResult { mode, name, construct, rendered, paths, replicas, bar, best, adversarial, outcomes });
    }
    if let Some(replicas) = scene_replicas {
        let estimators: Vec<_> = Balance::all().iter().map(|balance| (*balance).into()).collect();
        for case in scenes::scene_cases()? {
            modes.push(rendered(&case, &estimators, replicas, stop, done)?);
        }
    }
    modes.sort_by_key(|m| m.mode[1..].parse::<u32>().unwrap_or(u32::MAX));
    let wrong: [(Case, &dyn Method, _); 2] = [
        (cases::biased_control(), &Biased, "z-test of the mean"),
        (cases::unsafe_control(), &Unsafe, "worst pixel's variance"),
    ];
    let mut controls = Vec::new();
    for (case, method, check) in wrong {
        let outcome = exact(&case, method, replicas);
        controls.push(Control { mode: case.mode, name: case.name, check, outcome, caught: false });
        done()?;
    }
    let tests = controls.iter().map(|control| control.outcome.tests).sum();
    Ok(Results { facts: facts::facts(), ..Results::new(replicas, modes, controls, tests) })
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
    Ok(of_renders([mode, name, construct], replicas, None, outcomes))
}

/// The result of a mode whose variances come from renders.
fn of_renders(
    [mode, name, construct]: [&'static str; 3],
    replicas: u32,
    adversarial: Option<bool>,
    outcomes: Vec<Outcome>,
) -> ModeResult {
    let (rendered, bar, best, paths) = (true, cases::BAR, None, scenes::PATHS);
    ModeResult { mode, name, construct, rendered, paths, replicas, bar, best, adversarial, outcomes }
}

/// Replicas that one task adds up. Tasks' sums are added in order, so that the result does not depend on threads.
const REPLICAS_PER_TASK: u32 = 250;

/// Simulates one estimator on one exact case.
fn exact(case: &Case, method: &dyn Method, replicas: u32) -> Outcome {
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
                tally.add(&replica(&case.image, method, case.paths, &mut random));
            }
            tally
        })
        .collect();
    let none = Tally::new(&truth);
    tallies.iter().fold(none, |sum, tally| sum.join(tally)).outcome(method.name().to_owned(), &half, case.bar)
}
