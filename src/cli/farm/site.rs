//! Slurm's commands: scontrol, sbatch, squeue.

use std::collections::HashMap;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::farm::slurm::{Submitted, quoted};
use crate::{Error, Result};

/// Largest array with Slurm's default MaxArraySize of 1001, which is one more than the largest index.
pub(crate) const DEFAULT_ARRAY_SIZE: usize = 1000;

/// Configuration of a Slurm site.
pub struct Site {
    pub max_array_size: usize,
    /// Whether it requeues tasks that exit with 75.
    pub requeues: bool,
}

impl Site {
    /// Reads the configuration with scontrol.
    pub fn query() -> Result<Self> {
        let config = capture("scontrol", &["show".into(), "config".into()])?;
        let value_of = |key: &str| {
            let line = config.lines().find(|line| line.split('=').next().is_some_and(|name| name.trim() == key))?;
            line.split_once('=').map(|(_, value)| value.trim().to_owned())
        };
        let max_array_size =
            value_of("MaxArraySize").and_then(|n| n.parse::<usize>().ok()).map_or(DEFAULT_ARRAY_SIZE, |n| n.max(2) - 1);
        let requeues = value_of("RequeueExit").is_some_and(|codes| codes.split(',').any(|code| code.trim() == "75"));
        Ok(Self { max_array_size, requeues })
    }
}

/// Submits a job; returns its ID.
pub fn sbatch(arguments: &[String]) -> Result<String> {
    let all: Vec<String> = [String::from("--parsable")].into_iter().chain(arguments.iter().cloned()).collect();
    // The answer is "id" or "id;cluster".
    let answer = capture("sbatch", &all)?;
    Ok(answer.trim().split(';').next().unwrap_or_default().to_owned())
}

/// Standard output of a program.
/// Errors: [`Error::Host`] if it cannot be run, or fails.
pub(crate) fn capture(program: &str, arguments: &[String]) -> Result<String> {
    let output = Command::new(program).args(arguments).output().map_err(|e| {
        Error::Host(format!(
            "cannot run {program}: {e}; is Slurm installed here? --dry-run and --format openjd work without it"
        ))
    })?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        return Err(Error::Host(format!("{program} {}: {}", quoted(arguments), message.trim())));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Slurm's state of a task or a merge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueueState {
    Waiting,
    Running,
    Held,
}

/// Submitted tasks and merges in Slurm's queue.
pub struct Queue<'a> {
    submitted: &'a Submitted,
    /// States by job ID and array index; the index is "" for merges.
    states: HashMap<(String, String), QueueState>,
}

const SQUEUE_TIMEOUT: Duration = Duration::from_secs(5);

impl<'a> Queue<'a> {
    /// Runs squeue; `None` if it fails or does not answer in time.
    pub fn query(submitted: &'a Submitted) -> Option<Self> {
        let ids = submitted.arrays.iter().map(|array| &array.job).chain(&submitted.merges);
        let ids = ids.cloned().collect::<Vec<_>>().join(",");
        let mut command = Command::new("squeue");
        command.args(["--noheader", "--array", "--format=%F %K %T %r", &format!("--jobs={ids}")]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
        // A thread reads, because a long answer does not fit into the pipe's buffer.
        let out = child.stdout.take()?;
        let reader = thread::spawn(move || std::io::read_to_string(out).unwrap_or_default());
        let began = Instant::now();
        let status = loop {
            match child.try_wait().ok()? {
                Some(status) => break status,
                None if began.elapsed() > SQUEUE_TIMEOUT => {
                    let _ = child.kill().and_then(|()| child.wait());
                    return None;
                }
                None => thread::sleep(Duration::from_millis(10)),
            }
        };
        let answer = reader.join().ok()?;
        // squeue also fails when Slurm has forgotten all these jobs.
        status.success().then(|| Self { submitted, states: answer.lines().filter_map(parse_state).collect() })
    }

    pub fn task(&self, number: usize) -> Option<QueueState> {
        let array = self.submitted.arrays.iter().find(|a| (a.first..a.first + a.count).contains(&number))?;
        self.states.get(&(array.job.clone(), (number - array.first + 1).to_string())).copied()
    }

    pub fn merge(&self, number: usize) -> Option<QueueState> {
        self.states.get(&(self.submitted.merges.get(number)?.clone(), String::new())).copied()
    }
}

/// Parses a line of squeue: "job index state reason", with the index "N/A" outside of arrays.
fn parse_state(line: &str) -> Option<((String, String), QueueState)> {
    let mut words = line.trim().splitn(4, ' ');
    let (job, index, state) = (words.next()?, words.next()?, words.next()?);
    let reason = words.next().unwrap_or_default();
    let index = if index == "N/A" { "" } else { index };
    let held = reason.to_lowercase().contains("held") || reason == "DependencyNeverSatisfied";
    let queue_state = match state {
        "SPECIAL_EXIT" | "REQUEUE_HOLD" | "RESV_DEL_HOLD" => QueueState::Held,
        "PENDING" if held => QueueState::Held,
        "PENDING" | "REQUEUED" => QueueState::Waiting,
        "RUNNING" | "CONFIGURING" | "COMPLETING" | "SUSPENDED" | "STAGE_OUT" | "SIGNALING" | "STOPPED" => {
            QueueState::Running
        }
        _ => return None,
    };
    Some(((job.into(), index.into()), queue_state))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_squeue_says_is_understood() {
        let key = |job: &str, index: &str| (job.to_owned(), index.to_owned());
        for (line, understood) in [
            ("12 3 RUNNING None", Some((key("12", "3"), QueueState::Running))),
            ("12 4 PENDING Resources", Some((key("12", "4"), QueueState::Waiting))),
            ("12 5 PENDING JobHeldUser", Some((key("12", "5"), QueueState::Held))),
            ("12 6 PENDING launch failed requeued held", Some((key("12", "6"), QueueState::Held))),
            ("12 7 SPECIAL_EXIT JobHeldUser", Some((key("12", "7"), QueueState::Held))),
            ("13 N/A PENDING Dependency", Some((key("13", ""), QueueState::Waiting))),
            ("12 8 FAILED NonZeroExitCode", None),
            ("", None),
        ] {
            assert_eq!(parse_state(line), understood, "{line}");
        }
    }
}
