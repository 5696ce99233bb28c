//! `bismar farm task`: one session of a task, on the machine that the scheduler has chosen.

use std::env;
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Command, ExitStatus};
use std::time::Instant;

use clap::Args;
use signal_hook::consts::SIGKILL;

use super::site::capture;
use crate::console::child::{lead, this_program};
use crate::console::signals::HEARD;
use crate::console::{Signals, Verdict};
use crate::farm::Plan;
use crate::farm::array::array_task;
use crate::farm::sessions::{HEARTBEAT, HELD, INTERRUPTED, Sessions, record_path};
use crate::film::atomic;
use crate::film::lock::claim;
use crate::render::record::checkpoint::Earlier;
use crate::{Error, Result};

/// Run one task of a plan; called by the scripts of `farm submit`.
///
/// Output is appended to the task's log, and a record of its sessions is kept next to it. The exit code is that of the
/// render or merge, or 76 if three sessions in a row made no progress or the task was killed for lack of memory.
#[derive(Debug, Args)]
pub struct TaskArgs {
    /// Number of the task, from 1; or auto: that of this process in the array of Slurm, AWS Batch or Kubernetes that it is a
    /// task of.
    #[arg(value_name = "N|auto", value_parser = number)]
    number: usize,
    /// The plan: farm.json in the folder written by `farm submit`.
    #[arg(long, value_name = "FILE.json")]
    plan: PathBuf,
    /// Run a merge instead of a render.
    #[arg(long)]
    merge: bool,
}

fn number(text: &str) -> std::result::Result<usize, String> {
    match text {
        "auto" => array_task().map(|task| task.number as usize),
        _ => text.parse().map_err(|_| "neither the number of a task nor auto".into()),
    }
}

pub fn run(args: &TaskArgs) -> Result<Verdict> {
    let signals = Signals::listen()?;
    let plan = Plan::read(&args.plan)?;
    let (command, outputs) = plan.command(args.number, args.merge)?;
    let path = plan.log(args.number, args.merge);
    atomic::confine(std::slice::from_ref(&plan.folder));
    let record = record_path(&path);
    for own in outputs.iter().chain([&path, &record]).filter(|output| output.starts_with(&plan.folder)) {
        atomic::create_folder(own)?;
    }
    // Another session of this task may still run.
    let _claim = claim(&record)?;
    let cannot = |e| Error::CannotCreate(format!("{}: cannot write: {e}", path.display()));
    let log = atomic::open_guessable(File::options().create(true).read(true).append(true), &path).map_err(cannot)?;
    let log_start = log.metadata().map_or(0, |meta| meta.len());
    // Always this program, whatever the plan names: a plan must not start other programs.
    let mut process = this_program();
    process.args(&command[1..]).env(atomic::OF_A_PLAN, "1");
    process.stdout(log.try_clone().map_err(cannot)?).stderr(log.try_clone().map_err(cannot)?);
    if !args.merge {
        process.arg("--signals-from-parent");
    }
    let job = [variable("SLURM_ARRAY_JOB_ID"), variable("SLURM_JOB_ID")].into_iter().flatten().next();
    let sessions = Sessions::read(&record).begin(&job.unwrap_or_default(), &host(), paths(&outputs), log_start);
    let (retries_memory, is_led) = (plan.retries_memory, !args.merge);
    let mut session = Session { sessions, record, log, outputs, retries_memory, is_led };
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
    /// Whether the command listens to this process.
    is_led: bool,
}

impl Session {
    /// Runs the render or merge; returns its exit code.
    fn run(&mut self, process: &mut Command, signals: &Signals) -> Result<u8> {
        self.sessions.check_progress()?;
        self.sessions.write(&self.record)?;
        let mut last_beat = Instant::now();
        let status = lead(process, self.is_led.then_some(&[]), signals, &|_| (), &mut || {
            if last_beat.elapsed() > HEARTBEAT {
                last_beat = Instant::now();
                Sessions::heartbeat(&self.record);
            }
        })?;
        // Slurm's SIGKILL also kills this process; only the out-of-memory killer kills the child alone.
        let killed = status.signal() == Some(SIGKILL);
        if killed || status.code() == Some(HELD.into()) && self.lacked_memory() {
            return Err(self.out_of_memory(killed));
        }
        let code = exit_code(status)?;
        self.sessions.end(code, paths(&self.outputs))?;
        Ok(code)
    }

    /// Whether the log tells that the render lacked memory, before it began or while it ran.
    fn lacked_memory(&mut self) -> bool {
        let mut said = String::new();
        let read = self.log.seek(SeekFrom::Start(self.sessions.log)).and_then(|_| self.log.read_to_string(&mut said));
        let of_memory = |line: &str| line.starts_with("error: ") && line.contains("memory");
        read.is_ok() && said.lines().any(|line| of_memory(line) || line.starts_with("memory allocation of"))
    }

    /// Makes Slurm requeue the task with 1.5 times the memory (once, with --retry-memory), else hold it. Both must happen while
    /// the task runs: Slurm fails a task that ran out of memory whatever its exit code, and its merge with it.
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
        let had = memory.map_or(String::new(), |(_, mebibytes)| format!(" (limit {mebibytes} MiB)"));
        let how = if killed { ": the system has killed the process" } else { "" };
        let why = format!("out of memory{had}{how}");
        let Some(job) = slurm_job_id() else { return Error::Host(format!("{why}; give it more")) };
        let (commands, error): (Vec<Vec<String>>, _) = match more {
            Some((key, raised)) => {
                let update = ["update".into(), format!("JobId={job}"), format!("{key}={raised}")];
                let error = Error::Interrupted(format!("{why}; Slurm requeues it with {raised} MiB"));
                (vec![vec!["requeue".into(), job], update.into()], error)
            }
            None => {
                self.sessions.hold();
                let key = memory.map_or("MinMemoryNode", |(key, _)| key);
                let error = Error::Host(format!(
                    "{why}; Slurm holds it, and its merge waits: scontrol update JobId={job} {key}=MIB, then scontrol \
                     release {job}"
                ));
                (vec![vec!["requeuehold".into(), job]], error)
            }
        };
        // The first command makes Slurm signal this task: the record is written before it.
        match self.sessions.write(&self.record).and_then(|()| commands.iter().try_for_each(|words| scontrol(words))) {
            Ok(()) => error,
            Err(e) => Error::Host(format!("{why}; {e}")),
        }
    }
}

/// Slurm's ID of this task, as ARRAY_INDEX in an array: the last task's SLURM_JOB_ID is also the ID of the whole array.
fn slurm_job_id() -> Option<String> {
    let array = variable("SLURM_ARRAY_JOB_ID").zip(variable("SLURM_ARRAY_TASK_ID"));
    array.map(|(array, task)| format!("{array}_{task}")).or_else(|| variable("SLURM_JOB_ID"))
}

/// Runs scontrol. Its command may end this task, and Slurm then sends SIGTERM to all its processes, which scontrol must
/// survive.
fn scontrol(words: &[String]) -> Result<()> {
    let ignoring_sigterm = ["-c", "trap '' TERM; exec scontrol \"$@\"", "scontrol"].map(str::to_owned);
    capture("sh", &[&ignoring_sigterm[..], words].concat()).map(drop)
}

/// Exit code of a render or a merge.
/// Errors: [`Error::Bug`] if an unexpected signal ended it.
fn exit_code(status: ExitStatus) -> Result<u8> {
    match (status.code(), status.signal()) {
        (Some(code), _) => Ok(code as u8),
        // The signal came before the process had its handlers.
        (None, Some(signal)) if HEARD.contains(&signal) => Ok(INTERRUPTED),
        (None, signal) => Err(Error::Bug(format!("ended by signal {}", signal.unwrap_or_default()))),
    }
}

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
