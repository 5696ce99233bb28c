//! `bismar study stability`

use std::path::PathBuf;
use std::time::Instant;

use bismar::console::{Signals, Verbosity, Verdict, print, say};
use bismar::render::Progress;
use bismar::{Error, Result};
use clap::Args;

use super::{PAGE, RunArgs, open};
use crate::stability::{self, Results, page, steps};

/// Take every --balance through the modes in which such methods fail.
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
    #[command(flatten)]
    pub(super) run: RunArgs,
}

pub(super) fn run(args: &StabilityArgs, verbosity: Verbosity) -> Result<Verdict> {
    let page = open(&args.out, PAGE)?;
    let signals = Signals::listen()?;
    let reporter = args.run.reporter(verbosity);
    let (start, all) = (Instant::now(), steps(true) as f64);
    let mut steps = 0.0;
    let mut done = || {
        steps += 1.0;
        let fraction = (steps / all).min(1.0);
        let seconds = start.elapsed().as_secs_f64();
        reporter.update(Progress { fraction, seconds, rays: 0, noise: f64::INFINITY, spp: 0, mean_spp: 0.0 });
        if signals.stopped() { Err(Error::Interrupted("nothing was written".into())) } else { Ok(()) }
    };
    let replicas = if args.quick { 1000 } else { args.replicas };
    let results = stability::measure(replicas, Some(replicas), &signals.stop, &mut done)
        .inspect_err(|_| reporter.finish(false))?;
    reporter.finish(true);
    page::write(&args.out, &results)?;
    print(page::survival(&results).markdown().trim_end())?;
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    Ok(verdict(&results))
}

/// Done, or what is wrong with the checks or the means.
fn verdict(results: &Results) -> Verdict {
    for control in results.controls.iter().filter(|c| !c.caught) {
        say(format_args!("error: the {} was not caught: its check is blind", control.outcome.estimator));
    }
    for (estimator, mode) in results.wrong() {
        say(format_args!("error: {estimator} has a wrong mean in {} ({})", mode.mode, mode.name));
    }
    if results.controls_caught() && results.wrong().is_empty() { Verdict::Done } else { Verdict::Beyond }
}
