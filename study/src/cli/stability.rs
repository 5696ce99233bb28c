//! `bismar study stability`

use std::path::PathBuf;
use std::time::Instant;

use bismar::console::{Signals, Verbosity, Verdict, print, say};
use bismar::{Error, Result};
use clap::{Args, ValueEnum};

use super::common::{RunArgs, open, progress};
use crate::stability::tables::survival;
use crate::stability::{self, Found, Results, guiding, page, sharing};

/// Test every --balance, path guiding and path re-use in the known failure modes of such methods.
///
/// Writes report.html, stability.md (a table of methods and failure modes) and stability.json. Means are tested against the
/// exact values, and variances per pixel against half; estimators that are wrong on purpose verify both tests. The exit code
/// is 1 if a wrong estimator is not detected or a mean is wrong. Needs no scene.
#[derive(Debug, Args)]
pub(super) struct StabilityArgs {
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of pictures per method and failure mode. Means of fewer than 1000 are too far from a normal distribution for
    /// the tests.
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1000..=1 << 24))]
    replicas: u32,
    /// Quick preset, about half a minute: 1000 pictures per method and failure mode.
    #[arg(long, conflicts_with = "replicas")]
    quick: bool,
    /// Test only these methods.
    #[arg(long, value_name = "METHODS")]
    only: Option<Methods>,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

/// Methods with their own failure modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Methods {
    /// Every --balance: F1 to F18, F24, F25, F34
    Balance,
    /// --guiding: F19 to F23, F33
    Guiding,
    /// --path-reuse: F26 to F32
    PathReuse,
}

pub(super) fn run(args: &StabilityArgs, verbosity: Verbosity) -> Result<Verdict> {
    let page = open(&args.out)?;
    let signals = Signals::listen()?;
    let reporter = args.run.reporter(verbosity);
    let included = |methods| args.only.is_none_or(|only| only == methods);
    let balance_steps = if included(Methods::Balance) { stability::steps() } else { 0 };
    let guiding_steps = if included(Methods::Guiding) { guiding::steps() } else { 0 };
    let reuse_steps = if included(Methods::PathReuse) { sharing::steps() } else { 0 };
    let (start, all) = (Instant::now(), (balance_steps + guiding_steps + reuse_steps) as f64);
    let mut steps = 0.0;
    let mut done = || {
        steps += 1.0;
        reporter.update(progress((steps / all).min(1.0), start));
        if signals.stopped() { Err(Error::Interrupted("nothing was written".into())) } else { Ok(()) }
    };
    let replicas = if args.quick { 1000 } else { args.replicas };
    let mut measure = || -> Result<Found> {
        let mut found = Found::default();
        if included(Methods::Balance) {
            found.balance = Some(stability::measure(replicas, Some(replicas), &signals.stop, &mut done)?);
        }
        if included(Methods::Guiding) {
            found.guiding = Some(guiding::measure(replicas, &signals.stop, &mut done)?);
        }
        if included(Methods::PathReuse) {
            found.path_reuse = Some(sharing::measure(replicas, &signals.stop, &mut done)?);
        }
        Ok(found)
    };
    let found = measure().inspect_err(|_| reporter.finish(false))?;
    reporter.finish(true);
    page::write(&args.out, &found)?;
    for results in found.all() {
        print(survival(results).text())?;
    }
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    Ok(verdict(&found))
}

/// Prints undetected controls and wrong means; [`Verdict::Beyond`] if there are any.
fn verdict(found: &Found) -> Verdict {
    let mut verdict = Verdict::Done;
    for control in found.all().flat_map(|results| &results.controls).filter(|control| !control.caught) {
        verdict = Verdict::Beyond;
        say(format_args!("error: the {} was not caught: its check is blind", control.outcome.estimator));
    }
    for (estimator, mode) in found.all().flat_map(Results::wrong) {
        verdict = Verdict::Beyond;
        say(format_args!("error: {estimator} has a wrong mean in {} ({})", mode.mode, mode.name));
    }
    verdict
}
