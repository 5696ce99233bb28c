//! Worker processes that render a batch's jobs. Every job gets a result, even if its process dies.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::ops::Range;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};

use crate::batch::job::Job;
use crate::batch::message::{Ended, JobMessage, Message};
use crate::batch::queue::each;
use crate::batch::report::{Entry, Status};
use crate::console::child::{lead, this_program};
use crate::console::{LogFormat, Signals, Verbosity};
use crate::{Error, Result};

pub struct WorkerPool<'a> {
    pub jobs: &'a [Job],
    /// Files that the batch itself writes.
    pub written: &'a [OsString],
    /// Folders below which outputs may lie.
    pub folders: &'a [PathBuf],
    /// Number of jobs at the same time.
    pub at_once: usize,
    pub threads: usize,
    pub signals: &'a Signals,
    pub verbosity: Verbosity,
    /// Receives all messages, from any thread; each job ends exactly once.
    pub on_message: &'a (dyn Fn(Message) + Sync),
}

/// State of the jobs when a process has ended.
struct Exited {
    /// Jobs that it began but did not end.
    unfinished: Vec<usize>,
    /// First job that it did not begin.
    next: usize,
    status: ExitStatus,
}

impl WorkerPool<'_> {
    /// Renders each job in its own process.
    /// Errors: [`Error::Host`] if processes cannot be started.
    pub(crate) fn run_isolated(&self) -> Result<()> {
        let failed = Mutex::new(None);
        each(self.jobs.len(), self.at_once, &|job| {
            if let Err(e) = self.run_alone(job, self.threads) {
                failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
            }
        });
        failed.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
    }

    /// Renders all jobs in one process, which shares scenes in memory. If it dies, the unfinished jobs are rendered again,
    /// each in its own process, and the remaining ones in a new shared process.
    /// Errors: [`Error::Host`] if processes cannot be started.
    pub(crate) fn run_shared(&self) -> Result<()> {
        let mut next = 0;
        while next < self.jobs.len() {
            let mut exited = self.process(next..self.jobs.len(), self.at_once, self.threads)?;
            if exited.unfinished.is_empty() && exited.next == next {
                // It died before it began a job: the next job is taken as the cause.
                exited.unfinished.push(next);
                exited.next += 1;
            }
            for job in exited.unfinished {
                self.run_alone(job, self.threads * self.at_once)?;
            }
            next = exited.next;
            if self.signals.stopped() {
                (next..self.jobs.len()).for_each(|job| self.pending(job));
                break;
            }
        }
        Ok(())
    }

    /// Renders one job in its own process.
    fn run_alone(&self, job: usize, threads: usize) -> Result<()> {
        if self.signals.stopped() {
            self.pending(job);
            return Ok(());
        }
        let exited = self.process(job..job + 1, 1, threads)?;
        if exited.unfinished.is_empty() && exited.next > job {
            return Ok(());
        }
        let error = match exited.status.signal() {
            Some(9) => Error::Host("its process was killed, probably because the system ran out of memory".into()),
            Some(signal) => Error::Bug(format!("its process was ended by signal {signal}")),
            None if exited.status.code() == Some(Error::Host(String::new()).exit_code().into()) => {
                Error::Host("this host cannot do it; its message is above".into())
            }
            None => Error::Bug(format!("its process ended early, with {}", exited.status)),
        };
        let (status, error, exit_code) = (Status::Failed, Some(error.to_string()), error.exit_code());
        let job_of_entry = &self.jobs[job];
        let line = error.as_ref().map(|error| format!("{}: {error}", job_of_entry.name));
        let entry = Entry { status, error, exit_code, ..Entry::pending(job_of_entry) };
        (self.on_message)(Message::Ends(job, Box::new(Ended { entry, line, before: None })));
        Ok(())
    }

    /// Reports a job that was not begun.
    fn pending(&self, job: usize) {
        let entry = Entry::pending(&self.jobs[job]);
        (self.on_message)(Message::Ends(job, Box::new(Ended { entry, line: None, before: None })));
    }

    /// Runs one worker process over a range of the jobs.
    fn process(&self, range: Range<usize>, at_once: usize, threads: usize) -> Result<Exited> {
        let jobs = self.jobs[range.clone()].to_vec();
        let message = serde_json::to_string(&JobMessage {
            jobs,
            written: self.written.into(),
            folders: self.folders.into(),
            at_once,
            threads,
        });
        let message = message.map_err(|e| Error::Bug(format!("JSON: {e}")))? + "\n";
        let mut command = this_program();
        command.arg("batch-worker").stdout(Stdio::piped());
        command.args(self.verbosity.quiet.then_some("-q"));
        command.args((0..self.verbosity.verbose).map(|_| "-v"));
        if self.verbosity.log == LogFormat::Json {
            command.arg("--log=json");
        }
        let seen = Mutex::new((BTreeSet::new(), range.start));
        let status = lead(
            &mut command,
            Some(message.as_bytes()),
            self.signals,
            &|line| {
                // A dying process may leave an incomplete line.
                let Ok(message) = serde_json::from_str(line) else { return };
                let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                let (ended, next) = &mut *seen;
                let message = match message {
                    Message::Begins(job) => Message::Begins(range.start + job),
                    Message::Progress(job, progress) => Message::Progress(range.start + job, progress),
                    Message::Ends(job, entry) => Message::Ends(range.start + job, entry),
                };
                // Jobs begin in order, but messages of different threads may not arrive in order.
                *next = (*next).max(message.job() + 1);
                if let Message::Ends(job, _) = message {
                    ended.insert(job);
                }
                drop(seen);
                (self.on_message)(message);
            },
            &mut || (),
        )?;
        let (ended, next) = seen.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Exited { unfinished: (range.start..next).filter(|job| !ended.contains(job)).collect(), next, status })
    }
}
