//! Slurm's own programs: what is asked of them and what they say.

use std::collections::HashMap;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::farm::slurm::{Submitted, quoted};
use crate::{Error, Result};

/// Slurm's default for MaxArraySize is 1001, which is one more than the highest index.
pub const USUAL_ARRAY: usize = 1000;

/// What a site allows.
pub struct Site {
    pub largest_array: usize,
    /// Does it begin tasks again that exit with 75?
    pub requeues: bool,
}

impl Site {
    pub fn ask() -> Result<Self> {
        let config = capture("scontrol", &["show".into(), "config".into()])?;
        let of = |key: &str| {
            let line = config.lines().find(|line| line.split('=').next().is_some_and(|name| name.trim() == key))?;
            line.split_once('=').map(|(_, value)| value.trim().to_owned())
        };
        let largest = of("MaxArraySize").and_then(|n| n.parse::<usize>().ok()).map_or(USUAL_ARRAY, |n| n.max(2) - 1);
        let requeues = of("RequeueExit").is_some_and(|codes| codes.split(',').any(|code| code.trim() == "75"));
        Ok(Self { largest_array: largest, requeues })
    }
}

/// Submits; the job's number.
pub fn sbatch(arguments: &[String]) -> Result<String> {
    let all: Vec<String> = [String::from("--parsable")].into_iter().chain(arguments.iter().cloned()).collect();
    // "number" or "number;cluster".
    let answer = capture("sbatch", &all)?;
    Ok(answer.trim().split(';').next().unwrap_or_default().to_owned())
}

/// What a program says on standard output.
///
/// # Errors
/// [`Error::Host`] if it cannot be run, or fails.
pub fn capture(program: &str, arguments: &[String]) -> Result<String> {
    let output = Command::new(program).args(arguments).output().map_err(|e| {
        Error::Host(format!(
            "cannot run {program}: {e}; is Slurm installed here? --dry-run and --format openjd need none"
        ))
    })?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(Error::Host(format!("{program} {}: {}", quoted(arguments), said.trim())));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// What Slurm does with a task or a merge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    Waits,
    Runs,
    Held,
}

/// What Slurm's queue holds of what was submitted.
pub struct Queue<'a> {
    submitted: &'a Submitted,
    /// By number and index in the array, "" for merges.
    fates: HashMap<(String, String), Fate>,
}

/// Longer than this nobody who asks for a status waits for Slurm's answer.
const PATIENCE: Duration = Duration::from_secs(5);

impl<'a> Queue<'a> {
    /// Asks Slurm; `None` if it does not answer.
    pub fn ask(submitted: &'a Submitted) -> Option<Self> {
        let ids = submitted.arrays.iter().map(|array| &array.job).chain(&submitted.merges);
        let ids = ids.cloned().collect::<Vec<_>>().join(",");
        let mut command = Command::new("squeue");
        command.args(["--noheader", "--array", "--format=%F %K %T %r", &format!("--jobs={ids}")]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
        // Read beside waiting: a long answer does not fit into a pipe.
        let out = child.stdout.take()?;
        let reader = thread::spawn(move || std::io::read_to_string(out).unwrap_or_default());
        let began = Instant::now();
        let status = loop {
            match child.try_wait().ok()? {
                Some(status) => break status,
                None if began.elapsed() > PATIENCE => {
                    let _ = child.kill().and_then(|()| child.wait());
                    return None;
                }
                None => thread::sleep(Duration::from_millis(10)),
            }
        };
        let answer = reader.join().ok()?;
        // All jobs may be forgotten already: that is a failure without an answer, too.
        status.success().then(|| Self { submitted, fates: answer.lines().filter_map(fate).collect() })
    }

    /// Of a task, counted from 0.
    pub fn task(&self, number: usize) -> Option<Fate> {
        let array = self.submitted.arrays.iter().find(|a| (a.first..a.first + a.count).contains(&number))?;
        self.fates.get(&(array.job.clone(), (number - array.first + 1).to_string())).copied()
    }

    /// Of a merge, counted from 0.
    pub fn merge(&self, number: usize) -> Option<Fate> {
        self.fates.get(&(self.submitted.merges.get(number)?.clone(), String::new())).copied()
    }
}

/// A line of squeue: "job index state reason", the index "N/A" outside of arrays.
fn fate(line: &str) -> Option<((String, String), Fate)> {
    let mut words = line.trim().splitn(4, ' ');
    let (job, index, state) = (words.next()?, words.next()?, words.next()?);
    let reason = words.next().unwrap_or_default();
    let index = if index == "N/A" { "" } else { index };
    let held = reason.to_lowercase().contains("held") || reason == "DependencyNeverSatisfied";
    let fate = match state {
        "SPECIAL_EXIT" | "REQUEUE_HOLD" | "RESV_DEL_HOLD" => Fate::Held,
        "PENDING" if held => Fate::Held,
        "PENDING" | "REQUEUED" => Fate::Waits,
        "RUNNING" | "CONFIGURING" | "COMPLETING" | "SUSPENDED" | "STAGE_OUT" | "SIGNALING" | "STOPPED" => Fate::Runs,
        _ => return None,
    };
    Some(((job.into(), index.into()), fate))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_squeue_says_is_understood() {
        let key = |job: &str, index: &str| (job.to_owned(), index.to_owned());
        for (line, understood) in [
            ("12 3 RUNNING None", Some((key("12", "3"), Fate::Runs))),
            ("12 4 PENDING Resources", Some((key("12", "4"), Fate::Waits))),
            ("12 5 PENDING JobHeldUser", Some((key("12", "5"), Fate::Held))),
            ("12 6 PENDING launch failed requeued held", Some((key("12", "6"), Fate::Held))),
            ("12 7 SPECIAL_EXIT JobHeldUser", Some((key("12", "7"), Fate::Held))),
            ("13 N/A PENDING Dependency", Some((key("13", ""), Fate::Waits))),
            ("12 8 FAILED NonZeroExitCode", None),
            ("", None),
        ] {
            assert_eq!(fate(line), understood, "{line}");
        }
    }
}
