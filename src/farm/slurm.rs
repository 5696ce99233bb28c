//! A plan as a Slurm array and the merges that wait for it.

use std::fs;
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{PLAN, Plan, printable, utf8};
use crate::film::atomic;
use crate::{Error, Result};

/// What is asked of Slurm for each task.
#[derive(Debug, Clone, Default)]
pub struct Ask {
    /// `--cpus-per-task`.
    pub cpus: Option<u32>,
    /// `--mem`, as Slurm writes it.
    pub memory: Option<String>,
    /// `--time`, in minutes: a task that needs longer is saved, requeued and goes on.
    pub minutes: Option<u32>,
    /// Tasks at a time, at most.
    pub throttle: Option<u32>,
    /// Further options of sbatch, as they are.
    pub others: Vec<String>,
}

/// Files of a plan's folder: name and content.
///
/// # Errors
/// [`Error::Usage`] for control characters in what is asked: each option is one line.
pub fn files(plan: &Plan, ask: &Ask) -> Result<Vec<(String, String)>> {
    ask.others.iter().chain(&ask.memory).try_for_each(|option| printable(option))?;
    let mut files = vec![("tasks.sbatch".into(), script(plan, ask))];
    if !plan.merges.is_empty() {
        let alone = Ask { minutes: None, throttle: None, ..ask.clone() };
        files.push(("merge.sbatch".into(), script(plan, &alone)));
    }
    Ok(files)
}

/// A batch script. Its arguments are a command and, before it, a number that is added to the array's index to give the
/// command's last word. So the shell reads no name as a part of its program. The command replaces the shell, so that
/// signals reach it.
fn script(plan: &Plan, ask: &Ask) -> String {
    // Slurm's own words. In the folder's name, too, it reads `%` and `\` as more than letters, and tasks would fail.
    let plain = !plan.folder.to_string_lossy().contains(['%', '\\']);
    let log = if plain { "logs/slurm-%A_%a.log" } else { "/dev/null" };
    let mut options = vec![
        format!("--job-name={}", name(&plan.name)),
        format!("--output={log}"),
        "--open-mode=append".into(),
        "--requeue".into(),
        format!("--signal=B:TERM@{}", lead(ask.minutes)),
    ];
    options.extend(ask.cpus.map(|n| format!("--cpus-per-task={n}")));
    options.extend(ask.memory.as_ref().map(|m| format!("--mem={m}")));
    options.extend(ask.minutes.map(|m| format!("--time={m}")));
    options.extend(ask.others.iter().cloned());
    let options: String = options.iter().map(|o| format!("#SBATCH {o}\n")).collect();
    format!("#!/bin/bash\n{options}exec \"${{@:2}}\" $(( ${{SLURM_ARRAY_TASK_ID:-0}} + $1 ))\n")
}

/// Arguments of sbatch: the folder to be in, a script of it, and the script's arguments.
fn run(plan: &Plan, command: &[String], script: &str, number: usize, more: &[&str]) -> Result<Vec<String>> {
    let folder = utf8(&plan.folder)?;
    let mut words = vec![format!("--chdir={folder}"), format!("{folder}/{script}"), number.to_string()];
    words.extend(command.first().cloned());
    words.extend(["farm".into(), "task".into(), format!("--plan={folder}/{PLAN}")]);
    words.extend(more.iter().map(|&word| word.to_owned()));
    Ok(words)
}

/// Seconds before the time limit at which a task is told to save: two minutes, or a quarter of a short limit.
fn lead(minutes: Option<u32>) -> u32 {
    minutes.map_or(120, |m| (m.saturating_mul(15)).clamp(15, 120))
}

/// Arrays for all tasks, as arguments of sbatch: options and script's argument. A site limits an array's size.
///
/// # Errors
/// As [`utf8`].
pub fn arrays(plan: &Plan, ask: &Ask, largest: usize) -> Result<Vec<Array>> {
    let throttle = ask.throttle.map_or(String::new(), |n| format!("%{n}"));
    (0..plan.tasks.len())
        .step_by(largest.max(1))
        .map(|first| {
            let count = largest.min(plan.tasks.len() - first);
            let mut arguments = vec![format!("--array=1-{count}{throttle}")];
            arguments.extend(run(plan, &plan.tasks[first].command, "tasks.sbatch", first, &[])?);
            Ok(Array { first, count, arguments })
        })
        .collect()
}

/// One array of tasks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Array {
    /// First task, counted from 0.
    pub first: usize,
    /// Tasks.
    pub count: usize,
    /// Of sbatch.
    pub arguments: Vec<String>,
}

/// Arguments of sbatch for the merge of this number, counted from 0, after arrays with these job numbers.
///
/// # Errors
/// As [`utf8`].
pub fn merge(plan: &Plan, number: usize, arrays: &[(Array, String)]) -> Result<Vec<String>> {
    let (first, last) = plan.merges[number].tasks;
    let mut needed = Vec::new();
    for (array, id) in arrays {
        let (from, to) = (first.max(array.first), last.min(array.first + array.count - 1));
        if from > to {
            continue;
        }
        match to - from + 1 == array.count {
            true => needed.push(id.clone()),
            false => needed.extend((from..=to).map(|task| format!("{id}_{}", task - array.first + 1))),
        }
    }
    let mut arguments = vec![format!("--dependency=afterok:{}", needed.join(":")), "--kill-on-invalid-dep=yes".into()];
    arguments.extend(run(plan, &plan.merges[number].command, "merge.sbatch", number + 1, &["--merge"])?);
    Ok(arguments)
}

/// Numbers that Slurm gave to a plan's arrays and merges, in its order; kept in the plan's folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Submitted {
    /// Of the tasks.
    pub arrays: Vec<SubmittedArray>,
    /// Of the merges.
    pub merges: Vec<String>,
}

/// An array that Slurm has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmittedArray {
    /// First task, counted from 0.
    pub first: usize,
    /// Tasks.
    pub count: usize,
    /// Slurm's number.
    pub job: String,
}

/// Of [`Submitted`] within the folder.
const SUBMITTED: &str = "slurm.json";

impl Submitted {
    /// Reads it; `None` if Slurm was never asked.
    pub fn read(folder: &Path) -> Option<Self> {
        fs::read(folder.join(SUBMITTED)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok())
    }

    /// Writes it.
    ///
    /// # Errors
    /// As [`atomic::write`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
        atomic::write(&folder.join(SUBMITTED), |file| Ok(Ok(file.write_all(&json)?)))
    }

    /// Is it one of these jobs?
    pub fn knows(&self, job: &str) -> bool {
        self.arrays.iter().map(|array| &array.job).chain(&self.merges).any(|known| known == job)
    }
}

/// A job's name without what would need quotes.
fn name(text: &str) -> String {
    text.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// Words as a shell would want them, for people.
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
    use crate::farm::tests::plan;

    #[test]
    fn merges_wait_for_their_own_parts_also_across_arrays() {
        let plan = plan(3);
        let arrays = arrays(&plan, &Ask { throttle: Some(2), ..Default::default() }, 4).unwrap();
        assert_eq!(arrays.iter().map(|a| (a.first, a.count)).collect::<Vec<_>>(), [(0, 4), (4, 2)]);
        let run = ["--chdir=/f", "/f/tasks.sbatch", "4", "bismar", "farm", "task", "--plan=/f/farm.json"];
        assert_eq!(arrays[1].arguments, [&["--array=1-2%2"], &run[..]].concat());
        let ids: Vec<_> = arrays.into_iter().zip(["10".to_owned(), "20".to_owned()]).collect();
        assert_eq!(merge(&plan, 0, &ids).unwrap()[0], "--dependency=afterok:10_1:10_2:10_3");
        assert_eq!(merge(&plan, 1, &ids).unwrap()[0], "--dependency=afterok:10_4:20");
    }

    #[test]
    fn words_survive_a_shell_and_scripts_hold_none_of_them() {
        let words = ["it's", "a b", "", "--x=1,2", "$HOME"].map(str::to_owned);
        let output = std::process::Command::new("bash")
            .args(["-c", &format!("printf '%s\\n' {}", quoted(&words))])
            .output()
            .unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), "it's\na b\n\n--x=1,2\n$HOME\n");
        for (name, content) in files(&plan(3), &Ask::default()).unwrap() {
            assert!(!content.contains("hall") && !content.contains("/f"), "{name}: {content}");
        }
    }
}
