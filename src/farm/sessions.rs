//! What a task has come to: a record beside its log, written by `farm task` and read by `farm status`.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use crate::film::atomic;
use crate::{Error, Result};

/// Sessions of a task that was begun again and again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sessions {
    schema: u32,
    /// The scheduler's number of the submission; another one begins to count anew.
    pub job: String,
    /// Where the last session runs or ran.
    pub host: String,
    /// Sessions begun.
    pub begun: u32,
    /// Paths that the task's file held when the last one began.
    pub paths: u64,
    /// Sessions in a row, before the last one, that added none.
    pub fruitless: u32,
    /// Byte of the log where the last one begins.
    pub log: u64,
    /// Was it given more memory?
    pub memory_raised: bool,
    /// How much, in MiB: what has less was begun again before the scheduler had heard of it.
    #[serde(default)]
    pub memory_raised_to: u64,
    /// Was the last one ended for want of memory?
    pub out_of_memory: bool,
    /// What the last one ended with; nothing while it runs, and when nobody could say any more.
    pub code: Option<u8>,
}

/// So many sessions without a new path, and a task is not worth another.
const FRUITLESS: u32 = 3;
/// Seconds between signs of life.
pub const BEAT: Duration = Duration::from_secs(20);
/// Without a sign for so long, a session has died: several beats, as clocks differ and file systems are late.
const DEAD: Duration = Duration::from_secs(120);

impl Sessions {
    /// Reads a record; one that is not there or cannot be read is that of a task never begun.
    pub fn read(path: &Path) -> Self {
        fs::read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
    }

    /// The record as another session begins, for this submission, with so many paths in the task's file.
    pub fn begin(self, job: &str, host: &str, paths: u64, log: u64) -> Self {
        let known = if self.job == job { self } else { Self::default() };
        let fruitless = if known.begun > 0 && paths <= known.paths { known.fruitless + 1 } else { 0 };
        Self {
            schema: 1,
            job: job.into(),
            host: host.into(),
            begun: known.begun + 1,
            paths,
            fruitless,
            log,
            memory_raised: known.memory_raised,
            memory_raised_to: known.memory_raised_to,
            out_of_memory: false,
            code: None,
        }
    }

    /// Have the last sessions got nowhere so often that this one need not try?
    ///
    /// # Errors
    /// [`Error::Host`] then.
    pub fn worth_another(&mut self) -> Result<()> {
        match self.fruitless < FRUITLESS {
            true => Ok(()),
            false => Err(self.nowhere()),
        }
    }

    /// As a session ends with this code, and with so many paths in the task's file.
    ///
    /// # Errors
    /// [`Error::Host`] instead of "interrupted" where it was one fruitless session too many.
    pub fn end(&mut self, code: u8, paths: u64) -> Result<()> {
        self.code = Some(code);
        // Nothing of a session that is over is the next one's to count.
        let fruitless = if paths <= self.paths { self.fruitless + 1 } else { 0 };
        match code == INTERRUPTED && fruitless >= FRUITLESS {
            true => Err(self.nowhere()),
            false => Ok(()),
        }
    }

    fn nowhere(&mut self) -> Error {
        // Whoever releases a held task has changed something: it counts anew.
        self.begun = 0;
        Error::Host(format!(
            "begun {FRUITLESS} times in a row, and interrupted each time before anything was saved: give it more time or \
             a faster host"
        ))
    }

    /// Writes the record.
    ///
    /// # Errors
    /// As [`atomic::write`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
        atomic::write(path, |file| Ok(Ok(file.write_all(&json)?)))
    }

    /// Gives a sign of life. Where that fails nothing is lost but the sign.
    pub fn beat(path: &Path) {
        let _ = File::options().append(true).open(path).and_then(|file| file.set_modified(SystemTime::now()));
    }

    /// Does its last session run, by its signs of life?
    pub fn runs(&self, path: &Path) -> bool {
        let age = fs::metadata(path).and_then(|meta| meta.modified()).map(|time| time.elapsed().unwrap_or_default());
        self.begun > 0 && self.code.is_none() && age.is_ok_and(|age| age < DEAD)
    }
}

/// Exit code of what was interrupted, and goes on when it is begun again.
pub const INTERRUPTED: u8 = 75;
/// Exit code of what this host cannot do: a site's `RequeueExitHold`.
pub const HELD: u8 = 76;

/// The record's place, beside the log.
pub fn beside(log: &Path) -> PathBuf {
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
            sessions.worth_another().unwrap();
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
            sessions.worth_another().unwrap();
            assert_eq!(sessions.end(75, 21).is_err(), fruitless == 2, "{fruitless}");
        }
        // Three that were killed before they could say anything: the fourth says so.
        for killed in 0..4 {
            sessions = sessions.begin("7", "n1", 21, 0);
            assert_eq!(sessions.worth_another().is_err(), killed == 3, "{killed}");
        }
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
        assert!(!sessions.runs(&path));
        sessions.write(&path).unwrap();
        assert!(sessions.runs(&path) && Sessions::read(&path) == sessions);
        let long_ago = SystemTime::now() - 2 * DEAD;
        File::options().append(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        assert!(!sessions.runs(&path));
        Sessions::beat(&path);
        assert!(sessions.runs(&path));
        sessions.end(0, 1).unwrap();
        assert!(!sessions.runs(&path));
        fs::write(&path, "not JSON").unwrap();
        assert_eq!(Sessions::read(&path), Sessions::default());
    }
}
