//! Rendering a batch's jobs, with progress, events and the report.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde_json::json;
use tracing::info;

use super::overview::{self, Overview};
use super::worker_pool::WorkerPool;
use crate::batch::job::Job;
use crate::batch::message::{Ended, Message};
use crate::batch::queue::Cache;
use crate::batch::report::{self, Report};
use crate::batch::views;
use crate::console::progress::Style;
use crate::console::{Paths, Signals, Verbosity, Verdict, escaped_json, host, print, say};
use crate::farm::slurm::quoted;
use crate::film::atomic;
use crate::job::{Inputs, RenderRequest, Session, write_json};
use crate::render::record::checkpoint::Earlier;
use crate::{Error, Result};

#[derive(Default)]
pub struct Work {
    /// Batch file or scene, as the report names it.
    pub file: String,
    /// Names of all jobs in the order of the file, including those that --only excludes.
    pub order: Vec<String>,
    pub report: Option<PathBuf>,
    pub events: Option<PathBuf>,
    /// Folders below which outputs may lie.
    pub folders: Vec<PathBuf>,
    pub at_once: usize,
    /// One process per job.
    pub isolate: bool,
    pub dry_run: bool,
    pub threads: Option<usize>,
    pub style: Style,
    pub signals_from_parent: bool,
}

impl Work {
    /// Renders the jobs. `paths` are all files that the jobs read or write.
    /// Errors: Those of starting processes and of writing report and events; failed jobs are in the verdict.
    pub fn run(&self, mut jobs: Vec<Job>, mut paths: Paths, verbosity: Verbosity) -> Result<Verdict> {
        let (began, stdout) = (Instant::now(), Path::new("-"));
        self.report.iter().try_for_each(|report| paths.writes("--report", report))?;
        let events_file = self.events.as_ref().filter(|path| *path != stdout);
        events_file.iter().try_for_each(|events| paths.writes("--events", events))?;
        // Jobs that share a scene or its files follow one another, so that few scenes are in memory at the same time.
        let mut first: HashMap<String, usize> = HashMap::new();
        for (i, job) in jobs.iter().enumerate() {
            first.entry(job.request.files_key()).or_insert(i);
            first.entry(job.request.scene_key()).or_insert(i);
        }
        jobs.sort_by_key(|job| [job.request.files_key(), job.request.scene_key()].map(|key| first[&key]));
        if self.dry_run {
            return dry_run(&jobs, &self.order);
        }
        let signals = if self.signals_from_parent { Signals::from_parent() } else { Signals::listen() }?;
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
        let on_message = |message: Message| match message {
            Message::Begins(index) => {
                let job = &jobs[index];
                overview.begins(index, &job.name);
                let output = job.request.output.display().to_string();
                events.write(json!({"event": "job-begins", "job": job.name, "output": output}));
            }
            Message::Progress(index, progress) => overview.progress(index, &progress),
            Message::Ends(index, ended) => {
                let Ended { mut entry, line, before } = *ended;
                if let (Some(earlier), Some(paths)) = (earlier.get(&entry.job), before) {
                    entry.copy_earlier(earlier, paths);
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
        let worker_pool = WorkerPool {
            jobs: &jobs,
            folders: &self.folders,
            written: &written,
            at_once,
            threads,
            signals: &signals,
            verbosity,
            on_message: &on_message,
        };
        let worked = if self.isolate { worker_pool.run_isolated() } else { worker_pool.run_shared() };
        overview.finish();
        worked?;
        views::write(jobs.iter().filter(|job| job.is_view).map(|job| job.request.output.as_path()))?;

        let mut entries = entries.into_inner().unwrap_or_else(PoisonError::into_inner);
        let position: HashMap<&str, usize> =
            self.order.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect();
        entries.sort_by_key(|e| position.get(e.job.as_str()).copied());
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
        // The report keeps the entries of jobs that were excluded.
        let included: HashSet<String> = entries.iter().map(|e| e.job.clone()).collect();
        let others = self.order.iter().filter(|name| !included.contains(*name));
        entries.extend(others.filter_map(|name| earlier.get(name).cloned()));
        entries.sort_by_key(|e| position.get(e.job.as_str()).copied());
        write_json(report_path, &Report::new(self.file.clone(), seconds, exit_code, entries))?;
        if let Some(why) = events.failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(Error::Io(format!("--events: cannot write: {why}; events are missing")));
        }
        if !verbosity.quiet {
            if self.events.as_deref() != Some(stdout) {
                print(table.trim_end())?;
            }
            say(format_args!("{summary}; report in {}", report_path.display()));
        }
        Ok(verdict)
    }
}

/// Prints the commands and what they would do, in the order of the file.
fn dry_run(jobs: &[Job], order: &[String]) -> Result<Verdict> {
    let cache = Cache::new(jobs.iter().map(|j| j.request.files_key()));
    let mut rows: HashMap<&str, String> = HashMap::new();
    let mut worst = 0;
    for Job { name, request, .. } in jobs {
        let key = request.files_key();
        let would = || -> Result<&str> {
            let inputs = cache.get(&key, || Inputs::read(request))?;
            let session = Session { request, inputs: &inputs, threads: 1, began: Instant::now(), replaces: true };
            if session.finished_before()?.is_some() {
                return Ok("done before");
            }
            Ok(if Earlier::read(&request.output)?.is_some() { "render again or continue" } else { "render" })
        };
        let what = would().map(str::to_owned).unwrap_or_else(|e| {
            worst = worst.max(e.exit_code());
            format!("would fail: {e}")
        });
        cache.done(&key);
        let mut words: Vec<String> = ["bismar", "render"].map(str::to_owned).into();
        words.extend([request.scene.display().to_string(), "-o".into(), request.output.display().to_string()]);
        words.extend(RenderRequest { resume: false, ..request.clone() }.arguments()?);
        rows.insert(name, format!("{name}: {what}\n  {}", quoted(&words)));
    }
    let lines: Vec<_> = order.iter().filter_map(|name| rows.remove(name.as_str())).collect();
    print(lines.join("\n"))?;
    Ok(if worst == 0 { Verdict::Done } else { Verdict::Worst(worst) })
}

/// The --events file: JSON, one event per line.
struct Events {
    to: Option<Mutex<Box<dyn Write + Send>>>,
    /// The first failed write.
    failed: Mutex<Option<String>>,
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
        Ok(Self { to: to.map(Mutex::new), failed: Mutex::default(), began: Instant::now() })
    }

    fn write(&self, mut event: serde_json::Value) {
        let Some(to) = &self.to else { return };
        event["seconds_since_start"] = json!(self.began.elapsed().as_secs_f64());
        let mut to = to.lock().unwrap_or_else(PoisonError::into_inner);
        // Jobs are rendered all the same, and a reader that has gone away is no failure.
        if let Err(e) = writeln!(to, "{}", escaped_json(&event.to_string())).and_then(|()| to.flush())
            && e.kind() != ErrorKind::BrokenPipe
        {
            self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| e.to_string());
        }
    }
}
