//! A plan as a Slurm array and the merges that wait for it.

use super::Plan;

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
pub fn files(plan: &Plan, ask: &Ask) -> Vec<(String, String)> {
    let lines = |commands: &mut dyn Iterator<Item = &Vec<String>>| -> String {
        commands.map(|command| format!("{}\n", quoted(command))).collect()
    };
    let mut files = vec![
        ("tasks.sbatch".into(), script(plan, ask, "tasks.txt", "task-$number.log")),
        ("tasks.txt".into(), lines(&mut plan.tasks.iter().map(|t| &t.command))),
    ];
    if !plan.merges.is_empty() {
        let alone = Ask { minutes: None, throttle: None, ..ask.clone() };
        files.push(("merge.sbatch".into(), script(plan, &alone, "merges.txt", "merge-$number.log")));
        files.push(("merges.txt".into(), lines(&mut plan.merges.iter().map(|m| &m.command))));
    }
    files
}

/// A batch script: the number of its line is the array's index plus the first argument. The command replaces the shell,
/// so that signals reach it.
fn script(plan: &Plan, ask: &Ask, list: &str, log: &str) -> String {
    let folder = plan.folder.display().to_string();
    let mut options = vec![
        format!("--job-name={}", name(&plan.name)),
        format!("--output={}", quoted_option(&format!("{folder}/logs/slurm-%A_%a.log"))),
        "--open-mode=append".into(),
        "--requeue".into(),
        format!("--signal=B:TERM@{}", lead(ask.minutes)),
    ];
    options.extend(ask.cpus.map(|n| format!("--cpus-per-task={n}")));
    options.extend(ask.memory.as_ref().map(|m| format!("--mem={m}")));
    options.extend(ask.minutes.map(|m| format!("--time={m}")));
    options.extend(ask.others.iter().cloned());
    let options: String = options.iter().map(|o| format!("#SBATCH {o}\n")).collect();
    let folder = quote(&folder);
    format!(
        "#!/bin/bash\n{options}\
         number=$(( ${{SLURM_ARRAY_TASK_ID:-0}} + $1 ))\n\
         exec >>{folder}/logs/{log} 2>&1\n\
         eval \"exec $(sed -n \"${{number}}p\" {folder}/{list})\"\n"
    )
}

/// Seconds before the time limit at which a task is told to save: two minutes, or a quarter of a short limit.
fn lead(minutes: Option<u32>) -> u32 {
    minutes.map_or(120, |m| (m.saturating_mul(15)).clamp(15, 120))
}

/// Arrays for all tasks, as arguments of sbatch: options and script's argument. A site limits an array's size.
pub fn arrays(plan: &Plan, ask: &Ask, largest: usize) -> Vec<Array> {
    let throttle = ask.throttle.map_or(String::new(), |n| format!("%{n}"));
    let script = plan.folder.join("tasks.sbatch").display().to_string();
    (0..plan.tasks.len())
        .step_by(largest.max(1))
        .map(|first| {
            let count = largest.min(plan.tasks.len() - first);
            let arguments = vec![format!("--array=1-{count}{throttle}"), script.clone(), first.to_string()];
            Array { first, count, arguments }
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
pub fn merge(plan: &Plan, number: usize, arrays: &[(Array, String)]) -> Vec<String> {
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
    vec![
        format!("--dependency=afterok:{}", needed.join(":")),
        "--kill-on-invalid-dep=yes".into(),
        plan.folder.join("merge.sbatch").display().to_string(),
        (number + 1).to_string(),
    ]
}

/// A job's name without what would need quotes.
fn name(text: &str) -> String {
    text.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// Words for a shell.
pub fn quoted(words: &[String]) -> String {
    words.iter().map(|word| quote(word)).collect::<Vec<_>>().join(" ")
}

fn quote(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=/.,:+%@".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.into() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

/// A value for a line of #SBATCH.
fn quoted_option(value: &str) -> String {
    if value.contains([' ', '"', '\\']) {
        format!("\"{}\"", value.replace('\\', "\\\\").replace('"', "\\\""))
    } else {
        value.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::tests::plan;

    #[test]
    fn merges_wait_for_their_own_parts_also_across_arrays() {
        let plan = plan(3);
        let arrays = arrays(&plan, &Ask { throttle: Some(2), ..Default::default() }, 4);
        assert_eq!(arrays.iter().map(|a| (a.first, a.count)).collect::<Vec<_>>(), [(0, 4), (4, 2)]);
        assert_eq!(arrays[1].arguments, ["--array=1-2%2", "/f/tasks.sbatch", "4"]);
        let ids: Vec<_> = arrays.into_iter().zip(["10".to_owned(), "20".to_owned()]).collect();
        assert_eq!(merge(&plan, 0, &ids)[0], "--dependency=afterok:10_1:10_2:10_3");
        assert_eq!(merge(&plan, 1, &ids)[0], "--dependency=afterok:10_4:20");
    }

    #[test]
    fn lines_survive_a_shell() {
        let words = ["it's", "a b", "", "--x=1,2", "$HOME"].map(str::to_owned);
        let output = std::process::Command::new("bash")
            .args(["-c", &format!("printf '%s\\n' {}", quoted(&words))])
            .output()
            .unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), "it's\na b\n\n--x=1,2\n$HOME\n");
        let files = files(&plan(3), &Ask::default());
        assert!(files[1].1.lines().all(|line| line.contains(r"'/s/it'\''s a hall.glb'")));
        assert_eq!(files[1].1.lines().count(), 6);
    }
}
