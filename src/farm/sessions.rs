//! The record of a task's sessions next to its log, written by `farm task` and read by `farm status`.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use crate::film::atomic;
use crate::scene::import::read_own;
use crate::{Error, Result};

/// Sessions of a task, which may be interrupted and requeued several times.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sessions {
    schema: u32,
    /// The scheduler's ID of the submission; another one resets the counts.
    pub job: String,
    /// Host of the last session.
    pub host: String,
    pub begun: u32,
    /// Paths in the task's output when the last session began.
    pub paths: u64,
    /// Consecutive sessions before the last one that added no paths.
    pub fruitless: u32,
    /// Byte of the log at which the last session begins.
    pub log: u64,
    pub memory_raised: bool,
    /// Raised memory limit in MiB; a session with less was started before the scheduler applied it.
    pub memory_raised_to: u64,
    /// Whether the last session ran out of memory.
    pub out_of_memory: bool,
    /// Exit code of the last session; `None` while it runs, or if it died without recording one.
    pub code: Option<u8>,
}

/// Consecutive sessions without a new path after which a task is given up.
const MAX_FRUITLESS_SESSIONS: u32 = 3;
pub(crate) const HEARTBEAT: Duration = Duration::from_secs(20);
/// A session without a heartbeat for this long has died: several intervals, as clocks differ and file systems are slow.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(120);

impl Sessions {
    /// Reads a record; one that is missing or unreadable counts as never begun.
    pub fn read(path: &Path) -> Self {
        read_own(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
    }

    /// The record at the beginning of a session: of submission `job`, with `paths` in the task's output.
    pub fn begin(self, job: &str, host: &str, paths: u64, log: u64) -> Self {
        let previous = if self.job == job { self } else { Self::default() };
        let fruitless = if previous.begun > 0 && paths <= previous.paths { previous.fruitless + 1 } else { 0 };
        Self {
            schema: 1,
            job: job.into(),
            host: host.into(),
            begun: previous.begun + 1,
            paths,
            fruitless,
            log,
            out_of_memory: false,
            code: None,
            ..previous
        }
    }

    /// Gives the task up after too many sessions without progress.
    pub(crate) fn check_progress(&mut self) -> Result<()> {
        if self.fruitless < MAX_FRUITLESS_SESSIONS { Ok(()) } else { Err(self.no_progress()) }
    }

    /// Records the end of a session with an exit code and `paths` in the task's output.
    /// Errors: [`Error::Host`] if it was interrupted and too many sessions in a row added no paths.
    pub fn end(&mut self, code: u8, paths: u64) -> Result<()> {
        self.code = Some(code);
        // Not stored: the next session counts this one again when it begins.
        let fruitless = if paths <= self.paths { self.fruitless + 1 } else { 0 };
        if code == INTERRUPTED && fruitless >= MAX_FRUITLESS_SESSIONS { Err(self.no_progress()) } else { Ok(()) }
    }

    /// Resets the counts of a task that is held: somebody who releases it has changed something.
    pub fn hold(&mut self) {
        self.begun = 0;
    }

    fn no_progress(&mut self) -> Error {
        self.hold();
        Error::Host(format!(
            "begun {MAX_FRUITLESS_SESSIONS} times in a row, and interrupted each time before anything was saved: give it more time or \
             a faster host"
        ))
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write(path, |file| Ok(Ok(serde_json::to_writer_pretty(file, self)?)))
    }

    /// Gives a sign of life: sets the record's modification time. Failures are ignored.
    pub(crate) fn heartbeat(path: &Path) {
        let _ = atomic::open_guessable(File::options().append(true), path)
            .and_then(|file| file.set_modified(SystemTime::now()));
    }

    /// Whether the last session runs, according to its heartbeats.
    pub(crate) fn is_running(&self, path: &Path) -> bool {
        // Clocks differ a little; a time far in the future is none of a heartbeat.
        let age = fs::metadata(path).and_then(|meta| meta.modified());
        let age = age.map(|time| time.elapsed().unwrap_or_else(|ahead| ahead.duration()));
        self.begun > 0 && self.code.is_none() && age.is_ok_and(|age| age < HEARTBEAT_TIMEOUT)
    }
}

/// Exit code of an interrupted render, which resumes when it is started again.
pub(crate) const INTERRUPTED: u8 = 75;
/// Exit code of a render that this host cannot do, for a site's `RequeueExitHold`.
pub const HELD: u8 = 76;

/// Path of the record that belongs to a log.
pub(crate) fn record_path(log: &Path) -> PathBuf {
    log.with_extension("json")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_sessions_in_a_row_without_a_new_path_count() {
        // 20 preemptions, each after some progress.
        let mut sessions = Sessions::default();
        for paths in 0..20 {
            sessions = sessions.begin("7", "n1", paths, 0);
            sessions.check_progress().unwrap();
            sessions.end(75, paths + 1).unwrap();
        }
        // Two that bring nothing, one of them killed, and one that does.
        sessions = sessions.begin("7", "n1", 20, 0);
        sessions.end(75, 20).unwrap();
        sessions = sessions.begin("7", "n1", 20, 0).begin("7", "n1", 20, 0);
        assert_eq!(sessions.fruitless, 2);
        sessions.end(75, 21).unwrap();
        // Three that bring nothing: the third says so.
        for fruitless in 0..3 {
            sessions = sessions.begin("7", "n1", 21, 0);
            sessions.check_progress().unwrap();
            assert_eq!(sessions.end(75, 21).is_err(), fruitless == 2, "{fruitless}");
        }
        // Three that were killed before they could say anything: the fourth says so.
        for killed in 0..4 {
            sessions = sessions.begin("7", "n1", 21, 0);
            assert_eq!(sessions.check_progress().is_err(), killed == 3, "{killed}");
        }
        // A task that is held because of its memory, and released with more, begins anew.
        sessions = sessions.begin("7", "n1", 21, 0).begin("7", "n1", 21, 0).begin("7", "n1", 21, 0);
        sessions.hold();
        sessions = sessions.begin("7", "n1", 21, 0);
        assert_eq!((sessions.begun, sessions.fruitless), (1, 0));
        // What is submitted again begins anew; what ends otherwise than interrupted is not counted here.
        sessions = sessions.begin("8", "n1", 21, 0);
        assert_eq!((sessions.begun, sessions.fruitless), (1, 0));
        sessions.fruitless = 2;
        sessions.end(65, 21).unwrap();
    }

    #[test]
    fn a_record_lives_while_it_gives_signs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("task-1.json");
        let mut sessions = Sessions::read(&path).begin("7", "n1", 0, 0);
        assert!(!sessions.is_running(&path));
        sessions.write(&path).unwrap();
        assert!(sessions.is_running(&path) && Sessions::read(&path) == sessions);
        let long_ago = SystemTime::now() - 2 * HEARTBEAT_TIMEOUT;
        File::options().append(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        assert!(!sessions.is_running(&path));
        Sessions::heartbeat(&path);
        assert!(sessions.is_running(&path));
        sessions.end(0, 1).unwrap();
        assert!(!sessions.is_running(&path));
        fs::write(&path, "not JSON").unwrap();
        assert_eq!(Sessions::read(&path), Sessions::default());
    }
}
