//! Shared parts of the command-line programs: start-up, output, logging, progress, signals, and queries of the host.

pub mod args;
mod caller;
pub mod child;
pub mod help;
pub mod host;
mod logging;
pub mod memory;
pub mod panics;
pub mod paths;
pub mod progress;
pub mod screen;
pub mod signals;
pub mod tev;
mod writers;

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Arc;

use clap::Parser;

use crate::film::atomic;
use crate::{Error, Result};
pub use args::Size;
pub use logging::{Format as LogFormat, Verbosity, say};
pub use logging::{escaped, escaped_json};
pub use paths::Paths;
pub use progress::Reporter;
pub use signals::Signals;

/// The signal of a write beyond a file's largest size, by POSIX; the number is Linux'.
const SIGXFSZ: i32 = 25;

/// The commit that a release was built from; `development` or `unknown` for other builds.
pub const COMMIT: &str = env!("BISMAR_COMMIT");

/// The exit code of a command that did its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Done,
    /// Exit code 1: a comparison exceeds its limits.
    Beyond,
    /// The highest exit code of several jobs, which have been reported.
    Worst(u8),
}

/// Runs a program: parses the process's arguments, starts logging with the given verbosity, does `work`.
/// Exit codes are those of [`Verdict`] and [`Error::exit_code`], 70 for a panic.
pub fn run<Cli: Parser>(verbosity: impl Fn(&Cli) -> Verbosity, work: impl FnOnce(&Cli) -> Result<Verdict>) -> ExitCode {
    panics::install_hook();
    atomic::begin_command();
    caller::end_with_caller();
    // Beyond a file's largest size (ulimit -f) a write then fails as on a full disk, and leaves nothing.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    if let Err(error) = host::check_isa().and_then(|()| memory::exit_when_exhausted()) {
        return fail(&error);
    }
    let cli = match Cli::try_parse_from(args::command_line()) {
        Ok(cli) => cli,
        Err(e) => {
            // The exit code is the same if nothing can be printed.
            let _ = e.print();
            return if e.use_stderr() { ExitCode::from(64) } else { ExitCode::SUCCESS };
        }
    };
    logging::start(verbosity(&cli));
    // Panics of rayon threads arrive here too, after the pool has unwound. Only the exit code is used after a panic.
    let code = match catch_unwind(AssertUnwindSafe(|| work(&cli))) {
        Ok(Ok(Verdict::Done)) => ExitCode::SUCCESS,
        Ok(Ok(Verdict::Beyond)) => ExitCode::from(1),
        Ok(Ok(Verdict::Worst(code))) => ExitCode::from(code),
        Ok(Err(error)) => fail(&error),
        Err(payload) => match panics::error(&*payload) {
            // The panic hook has printed the message.
            Error::Bug(_) => ExitCode::from(70),
            error => fail(&error),
        },
    };
    writers::flush();
    code
}

/// Prints an error and returns its exit code.
pub fn fail(error: &Error) -> ExitCode {
    logging::say_error(error);
    writers::flush();
    ExitCode::from(error.exit_code())
}

/// Prints a command's result on stdout, with control characters as escapes. A closed pipe (`| head`) is no error.
/// Errors: [`Error::Io`] if stdout cannot be written for another reason.
pub fn print(text: impl Display) -> Result<()> {
    print_unescaped(&escaped(&text.to_string()))
}

fn print_unescaped(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::Io(format!("standard output: cannot write: {e}"))),
        _ => Ok(()),
    }
}

/// Prints indented JSON on stdout.
/// Errors: Those of [`print()`]; [`Error::Bug`] if the value cannot be serialised.
pub(crate) fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
    print_unescaped(&escaped_json(&text))
}
