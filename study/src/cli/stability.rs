//! `bismar study stability`

use std::path::PathBuf;
use std::time::Instant;

use bismar::console::{Signals, Verbosity, Verdict, print, say};
use bismar::render::Progress;
use bismar::{Error, Result};
use clap::{Args, ValueEnum};

use super::{PAGE, RunArgs, open};
use crate::stability::{self, Found, guiding, page};

/// Take every --balance, and guiding, through the modes in which such methods fail.
///
/// Writes report.html, stability.md (the table of who survives what) and stability.json. Tests means against the truth,
/// variances pixel by pixel against half, and both checks against controls that are wrong on purpose: exit code 1 when a
/// control is not caught or a mean is wrong. Needs no scene.
#[derive(Debug, Args)]
pub(super) struct StabilityArgs {
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Pictures of each kind. Means of fewer than 1000 are too far from normal for the tests.
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1000..=1 << 24))]
    replicas: u32,
    /// A look within half a minute or so: 1000 pictures of each kind.
    #[arg(long, conflicts_with = "replicas")]
    quick: bool,
    /// Of these alone.
    #[arg(long, value_name = "METHODS")]
    only: Option<Methods>,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

/// What is taken through modes of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Methods {
    /// Every --balance: F1 to F18.
    Balance,
    /// --guiding: F19 to F23.
    Guiding,
}

pub(super) fn run(args: &StabilityArgs, verbosity: Verbosity) -> Result<Verdict> {
    let page = open(&args.out, PAGE)?;
    let signals = Signals::listen()?;
    let reporter = args.run.reporter(verbosity);
    let asked = |methods| args.only.is_none_or(|only| only == methods);
    let of_balance = if asked(Methods::Balance) { stability::steps(true) } else { 0 };
    let of_guiding = if asked(Methods::Guiding) { guiding::steps() } else { 0 };
    let (start, all) = (Instant::now(), (of_balance + of_guiding) as f64);
    let mut steps = 0.0;
    let mut done = || {
        steps += 1.0;
        let fraction = (steps / all).min(1.0);
        let seconds = start.elapsed().as_secs_f64();
        reporter.update(Progress { fraction, seconds, rays: 0, noise: f64::INFINITY, spp: 0, mean_spp: 0.0 });
        if signals.stopped() { Err(Error::Interrupted("nothing was written".into())) } else { Ok(()) }
    };
    let replicas = if args.quick { 1000 } else { args.replicas };
    let mut measure = || -> Result<Found> {
        let mut found = Found::default();
        if asked(Methods::Balance) {
            found.balance = Some(stability::measure(replicas, Some(replicas), &signals.stop, &mut done)?);
        }
        if asked(Methods::Guiding) {
            found.guiding = Some(guiding::measure(replicas, &signals.stop, &mut done)?);
        }
        Ok(found)
    };
    let found = measure().inspect_err(|_| reporter.finish(false))?;
    reporter.finish(true);
    page::write(&args.out, &found)?;
    let tables = [found.balance.as_ref().map(page::survival), found.guiding.as_ref().map(guiding::page::survival)];
    for table in tables.iter().flatten() {
        print(table.markdown().trim_end())?;
    }
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    Ok(verdict(&found))
}

/// Done, or what is wrong with the checks or the means.
fn verdict(found: &Found) -> Verdict {
    let (blind, wrong) = (found.controls().filter(|c| !c.caught).collect::<Vec<_>>(), found.wrong());
    for control in &blind {
        say(format_args!("error: the {} was not caught: its check is blind", control.outcome.estimator));
    }
    for (estimator, mode, name) in &wrong {
        say(format_args!("error: {estimator} has a wrong mean in {mode} ({name})"));
    }
    if blind.is_empty() && wrong.is_empty() { Verdict::Done } else { Verdict::Beyond }
}
