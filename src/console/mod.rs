//! What every program of the project needs between its flags and its exit code: one way to start, speak, show progress,
//! listen to signals and look at the machine.

pub mod args;
pub mod child;
pub mod help;
pub mod host;
mod logging;
pub mod memory;
mod panics;
pub mod paths;
pub mod progress;
pub mod screen;
pub mod signals;
pub mod stderr;
pub mod tev;

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::{Args, Parser};

use crate::{Error, Result};
pub use args::Size;
pub use logging::{Format as LogFormat, say};
pub use paths::Paths;
pub use progress::Reporter;
pub use signals::Signals;

/// The commit that a release was built from; other builds say that they are none.
pub const COMMIT: &str = env!("BISMAR_COMMIT");

/// What `--version` says: the program's version and what it was built from.
pub const VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    "\ncommit ",
    env!("BISMAR_COMMIT"),
    "\nEmbree ",
    env!("BISMAR_EMBREE_HEADER_VERSION"),
    ", obvhs ",
    env!("BISMAR_OBVHS_VERSION"),
    "\ncompiled for ",
    env!("BISMAR_ISA_BASELINE"),
);

/// How much is said on stderr.
#[derive(Debug, Clone, Copy, Args)]
pub struct Verbosity {
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say what is done, and when; twice for more, thrice for all. The variable RUST_LOG chooses finer.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// How lines on stderr look.
    #[arg(long, global = true, value_enum, default_value_t, value_name = "FORMAT")]
    pub log: LogFormat,
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
    if let Err(error) = host::check_isa().and_then(|()| memory::exit_when_exhausted()) {
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
    logging::start(verbosity(&cli));
    // A panic on a rayon thread arrives here too, once the pool has unwound. Nothing is used after it but the exit code.
    let code = match catch_unwind(AssertUnwindSafe(|| work(&cli))) {
        Ok(Ok(Verdict::Done)) => ExitCode::SUCCESS,
        Ok(Ok(Verdict::Beyond)) => ExitCode::from(1),
        Ok(Ok(Verdict::Worst(code))) => ExitCode::from(code),
        Ok(Err(error)) => fail(&error),
        // The hook has said what there is to say.
        Err(_) => ExitCode::from(70),
    };
    stderr::flush();
    code
}

/// Says an error; its exit code.
pub fn fail(error: &Error) -> ExitCode {
    logging::say_error(error);
    stderr::flush();
    ExitCode::from(error.exit_code())
}

/// A command's result on stdout, as [`say`] shows it. A reader that has gone away (`| head`) has had enough: that is no
/// error.
///
/// # Errors
/// [`Error::Io`] when it cannot be written for another reason.
pub fn print(text: impl Display) -> Result<()> {
    print_as_it_is(&shown(&text.to_string()))
}

fn print_as_it_is(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Error::Io(format!("standard output: cannot write: {e}"))),
        _ => Ok(()),
    }
}

/// With control characters as escapes, but for the ends of lines and tabs.
fn shown(text: &str) -> String {
    let control = |c: char| c.is_control() && c != '\n' && c != '\t';
    if !text.contains(control) {
        return text.into();
    }
    text.chars().map(|c| if control(c) { c.escape_default().to_string() } else { c.into() }).collect()
}

/// Pretty JSON on stdout.
///
/// # Errors
/// As [`print()`].
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    // JSON has escapes of its own.
    print_as_it_is(&serde_json::to_string_pretty(value).map_err(|e| Error::Bug(format!("JSON: {e}")))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown() {
        assert_eq!(shown("a\nb\tc"), "a\nb\tc");
        assert_eq!(shown("\u{1b}[2J\r\u{85}é"), "\\u{1b}[2J\\r\\u{85}é");
    }
}
