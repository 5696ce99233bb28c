//! What came of a batch: JSON report and table.

use std::collections::HashMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::file::Job;

/// What became of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Rendered.
    Done,
    /// There already.
    Before,
    /// Something is wrong with it.
    Failed,
    /// Stopped by a signal; what there is is saved.
    Interrupted,
    /// Not begun.
    Pending,
}

/// One job of the report.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Entry {
    /// The job.
    pub job: String,
    /// As the file names it, relative to where the program ran.
    pub scene: String,
    /// As `scene`.
    pub output: String,
    /// What became of it.
    pub status: Status,
    /// As `bismar render` would have exited.
    pub exit_code: u8,
    /// What was wrong.
    pub error: Option<String>,
    /// Wall seconds of the render, loading included.
    pub seconds: f64,
    /// Of a render that ran to its end, as `render --stats` writes it (docs/stats.md).
    pub stats: Option<Value>,
}

impl Entry {
    /// Of a job that has not begun.
    pub fn pending(job: &Job) -> Self {
        Self {
            job: job.name.clone(),
            scene: job.scene.display().to_string(),
            output: job.output.display().to_string(),
            status: Status::Pending,
            exit_code: 0,
            error: None,
            seconds: 0.0,
            stats: None,
        }
    }

    /// Takes over what an earlier report says of the render, if the picture is still that one.
    pub fn remember(&mut self, earlier: &Entry, paths: u32) {
        let same = earlier.output == self.output
            && earlier.stats.as_ref().is_some_and(|stats| stats["samples"]["pixel_min"] == paths);
        if same {
            (self.seconds, self.stats) = (earlier.seconds, earlier.stats.clone());
        }
    }
}

/// What a report that is there says of each job; nothing where there is none that can be read.
pub fn earlier(path: &Path) -> HashMap<String, Entry> {
    #[derive(Deserialize)]
    struct Earlier {
        jobs: Vec<Entry>,
    }
    let report = std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice::<Earlier>(&bytes).ok());
    report.into_iter().flat_map(|report| report.jobs).map(|entry| (entry.job.clone(), entry)).collect()
}

/// The whole report.
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
    /// In the order of the file.
    pub jobs: Vec<Entry>,
}

impl Report {
    /// Counts; `exit_code` is [`worst`] of the jobs that the command was asked for.
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

/// One line: how many of which.
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

/// 75 when anything was interrupted, for then the same command again goes on; else the highest code of a job.
pub fn worst(jobs: &[Entry]) -> u8 {
    let unfinished = |j: &Entry| matches!(j.status, Status::Interrupted | Status::Pending);
    if jobs.iter().any(unfinished) { 75 } else { jobs.iter().map(|j| j.exit_code).max().unwrap_or(0) }
}
