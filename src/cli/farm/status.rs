//! `bismar farm status`: what has become of a plan, by its files, and by Slurm where that answers.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, Command, FromArgMatches};
use serde_json::{Value, json};

use super::site::{Fate, Queue};
use crate::batch::frames::numbered_name;
use crate::cli::batch::files_key;
use crate::cli::render::{Inputs, RenderArgs, Session};
use crate::console::{Verdict, print, print_json};
use crate::farm::sessions::{HELD, INTERRUPTED, Sessions, beside};
use crate::farm::slurm::Submitted;
use crate::farm::{PLAN, Plan};
use crate::render::checkpoint::Earlier;
use crate::{Error, Result};

/// Show how far a submitted job is.
///
/// Files are held against what the plan asks for. Where Slurm answers, it says what waits, runs or is held.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// The folder of `farm submit`.
    folder: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How far a task's or a merge's file is.
struct State {
    /// `waiting`, `running`, `begun`, `held`, `failed`, `dead`, `stale` or `done` (docs/farm.md).
    name: &'static str,
    /// Of its paths, in [0, 1].
    fraction: f64,
    /// Of its last session, or what its file holds instead.
    error: Option<String>,
    output: PathBuf,
    frame: Option<u32>,
}

pub fn run(args: &StatusArgs) -> Result<Verdict> {
    let plan = Plan::read(&args.folder.join(PLAN))?;
    let submitted = Submitted::read(&plan.folder);
    let queue = submitted.as_ref().and_then(Queue::ask);
    let mut look = Look { submitted: submitted.as_ref(), scenes: HashMap::new() };
    let (mut tasks, mut merges) = (Vec::new(), Vec::new());
    for (i, task) in plan.tasks.iter().enumerate() {
        let fate = queue.as_ref().and_then(|queue| queue.task(i));
        let states = look.states(understand(&task.command)?, &plan.log(i + 1, false), fate)?;
        tasks.extend(states.into_iter().map(|state| Row { render: &task.render, part: task.part, task: i + 1, state }));
    }
    for (i, merge) in plan.merges.iter().enumerate() {
        let fate = queue.as_ref().and_then(|queue| queue.merge(i));
        let mut whole = understand(&plan.tasks[merge.tasks.0].command)?;
        // What parts carry because a farm interrupts, the whole need not.
        (whole.part, whole.checkpoint, whole.output) = (None, None, Some(merge.output.clone()));
        let states = look.states(whole, &plan.log(i + 1, true), fate)?;
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

/// A file that a task or a merge makes: of a sequence's, one for each frame.
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

/// A task's command as `bismar render` would understand it.
fn understand(command: &[String]) -> Result<RenderArgs> {
    let bad = |e: clap::Error| Error::Data(format!("{PLAN}: {}", e.to_string().trim_end()));
    let matches = RenderArgs::augment_args(Command::new("render")).try_get_matches_from(&command[1..]).map_err(bad)?;
    RenderArgs::from_arg_matches(&matches).map_err(bad)
}

struct Look<'a> {
    submitted: Option<&'a Submitted>,
    /// Hashes of what the commands name, or why there are none.
    scenes: HashMap<String, Result<Inputs>>,
}

/// What the file of a task is.
enum Holds {
    Nothing,
    /// So much of its paths.
    Some(f64),
    All,
    /// Something else, as told.
    Other(String),
}

impl Look<'_> {
    /// Of each of a command's files, in its order.
    fn states(&mut self, asked: RenderArgs, log: &Path, fate: Option<Fate>) -> Result<Vec<State>> {
        let Some(frames) = &asked.frames else { return Ok(vec![self.state(&asked, log, fate, None)]) };
        let mut states = Vec::new();
        // A task renders one frame after the other.
        let mut first = true;
        for &frame in frames.numbers() {
            let mut state = self.state(&asked.of_frame(frame)?, log, fate, Some(frame));
            if state.name == "running" && !std::mem::take(&mut first) {
                (state.name, state.fraction) = (if state.fraction > 0.0 { "begun" } else { "waiting" }, 0.0);
            }
            states.push(state);
        }
        Ok(states)
    }

    fn state(&mut self, asked: &RenderArgs, log: &Path, fate: Option<Fate>, frame: Option<u32>) -> State {
        let record = beside(log);
        let sessions = Some(Sessions::read(&record))
            // An earlier submission's tells nothing of this one.
            .filter(|s| self.submitted.is_none_or(|submitted| s.job.is_empty() || submitted.knows(&s.job)))
            .unwrap_or_default();
        let log = fs::read(log).unwrap_or_default();
        let log = String::from_utf8_lossy(log.get(sessions.log as usize..).unwrap_or_default()).into_owned();
        let (holds, why) = self.holds(asked);
        let begun = sessions.begun > 0 || matches!(holds, Holds::Some(_));
        let name = match (&holds, fate, sessions.code) {
            (Holds::All, ..) => "done",
            (_, Some(Fate::Runs), _) => "running",
            (_, Some(Fate::Held), _) => "held",
            (_, None, None) if sessions.runs(&record) => "running",
            (_, None, None) if sessions.begun > 0 => "dead",
            (_, None, Some(HELD)) => "held",
            (_, None, Some(code)) if code != 0 && code != INTERRUPTED => "failed",
            (Holds::Other(_), ..) => "stale",
            (_, Some(Fate::Waits), _) => "waiting",
            _ if begun => "begun",
            _ => "waiting",
        };
        let percent = |line: &str| line.strip_prefix("PROGRESS: ")?.strip_suffix('%')?.parse::<f64>().ok();
        let said = log.lines().rev().find_map(percent).map_or(0.0, |p| p / 100.0);
        let (output, mut lines) = (asked.output(), log.lines().rev());
        let (said, told) = match frame {
            None => (said, lines.find_map(|line| line.strip_prefix("error: "))),
            // Its log is that of all its task's frames.
            Some(frame) => {
                let stem = output.file_stem().unwrap_or_default().to_string_lossy();
                let own = [format!("{stem}: "), format!("error: frame {frame}: ")];
                let of_all = |line: &str| line.starts_with("error: ") && !line.starts_with("error: frame ");
                let told = lines.find(|line| own.iter().any(|own| line.starts_with(own)) || of_all(line));
                (0.0, told.map(|line| line.trim_start_matches("error: ")))
            }
        };
        let (fraction, other) = match holds {
            Holds::All => (1.0, None),
            Holds::Some(saved) if name == "running" => (saved.max(said), None),
            Holds::Some(saved) => (saved, None),
            Holds::Nothing => (if name == "running" { said } else { 0.0 }, None),
            Holds::Other(other) => (0.0, Some(other)),
        };
        let error = if name == "done" { None } else { told.map(str::to_owned).or(other).or(why) };
        State { name, fraction: fraction.clamp(0.0, 1.0), error, output, frame }
    }

    /// What is in a command's output, and why that cannot be said for certain.
    fn holds(&mut self, asked: &RenderArgs) -> (Holds, Option<String>) {
        let output = asked.output();
        let record = match Earlier::read(&output) {
            Ok(None) => return (Holds::Nothing, None),
            Ok(Some(earlier)) => earlier.record,
            Err(e) => return (Holds::Other(e.to_string()), None),
        };
        let settings = asked.settings();
        let some = Holds::Some(settings.spp.map_or(0.0, |goal| f64::from(record.paths) / f64::from(goal)));
        let inputs = self.scenes.entry(files_key(asked)).or_insert_with(|| {
            let inputs = Inputs::read(asked)?;
            // The hashes are enough.
            inputs.take(asked)?;
            Ok(inputs)
        });
        let inputs = match inputs {
            Ok(inputs) => inputs,
            Err(e) if record.is_done(&settings) => return (Holds::All, Some(e.to_string())),
            Err(e) => return (some, Some(e.to_string())),
        };
        if !record.matches(&inputs.identity(asked, &settings), &asked.asked()) {
            return (Holds::Other(format!("{}: holds another render than the plan asks for", output.display())), None);
        }
        let session = Session { args: asked, inputs, threads: 1, began: Instant::now(), replaces: false };
        match session.done_before() {
            Ok(Some(_)) => (Holds::All, None),
            Ok(None) => (some, None),
            Err(e) => (Holds::Other(e.to_string()), None),
        }
    }
}
