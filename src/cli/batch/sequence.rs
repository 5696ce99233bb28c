//! `bismar render --frames`: a batch of one scene's frames.

use clap::{ArgMatches, Args, Command};

use super::{Work, plan};
use crate::batch::file::Job;
use crate::cli::render::{RenderArgs, given};
use crate::console::progress::Style;
use crate::console::{Verbosity, Verdict, print};
use crate::farm::utf8;
use crate::{Error, Result};

/// Flags that are the sequence's own affair: it goes on always, by itself, and shows its own progress.
const OWN: [&str; 6] = ["resume", "progress", "threads", "path-mapping", "led", "output"];

/// Renders the frames; `matches` are what the command line said.
pub fn run(args: &RenderArgs, matches: &ArgMatches, verbosity: Verbosity) -> Result<Verdict> {
    let result = render(args, matches, verbosity);
    if let (Err(error), Style::Openjd) = (&result, args.progress) {
        print(format_args!("openjd_fail: {}", error.to_string().replace('\n', " ")))?;
    }
    result
}

fn render(args: &RenderArgs, matches: &ArgMatches, verbosity: Verbosity) -> Result<Verdict> {
    args.check()?;
    let args = &args.on_this_machine()?;
    let command = RenderArgs::augment_args(Command::new("render"));
    let mut flags = given(&command, matches)?;
    flags.retain(|(name, _)| !OWN.contains(&name.as_str()));
    // Paths as they are on this machine.
    for (name, path) in [("env", &args.env), ("preview", &args.preview), ("stats", &args.stats)] {
        for (_, value) in flags.iter_mut().filter(|(flag, _)| flag == name) {
            *value = path.as_deref().map(|path| utf8(path).map(str::to_owned)).transpose()?;
        }
    }
    let output = args.output();
    let name = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let job = Job { name, scene: args.scene.clone(), flags, output, at: Default::default() };
    // Nothing here is of a batch file.
    let (jobs, paths) = plan(None, vec![job]).map_err(|e| match e {
        Error::Config(why) => Error::Usage(why),
        other => other,
    })?;
    let work = Work {
        file: args.scene.display().to_string(),
        order: jobs.iter().map(|j| j.job.name.clone()).collect(),
        report: None,
        events: None,
        at_once: 1,
        isolate: false,
        dry_run: false,
        threads: args.threads,
        style: args.progress,
        led: args.led,
    };
    work.carry_out(jobs, paths, verbosity)
}
