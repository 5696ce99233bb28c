//! `bismar render --frames`: the pictures of one scene as a batch.

use super::plan::plan;
use super::work::Work;
use crate::cli::render::RenderArgs;
use crate::console::{Verbosity, Verdict};
use crate::film::atomic;
use crate::{Error, Result};

/// Renders the pictures.
pub fn run(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let (job, folders) = args.sequence()?;
    atomic::confine(&folders);
    let file = job.scene.display().to_string();
    // There is no batch file that could be wrong.
    let (jobs, paths) = plan(None, vec![job]).map_err(|e| match e {
        Error::Config(why) => Error::Usage(why),
        other => other,
    })?;
    let work = Work {
        file,
        order: jobs.iter().map(|j| j.job.name.clone()).collect(),
        folders,
        at_once: 1,
        threads: args.threads,
        style: args.progress,
        signals_from_parent: args.signals_from_parent,
        ..Work::default()
    };
    work.run(jobs, paths, verbosity)
}
