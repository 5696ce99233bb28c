//! `bismar farm status`: the state of a plan, from its files and from Slurm's queue.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::site::{Queue, QueueState};
use crate::batch::frames::Sequence;
use crate::batch::numbering::{numbered, numbered_name};
use crate::batch::split::split;
use crate::cli::render;
use crate::console::{Verdict, print, print_json};
use crate::farm::sessions::{HELD, INTERRUPTED, Sessions, record_path};
use crate::farm::slurm::Submitted;
use crate::farm::{PLAN, Plan};
use crate::job::{Inputs, RenderRequest, Session};
use crate::render::record::checkpoint::Earlier;
use crate::scene::import::read_own;
use crate::{Error, Result};

/// Show the progress of a submitted plan.
///
/// Output files are compared with the plan. Slurm's queue, if available, tells which tasks are waiting, running or held.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Folder written by `farm submit`.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

struct State {
    /// `waiting`, `running`, `begun`, `held`, `failed`, `dead`, `stale` or `done` (docs/farm.md).
    name: &'static str,
    /// Fraction of its paths, in [0, 1].
    fraction: f64,
    /// Error of the last session, or what is wrong with the file.
    error: Option<String>,
    output: PathBuf,
    frame: Option<u32>,
}

pub fn run(args: &StatusArgs) -> Result<Verdict> {
    let plan = Plan::read(&args.folder.join(PLAN))?;
    let submitted = Submitted::read(&plan.folder);
    let queue = submitted.as_ref().and_then(Queue::query);
    let mut inspector = Inspector { submitted: submitted.as_ref(), inputs: HashMap::new() };
    let (mut tasks, mut merges) = (Vec::new(), Vec::new());
    for (i, task) in plan.tasks.iter().enumerate() {
        let queue_state = queue.as_ref().and_then(|queue| queue.task(i));
        let states = inspector.states(&parse_command(&task.command)?, &plan.log(i + 1, false), queue_state);
        tasks.extend(states.into_iter().map(|state| Row { render: &task.render, part: task.part, task: i + 1, state }));
    }
    for (i, merge) in plan.merges.iter().enumerate() {
        let queue_state = queue.as_ref().and_then(|queue| queue.merge(i));
        let mut whole = parse_command(&plan.tasks[merge.tasks.0].command)?;
        // The merged picture is whole, and need not be resumable as its parts are.
        for (frame, whole) in whole.iter_mut() {
            (whole.part, whole.checkpoint) = (None, None);
            let output = frame.and_then(|frame| numbered(&merge.output, frame));
            whole.output = output.unwrap_or_else(|| merge.output.clone());
        }
        let states = inspector.states(&whole, &plan.log(i + 1, true), queue_state);
        merges.extend(states.into_iter().map(|state| Row { render: &merge.render, part: 0, task: i + 1, state }));
    }
    let is_done = |row: &Row| row.state.name == "done";
    let done = tasks.iter().filter(|row| is_done(row)).count();
    let all = tasks.iter().map(|row| row.state.fraction).sum::<f64>() / tasks.len().max(1) as f64;
    let complete = done == tasks.len() && merges.iter().all(is_done);
    let sequences = plan.tasks.iter().any(|task| task.frames.is_some());
    if args.json {
        print_json(&json!({ "schema": 1, "name": plan.name, "complete": complete, "fraction": all,
            "slurm_answers": queue.is_some(), "tasks": tasks.iter().map(Row::task).collect::<Vec<_>>(),
            "merges": merges.iter().map(Row::merge).collect::<Vec<_>>() }))?;
        return Ok(Verdict::Done);
    }
    let mut text = String::new();
    let error = |row: &Row| row.state.error.as_ref().map_or(String::new(), |e| format!("  {e}"));
    for row in &tasks {
        let part = if plan.parts > 1 { format!(" {}/{}", row.part, plan.parts) } else { String::new() };
        text +=
            &format!("{}{part}: {} {:.0} %{}\n", row.name(), row.state.name, 100.0 * row.state.fraction, error(row));
    }
    for row in &merges {
        text += &format!("{} merged: {}{}\n", row.name(), row.state.name, error(row));
    }
    let what = match (sequences, plan.parts) {
        (true, 1) => "frames",
        (true, _) => "parts of frames",
        _ => "tasks",
    };
    print(format!("{text}{done} of {} {what} done, {:.0} % in all", tasks.len(), 100.0 * all))?;
    Ok(Verdict::Done)
}

/// An output file of a task or a merge; one per frame of a sequence.
struct Row<'a> {
    render: &'a str,
    part: u32,
    /// Number of the task or merge, from 1.
    task: usize,
    state: State,
}

impl Row<'_> {
    fn name(&self) -> String {
        let numbered = self.state.frame.and_then(|frame| numbered_name(self.render, frame));
        numbered.unwrap_or_else(|| self.render.to_owned())
    }

    fn task(&self) -> Value {
        let s = &self.state;
        self.of_sequence(json!({ "render": self.name(), "part": self.part, "state": s.name, "fraction": s.fraction,
            "error": s.error, "output": s.output }))
    }

    fn merge(&self) -> Value {
        let s = &self.state;
        self.of_sequence(json!({ "render": self.name(), "done": s.name == "done", "state": s.name, "error": s.error,
            "output": s.output }))
    }

    fn of_sequence(&self, mut row: Value) -> Value {
        if let Some(frame) = self.state.frame {
            (row["frame"], row["task"]) = (frame.into(), self.task.into());
        }
        row
    }
}

/// Requests with their frames.
type Requests = [(Option<u32>, RenderRequest)];

/// What a task's command asks for, picture by picture, with the numbers of frames.
fn parse_command(command: &[String]) -> Result<Box<Requests>> {
    let bad = |why: &str| Error::Data(format!("{PLAN}: {}", why.trim_end()));
    let args = render::read(&render::command(), command[1..].iter().map(OsString::from));
    let job = args.map_err(|e| bad(&e.to_string()))?.job(String::new())?;
    let frame = |request: &RenderRequest| {
        let frames = matches!(job.sequence, Some(Sequence::Frames(_)));
        request.selection.frame.filter(|_| frames).map(|frame| frame as u32)
    };
    let jobs = split(&job).map_err(|(_, why)| bad(&why))?;
    Ok(jobs.into_iter().map(|job| (frame(&job.request), job.request)).collect())
}

struct Inspector<'a> {
    submitted: Option<&'a Submitted>,
    /// Input files of the commands by [`files_key`], or why they cannot be read.
    inputs: HashMap<String, Result<Inputs>>,
}

/// Contents of an output file.
enum Contents {
    Nothing,
    /// A fraction of its paths.
    Some(f64),
    All,
    /// Another render or a damaged file, with the reason.
    Other(String),
}

impl Inspector<'_> {
    /// States of all output files of a command: one, or one per frame.
    fn states(&mut self, requests: &Requests, log: &Path, queue_state: Option<QueueState>) -> Vec<State> {
        let mut states = Vec::new();
        // A task renders one frame after the other.
        let mut first = true;
        for (frame, request) in requests {
            let mut state = self.state(request, log, queue_state, *frame);
            if state.name == "running" && !std::mem::take(&mut first) {
                (state.name, state.fraction) = (if state.fraction > 0.0 { "begun" } else { "waiting" }, 0.0);
            }
            states.push(state);
        }
        states
    }

    /// State of one output file, from the file, the log, the record of sessions and Slurm's queue.
    fn state(
        &mut self,
        request: &RenderRequest,
        log: &Path,
        queue_state: Option<QueueState>,
        frame: Option<u32>,
    ) -> State {
        let record = record_path(log);
        let sessions = Some(Sessions::read(&record))
            // The record of an earlier submission is ignored.
            .filter(|s| self.submitted.is_none_or(|submitted| s.job.is_empty() || submitted.contains(&s.job)))
            .unwrap_or_default();
        let log = read_own(log).unwrap_or_default();
        let log = String::from_utf8_lossy(log.get(sessions.log as usize..).unwrap_or_default()).into_owned();
        let (contents, why) = self.contents(request);
        let begun = sessions.begun > 0 || matches!(contents, Contents::Some(_));
        let name = match (&contents, queue_state, sessions.code) {
            (Contents::All, ..) => "done",
            (_, Some(QueueState::Running), _) => "running",
            (_, Some(QueueState::Held), _) => "held",
            (_, None, None) if sessions.is_running(&record) => "running",
            (_, None, None) if sessions.begun > 0 => "dead",
            (_, None, Some(HELD)) => "held",
            (_, None, Some(code)) if code != 0 && code != INTERRUPTED => "failed",
            (Contents::Other(_), ..) => "stale",
            (_, Some(QueueState::Waiting), _) => "waiting",
            _ if begun => "begun",
            _ => "waiting",
        };
        let percent = |line: &str| line.strip_prefix("PROGRESS: ")?.strip_suffix('%')?.parse::<f64>().ok();
        let logged = log.lines().rev().find_map(percent).map_or(0.0, |p| p / 100.0);
        let (output, mut lines) = (request.output.clone(), log.lines().rev());
        let (logged, log_error) = match frame {
            None => (logged, lines.find_map(|line| line.strip_prefix("error: "))),
            // The log is shared by all frames of the task.
            Some(frame) => {
                let stem = output.file_stem().unwrap_or_default().to_string_lossy();
                let prefixes = [format!("{stem}: "), format!("error: frame {frame}: ")];
                let of_all = |line: &str| line.starts_with("error: ") && !line.starts_with("error: frame ");
                let line = lines.find(|line| prefixes.iter().any(|prefix| line.starts_with(prefix)) || of_all(line));
                (0.0, line.map(|line| line.trim_start_matches("error: ")))
            }
        };
        let (fraction, other) = match contents {
            Contents::All => (1.0, None),
            Contents::Some(saved) if name == "running" => (saved.max(logged), None),
            Contents::Some(saved) => (saved, None),
            Contents::Nothing => (if name == "running" { logged } else { 0.0 }, None),
            Contents::Other(other) => (0.0, Some(other)),
        };
        let error = if name == "done" { None } else { log_error.map(str::to_owned).or(other).or(why) };
        State { name, fraction: fraction.clamp(0.0, 1.0), error, output, frame }
    }

    /// Contents of a command's output, and why they are uncertain.
    fn contents(&mut self, request: &RenderRequest) -> (Contents, Option<String>) {
        let output = &request.output;
        let record = match Earlier::read(output) {
            Ok(None) => return (Contents::Nothing, None),
            Ok(Some(earlier)) => earlier.record,
            Err(e) => return (Contents::Other(e.to_string()), None),
        };
        let settings = &request.settings();
        let some = Contents::Some(settings.spp.map_or(0.0, |goal| f64::from(record.paths) / f64::from(goal)));
        let inputs = self.inputs.entry(request.files_key()).or_insert_with(|| {
            let inputs = Inputs::read(request)?;
            // Only the hashes are needed: the files are closed.
            inputs.take(request)?;
            Ok(inputs)
        });
        let inputs = match inputs {
            Ok(inputs) => inputs,
            Err(e) if record.is_done(settings) => return (Contents::All, Some(e.to_string())),
            Err(e) => return (some, Some(e.to_string())),
        };
        if !record.matches(&inputs.identity(request, settings), &request.requested()) {
            return (
                Contents::Other(format!("{}: holds another render than the plan asks for", output.display())),
                None,
            );
        }
        let session = Session { request, inputs, threads: 1, began: Instant::now(), replaces: false };
        match session.finished_before() {
            Ok(Some(_)) => (Contents::All, None),
            Ok(None) => (some, None),
            Err(e) => (Contents::Other(e.to_string()), None),
        }
    }
}
