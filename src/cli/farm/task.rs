//! `bismar farm task`: one session of a task, on whatever machine the scheduler has chosen.

use std::env;
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
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
use crate::farm::sessions::{BEAT, HELD, INTERRUPTED, Sessions, beside};
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
    let log = File::options().create(true).read(true).append(true).open(&path).map_err(cannot)?;
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
    let mut session = Session { sessions, record, log, outputs, retries_memory: plan.retries_memory };
    let code = session.run(&mut process, &signals).unwrap_or_else(|error| {
        let _ = writeln!(session.log, "error: {error}");
        error.exit_code()
    });
    session.sessions.code = Some(code);
    session.sessions.write(&session.record)?;
    Ok(Verdict::Worst(code))
}

struct Session {
    sessions: Sessions,
    record: PathBuf,
    log: File,
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
        // Whoever else kills, as Slurm does, kills this process as well.
        let killed = status.signal() == Some(SIGKILL);
        if killed || status.code() == Some(HELD.into()) && self.wanted_memory() {
            return Err(self.out_of_memory(killed));
        }
        let code = code(status)?;
        self.sessions.end(code, paths(&self.outputs))?;
        Ok(code)
    }

    /// Did the render say that it had too little memory, before it began or when there was no more?
    fn wanted_memory(&mut self) -> bool {
        let mut said = String::new();
        let read = self.log.seek(SeekFrom::Start(self.sessions.log)).and_then(|_| self.log.read_to_string(&mut said));
        let of_memory = |line: &str| line.starts_with("error: ") && line.contains("memory");
        read.is_ok() && said.lines().any(|line| of_memory(line) || line.starts_with("memory allocation of"))
    }

    /// Lets Slurm begin the task again with half as much memory again, once and if that is asked for, else hold it. Both
    /// now, while it runs: what Slurm sees run out of memory fails, whatever it exits with, and takes its merge along.
    fn out_of_memory(&mut self, killed: bool) -> Error {
        let memory = [("SLURM_MEM_PER_NODE", "MinMemoryNode"), ("SLURM_MEM_PER_CPU", "MinMemoryCPU")];
        let memory = memory.into_iter().find_map(|(name, key)| Some((key, variable(name)?.parse::<u64>().ok()?)));
        let memory = memory.filter(|(_, mebibytes)| *mebibytes > 0);
        let Sessions { memory_raised, memory_raised_to, .. } = self.sessions;
        let more = memory.filter(|(_, given)| self.retries_memory && (!memory_raised || *given < memory_raised_to));
        let more = more.map(|(key, given)| (key, given + given.div_ceil(2)));
        self.sessions.out_of_memory = true;
        if let Some((_, raised)) = more {
            (self.sessions.memory_raised, self.sessions.memory_raised_to) = (true, raised);
        }
        let had = memory.map_or(String::new(), |(_, mebibytes)| format!(" (it was given {mebibytes} MiB)"));
        let how = if killed { ": the system has killed the process" } else { "" };
        let why = format!("out of memory{had}{how}");
        let Some(job) = job() else { return Error::Host(format!("{why}; give it more")) };
        let (orders, told): (Vec<Vec<String>>, _) = match more {
            Some((key, raised)) => {
                let update = ["update".into(), format!("JobId={job}"), format!("{key}={raised}")];
                let told = Error::Interrupted(format!("{why}; Slurm begins it again with {raised} MiB"));
                (vec![vec!["requeue".into(), job], update.into()], told)
            }
            None => {
                let key = memory.map_or("MinMemoryNode", |(key, _)| key);
                let told = Error::Host(format!(
                    "{why}; Slurm holds it, and its merge waits: scontrol update JobId={job} {key}=MIB, then scontrol \
                     release {job}"
                ));
                (vec![vec!["requeuehold".into(), job]], told)
            }
        };
        // Slurm's signals follow the first order: what is to be known is written before it.
        match self.sessions.write(&self.record).and_then(|()| orders.iter().try_for_each(|words| order(words))) {
            Ok(()) => told,
            Err(e) => Error::Host(format!("{why}; {e}")),
        }
    }
}

/// Slurm's name for this task alone: the number of an array's last task is the array's, too.
fn job() -> Option<String> {
    let array = variable("SLURM_ARRAY_JOB_ID").zip(variable("SLURM_ARRAY_TASK_ID"));
    array.map(|(array, task)| format!("{array}_{task}")).or_else(|| variable("SLURM_JOB_ID"))
}

/// Has `scontrol` do something. What it orders may end this task, whose processes Slurm then sends SIGTERM: it is not to
/// hear of that.
fn order(words: &[String]) -> Result<()> {
    let deaf = ["-c", "trap '' TERM; exec scontrol \"$@\"", "scontrol"].map(str::to_owned);
    capture("sh", &[&deaf[..], words].concat()).map(drop)
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
