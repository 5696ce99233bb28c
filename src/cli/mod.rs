//! The command line: one file a command. Exit codes are those of [`Error::exit_code`], 0, and 1 for a comparison
//! beyond its threshold.

mod batch;
mod compare;
mod farm;
mod host;
mod inspect;
mod memory;
mod merge;
mod panics;
mod progress;
mod render;
mod signals;
mod stability;
mod stats;
mod study;

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::panic::catch_unwind;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use tracing_subscriber::EnvFilter;

use crate::{Error, Result};

/// Offline glTF renderer that finds, for each pixel, the balance between light and BSDF sampling.
#[derive(Debug, Parser)]
#[command(name = "bismar", version, arg_required_else_help = true, max_term_width = 100)]
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
    Farm(farm::FarmArgs),
    Merge(merge::MergeArgs),
    Compare(compare::CompareArgs),
    Study(study::StudyArgs),
}

/// How much is said on stderr.
#[derive(Debug, Clone, Copy, Args)]
struct Verbosity {
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Say what is done; twice for more.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

/// What a command that did its work ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Exit code 0.
    Done,
    /// Exit code 1: the pictures differ beyond the threshold.
    Beyond,
    /// The worst exit code of several jobs, which have been reported.
    Worst(u8),
}

/// Runs the program with the process's arguments.
pub fn run() -> ExitCode {
    panics::install_hook();
    if let Err(error) = host::check_isa() {
        return fail(&error);
    }
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            // Nowhere to print to is no reason to fail differently.
            let _ = e.print();
            return if e.use_stderr() { ExitCode::from(64) } else { ExitCode::SUCCESS };
        }
    };
    start_logging(cli.verbosity);
    // A panic on a rayon thread arrives here too, once the pool has unwound.
    let result = catch_unwind(|| match &cli.command {
        Command::Render(args) => render::run(args, cli.verbosity),
        Command::Inspect(args) => inspect::run(args),
        Command::Batch(args) => batch::run(args, cli.verbosity),
        Command::Farm(args) => farm::run(args),
        Command::Merge(args) => merge::run(args, cli.verbosity),
        Command::Compare(args) => compare::run(args),
        Command::Study(args) => study::run(args, cli.verbosity),
    });
    match result {
        Ok(Ok(Verdict::Done)) => ExitCode::SUCCESS,
        Ok(Ok(Verdict::Beyond)) => ExitCode::from(1),
        Ok(Ok(Verdict::Worst(code))) => ExitCode::from(code),
        Ok(Err(error)) => fail(&error),
        // The hook has said what there is to say.
        Err(_) => ExitCode::from(70),
    }
}

fn fail(error: &Error) -> ExitCode {
    say(format_args!("error: {error}"));
    ExitCode::from(error.exit_code())
}

fn start_logging(verbosity: Verbosity) {
    let level = match verbosity {
        Verbosity { quiet: true, .. } => "error",
        Verbosity { verbose: 0, .. } => "warn",
        Verbosity { verbose: 1, .. } => "info",
        _ => "debug",
    };
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(EnvFilter::new(level))
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .log_internal_errors(false);
    // Only a second call in one process fails; the first one's level stays then.
    let _ = subscriber.try_init();
}

/// A line on stderr. `eprintln` would panic when nobody reads it.
fn say(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// A command's result on stdout. A reader that has gone away (`| head`) has had enough: that is no error.
fn print(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::Io(format!("standard output: cannot write: {e}"))),
        _ => Ok(()),
    }
}

/// Pretty JSON on stdout.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    print(serde_json::to_string_pretty(value).map_err(|e| Error::Bug(format!("JSON: {e}")))?)
}
