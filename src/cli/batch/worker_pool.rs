//! Processes that render a batch's jobs. Whatever ends one of them, every job is accounted for.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::ops::Range;
use std::os::unix::process::ExitStatusExt;
use std::process::{ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};

use super::Planned;
use crate::batch::message::{Ended, JobMessage, Message};
use crate::batch::queue::each;
use crate::batch::report::{Entry, Status};
use crate::console::child::{lead, this_program};
use crate::console::{LogFormat, Signals, Verbosity};
use crate::{Error, Result};

/// What processes need.
pub struct WorkerPool<'a> {
    pub jobs: &'a [Planned],
    /// What the batch itself writes.
    pub written: &'a [OsString],
    /// Jobs at a time.
    pub at_once: usize,
    /// Threads of each.
    pub threads: usize,
    pub signals: &'a Signals,
    pub verbosity: Verbosity,
    /// Is told what happens, from any thread; each job ends once.
    pub told: &'a (dyn Fn(Message) + Sync),
}

/// What a process left when it had ended.
struct Left {
    /// Jobs that it began and did not end.
    unfinished: Vec<usize>,
    /// The first that it did not begin.
    next: usize,
    status: ExitStatus,
}

impl WorkerPool<'_> {
    /// Each job in a process of its own.
    ///
    /// # Errors
    /// [`Error::Host`] if processes cannot be started.
    pub fn work_apart(&self) -> Result<()> {
        let failed = Mutex::new(None);
        each(self.jobs.len(), self.at_once, &|job| {
            if let Err(e) = self.alone(job, self.threads) {
                failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
            }
        });
        failed.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
    }

    /// All jobs in one process, which has scenes in memory once. If it dies, those that it worked on are tried again,
    /// each in a process of its own, so that one of them takes no other along; the rest follow in a new one.
    ///
    /// # Errors
    /// [`Error::Host`] if processes cannot be started.
    pub fn work_together(&self) -> Result<()> {
        let mut next = 0;
        while next < self.jobs.len() {
            let mut left = self.process(next..self.jobs.len(), self.at_once, self.threads)?;
            if left.unfinished.is_empty() && left.next == next {
                // It died before it began: whatever it was, it is the next job's.
                left.unfinished.push(next);
                left.next += 1;
            }
            for job in left.unfinished {
                self.alone(job, self.threads * self.at_once)?;
            }
            next = left.next;
            if self.signals.stopped() {
                (next..self.jobs.len()).for_each(|job| self.pending(job));
                break;
            }
        }
        Ok(())
    }

    /// One job in a process of its own.
    fn alone(&self, job: usize, threads: usize) -> Result<()> {
        if self.signals.stopped() {
            self.pending(job);
            return Ok(());
        }
        let left = self.process(job..job + 1, 1, threads)?;
        if left.unfinished.is_empty() && left.next > job {
            return Ok(());
        }
        let error = match left.status.signal() {
            Some(9) => Error::Host("its process was killed, as the system does when memory runs out".into()),
            Some(signal) => Error::Bug(format!("its process was ended by signal {signal}")),
            None => Error::Bug(format!("its process ended early, with {}", left.status)),
        };
        let (status, error, exit_code) = (Status::Failed, Some(error.to_string()), error.exit_code());
        let own = &self.jobs[job].job;
        let line = error.as_ref().map(|error| format!("{}: {error}", own.name));
        let entry = Entry { status, error, exit_code, ..Entry::pending(own) };
        (self.told)(Message::Ends(job, Box::new(Ended { entry, line, before: None })));
        Ok(())
    }

    fn pending(&self, job: usize) {
        let entry = Entry::pending(&self.jobs[job].job);
        (self.told)(Message::Ends(job, Box::new(Ended { entry, line: None, before: None })));
    }

    fn process(&self, range: Range<usize>, at_once: usize, threads: usize) -> Result<Left> {
        let jobs = self.jobs[range.clone()].iter().map(|planned| planned.job.clone()).collect();
        let order = serde_json::to_string(&JobMessage { jobs, written: self.written.into(), at_once, threads });
        let order = order.map_err(|e| Error::Bug(format!("JSON: {e}")))? + "\n";
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
            order.as_bytes(),
            self.signals,
            &|line| {
                // Half a line is all that a dying process may leave.
                let Ok(message) = serde_json::from_str(line) else { return };
                let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                let (ended, next) = &mut *seen;
                let message = match message {
                    Message::Begins(job) => Message::Begins(range.start + job),
                    Message::Goes(job, progress) => Message::Goes(range.start + job, progress),
                    Message::Ends(job, entry) => Message::Ends(range.start + job, entry),
                };
                // Jobs begin in their order, whoever is the first to say so.
                *next = (*next).max(message.job() + 1);
                if let Message::Ends(job, _) = message {
                    ended.insert(job);
                }
                drop(seen);
                (self.told)(message);
            },
            &mut || (),
        )?;
        let (ended, next) = seen.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Left { unfinished: (range.start..next).filter(|job| !ended.contains(job)).collect(), next, status })
    }
}
