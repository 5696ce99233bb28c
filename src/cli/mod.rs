//! The command line of `bismar`, one file per command. Exit codes are 0, those of
//! [`Error::exit_code`](crate::Error::exit_code), and 1 for a comparison beyond its threshold.

mod batch;
mod check;
mod compare;
mod develop;
mod farm;
pub mod in_memory;
mod inspect;
mod labels;
mod look;
mod merge;
pub mod options;
mod render;
mod sheet;
mod study;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::console::help::{CompletionsArgs, ManArgs, OptionsArgs};
use crate::console::{self, Verbosity, Verdict, progress};
use crate::job;
use crate::render::BuildInfo;

/// Offline glTF path tracer that finds the balance between light and BSDF sampling for each pixel.
#[derive(Debug, Parser)]
#[command(name = "bismar", version, long_version = BuildInfo::text(), arg_required_else_help = true, max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    verbosity: Verbosity,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(Box<render::RenderArgs>),
    Inspect(inspect::InspectArgs),
    Batch(batch::BatchArgs),
    /// Render the jobs of a message on standard input; started by `bismar batch`.
    #[command(hide = true)]
    BatchWorker,
    /// Denoise a picture on standard input; started by `bismar render`.
    #[command(hide = true)]
    DenoiseWorker {
        width: usize,
        height: usize,
    },
    Farm(farm::FarmArgs),
    Merge(merge::MergeArgs),
    Compare(compare::CompareArgs),
    Check(check::CheckArgs),
    Labels(labels::LabelsArgs),
    Look(look::LookArgs),
    Develop(develop::DevelopArgs),
    #[command(alias = "movie")]
    Sheet(sheet::SheetArgs),
    Study(study::StudyArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
    #[command(hide = true)]
    Options(OptionsArgs),
}

pub fn run() -> ExitCode {
    if let Err(error) = study::help(std::env::args_os()) {
        return console::fail(&error);
    }
    console::run(
        |cli: &Cli| cli.verbosity,
        |cli| match &cli.command {
            Command::Render(args) if !args.is_sequence() => render::run(args, cli.verbosity),
            Command::Render(args) => {
                batch::sequence(args, cli.verbosity).inspect_err(|error| progress::failed(args.progress, error))
            }
            Command::Inspect(args) => inspect::run(args),
            Command::Batch(args) => batch::run(args, cli.verbosity),
            Command::BatchWorker => batch::work(),
            Command::DenoiseWorker { width, height } => job::denoise(*width, *height).map(|()| Verdict::Done),
            Command::Farm(args) => farm::run(args),
            Command::Merge(args) => merge::run(args, cli.verbosity),
            Command::Compare(args) => compare::run(args),
            Command::Check(args) => check::run(args, cli.verbosity),
            Command::Labels(args) => labels::run(args, cli.verbosity),
            Command::Look(args) => look::run(args, cli.verbosity),
            Command::Develop(args) => develop::run(args, cli.verbosity),
            Command::Sheet(args) => sheet::run(args, cli.verbosity),
            Command::Study(args) => study::run(args, cli.verbosity),
            Command::Completions(args) => args.run(Cli::command()),
            Command::Man(args) => args.run(Cli::command()),
            Command::Options(args) => args.run(&Cli::command()),
        },
    )
}
