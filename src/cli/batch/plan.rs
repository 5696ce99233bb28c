//! The jobs of a batch: read from its file, with their flags parsed and their files checked.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::Path;

use clap::error::{ContextKind, ContextValue};
use clap::{ArgAction, Command, FromArgMatches, ValueHint};

use crate::batch::file::{self, Flag, JobText, split_all};
use crate::batch::job::Job;
use crate::cli::options::reason;
use crate::cli::render::{RenderArgs, command};
use crate::console::Paths;
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
    "signals-from-parent",
];

/// Reads a batch file; a sequence of frames is one job.
/// Errors: [`Error::Config`] with line and column.
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
                _ if Technique::ALL.iter().any(|technique| technique.row().flag == name) => Flag::Mode,
                _ if ["env", "cameras"].contains(&name.as_str()) => Flag::Input,
                _ if arg.get_value_hint() == ValueHint::AnyPath => Flag::File,
                _ => Flag::Value,
            };
            (name, flag)
        })
        .collect();
    let jobs = file::read(path, &flags)?;
    jobs.into_iter().map(|text| parse(path, &command, text)).collect()
}

/// Splits sequences into one job per picture. Also returns all files of the jobs: no job may write a file that it or another job
/// reads or writes. `file` is the batch file, if there is one.
/// Errors: [`Error::Config`], with line and column in `file`.
pub fn plan(file: Option<&Path>, jobs: &[Job]) -> Result<(Vec<Job>, Paths)> {
    let wrong = |why: String| Error::Config(why);
    let mut jobs = split_all(jobs).map_err(|((line, column), why)| match file {
        Some(file) => wrong(format!("{}:{line}:{column}: {why}", file.display())),
        None => wrong(why),
    })?;
    let mut paths = Paths::default();
    file.iter().try_for_each(|file| paths.reads("the batch file", file))?;
    for job in &mut jobs {
        job.request.resume = true;
        job.request.declare(&format!(" of '{}'", job.name), &mut paths).map_err(|e| match file {
            Some(file) => wrong(format!("{}: job '{}': {e}", job.location.text(file, None), job.name)),
            None => wrong(e.to_string()),
        })?;
    }
    Ok((jobs, paths))
}

/// Parses a job's flags as `bismar render` would.
fn parse(file: &Path, command: &Command, text: JobText) -> Result<Job> {
    let JobText { name, scene, output, flags, location } = text;
    let wrong =
        |key: Option<&str>, why: &str| Error::Config(format!("{}: job '{name}': {why}", location.text(file, key)));
    let line = [OsString::from("render"), scene.into()].into_iter().chain(flags.into_iter().map(OsString::from));
    let matches = command.clone().try_get_matches_from(line);
    let mut args = matches.and_then(|matches| RenderArgs::from_arg_matches(&matches)).map_err(|e| {
        let named = match e.get(ContextKind::InvalidArg) {
            Some(ContextValue::String(arg)) => Some(arg.as_str()),
            Some(ContextValue::Strings(args)) => args.first().map(String::as_str),
            _ => None,
        };
        let key = named.map(|arg| arg.trim_start_matches('-').split([' ', '=']).next().unwrap_or(arg));
        wrong(key, &reason(&e))
    })?;
    args.output = Some(output);
    let job = args.job(name.clone());
    Ok(Job { location: location.clone(), ..job.map_err(|e| wrong(None, &e.to_string()))? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(text: &str) -> Result<(Vec<Job>, Vec<Job>)> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("b.toml");
        std::fs::write(&file, text).unwrap();
        let jobs = read(&file)?;
        let split = plan(Some(&file), &jobs)?.0;
        Ok((jobs, split))
    }

    #[test]
    fn frames_are_one_job_until_they_are_split() {
        let text = "[defaults]\noutput = 'out/{name}.exr'\npreview = 'p/{name}-{frame:02}.png'\n[[matrix]]\n\
                    scene = 'a.glb'\ncamera = ['x', 'y']\nframes = '1-9x4'\n[[job]]\nscene = 'a.glb'\nname = 'b-##'\n\
                    frames = [7, 12]\nseed-per-frame = false\n[[job]]\nscene = 'b.glb'\npreview = 'still.png'";
        let (jobs, frames) = jobs(text).unwrap();
        assert_eq!(jobs.iter().map(|j| j.name.as_str()).collect::<Vec<_>>(), ["a-x.####", "a-y.####", "b-##", "b"]);
        assert_eq!(frames.len(), 9);
        for (job, name, output, preview, flags) in [
            (2, "a-x.0009", "out/a-x.0009.exr", "p/a-x.0009-09.png", "camera x, frame 9, resume, seed-per-frame"),
            (7, "b-12", "out/b-12.exr", "p/b-12-12.png", "frame 12, resume, seed-per-frame false"),
            (8, "b", "b.exr", "still.png", "resume"),
        ] {
            let Job { name: own, request, .. } = &frames[job];
            assert_eq!(own, name);
            assert!(request.output.ends_with(output) && request.preview.as_ref().unwrap().ends_with(preview));
            let mut own = request.flags().unwrap();
            own.retain(|(name, _)| name != "preview");
            own.sort();
            let text = |(name, value): (String, Option<String>)| value.map_or(name.clone(), |v| format!("{name} {v}"));
            assert_eq!(own.into_iter().map(text).collect::<Vec<_>>().join(", "), flags);
        }
    }

    #[test]
    fn mistakes_are_reported_with_their_location() {
        for (text, place, words) in [
            ("[[job]]\nscene = 'a'\n[[job]]\nscene = 'b/a.glb'", "3:1", "two jobs are called 'a'"),
            ("[[matrix]]\nscene = 'a'\nseed = [1, 2]\noutput = 'o.exr'", "1:1", "both write"),
            ("[[job]]\nscene = 'a'\nframes = '5-1'", "3:1", "ends before"),
            ("[[job]]\nscene = 'a'\nframes = '1-1e9'", "3:1", "is not a frame"),
            ("[[job]]\nscene = 'a'\nframes = '1-9'\noutput = 'o.exr'", "4:1", "####"),
            ("[[matrix]]\nscene = 'a'\nframes = '1-99999'\nseed = [1, 2]", "1:1", "with its frames"),
            ("[[job]]\nscene = 'a'\nframes = '1-2'\nturntable = 3", "", "cannot be used with"),
        ] {
            let error = jobs(text).unwrap_err();
            let (exit_code, why) = (error.exit_code(), error.to_string());
            assert!(
                exit_code == 78 && why.contains(&format!("b.toml:{place}")) && why.contains(words),
                "{text}: {why}"
            );
        }
    }
}
