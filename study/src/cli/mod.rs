//! The command line of `bismar-study`, one file per study. Exit codes are those of `bismar`.

mod balance;
mod common;
mod means;
mod rays;
mod stability;

use std::process::ExitCode;

use bismar::Result;
use bismar::console::help::{CompletionsArgs, ManArgs};
use bismar::console::{self, Verbosity, Verdict, host};
use bismar::render::BuildInfo;
use clap::{CommandFactory, Parser, Subcommand};
use tracing::info;

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
    Means(means::MeansArgs),
    Rays(rays::RaysArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

pub fn run() -> ExitCode {
    console::run(
        |cli: &Cli| cli.verbosity,
        |cli| match &cli.study {
            Study::Balance(args) => on_threads(args.run.threads, || balance::run(args, cli.verbosity)),
            Study::Stability(args) => on_threads(args.run.threads, || stability::run(args, cli.verbosity)),
            Study::Means(args) => on_threads(args.run.threads, || means::run(args, cli.verbosity)),
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
