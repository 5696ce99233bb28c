//! A plan as Slurm job arrays, and merges that depend on them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::names::{printable, utf8};
use super::plan::{PLAN, Plan};
use crate::Result;
use crate::film::atomic;
use crate::scene::import::read_own;

/// Resources and options of each task.
#[derive(Debug, Clone, Default)]
pub struct TaskOptions {
    /// `--cpus-per-task`.
    pub cpus: Option<u32>,
    /// `--mem`, as Slurm writes it.
    pub memory: Option<String>,
    /// `--mem` of merges; `memory` if `None`.
    pub merge_memory: Option<String>,
    /// `--time`, in minutes: a task that needs longer is saved, requeued and resumed.
    pub minutes: Option<u32>,
    /// Most tasks at the same time.
    pub throttle: Option<u32>,
    /// Further options of sbatch, passed on unchanged.
    pub others: Vec<String>,
}

/// Scripts of a plan's folder: name and content.
/// Errors: [`crate::Error::Usage`] for control characters in options, each of which is a line of the script.
pub fn files(plan: &Plan, options: &TaskOptions) -> Result<Vec<(String, String)>> {
    options
        .others
        .iter()
        .chain(&options.memory)
        .chain(&options.merge_memory)
        .try_for_each(|option| printable(option))?;
    let mut files = vec![("tasks.sbatch".into(), script(plan, options))];
    if !plan.merges.is_empty() {
        let memory = options.merge_memory.as_ref().or(options.memory.as_ref()).cloned();
        let alone = TaskOptions { memory, minutes: None, throttle: None, ..options.clone() };
        files.push(("merge.sbatch".into(), script(plan, &alone)));
    }
    Ok(files)
}

/// A batch script. Its arguments are an offset and a command; the command's last word is the offset plus the array index.
/// No name is part of the script's text, so the shell interprets none. `exec` makes signals reach the command.
fn script(plan: &Plan, task: &TaskOptions) -> String {
    // The log of Slurm itself. Slurm interprets `%` and `\` even in the folder's name, and tasks would fail.
    let plain = !plan.folder.to_string_lossy().contains(['%', '\\']);
    let log = if plain { "logs/slurm-%A_%a.log" } else { "/dev/null" };
    let mut options = vec![
        format!("--job-name={}", name(&plan.name)),
        format!("--output={log}"),
        "--open-mode=append".into(),
        "--requeue".into(),
        format!("--signal=B:TERM@{}", term_lead_seconds(task.minutes)),
    ];
    options.extend(task.cpus.map(|n| format!("--cpus-per-task={n}")));
    options.extend(task.memory.as_ref().map(|m| format!("--mem={m}")));
    options.extend(task.minutes.map(|m| format!("--time={m}")));
    options.extend(task.others.iter().cloned());
    let options: String = options.iter().map(|o| format!("#SBATCH {o}\n")).collect();
    format!(
        "#!/bin/bash\n# Written by `bismar farm submit`.\n{options}exec \"${{@:2}}\" $(( ${{SLURM_ARRAY_TASK_ID:-0}} + $1 ))\n"
    )
}

/// Arguments of sbatch: working folder, script, and the script's arguments.
fn run(plan: &Plan, command: &[String], script: &str, number: usize, more: &[&str]) -> Result<Vec<String>> {
    let folder = utf8(&plan.folder)?;
    let mut words = vec![format!("--chdir={folder}"), format!("{folder}/{script}"), number.to_string()];
    words.extend(command.first().cloned());
    words.extend(["farm".into(), "task".into(), format!("--plan={folder}/{PLAN}")]);
    words.extend(more.iter().map(|&word| word.to_owned()));
    Ok(words)
}

/// Seconds before the time limit at which a task gets SIGTERM and saves: two minutes, or a quarter of a shorter limit.
fn term_lead_seconds(minutes: Option<u32>) -> u32 {
    minutes.map_or(120, |m| (m.saturating_mul(15)).clamp(15, 120))
}

/// Job arrays of at most `largest` tasks, with their arguments of sbatch.
pub fn arrays(plan: &Plan, options: &TaskOptions, largest: usize) -> Result<Vec<(Array, Vec<String>)>> {
    let throttle = options.throttle.map_or(String::new(), |n| format!("%{n}"));
    (0..plan.tasks.len())
        .step_by(largest.max(1))
        .map(|first| {
            let count = largest.min(plan.tasks.len() - first);
            let mut arguments = vec![format!("--array=1-{count}{throttle}")];
            arguments.extend(run(plan, &plan.tasks[first].command, "tasks.sbatch", first, &[])?);
            Ok((Array { first, count, job: String::new() }, arguments))
        })
        .collect()
}

/// Arguments of sbatch for the merge with this index, which depends on tasks of `arrays` with their job IDs.
pub fn merge(plan: &Plan, number: usize, arrays: &[Array]) -> Result<Vec<String>> {
    let (first, last) = plan.merges[number].tasks;
    let mut needed = Vec::new();
    for array in arrays {
        let (from, to) = (first.max(array.first), last.min(array.first + array.count - 1));
        if from > to {
            continue;
        }
        match to - from + 1 == array.count {
            true => needed.push(array.job.clone()),
            false => needed.extend((from..=to).map(|task| format!("{}_{}", array.job, task - array.first + 1))),
        }
    }
    let mut arguments = vec![format!("--dependency=afterok:{}", needed.join(":")), "--kill-on-invalid-dep=yes".into()];
    arguments.extend(run(plan, &plan.merges[number].command, "merge.sbatch", number + 1, &["--merge"])?);
    Ok(arguments)
}

/// Slurm's job IDs of a plan's arrays and merges, stored in the plan's folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Submitted {
    /// By which the file is known as ours.
    schema: u32,
    pub arrays: Vec<Array>,
    /// Job IDs of the merges, in the order of the plan.
    pub merges: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Array {
    /// Index of the first task.
    pub first: usize,
    pub count: usize,
    /// Slurm's job ID; empty before it is submitted.
    pub job: String,
}

/// File name of [`Submitted`] in the plan's folder.
const SUBMITTED: &str = "slurm.json";

impl Submitted {
    /// Reads the job IDs; `None` if the plan was never submitted to Slurm.
    pub fn read(folder: &Path) -> Option<Self> {
        read_own(&folder.join(SUBMITTED)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok())
    }

    pub fn write(&self, folder: &Path) -> Result<()> {
        atomic::write(&folder.join(SUBMITTED), |file| Ok(Ok(serde_json::to_writer_pretty(file, self)?)))
    }

    /// Whether a job ID is one of these.
    pub fn contains(&self, job: &str) -> bool {
        self.arrays.iter().map(|array| &array.job).chain(&self.merges).any(|known| known == job)
    }
}

/// A job name without characters that need quoting.
fn name(text: &str) -> String {
    text.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// Words quoted for a shell, to be shown.
pub fn quoted(words: &[String]) -> String {
    words.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=/.,:+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.into() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::plan::tests::plan;

    #[test]
    fn merges_wait_for_their_own_parts_also_across_arrays() {
        let plan = plan(3);
        let arrays = arrays(&plan, &TaskOptions { throttle: Some(2), ..Default::default() }, 4).unwrap();
        assert_eq!(arrays.iter().map(|(a, _)| (a.first, a.count)).collect::<Vec<_>>(), [(0, 4), (4, 2)]);
        let run = ["--chdir=/f", "/f/tasks.sbatch", "4", "bismar", "farm", "task", "--plan=/f/farm.json"];
        assert_eq!(arrays[1].1, [&["--array=1-2%2"], &run[..]].concat());
        let submitted: Vec<_> =
            arrays.into_iter().zip(["10", "20"]).map(|((array, _), id)| Array { job: id.into(), ..array }).collect();
        assert_eq!(merge(&plan, 0, &submitted).unwrap()[0], "--dependency=afterok:10_1:10_2:10_3");
        assert_eq!(merge(&plan, 1, &submitted).unwrap()[0], "--dependency=afterok:10_4:20");
    }

    #[test]
    fn words_survive_a_shell_and_scripts_hold_none_of_them() {
        let words = ["it's", "a b", "", "--x=1,2", "$HOME"].map(str::to_owned);
        let output = std::process::Command::new("bash")
            .args(["-c", &format!("printf '%s\\n' {}", quoted(&words))])
            .output()
            .unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), "it's\na b\n\n--x=1,2\n$HOME\n");
        for (name, content) in files(&plan(3), &TaskOptions::default()).unwrap() {
            assert!(!content.contains("hall") && !content.contains("/f"), "{name}: {content}");
        }
    }
}
