//! The JSON report of a batch.

use std::collections::HashMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::value::RawValue;

use super::job::Job;
use crate::scene::import::read_own;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    Done,
    /// Finished before this command.
    Before,
    Failed,
    /// Stopped by a signal; the picture so far is saved.
    Interrupted,
    Pending,
}

/// One job of the report.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Entry {
    pub job: String,
    /// Path of the scene, relative to the working directory of the command.
    pub scene: String,
    /// Path of the picture, relative to the working directory of the command.
    pub output: String,
    pub status: Status,
    /// Exit code that `bismar render` would have had.
    pub exit_code: u8,
    pub error: Option<String>,
    /// Wall seconds of the render, loading included.
    pub seconds: f64,
    /// Statistics of a finished render, as written by `render --stats` (docs/stats.md).
    pub stats: Option<Box<RawValue>>,
}

impl Entry {
    /// Entry of a job that has not begun.
    pub(crate) fn pending(job: &Job) -> Self {
        Self {
            job: job.name.clone(),
            scene: job.request.scene.display().to_string(),
            output: job.request.output.display().to_string(),
            status: Status::Pending,
            exit_code: 0,
            error: None,
            seconds: 0.0,
            stats: None,
        }
    }

    /// The statistics; they are kept as text, which takes a sixth of the memory.
    pub fn statistics(&self) -> Option<Value> {
        serde_json::from_str(self.stats.as_ref()?.get()).ok()
    }

    /// Copies seconds and statistics from an earlier report, if that is about the same picture.
    pub(crate) fn copy_earlier(&mut self, earlier: &Entry, paths: u32) {
        let same = earlier.output == self.output
            && earlier.statistics().is_some_and(|stats| stats["samples"]["pixel_min"] == paths);
        if same {
            (self.seconds, self.stats) = (earlier.seconds, earlier.stats.clone());
        }
    }
}

/// Entries of an existing report by job name; empty if there is none that can be read.
pub fn earlier(path: &Path) -> HashMap<String, Entry> {
    #[derive(Deserialize)]
    struct Earlier {
        jobs: Vec<Entry>,
    }
    let report = read_own(path).ok().and_then(|bytes| serde_json::from_slice::<Earlier>(&bytes).ok());
    report.into_iter().flat_map(|report| report.jobs).map(|entry| (entry.job.clone(), entry)).collect()
}

#[derive(Debug, Clone, Serialize)]
pub struct Report {
    schema: u32,
    version: &'static str,
    file: String,
    seconds: f64,
    exit_code: u8,
    done: usize,
    before: usize,
    failed: usize,
    interrupted: usize,
    pending: usize,
    /// Entries in the order of the batch file.
    pub jobs: Vec<Entry>,
}

impl Report {
    /// A report; `exit_code` is [`worst`] of the jobs that this command included.
    pub fn new(file: String, seconds: f64, exit_code: u8, jobs: Vec<Entry>) -> Self {
        let count = |status| jobs.iter().filter(|j| j.status == status).count();
        Self {
            schema: 1,
            version: env!("CARGO_PKG_VERSION"),
            file,
            seconds,
            exit_code,
            done: count(Status::Done),
            before: count(Status::Before),
            failed: count(Status::Failed),
            interrupted: count(Status::Interrupted),
            pending: count(Status::Pending),
            jobs,
        }
    }
}

/// One line of text: number of jobs by status.
pub fn summary(jobs: &[Entry], seconds: f64) -> String {
    let count = |status| jobs.iter().filter(|j| j.status == status).count();
    let counts = [
        (count(Status::Done), "done"),
        (count(Status::Before), "done before"),
        (count(Status::Failed), "failed"),
        (count(Status::Interrupted), "interrupted"),
        (count(Status::Pending), "not begun"),
    ];
    let some = counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}"));
    format!("{} jobs: {} in {seconds:.1} s", jobs.len(), some.collect::<Vec<_>>().join(", "))
}

/// Exit code of a batch: 75 if anything is unfinished, because the same command then continues; else the highest of its
/// jobs.
pub fn worst(jobs: &[Entry]) -> u8 {
    let unfinished = |j: &Entry| matches!(j.status, Status::Interrupted | Status::Pending);
    if jobs.iter().any(unfinished) { 75 } else { jobs.iter().map(|j| j.exit_code).max().unwrap_or(0) }
}
