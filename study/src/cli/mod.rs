//! The command line of `bismar-study`, one file per study. Exit codes are those of `bismar`.

mod balance;
mod rays;
mod stability;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use bismar::Result;
use bismar::console::args::threads;
use bismar::console::help::{CompletionsArgs, ManArgs};
use bismar::console::progress::Style;
use bismar::console::{self, Reporter, Verbosity, Verdict, host};
use bismar::film::atomic;
use bismar::render::BuildInfo;
use bismar::render::Progress;
use clap::{Args, CommandFactory, Parser, Subcommand};
use tracing::info;

use crate::files;

/// Measure the renderer's methods.
#[derive(Debug, Parser)]
#[command(name = "bismar-study", bin_name = "bismar study", version, long_version = BuildInfo::text(), max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    verbosity: Verbosity,
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Balance(balance::BalanceArgs),
    Stability(stability::StabilityArgs),
    Rays(rays::RaysArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

/// File name of a study's report in its folder.
const PAGE: &str = "report.html";

/// Flags of every study.
#[derive(Debug, Args)]
struct RunArgs {
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// Progress display.
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    progress: Style,
}

impl RunArgs {
    /// The reporter of progress.
    fn reporter(&self, verbosity: Verbosity) -> Reporter {
        Reporter::new(self.progress, verbosity.quiet)
    }
}

/// Progress of a study without pictures of its own: only the fraction that is done and the time.
fn progress(fraction: f64, start: Instant) -> Progress {
    let seconds = start.elapsed().as_secs_f64();
    Progress { fraction, seconds, rays: 0, noise: f64::INFINITY, spp: 0, mean_spp: 0.0 }
}

/// Creates a study's folder and checks that its `page` can be written, before hours of work; returns the page's path.
fn open(folder: &Path, page: &str) -> Result<PathBuf> {
    atomic::confine(&[folder.into()]);
    files::folder(folder)?;
    let page = folder.join(page);
    atomic::check(&page)?;
    Ok(page)
}

/// Runs the program with the process's arguments.
pub fn run() -> ExitCode {
    console::run(
        |cli: &Cli| cli.verbosity,
        |cli| match &cli.study {
            Study::Balance(args) => on_threads(args.run.threads, || balance::run(args, cli.verbosity)),
            Study::Stability(args) => on_threads(args.run.threads, || stability::run(args, cli.verbosity)),
            Study::Rays(args) => rays::run(args, cli.verbosity),
            Study::Completions(args) => args.run(Cli::command()),
            Study::Man(args) => args.run(Cli::command()),
        },
    )
}

/// Runs `work` in a pool of this many threads.
fn on_threads(threads: Option<usize>, work: impl FnOnce() -> Result<Verdict> + Send) -> Result<Verdict> {
    let (threads, source) = host::threads(threads)?;
    info!("{threads} threads ({source})");
    host::pool(threads)?.install(work)
}
