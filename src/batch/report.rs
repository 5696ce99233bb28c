//! What came of a batch: JSON report and table.

use serde::Serialize;

/// What became of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
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

/// One job of the report; `S` is what is known of a render that ran to its end.
#[derive(Debug, Clone, Serialize)]
pub struct Entry<S> {
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
    /// Wall seconds, loading included.
    pub seconds: f64,
    /// As `render --stats` writes it (docs/stats.md).
    pub stats: Option<S>,
}

/// The whole report.
#[derive(Debug, Clone, Serialize)]
pub struct Report<S> {
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
    pub jobs: Vec<Entry<S>>,
}

impl<S> Report<S> {
    /// Counts.
    pub fn new(file: String, seconds: f64, jobs: Vec<Entry<S>>) -> Self {
        let count = |status| jobs.iter().filter(|j| j.status == status).count();
        Self {
            schema: 1,
            version: env!("CARGO_PKG_VERSION"),
            file,
            seconds,
            exit_code: worst(&jobs),
            done: count(Status::Done),
            before: count(Status::Before),
            failed: count(Status::Failed),
            interrupted: count(Status::Interrupted),
            pending: count(Status::Pending),
            jobs,
        }
    }

    /// What the batch exits with.
    pub fn exit_code(&self) -> u8 {
        self.exit_code
    }

    /// One line: how many of which.
    pub fn summary(&self) -> String {
        let counts = [
            (self.done, "done"),
            (self.before, "done before"),
            (self.failed, "failed"),
            (self.interrupted, "interrupted"),
            (self.pending, "not begun"),
        ];
        let some = counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}"));
        format!("{} jobs: {} in {:.1} s", self.jobs.len(), some.collect::<Vec<_>>().join(", "), self.seconds)
    }
}

/// 75 when anything was interrupted, for then the same command again goes on; else the highest code of a job.
fn worst<S>(jobs: &[Entry<S>]) -> u8 {
    let unfinished = |j: &Entry<S>| matches!(j.status, Status::Interrupted | Status::Pending);
    if jobs.iter().any(unfinished) { 75 } else { jobs.iter().map(|j| j.exit_code).max().unwrap_or(0) }
}
