//! The worker process of a batch: a job message in, messages out ([`message`](crate::batch::message)).

use std::collections::HashMap;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::value::to_raw_value;

use crate::batch::job::Job;
use crate::batch::message::{Ended, JobMessage, Message};
use crate::batch::queue::{Cache, each};
use crate::batch::report::{Entry, Status};
use crate::console::{Paths, Signals, Verdict, host, panics};
use crate::film::atomic;
use crate::job::{Done, Inputs, Loaded, RenderRequest, Session, memory};
use crate::render::Progress;
use crate::{Error, Result};

pub fn run() -> Result<Verdict> {
    let mut line = String::new();
    io::stdin().read_line(&mut line).map_err(|e| Error::Io(format!("standard input: cannot read: {e}")))?;
    let JobMessage { jobs, written, folders, at_once, threads } =
        serde_json::from_str(&line).map_err(|e| Error::Usage(format!("not a job message of `bismar batch`: {e}")))?;
    atomic::confine(&folders);
    let signals = Signals::from_parent()?;
    let mut paths = Paths::default();
    written.iter().try_for_each(|path| paths.writes("the batch's own", path.as_ref()))?;
    jobs.iter().try_for_each(|job| job.request.declare(&format!(" of '{}'", job.name), &mut paths))?;
    let pools = (0..at_once.clamp(1, jobs.len().max(1))).map(|_| host::pool(threads)).collect::<Result<Vec<_>>>()?;
    let worker = Worker {
        inputs: Cache::new(jobs.iter().map(|j| j.request.files_key())),
        latest: Mutex::default(),
        scenes: Cache::new(jobs.iter().map(|j| j.request.scene_key())),
        jobs,
        paths: Mutex::new(paths),
        threads,
        sequential: pools.len() == 1,
        signals,
    };
    // A thread prints, so that rendering does not wait for the reader.
    let (messages, printed) = channel();
    let printer = thread::spawn(move || {
        for message in printed {
            let Ok(text) = serde_json::to_string(&message) else { continue };
            let mut out = io::stdout().lock();
            // If the parent has died, standard input ends as well and stops the jobs.
            let _ = writeln!(out, "{text}").and_then(|()| out.flush());
        }
    });
    let (workers, free) = (pools.len(), Mutex::new(pools));
    each(worker.jobs.len(), workers, &|index| {
        let messages = messages.clone();
        let pool = free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let Some(pool) = pool else { return };
        let ended = pool.install(|| worker.work(index, &messages));
        let _ = messages.send(Message::Ends(index, Box::new(ended)));
        free.lock().unwrap_or_else(PoisonError::into_inner).push(pool);
    });
    drop(messages);
    let _ = printer.join();
    Ok(Verdict::Done)
}

/// Shortest time between progress messages of a job.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

struct Worker {
    jobs: Vec<Job>,
    inputs: Cache<Inputs>,
    scenes: Cache<Loaded>,
    /// By files, the latest scene made of them, if others will follow.
    latest: Mutex<HashMap<String, Arc<Loaded>>>,
    /// Files that the jobs read or write.
    paths: Mutex<Paths>,
    /// Threads per job.
    threads: usize,
    sequential: bool,
    signals: Signals,
}

impl Worker {
    /// Renders one job; errors and panics are in its entry.
    fn work(&self, index: usize, messages: &Sender<Message>) -> Ended {
        let job = &self.jobs[index];
        let request = &job.request;
        let began = Instant::now();
        let mut entry = Entry::pending(job);
        if self.signals.stopped() {
            return Ended { entry, line: None, before: None };
        }
        let _ = messages.send(Message::Begins(index));
        if self.sequential {
            host::reset_peak_memory();
        }
        let last_message = Mutex::new(None);
        let on_progress = |progress: Progress| {
            let Ok(mut last) = last_message.try_lock() else { return };
            if last.is_none_or(|at: Instant| at.elapsed() >= PROGRESS_INTERVAL) {
                *last = Some(Instant::now());
                let _ = messages.send(Message::Progress(index, progress));
            }
        };
        let key = request.scene_key();
        let result = catch_unwind(AssertUnwindSafe(|| self.render(request, &key, began, &on_progress)))
            .unwrap_or_else(|panic| Err(panics::error(&*panic)));
        if self.inputs.done(&request.files_key()) {
            self.latest().remove(&request.files_key());
        }
        self.scenes.done(&key);
        entry.seconds = began.elapsed().as_secs_f64();
        let (mut line, mut before) = (None, None);
        match result {
            Ok(Done::Rendered(_, stats)) => {
                entry.status = Status::Done;
                line = Some(format!("{}: {}", job.name, stats.summary()));
                entry.stats = to_raw_value(&stats).ok();
            }
            Ok(Done::Before(_, paths, _)) => {
                entry.status = Status::Before;
                before = Some(paths);
            }
            Err(error) => {
                let interrupted = matches!(error, Error::Interrupted(_));
                entry.status = if interrupted { Status::Interrupted } else { Status::Failed };
                entry.exit_code = error.exit_code();
                entry.error = Some(error.to_string());
                line = Some(format!("{}: {error}", job.name));
            }
        }
        Ended { entry, line, before }
    }

    fn latest(&self) -> MutexGuard<'_, HashMap<String, Arc<Loaded>>> {
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn render(
        &self,
        request: &RenderRequest,
        key: &str,
        began: Instant,
        on_progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Done> {
        atomic::create_folder(&request.output)?;
        let files = request.files_key();
        let inputs = self.inputs.get(&files, || Inputs::read(request))?;
        inputs.declare(&mut self.paths.lock().unwrap_or_else(PoisonError::into_inner))?;
        let _claims = request.claim_outputs()?;
        let session = Session { request, inputs: &inputs, threads: self.threads, began, replaces: true };
        if let Some(earlier) = session.finished_before()? {
            return session.develop(&earlier);
        }
        memory::hold(session.check_memory()?);
        let building = |_, _| !self.signals.stopped();
        // Whether other scenes will be made of these files.
        let more = self.inputs.left(&files) > self.scenes.left(key);
        let loaded = self.scenes.get(key, || {
            let previous = self.latest().remove(&files);
            Loaded::load_next(request, &inputs, previous, more, &building)
        })?;
        if more {
            self.latest().insert(files, Arc::clone(&loaded));
        }
        session.render(&loaded, &self.signals.stop, on_progress, &|_| ())
    }
}
