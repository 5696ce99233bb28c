//! `bismar study`: becomes `bismar-study`, the program of the crate `study/`, which lies beside this one.

use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::Command;

use clap::Args;

use crate::console::{LogFormat, Verbosity, Verdict};
use crate::{Error, Result};

/// Measure what the program's choices are worth: balance, stability, rays
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub struct StudyArgs {
    /// A study and its flags.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    line: Vec<OsString>,
}

/// Becomes the other program, so that signals and the exit code are its own.
pub fn run(args: &StudyArgs, verbosity: Verbosity) -> Result<Verdict> {
    let loudness = if verbosity.quiet { vec!["-q"] } else { vec!["-v"; verbosity.verbose.into()] };
    let format = if verbosity.log == LogFormat::Json { vec!["--log=json"] } else { Vec::new() };
    Err(become_study(loudness.into_iter().chain(format).map(OsString::from).chain(args.line.iter().cloned())))
}

/// `bismar help study …` is for the other program to answer; returns if that was not asked.
///
/// # Errors
/// [`Error::Host`] if it cannot be started.
pub fn help(mut line: impl Iterator<Item = OsString>) -> Result<()> {
    if line.nth(1).is_some_and(|word| word == "help") && line.next().is_some_and(|word| word == "study") {
        return Err(become_study(["help".into()].into_iter().chain(line)));
    }
    Ok(())
}

/// Returns only if it cannot.
fn become_study(line: impl Iterator<Item = OsString>) -> Error {
    let program = match std::env::current_exe() {
        Ok(here) => here.with_file_name("bismar-study"),
        Err(e) => return Error::Host(format!("cannot tell where this program is: {e}")),
    };
    let error = Command::new(&program).args(line).exec();
    let advice = match error.kind() {
        ErrorKind::NotFound => "; studies are a program of their own: put it beside bismar, or `make build` it",
        _ => "",
    };
    Error::Host(format!("{}: cannot start: {error}{advice}", program.display()))
}
