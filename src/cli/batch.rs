//! `bismar batch JOBS.toml`

mod overview;
mod plan;
mod work;
mod worker;
mod worker_pool;

use std::path::{Path, PathBuf};

use clap::Args;
use glob::Pattern;

use crate::cli::render::RenderArgs;
use crate::console::args::threads;
use crate::console::{Verbosity, Verdict};
use crate::film::atomic;
use crate::{Error, Result};
pub use plan::{plan, read};
pub use work::Work;
pub use worker::run as work;

/// Render the jobs of a batch file: scenes, cameras, settings (docs/batch.md).
///
/// A failed job does not stop the others. Running the same command again renders missing and changed pictures and resumes
/// interrupted ones. The exit code is the highest of all jobs, or 75 after SIGINT, SIGTERM, SIGHUP or SIGUSR1.
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// The batch file (TOML).
    file: PathBuf,
    /// Number of jobs to render at the same time; they share the threads.
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: u32,
    /// Render each job in its own process; scenes are not shared between jobs.
    #[arg(long)]
    isolate: bool,
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// Render only jobs whose names match this pattern, as in 'hall-*'; may be repeated. The report keeps the entries of the
    /// other jobs.
    #[arg(long, value_name = "PATTERN")]
    only: Vec<Pattern>,
    /// Folder below which outputs may lie; may be repeated [default: the batch file's folder].
    #[arg(long, value_name = "DIR")]
    root: Vec<PathBuf>,
    /// Print the commands that would run and what they would do, without running them.
    #[arg(long)]
    dry_run: bool,
    /// JSON report [default: the batch file's name with -report.json, in the same folder].
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Append events as JSON, one per line, as they happen; - is standard output.
    #[arg(long, value_name = "FILE")]
    events: Option<PathBuf>,
}

pub fn run(args: &BatchArgs, verbosity: Verbosity) -> Result<Verdict> {
    let report = args.report.clone().unwrap_or_else(|| {
        let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
        args.file.with_file_name(format!("{stem}-report.json"))
    });
    // The default report follows from the batch file that the command line names. What waits in its place may be of others.
    if args.report.is_none() {
        atomic::check_below(&report, &[])?;
        atomic::check_ours(&report, None)?;
    }
    [&report].into_iter().chain(&args.events).for_each(|path| atomic::named(path));
    let folders = roots(&args.file, &args.root);
    atomic::confine(&folders);
    let (mut jobs, paths) = plan(Some(&args.file), &read(&args.file)?)?;
    let order: Vec<String> = jobs.iter().map(|job| job.name.clone()).collect();
    if !args.only.is_empty() {
        jobs.retain(|job| args.only.iter().any(|pattern| pattern.matches(&job.name)));
        if jobs.is_empty() {
            let names = order.iter().take(20).cloned().collect::<Vec<_>>().join(", ");
            let more = if order.len() > 20 { ", …" } else { "" };
            return Err(Error::Usage(format!("--only: no job's name matches; the jobs are {names}{more}")));
        }
    }
    let work = Work {
        file: args.file.display().to_string(),
        order,
        report: Some(report),
        events: args.events.clone(),
        folders,
        at_once: args.jobs as usize,
        isolate: args.isolate,
        dry_run: args.dry_run,
        threads: args.threads,
        ..Work::default()
    };
    work.run(jobs, paths, verbosity)
}

/// Renders the pictures of `bismar render --frames`, `--turntable` or `--cameras` as a batch.
pub fn sequence(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let (job, folders) = args.job_and_folders()?;
    atomic::confine(&folders);
    let (file, threads) = (job.request.scene.display().to_string(), job.request.threads);
    // There is no batch file that could be wrong.
    let (jobs, paths) = plan(None, &[job]).map_err(|e| match e {
        Error::Config(why) => Error::Usage(why),
        other => other,
    })?;
    let work = Work {
        file,
        order: jobs.iter().map(|job| job.name.clone()).collect(),
        folders,
        at_once: 1,
        threads,
        style: args.progress,
        signals_from_parent: args.signals_from_parent,
        ..Work::default()
    };
    work.run(jobs, paths, verbosity)
}

/// Folders below which the outputs of a batch file may lie: its own, or those that the command line names.
pub fn roots(file: &Path, named: &[PathBuf]) -> Vec<PathBuf> {
    let own = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if named.is_empty() { vec![own.into()] } else { named.to_vec() }
}
