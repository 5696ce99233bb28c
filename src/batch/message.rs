//! Messages between a batch and its worker processes: a [`JobMessage`] on a worker's standard input, [`Message`]s on its
//! standard output, one JSON object per line.

use std::ffi::OsString;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::job::Job;
use super::report::Entry;
use crate::render::Progress;

/// The jobs that a worker process renders.
#[derive(Debug, Serialize, Deserialize)]
pub struct JobMessage {
    /// Jobs, in the order in which they begin.
    pub jobs: Vec<Job>,
    /// Files that the batch itself writes.
    pub written: Vec<OsString>,
    /// Folders below which outputs may lie.
    pub folders: Vec<PathBuf>,
    pub at_once: usize,
    pub threads: usize,
}

/// Progress of a worker process. Jobs are indices into [`JobMessage::jobs`].
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Message {
    Begins(usize),
    /// A job has made progress.
    #[serde(rename = "goes")]
    Progress(usize, Progress),
    Ends(usize, Box<Ended>),
}

impl Message {
    pub fn job(&self) -> usize {
        match self {
            Message::Begins(job) | Message::Progress(job, _) | Message::Ends(job, _) => *job,
        }
    }
}

#[derive(Debug, Serialize, Deserialize)]
pub struct Ended {
    pub entry: Entry,
    /// Line of text for the terminal, if any.
    pub line: Option<String>,
    /// Paths per pixel of a picture that was finished before.
    pub before: Option<u32>,
}
