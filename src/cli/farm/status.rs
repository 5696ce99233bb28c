//! `bismar farm status`: what has become of a plan, by its files, and by Slurm where that answers.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, Command, FromArgMatches};
use serde_json::json;

use super::site::{Fate, Queue};
use crate::cli::batch::scene_key;
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

/// How far a task or a merge is.
struct State {
    /// `waiting`, `running`, `begun`, `held`, `failed`, `dead`, `stale` or `done` (docs/farm.md).
    name: &'static str,
    /// Of its paths, in [0, 1].
    fraction: f64,
    /// Of its last session, or what its file holds instead.
    error: Option<String>,
}

pub fn run(args: &StatusArgs) -> Result<Verdict> {
    let plan = Plan::read(&args.folder.join(PLAN))?;
    let submitted = Submitted::read(&plan.folder);
    let queue = submitted.as_ref().and_then(Queue::ask);
    let mut look = Look { submitted: submitted.as_ref(), scenes: HashMap::new() };
    let (mut tasks, mut merges) = (Vec::new(), Vec::new());
    for (i, task) in plan.tasks.iter().enumerate() {
        let fate = queue.as_ref().and_then(|queue| queue.task(i));
        tasks.push(look.state(&understand(&task.command)?, &plan.log(i + 1, false), fate));
    }
    for (i, merge) in plan.merges.iter().enumerate() {
        let fate = queue.as_ref().and_then(|queue| queue.merge(i));
        let mut whole = understand(&plan.tasks[merge.tasks.0].command)?;
        // What parts carry because a farm interrupts, the whole need not.
        (whole.part, whole.checkpoint, whole.output) = (None, None, Some(merge.output.clone()));
        merges.push(look.state(&whole, &plan.log(i + 1, true), fate));
    }
    let done = tasks.iter().filter(|s| s.name == "done").count();
    let all = tasks.iter().map(|s| s.fraction).sum::<f64>() / tasks.len().max(1) as f64;
    let complete = done == tasks.len() && merges.iter().all(|s| s.name == "done");
    if args.json {
        let tasks = plan.tasks.iter().zip(&tasks).map(|(task, s)| {
            json!({ "render": task.render, "part": task.part, "state": s.name, "fraction": s.fraction,
                "error": s.error, "output": task.output })
        });
        let merges = plan.merges.iter().zip(&merges).map(|(merge, s)| {
            json!({ "render": merge.render, "done": s.name == "done", "state": s.name, "error": s.error,
                "output": merge.output })
        });
        print_json(&json!({ "schema": 1, "name": plan.name, "complete": complete, "fraction": all,
            "slurm_answers": queue.is_some(), "tasks": tasks.collect::<Vec<_>>(),
            "merges": merges.collect::<Vec<_>>() }))?;
        return Ok(Verdict::Done);
    }
    let mut text = String::new();
    let error = |s: &State| s.error.as_ref().map_or(String::new(), |e| format!("  {e}"));
    for (task, s) in plan.tasks.iter().zip(&tasks) {
        let part = if plan.parts > 1 { format!(" {}/{}", task.part, plan.parts) } else { String::new() };
        text += &format!("{}{part}: {} {:.0} %{}\n", task.render, s.name, 100.0 * s.fraction, error(s));
    }
    for (merge, s) in plan.merges.iter().zip(&merges) {
        text += &format!("{} merged: {}{}\n", merge.render, s.name, error(s));
    }
    print(format!("{text}{done} of {} tasks done, {:.0} % in all", tasks.len(), 100.0 * all))?;
    Ok(Verdict::Done)
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
    fn state(&mut self, asked: &RenderArgs, log: &Path, fate: Option<Fate>) -> State {
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
        let told = log.lines().rev().find_map(|line| line.strip_prefix("error: "));
        let (fraction, other) = match holds {
            Holds::All => (1.0, None),
            Holds::Some(saved) if name == "running" => (saved.max(said), None),
            Holds::Some(saved) => (saved, None),
            Holds::Nothing => (if name == "running" { said } else { 0.0 }, None),
            Holds::Other(other) => (0.0, Some(other)),
        };
        let error = if name == "done" { None } else { told.map(str::to_owned).or(other).or(why) };
        State { name, fraction: fraction.clamp(0.0, 1.0), error }
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
        let inputs = self.scenes.entry(scene_key(asked)).or_insert_with(|| {
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
        if !record.answers(&inputs.identity(asked, &settings), &asked.asked()) {
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
