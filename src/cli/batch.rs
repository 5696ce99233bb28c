//! `bismar batch JOBS.toml`

mod crew;
mod overview;
mod worker;

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
use crate::batch::order::{Ended, Message};
use crate::batch::queue::Shelf;
use crate::batch::report::{self, Report};
use crate::console::args::threads;
use crate::console::{Paths, Signals, Verbosity, Verdict, host, print, say};
use crate::farm::slurm::quoted;
use crate::film::atomic;
use crate::render::checkpoint::Earlier;
use crate::{Error, Result};
use crew::Crew;
use overview::Overview;
pub use worker::{WorkerArgs, run as work};

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

/// Reads a batch file and checks every job's flags, and that no job writes what it or another reads or writes.
///
/// # Errors
/// [`Error::Config`] with the place in the file.
pub fn plan(path: &Path) -> Result<(Vec<Planned>, Paths)> {
    let command = RenderArgs::augment_args(Command::new("render"));
    let flags: HashMap<String, Flag> = command
        .get_arguments()
        .filter_map(|arg| Some((arg.get_long()?.to_owned(), arg)))
        .filter(|(name, _)| !NOT_IN_FILES.contains(&name.as_str()) && name != "help")
        .map(|(name, arg)| {
            let flag = match arg.get_action() {
                ArgAction::SetTrue => Flag::Switch,
                _ if name == "size" => Flag::List('x'),
                _ if ["aov", "crop"].contains(&name.as_str()) => Flag::List(','),
                _ if name == "env" => Flag::Input,
                // clap knows a path by its type.
                _ if arg.get_value_hint() == ValueHint::AnyPath => Flag::File,
                _ => Flag::Value,
            };
            (name, flag)
        })
        .collect();
    let jobs = file::read(path, &flags)?;
    let jobs: Vec<_> = jobs.into_iter().map(|job| understand(path, &command, job)).collect::<Result<_>>()?;
    let mut paths = Paths::default();
    paths.reads("the batch file", path)?;
    for Planned { job, args } in &jobs {
        declare(args, &format!(" of '{}'", job.name), &mut paths)
            .map_err(|e| Error::Config(format!("{}: job '{}': {e}", job.at.of(path, None), job.name)))?;
    }
    Ok((jobs, paths))
}

fn understand(path: &Path, command: &Command, job: Job) -> Result<Planned> {
    let bad = |key: Option<&str>, why: &str| {
        let why = why.strip_prefix("error: ").unwrap_or(why);
        let why = why.split("\n\n").next().unwrap_or(why);
        Error::Config(format!("{}: job '{}': {why}", job.at.of(path, key), job.name))
    };
    let mut line = vec!["render".into(), job.scene.clone().into_os_string()];
    line.extend(job.arguments().into_iter().map(Into::into));
    let matches = command.clone().try_get_matches_from(line).map_err(|e| {
        let named = match e.get(ContextKind::InvalidArg) {
            Some(ContextValue::String(arg)) => Some(arg.as_str()),
            Some(ContextValue::Strings(args)) => args.first().map(String::as_str),
            _ => None,
        };
        let key = named.map(|arg| arg.trim_start_matches('-').split([' ', '=']).next().unwrap_or(arg).to_owned());
        bad(key.as_deref(), &e.to_string())
    })?;
    let mut args = RenderArgs::from_arg_matches(&matches).map_err(|e| bad(None, &e.to_string()))?;
    args.output = Some(job.output.clone());
    args.resume = true;
    args.check().map_err(|e| bad(None, &e.to_string()))?;
    Ok(Planned { job, args })
}

pub fn run(args: &BatchArgs, verbosity: Verbosity) -> Result<Verdict> {
    let began = Instant::now();
    let (mut jobs, mut paths) = plan(&args.file)?;
    let report_path = args.report.clone().unwrap_or_else(|| {
        let stem = args.file.file_stem().unwrap_or_default().to_string_lossy();
        args.file.with_file_name(format!("{stem}-report.json"))
    });
    paths.writes("--report", &report_path)?;
    if let Some(events) = args.events.as_deref().filter(|path| *path != Path::new("-")) {
        paths.writes("--events", events)?;
    }
    let order: Vec<String> = jobs.iter().map(|j| j.job.name.clone()).collect();
    if !args.only.is_empty() {
        jobs.retain(|planned| args.only.iter().any(|pattern| pattern.matches(&planned.job.name)));
        if jobs.is_empty() {
            let names = order.iter().take(20).cloned().collect::<Vec<_>>().join(", ");
            let more = if order.len() > 20 { ", …" } else { "" };
            return Err(Error::Usage(format!("--only: no job's name matches; there are {names}{more}")));
        }
    }
    // Jobs with one scene follow one another, so that few scenes are in memory at a time.
    let mut first: HashMap<String, usize> = HashMap::new();
    for (i, planned) in jobs.iter().enumerate() {
        first.entry(scene_key(&planned.args)).or_insert(i);
    }
    jobs.sort_by_key(|planned| first.get(&scene_key(&planned.args)).copied());
    if args.dry_run {
        return dry_run(&jobs, &order);
    }
    let signals = Signals::listen()?;
    let earlier = report::earlier(&report_path);
    atomic::check(&report_path)?;
    let events = Events::open(args.events.as_deref())?;
    let (threads, source) = host::threads(args.threads)?;
    let at_once = (args.jobs as usize).min(jobs.len());
    let each_threads = (threads / at_once).max(1);
    info!("{at_once} jobs at a time, each on {each_threads} threads ({threads} in all: {source})");

    let overview = Overview::new(jobs.len(), verbosity.quiet);
    let entries = Mutex::new(Vec::new());
    events.write(json!({"event": "batch-begins", "jobs": jobs.len(), "file": args.file.display().to_string()}));
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
    let written = [Some(&report_path), args.events.as_ref().filter(|path| *path != Path::new("-"))];
    let written: Vec<_> = written.into_iter().flatten().map(|path| path.clone().into_os_string()).collect();
    let crew = Crew { jobs: &jobs, written: &written, at_once, threads, signals: &signals, verbosity, told: &told };
    let worked = if args.isolate { crew.work_apart() } else { crew.work_together() };
    overview.finish();
    worked?;

    let mut entries = entries.into_inner().unwrap_or_else(PoisonError::into_inner);
    let place: HashMap<&str, usize> = order.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
    entries.sort_by_key(|e| place.get(e.job.as_str()).copied());
    let (exit_code, seconds) = (report::worst(&entries), began.elapsed().as_secs_f64());
    events.write(json!({"event": "batch-ends", "exit_code": exit_code}));
    let (summary, table) = (report::summary(&entries, seconds), overview::table(&entries));
    // What was not asked for stays as it was.
    let asked: HashSet<String> = entries.iter().map(|e| e.job.clone()).collect();
    let others = order.iter().filter(|name| !asked.contains(*name));
    entries.extend(others.filter_map(|name| earlier.get(name).cloned()));
    entries.sort_by_key(|e| place.get(e.job.as_str()).copied());
    let report = Report::new(args.file.display().to_string(), seconds, exit_code, entries);
    atomic::write(&report_path, |file| {
        serde_json::to_writer_pretty(&mut *file, &report)?;
        file.write_all(b"\n")?;
        Ok(Ok(()))
    })?;
    if !verbosity.quiet {
        if args.events.as_deref() != Some(Path::new("-")) {
            print(table.trim_end())?;
        }
        say(format_args!("{summary}; report in {}", report_path.display()));
    }
    Ok(match exit_code {
        0 => Verdict::Done,
        code => Verdict::Worst(code),
    })
}

/// Equal for jobs that can share a scene in memory.
pub fn scene_key(a: &RenderArgs) -> String {
    format!(
        "{:?}{} {:?} {} {} {} {} {:?}",
        a.scene,
        a.choices(),
        a.env,
        a.env_rotate,
        a.env_strength,
        a.no_env,
        a.strict,
        a.rays
    )
}

/// Says what would be done, in the order of the file.
fn dry_run(jobs: &[Planned], order: &[String]) -> Result<Verdict> {
    let shelf = Shelf::new(jobs.iter().map(|j| scene_key(&j.args)));
    let mut rows: HashMap<&str, String> = HashMap::new();
    let mut worst = 0;
    for Planned { job, args } in jobs {
        let key = scene_key(args);
        let would = || -> Result<&str> {
            let inputs = shelf.get(&key, || Inputs::read(args))?;
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
        shelf.done(&key);
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
