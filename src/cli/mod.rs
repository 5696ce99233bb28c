//! The command line of `bismar`: one file a command. Exit codes are those of [`Error::exit_code`](crate::Error::exit_code),
//! 0, and 1 for a comparison beyond its threshold.

mod batch;
mod compare;
mod develop;
mod farm;
mod inspect;
mod memory;
mod merge;
mod movie;
mod render;
mod shown;
mod stats;
mod study;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::Error;
use crate::console::help::{CompletionsArgs, ManArgs};
use crate::console::{self, Verbosity};

/// Offline glTF renderer that finds, for each pixel, the balance between light and BSDF sampling.
#[derive(Debug, Parser)]
#[command(name = "bismar", version, long_version = console::VERSION, arg_required_else_help = true, max_term_width = 100)]
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
    #[command(hide = true)]
    BatchWorker(batch::WorkerArgs),
    Farm(farm::FarmArgs),
    Merge(merge::MergeArgs),
    Compare(compare::CompareArgs),
    Develop(develop::DevelopArgs),
    Movie(movie::MovieArgs),
    Study(study::StudyArgs),
    Completions(CompletionsArgs),
    Man(ManArgs),
}

/// Runs the program with the process's arguments.
pub fn run() -> ExitCode {
    if let Err(error) = study::help(std::env::args_os()) {
        return console::fail(&error);
    }
    console::run(
        |cli: &Cli| cli.verbosity,
        |cli| match &cli.command {
            Command::Render(args) if args.frames.is_some() => {
                // What was parsed once is parsed again: which flags were given is what the frames' processes are told.
                let matches = Cli::command().get_matches();
                let own = matches.subcommand_matches("render").ok_or_else(|| Error::Bug("no render".into()))?;
                batch::sequence(args, own, cli.verbosity)
            }
            Command::Render(args) => render::run(args, cli.verbosity),
            Command::Inspect(args) => inspect::run(args),
            Command::Batch(args) => batch::run(args, cli.verbosity),
            Command::BatchWorker(_) => batch::work(),
            Command::Farm(args) => farm::run(args),
            Command::Merge(args) => merge::run(args, cli.verbosity),
            Command::Compare(args) => compare::run(args),
            Command::Develop(args) => develop::run(args, cli.verbosity),
            Command::Movie(args) => movie::run(args, cli.verbosity),
            Command::Study(args) => study::run(args, cli.verbosity),
            Command::Completions(args) => args.run(Cli::command()),
            Command::Man(args) => args.run(Cli::command()),
        },
    )
}
