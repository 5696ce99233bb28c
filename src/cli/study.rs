//! `bismar study`: replaces this process by `bismar-study`, the program of the crate `study/`, in the same folder.

use std::ffi::OsString;
use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::process::Command;

use clap::Args;

use crate::console::{LogFormat, Verbosity, Verdict};
use crate::{Error, Result};

/// Measure the renderer's methods: balance, stability, rays
#[derive(Debug, Args)]
#[command(disable_help_flag = true)]
pub struct StudyArgs {
    /// Name of a study, and its flags.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    line: Vec<OsString>,
}

/// Replaces this process, so that signals and the exit code are those of the study.
/// Errors: [`Error::Host`] if the program cannot be started.
pub fn run(args: &StudyArgs, verbosity: Verbosity) -> Result<Verdict> {
    let verbosity_flags = if verbosity.quiet { vec!["-q"] } else { vec!["-v"; verbosity.verbose.into()] };
    let format = if verbosity.log == LogFormat::Json { vec!["--log=json"] } else { Vec::new() };
    Err(become_study(verbosity_flags.into_iter().chain(format).map(OsString::from).chain(args.line.iter().cloned())))
}

/// Passes `bismar help study …` to the other program; returns for any other command line.
/// Errors: [`Error::Host`] if it cannot be started.
pub fn help(mut line: impl Iterator<Item = OsString>) -> Result<()> {
    if line.nth(1).is_some_and(|word| word == "help") && line.next().is_some_and(|word| word == "study") {
        return Err(become_study(["help".into()].into_iter().chain(line)));
    }
    Ok(())
}

/// Replaces this process; returns only on failure.
fn become_study(line: impl Iterator<Item = OsString>) -> Error {
    let program = match std::env::current_exe() {
        Ok(here) => here.with_file_name("bismar-study"),
        Err(e) => return Error::Host(format!("cannot find this program's file: {e}")),
    };
    let error = Command::new(&program).args(line).exec();
    let advice = match error.kind() {
        ErrorKind::NotFound => "; studies are a separate program: put it next to bismar, or build it with `make build`",
        _ => "",
    };
    Error::Host(format!("{}: cannot start: {error}{advice}", program.display()))
}
