//! `bismar farm task`: one session of a task, on whatever machine the scheduler has chosen.

use std::env;
use std::fs::{self, File};
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Command, ExitStatus};
use std::time::Instant;

use clap::Args;
use signal_hook::consts::{SIGHUP, SIGINT, SIGKILL, SIGTERM, SIGUSR1};

use super::site::capture;
use crate::console::child::{lead, this_program};
use crate::console::{Signals, Verdict};
use crate::farm::Plan;
use crate::farm::sessions::{BEAT, INTERRUPTED, Sessions, beside};
use crate::render::checkpoint::Earlier;
use crate::{Error, Result};

/// Do one task of a plan, as the scripts of `farm submit` ask for it.
///
/// What it says is appended to its log, and a record of it is kept beside that. The exit code is that of its render or
/// merge, but 76 where it got nowhere three times in a row, or was killed for want of memory.
#[derive(Debug, Args)]
pub struct TaskArgs {
    /// Which, counted from 1.
    number: usize,
    /// The plan: farm.json in the folder of `farm submit`.
    #[arg(long, value_name = "FILE.json")]
    plan: PathBuf,
    /// Of the plan's merges, not of its renders.
    #[arg(long)]
    merge: bool,
}

pub fn run(args: &TaskArgs) -> Result<Verdict> {
    let signals = Signals::listen()?;
    let plan = Plan::read(&args.plan)?;
    let (command, outputs) = plan.command(args.number, args.merge)?;
    let path = plan.log(args.number, args.merge);
    let cannot = |e| Error::CannotCreate(format!("{}: cannot write: {e}", path.display()));
    let mut log = File::options().create(true).append(true).open(&path).map_err(cannot)?;
    let said = log.metadata().map_or(0, |meta| meta.len());
    // The plan's word for the program is not asked: a plan can make this program render and merge, and no other do
    // anything.
    let mut process = this_program();
    process.args(&command[1..]);
    process.stdout(log.try_clone().map_err(cannot)?).stderr(log.try_clone().map_err(cannot)?);
    if !args.merge {
        process.arg("--led");
    }
    let record = beside(&path);
    let job = [variable("SLURM_ARRAY_JOB_ID"), variable("SLURM_JOB_ID")].into_iter().flatten().next();
    let sessions = Sessions::read(&record).begin(&job.unwrap_or_default(), &host(), paths(&outputs), said);
    let mut session = Session { sessions, record, outputs, retries_memory: plan.retries_memory };
    let code = session.run(&mut process, &signals).unwrap_or_else(|error| {
        let _ = writeln!(log, "error: {error}");
        error.exit_code()
    });
    session.sessions.code = Some(code);
    session.sessions.write(&session.record)?;
    Ok(Verdict::Worst(code))
}

struct Session {
    sessions: Sessions,
    record: PathBuf,
    outputs: Vec<PathBuf>,
    retries_memory: bool,
}

impl Session {
    /// The exit code.
    fn run(&mut self, process: &mut Command, signals: &Signals) -> Result<u8> {
        self.sessions.worth_another()?;
        self.sessions.write(&self.record)?;
        let mut beaten = Instant::now();
        let status = lead(process, &[], signals, &|_| (), &mut || {
            if beaten.elapsed() > BEAT {
                beaten = Instant::now();
                Sessions::beat(&self.record);
            }
        })?;
        if status.signal() == Some(SIGKILL) {
            // Whoever else kills, as Slurm does, kills this process as well.
            return Err(self.out_of_memory());
        }
        let code = code(status)?;
        self.sessions.end(code, paths(&self.outputs))?;
        Ok(code)
    }

    /// Lets Slurm begin the task again with half as much memory again, once and if that is asked for, else hold it. Both
    /// now, while it runs: what Slurm sees run out of memory fails, whatever it exits with, and takes its merge along.
    fn out_of_memory(&mut self) -> Error {
        let memory = [("SLURM_MEM_PER_NODE", "MinMemoryNode"), ("SLURM_MEM_PER_CPU", "MinMemoryCPU")];
        let memory = memory.into_iter().find_map(|(name, key)| Some((key, variable(name)?.parse::<u64>().ok()?)));
        let memory = memory.filter(|(_, mebibytes)| *mebibytes > 0);
        let more = memory.filter(|_| self.retries_memory && !self.sessions.memory_raised);
        self.sessions.out_of_memory = true;
        self.sessions.memory_raised |= more.is_some();
        let had = memory.map_or(String::new(), |(_, mebibytes)| format!(" (it was given {mebibytes} MiB)"));
        let why = format!("out of memory{had}: the system has killed the process");
        // Slurm's signals follow at once.
        let written = self.sessions.write(&self.record);
        let Some(job) = variable("SLURM_JOB_ID") else { return Error::Host(format!("{why}; give it more")) };
        let scontrol = |words: &[&str]| capture("scontrol", &words.iter().map(|&word| word.into()).collect::<Vec<_>>());
        let done = written.and_then(|()| match more {
            Some((key, mebibytes)) => {
                let raised = mebibytes + mebibytes.div_ceil(2);
                scontrol(&["requeue", &job])?;
                scontrol(&["update", &format!("JobId={job}"), &format!("{key}={raised}")])?;
                Ok(Error::Interrupted(format!("{why}; Slurm begins it again with {raised} MiB")))
            }
            None => {
                scontrol(&["requeuehold", &job])?;
                let key = memory.map_or("MinMemoryNode", |(key, _)| key);
                Ok(Error::Host(format!(
                    "{why}; Slurm holds it, and its merge waits: scontrol update JobId={job} {key}=MIB, then scontrol \
                     release {job}"
                )))
            }
        });
        done.unwrap_or_else(|e| Error::Host(format!("{why}; {e}")))
    }
}

/// What a render or a merge ended with.
///
/// # Errors
/// [`Error::Bug`] where it was by a signal that nobody sends.
fn code(status: ExitStatus) -> Result<u8> {
    match (status.code(), status.signal()) {
        (Some(code), _) => Ok(code as u8),
        // Before it listened.
        (None, Some(SIGINT | SIGTERM | SIGHUP | SIGUSR1)) => Ok(INTERRUPTED),
        (None, signal) => Err(Error::Bug(format!("ended by signal {}", signal.unwrap_or_default()))),
    }
}

/// Paths that pictures hold.
fn paths(pictures: &[PathBuf]) -> u64 {
    let of = |picture: &PathBuf| Earlier::read(picture).ok().flatten().map_or(0, |earlier| earlier.record.stats.paths);
    pictures.iter().map(of).sum()
}

fn variable(name: &str) -> Option<String> {
    env::var(name).ok().filter(|value| !value.trim().is_empty())
}

fn host() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").map_or(String::new(), |name| name.trim().to_owned())
}
