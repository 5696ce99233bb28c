//! The command line of `bismar-study`: one file a study. Exit codes are `bismar`'s.

mod balance;
mod rays;
mod stability;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use bismar::Result;
use bismar::console::args::threads;
use bismar::console::help::{CompletionsArgs, ManArgs};
use bismar::console::progress::Style;
use bismar::console::{self, Reporter, Verbosity, Verdict, host};
use bismar::film::atomic;
use clap::{Args, CommandFactory, Parser, Subcommand};
use tracing::info;

use crate::files;

/// Measure what the program's choices are worth.
#[derive(Debug, Parser)]
#[command(name = "bismar-study", bin_name = "bismar study", version, long_version = console::VERSION, max_term_width = 100)]
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

/// The page of every study, in its folder.
const PAGE: &str = "report.html";

/// What every study takes.
#[derive(Debug, Args)]
struct RunArgs {
    /// Threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    progress: Style,
}

impl RunArgs {
    /// Who tells of progress.
    fn reporter(&self, verbosity: Verbosity) -> Reporter {
        Reporter::new(self.progress, verbosity.quiet)
    }
}

/// Makes a study's folder, and finds out now if its `page` could not be written after hours: the page's path.
fn open(folder: &Path, page: &str) -> Result<PathBuf> {
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

/// Does work on as many threads as asked for.
fn on_threads(asked: Option<usize>, work: impl FnOnce() -> Result<Verdict> + Send) -> Result<Verdict> {
    let (threads, source) = host::threads(asked)?;
    info!("{threads} threads ({source})");
    host::pool(threads)?.install(work)
}
