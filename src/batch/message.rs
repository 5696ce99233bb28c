//! What a batch and the processes that work for it say to each other: an order on their standard input, messages on their
//! standard output, one JSON object a line.

use std::ffi::OsString;

use serde::{Deserialize, Serialize};

use super::file::Job;
use super::report::Entry;
use crate::render::Progress;

/// What a process is to do.
#[derive(Debug, Serialize, Deserialize)]
pub struct JobMessage {
    /// In this order.
    pub jobs: Vec<Job>,
    /// Files that the batch itself writes.
    pub written: Vec<OsString>,
    /// Jobs at a time.
    pub at_once: usize,
    /// Threads of each.
    pub threads: usize,
}

/// What happens there; jobs are counted from 0 in the order.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Message {
    /// A job begins.
    Begins(usize),
    /// A job goes on.
    Goes(usize, Progress),
    /// A job has ended.
    Ends(usize, Box<Ended>),
}

impl Message {
    /// Of whom.
    pub fn job(&self) -> usize {
        match self {
            Message::Begins(job) | Message::Goes(job, _) | Message::Ends(job, _) => *job,
        }
    }
}

/// What has come of a job.
#[derive(Debug, Serialize, Deserialize)]
pub struct Ended {
    /// For the report.
    pub entry: Entry,
    /// For people, if there is anything to say.
    pub line: Option<String>,
    /// Paths a pixel of a picture that was there before.
    pub before: Option<u32>,
}
