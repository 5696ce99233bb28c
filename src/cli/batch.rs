//! `bismar batch JOBS.toml`

mod overview;
mod sequence;
mod worker;
mod worker_pool;

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use clap::error::{ContextKind, ContextValue};
use clap::{ArgAction, Args, Command, FromArgMatches, ValueHint};
use glob::Pattern;
use serde_json::json;
use tracing::info;

use super::render::{Inputs, RenderArgs, Session, declare};
use crate::batch::file::{self, Flag, Job};
use crate::batch::frames::split;
use crate::batch::message::{Ended, Message};
use crate::batch::queue::Cache;
use crate::batch::report::{self, Report};
use crate::console::args::threads;
use crate::console::progress::Style;
use crate::console::{Paths, Signals, Verbosity, Verdict, host, print, say};
use crate::farm::slurm::quoted;
use crate::film::atomic;
use crate::render::checkpoint::Earlier;
use crate::{Error, Result};
use overview::Overview;
pub use sequence::run as sequence;
pub use worker::{WorkerArgs, run as work};
use worker_pool::WorkerPool;

/// Render what a file lists: many scenes, cameras, settings (docs/batch.md).
///
/// A job that fails does not stop the others. The same command again does what is missing or has changed, and goes on
/// with what was interrupted. The exit code is the highest of any job's, or 75 after SIGINT, SIGTERM, SIGHUP or
/// SIGUSR1.
#[derive(Debug, Args)]
pub struct BatchArgs {
    /// The batch file, TOML.
    file: PathBuf,
    /// Jobs at a time; threads are divided among them.
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: u32,
    /// Each job in a process of its own, with a scene of its own.
    #[arg(long)]
    isolate: bool,
    /// Threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// Only jobs whose names match, as in 'hall-*'; may be given several times. The report keeps the others.
    #[arg(long, value_name = "PATTERN")]
    only: Vec<Pattern>,
    /// Say what would be done, as commands for a shell, and do nothing.
    #[arg(long)]
    dry_run: bool,
    /// Where the JSON report goes [default: the file's name with -report.json, beside it].
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Write what happens as JSON, one event a line, as it happens; - is standard output.
    #[arg(long, value_name = "FILE")]
    events: Option<PathBuf>,
}

/// Flags of `render` that make no sense in a batch file.
const NOT_IN_FILES: [&str; 8] =
    ["resume", "progress", "threads", "part", "memory-limit", "path-mapping", "on-checkpoint", "led"];

/// A job with its flags understood.
pub struct Planned {
    /// The job.
    pub job: Job,
    /// As `bismar render` would take it.
    pub args: RenderArgs,
}

/// Reads a batch file; sequences of frames are one job each.
///
/// # Errors
/// [`Error::Config`] with the place in the file.
pub fn read(path: &Path) -> Result<Vec<Job>> {
    let command = RenderArgs::augment_args(Command::new("render"));
    let flags: HashMap<String, Flag> = command
        .get_arguments()
        .filter_map(|arg| Some((arg.get_long()?.to_owned(), arg)))
        .filter(|(name, _)| !NOT_IN_FILES.contains(&name.as_str()) && name != "help")
        .map(|(name, arg)| {
            let flag = match arg.get_action() {
                ArgAction::SetTrue => Flag::Switch,
                _ if name == "size" => Flag::List('x'),
                _ if ["aov", "crop", "frames"].contains(&name.as_str()) => Flag::List(','),
                _ if name == "seed-per-frame" => Flag::Choice,
                _ if name == "env" => Flag::Input,
                // clap knows a path by its type.
                _ if arg.get_value_hint() == ValueHint::AnyPath => Flag::File,
                _ => Flag::Value,
            };
            (name, flag)
        })
        .collect();
    file::read(path, &flags)
}

/// Jobs as they are carried out, each frame one; `file` is where they are written, if they are. Checks every job's flags,
/// and that no job writes what it or another reads or writes.
///
/// # Errors
/// [`Error::Config`], with the place in the file.
pub fn plan(file: Option<&Path>, jobs: Vec<Job>) -> Result<(Vec<Planned>, Paths)> {
    let command = RenderArgs::augment_args(Command::new("render"));
    let mut planned = Vec::new();
    for job in jobs {
        let whole = job.clone();
        let frames = split(job).map_err(|(key, why)| bad(file, &whole, Some(&key), &why))?;
        for frame in frames {
            planned.push(understand(file, &command, frame)?);
        }
    }
    let mut paths = Paths::default();
    file.iter().try_for_each(|file| paths.reads("the batch file", file))?;
    for Planned { job, args } in &planned {
        declare(args, &format!(" of '{}'", job.name), &mut paths).map_err(|e| bad(file, job, None, &e.to_string()))?;
    }
    Ok((planned, paths))
}

/// What is wrong with a job, and where it stands in its file, if it does.
fn bad(file: Option<&Path>, job: &Job, key: Option<&str>, why: &str) -> Error {
    let why = why.strip_prefix("error: ").unwrap_or(why);
    let why = why.split("\n\n").next().unwrap_or(why);
    Error::Config(match file {
        Some(file) => format!("{}: job '{}': {why}", job.at.of(file, key), job.name),
        None => why.into(),
    })
}

fn understand(file: Option<&Path>, command: &Command, job: Job) -> Result<Planned> {
    let mut line = vec!["render".into(), job.scene.clone().into_os_string()];
    line.extend(job.arguments().into_iter().map(Into::into));
    let matches = command.clone().try_get_matches_from(line).map_err(|e| {
        let named = match e.get(ContextKind::InvalidArg) {
            Some(ContextValue::String(arg)) => Some(arg.as_str()),
            Some(ContextValue::Strings(args)) => args.first().map(String::as_str),
            _ => None,
        };
        let key = named.map(|arg| arg.trim_start_matches('-').split([' ', '=']).next().unwrap_or(arg).to_owned());
        bad(file, &job, key.as_deref(), &e.to_string())
    })?;
    let mut args = RenderArgs::from_arg_matches(&matches).map_err(|e| bad(file, &job, None, &e.to_string()))?;
    args.output = Some(job.output.clone());
    args.resume = true;
    args.check().map_err(|e| bad(file, &job, None, &e.to_string()))?;
    Ok(Planned { job, args })
}

pub fn run(args: &BatchArgs, verbosity: Verbosity) -> Result<Verdict> {
    let (mut jobs, paths) = plan(Some(&args.file), read(&args.file)?)?;
    let report = args.report.clone().unwrap_or_else(|| {
        let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
        args.file.with_file_name(format!("{stem}-report.json"))
    });
    let order: Vec<String> = jobs.iter().map(|j| j.job.name.clone()).collect();
    if !args.only.is_empty() {
        jobs.retain(|planned| args.only.iter().any(|pattern| pattern.matches(&planned.job.name)));
        if jobs.is_empty() {
            let names = order.iter().take(20).cloned().collect::<Vec<_>>().join(", ");
            let more = if order.len() > 20 { ", …" } else { "" };
            return Err(Error::Usage(format!("--only: no job's name matches; there are {names}{more}")));
        }
    }
    let work = Work {
        file: args.file.display().to_string(),
        order,
        report: Some(report),
        events: args.events.clone(),
        at_once: args.jobs as usize,
        isolate: args.isolate,
        dry_run: args.dry_run,
        threads: args.threads,
        style: Style::Auto,
        led: false,
    };
    work.carry_out(jobs, paths, verbosity)
}

/// How jobs are to be done.
struct Work {
    /// Where they come from, for people.
    file: String,
    /// All jobs' names, also of those that are not asked for.
    order: Vec<String>,
    report: Option<PathBuf>,
    events: Option<PathBuf>,
    at_once: usize,
    isolate: bool,
    dry_run: bool,
    threads: Option<usize>,
    style: Style,
    /// Are signals a parent's?
    led: bool,
}

impl Work {
    fn carry_out(&self, mut jobs: Vec<Planned>, mut paths: Paths, verbosity: Verbosity) -> Result<Verdict> {
        let (began, stdout) = (Instant::now(), Path::new("-"));
        self.report.iter().try_for_each(|report| paths.writes("--report", report))?;
        let events_file = self.events.as_ref().filter(|path| *path != stdout);
        events_file.iter().try_for_each(|events| paths.writes("--events", events))?;
        // Jobs with one scene follow one another, and those with scenes from the same files, so that few are in memory at a
        // time.
        let mut first: HashMap<String, usize> = HashMap::new();
        for (i, planned) in jobs.iter().enumerate() {
            first.entry(files_key(&planned.args)).or_insert(i);
            first.entry(scene_key(&planned.args)).or_insert(i);
        }
        jobs.sort_by_key(|planned| [files_key(&planned.args), scene_key(&planned.args)].map(|key| first[&key]));
        if self.dry_run {
            return dry_run(&jobs, &self.order);
        }
        let signals = if self.led { Signals::led() } else { Signals::listen() }?;
        let earlier = self.report.as_deref().map(report::earlier).unwrap_or_default();
        self.report.iter().try_for_each(|report| atomic::check(report))?;
        let events = Events::open(self.events.as_deref())?;
        let (threads, source) = host::threads(self.threads)?;
        let at_once = self.at_once.min(jobs.len());
        let each_threads = (threads / at_once).max(1);
        info!("{at_once} jobs at a time, each on {each_threads} threads ({threads} in all: {source})");

        let overview = Overview::new(jobs.len(), self.style, verbosity.quiet);
        let entries = Mutex::new(Vec::new());
        events.write(json!({"event": "batch-begins", "jobs": jobs.len(), "file": self.file}));
        let told = |message: Message| match message {
            Message::Begins(index) => {
                let job = &jobs[index].job;
                overview.begins(index, &job.name);
                let output = job.output.display().to_string();
                events.write(json!({"event": "job-begins", "job": job.name, "output": output}));
            }
            Message::Goes(index, progress) => overview.progress(index, &progress),
            Message::Ends(index, ended) => {
                let Ended { mut entry, line, before } = *ended;
                if let (Some(earlier), Some(paths)) = (earlier.get(&entry.job), before) {
                    entry.remember(earlier, paths);
                }
                overview.ended(index, &entry, line);
                events.write(json!({"event": "job-ends", "job": entry.job, "status": entry.status,
                    "exit_code": entry.exit_code, "error": entry.error, "seconds": entry.seconds,
                    "output": entry.output}));
                entries.lock().unwrap_or_else(PoisonError::into_inner).push(entry);
            }
        };
        let threads = each_threads;
        let written = self.report.iter().chain(events_file);
        let written: Vec<_> = written.map(|path| path.clone().into_os_string()).collect();
        let worker_pool =
            WorkerPool { jobs: &jobs, written: &written, at_once, threads, signals: &signals, verbosity, told: &told };
        let worked = if self.isolate { worker_pool.work_apart() } else { worker_pool.work_together() };
        overview.finish();
        worked?;

        let mut entries = entries.into_inner().unwrap_or_else(PoisonError::into_inner);
        let place: HashMap<&str, usize> = self.order.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
        entries.sort_by_key(|e| place.get(e.job.as_str()).copied());
        let (exit_code, seconds) = (report::worst(&entries), began.elapsed().as_secs_f64());
        events.write(json!({"event": "batch-ends", "exit_code": exit_code}));
        let (summary, table) = (report::summary(&entries, seconds), overview::table(&entries));
        let verdict = if exit_code == 0 { Verdict::Done } else { Verdict::Worst(exit_code) };
        let Some(report_path) = &self.report else {
            if !verbosity.quiet {
                say(summary);
            }
            return Ok(verdict);
        };
        // What was not asked for stays as it was.
        let asked: HashSet<String> = entries.iter().map(|e| e.job.clone()).collect();
        let others = self.order.iter().filter(|name| !asked.contains(*name));
        entries.extend(others.filter_map(|name| earlier.get(name).cloned()));
        entries.sort_by_key(|e| place.get(e.job.as_str()).copied());
        let report = Report::new(self.file.clone(), seconds, exit_code, entries);
        atomic::write(report_path, |file| {
            serde_json::to_writer_pretty(&mut *file, &report)?;
            file.write_all(b"\n")?;
            Ok(Ok(()))
        })?;
        if !verbosity.quiet {
            if self.events.as_deref() != Some(stdout) {
                print(table.trim_end())?;
            }
            say(format_args!("{summary}; report in {}", report_path.display()));
        }
        Ok(verdict)
    }
}

/// Equal for jobs that can share a scene in memory.
fn scene_key(a: &RenderArgs) -> String {
    format!("{} {:?} {} {:?} {}", files_key(a), a.choices(), a.is_framed(), a.rays, a.strict)
}

/// Equal for jobs whose scenes are made of the same files.
pub fn files_key(a: &RenderArgs) -> String {
    format!("{:?} {:?} {} {} {} {}", a.scene, a.env, a.env_rotate, a.env_strength, a.no_env, a.sky)
}

/// Says what would be done, in the order of the file.
fn dry_run(jobs: &[Planned], order: &[String]) -> Result<Verdict> {
    let cache = Cache::new(jobs.iter().map(|j| files_key(&j.args)));
    let mut rows: HashMap<&str, String> = HashMap::new();
    let mut worst = 0;
    for Planned { job, args } in jobs {
        let key = files_key(args);
        let would = || -> Result<&str> {
            let inputs = cache.get(&key, || Inputs::read(args))?;
            let session = Session { args, inputs: &inputs, threads: 1, began: Instant::now(), replaces: true };
            if session.done_before()?.is_some() {
                return Ok("done before");
            }
            Ok(if Earlier::read(&args.output())?.is_some() { "render again or go on" } else { "render" })
        };
        let what = would().map(str::to_owned).unwrap_or_else(|e| {
            worst = worst.max(e.exit_code());
            format!("would fail: {e}")
        });
        cache.done(&key);
        let mut words: Vec<String> = ["bismar", "render"].map(str::to_owned).into();
        words.extend([job.scene.display().to_string(), "-o".into(), job.output.display().to_string()]);
        words.extend(job.arguments());
        rows.insert(&job.name, format!("{}: {what}\n  {}", job.name, quoted(&words)));
    }
    let lines: Vec<_> = order.iter().filter_map(|name| rows.remove(name.as_str())).collect();
    print(lines.join("\n"))?;
    Ok(if worst == 0 { Verdict::Done } else { Verdict::Worst(worst) })
}

/// JSON, one event a line.
struct Events {
    to: Option<Mutex<Box<dyn Write + Send>>>,
    began: Instant,
}

impl Events {
    fn open(path: Option<&Path>) -> Result<Self> {
        let to: Option<Box<dyn Write + Send>> = match path {
            None => None,
            Some(path) if path == Path::new("-") => Some(Box::new(std::io::stdout())),
            Some(path) => {
                let file = File::options().create(true).append(true).open(path);
                let file = file.map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", path.display())))?;
                Some(Box::new(file))
            }
        };
        Ok(Self { to: to.map(Mutex::new), began: Instant::now() })
    }

    fn write(&self, mut event: serde_json::Value) {
        let Some(to) = &self.to else { return };
        event["seconds_since_start"] = json!(self.began.elapsed().as_secs_f64());
        let mut to = to.lock().unwrap_or_else(PoisonError::into_inner);
        // Nobody there to read events is no reason to stop rendering.
        let _ = writeln!(to, "{event}").and_then(|()| to.flush());
    }
}
