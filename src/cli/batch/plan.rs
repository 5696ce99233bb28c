//! The jobs of a batch: read from its file, one per frame, with their flags parsed and their files checked.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::Path;

use clap::error::{ContextKind, ContextValue};
use clap::{ArgAction, Command, ValueHint};

use crate::batch::file::{self, Flag};
use crate::batch::frames::split;
use crate::batch::job::Job;
use crate::cli::flag_values::reason;
use crate::cli::render::{self, command};
use crate::console::Paths;
use crate::job::RenderRequest;
use crate::render::Technique;
use crate::{Error, Result};

/// Flags of `render` that a batch file must not hold.
const NOT_IN_FILES: [&str; 11] = [
    "relative-to",
    "placed",
    "resume",
    "replay-pixel",
    "progress",
    "threads",
    "part",
    "memory-limit",
    "path-mapping",
    "on-checkpoint",
    "led",
];

/// A job with its flags parsed.
pub struct Planned {
    /// The job.
    pub job: Job,
    /// What it asks for.
    pub request: RenderRequest,
}

/// Reads a batch file; a sequence of frames is one job.
///
/// # Errors
/// [`Error::Config`] with line and column.
pub fn read(path: &Path) -> Result<Vec<Job>> {
    let command = command();
    let flags: HashMap<String, Flag> = command
        .get_arguments()
        .filter_map(|arg| Some((arg.get_long()?.to_owned(), arg)))
        .filter(|(name, _)| !NOT_IN_FILES.contains(&name.as_str()) && name != "help")
        .map(|(name, arg)| {
            let flag = match arg.get_action() {
                ArgAction::SetTrue => Flag::Switch,
                _ if name == "size" => Flag::List('x'),
                _ if ["aov", "crop", "frames", "orbit", "sunsky"].contains(&name.as_str()) => Flag::List(','),
                _ if name == "seed-per-frame" => Flag::Choice,
                _ if Technique::of_flag(&name).is_some() => Flag::Mode,
                _ if ["env", "cameras"].contains(&name.as_str()) => Flag::Input,
                _ if arg.get_value_hint() == ValueHint::AnyPath => Flag::File,
                _ => Flag::Value,
            };
            (name, flag)
        })
        .collect();
    file::read(path, &flags)
}

/// Splits sequences into one job per frame and parses every job's flags. `file` is the batch file, if there is one. Also
/// returns all files of the jobs: no job may write a file that it or another job reads or writes.
///
/// # Errors
/// [`Error::Config`], with line and column in `file`.
pub fn plan(file: Option<&Path>, jobs: Vec<Job>) -> Result<(Vec<Planned>, Paths)> {
    let command = command();
    let mut planned = Vec::new();
    for job in jobs {
        let whole = job.clone();
        let frames = split(job).map_err(|(key, why)| job_error(file, &whole, Some(&key), &why))?;
        for frame in frames {
            planned.push(parse_flags(file, &command, frame)?);
        }
    }
    let mut paths = Paths::default();
    file.iter().try_for_each(|file| paths.reads("the batch file", file))?;
    for Planned { job, request } in &planned {
        request
            .declare(&format!(" of '{}'", job.name), &mut paths)
            .map_err(|e| job_error(file, job, None, &e.to_string()))?;
    }
    Ok((planned, paths))
}

/// Error about a job, with its line and column in the file.
fn job_error(file: Option<&Path>, job: &Job, key: Option<&str>, why: &str) -> Error {
    Error::Config(match file {
        Some(file) => format!("{}: job '{}': {why}", job.location.text(file, key), job.name),
        None => why.into(),
    })
}

/// Parses a job's flags as `bismar render` would.
///
/// # Errors
/// [`Error::Config`], with line and column in `file`.
pub fn parse_flags(file: Option<&Path>, command: &Command, job: Job) -> Result<Planned> {
    let mut line = vec!["render".into(), job.scene.clone().into_os_string()];
    line.extend(job.arguments().into_iter().map(OsString::from));
    let mut args = render::read(command, line).map_err(|e| {
        let named = match e.get(ContextKind::InvalidArg) {
            Some(ContextValue::String(arg)) => Some(arg.as_str()),
            Some(ContextValue::Strings(args)) => args.first().map(String::as_str),
            _ => None,
        };
        let key = named.map(|arg| arg.trim_start_matches('-').split([' ', '=']).next().unwrap_or(arg).to_owned());
        job_error(file, &job, key.as_deref(), &reason(&e))
    })?;
    args.output = Some(job.output.clone());
    args.resume = true;
    let request = args.request().map_err(|e| job_error(file, &job, None, &e.to_string()))?;
    Ok(Planned { job, request })
}
