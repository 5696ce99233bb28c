//! What every program of the project needs between its flags and its exit code: one way to start, speak, show progress,
//! listen to signals and look at the machine.

pub mod args;
pub mod host;
mod panics;
pub mod paths;
pub mod progress;
pub mod signals;

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::{Args, Parser};
use tracing::Level;

use crate::{Error, Result};
pub use args::Size;
pub use paths::Paths;
pub use progress::Reporter;
pub use signals::Signals;

/// How much is said on stderr.
#[derive(Debug, Clone, Copy, Args)]
pub struct Verbosity {
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say what is done; twice for more.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

/// What a command that did its work ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Exit code 0.
    Done,
    /// Exit code 1: what was compared differs beyond what is allowed.
    Beyond,
    /// The worst exit code of several jobs, which have been reported.
    Worst(u8),
}

/// Runs a program with the process's arguments: parses them, starts logging as loud as `verbosity` says, does `work`.
/// Exit codes are those of [`Verdict`] and [`Error::exit_code`], 70 for a panic.
pub fn run<Cli: Parser>(verbosity: impl Fn(&Cli) -> Verbosity, work: impl FnOnce(&Cli) -> Result<Verdict>) -> ExitCode {
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
    start_logging(verbosity(&cli));
    // A panic on a rayon thread arrives here too, once the pool has unwound. Nothing is used after it but the exit code.
    match catch_unwind(AssertUnwindSafe(|| work(&cli))) {
        Ok(Ok(Verdict::Done)) => ExitCode::SUCCESS,
        Ok(Ok(Verdict::Beyond)) => ExitCode::from(1),
        Ok(Ok(Verdict::Worst(code))) => ExitCode::from(code),
        Ok(Err(error)) => fail(&error),
        // The hook has said what there is to say.
        Err(_) => ExitCode::from(70),
    }
}

/// Says an error; its exit code.
pub fn fail(error: &Error) -> ExitCode {
    say(format_args!("error: {error}"));
    ExitCode::from(error.exit_code())
}

fn start_logging(verbosity: Verbosity) {
    let level = match verbosity {
        Verbosity { quiet: true, .. } => Level::ERROR,
        Verbosity { verbose: 0, .. } => Level::WARN,
        Verbosity { verbose: 1, .. } => Level::INFO,
        _ => Level::DEBUG,
    };
    let subscriber = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .without_time()
        .log_internal_errors(false);
    // Only a second call in one process fails; the first one's level stays then.
    let _ = subscriber.try_init();
}

/// A line on stderr. `eprintln` would panic when nobody reads it.
pub fn say(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// A command's result on stdout. A reader that has gone away (`| head`) has had enough: that is no error.
///
/// # Errors
/// [`Error::Io`] when it cannot be written for another reason.
pub fn print(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::Io(format!("standard output: cannot write: {e}"))),
        _ => Ok(()),
    }
}

/// Pretty JSON on stdout.
///
/// # Errors
/// As [`print()`].
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    print(serde_json::to_string_pretty(value).map_err(|e| Error::Bug(format!("JSON: {e}")))?)
}
