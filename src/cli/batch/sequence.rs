//! `bismar render --frames`: the frames of one scene as a batch.

use std::path::{Component, Path, PathBuf};

use clap::{ArgMatches, Args, Command};

use super::plan::plan;
use super::work::Work;
use crate::batch::job::Job;
use crate::batch::views;
use crate::cli::render::{RenderArgs, given};
use crate::console::{Verbosity, Verdict, progress};
use crate::farm::utf8;
use crate::film::atomic;
use crate::{Error, Result};

/// The folder of an output, before the first of its folders whose name holds the frame's number.
fn folder(output: &Path) -> PathBuf {
    let has_number = |part: &Component| part.as_os_str().to_string_lossy().contains(['#', '{']);
    let parent = output.parent().unwrap_or(Path::new(""));
    let before: PathBuf = parent.components().take_while(|part| !has_number(part)).collect();
    if before.as_os_str().is_empty() { ".".into() } else { before }
}

/// Flags that the sequence handles itself and does not pass to its jobs.
const NOT_FOR_JOBS: [&str; 6] = ["resume", "progress", "threads", "path-mapping", "led", "output"];

/// Renders the frames; `matches` are the parsed command line, which tells the flags that were given.
pub fn run(args: &RenderArgs, matches: &ArgMatches, verbosity: Verbosity) -> Result<Verdict> {
    let result = render(args, matches, verbosity);
    result.inspect_err(|error| progress::failed(args.progress, error))
}

fn render(args: &RenderArgs, matches: &ArgMatches, verbosity: Verbosity) -> Result<Verdict> {
    args.check()?;
    let args = &args.on_this_machine()?;
    // For the exit code of a file that is missing or wrong.
    args.cameras.iter().try_for_each(|file| views::read(file).map(drop))?;
    let command = RenderArgs::augment_args(Command::new("render"));
    let mut flags = given(&command, matches)?;
    flags.retain(|(name, _)| !NOT_FOR_JOBS.contains(&name.as_str()));
    // Paths after --path-mapping.
    for (name, path) in
        [("env", &args.env), ("cameras", &args.cameras), ("preview", &args.preview), ("stats", &args.stats)]
    {
        for (_, value) in flags.iter_mut().filter(|(flag, _)| flag == name) {
            *value = path.as_deref().map(|path| utf8(path).map(str::to_owned)).transpose()?;
        }
    }
    let output = args.output();
    let name = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let job = Job { name, scene: args.scene.clone(), flags, output, ..Job::default() };
    let folders: Vec<PathBuf> = [Some(&job.output), args.preview.as_ref(), args.stats.as_ref()]
        .into_iter()
        .flatten()
        .map(|path| folder(path))
        .collect();
    atomic::confine(&folders);
    // There is no batch file that could be wrong.
    let (jobs, paths) = plan(None, vec![job]).map_err(|e| match e {
        Error::Config(why) => Error::Usage(why),
        other => other,
    })?;
    let work = Work {
        file: args.scene.display().to_string(),
        order: jobs.iter().map(|j| j.job.name.clone()).collect(),
        report: None,
        events: None,
        folders,
        at_once: 1,
        isolate: false,
        dry_run: false,
        threads: args.threads,
        style: args.progress,
        signals_from_parent: args.signals_from_parent,
    };
    work.run(jobs, paths, verbosity)
}
