//! Renders for many machines: what to run ([`Plan`]), said to Slurm ([`slurm`]) or in the Open Job Description format
//! ([`openjd`]). Nothing here renders: every task is one plain command that can be run again at any time.

pub mod openjd;
mod path_mapping;
pub mod slurm;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{Error, Result};
pub use path_mapping::PathMapping;

/// One render, whole or in parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Render {
    /// Unique in its plan; becomes part of file names.
    pub name: String,
    /// Absolute.
    pub scene: PathBuf,
    /// Absolute.
    pub output: PathBuf,
    /// Other flags of `bismar render`, paths absolute; `None` for switches.
    pub flags: Vec<(String, Option<String>)>,
}

/// What a farm has to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    schema: u32,
    /// For people and schedulers.
    pub name: String,
    /// Where scripts, logs and parts are; absolute.
    pub folder: PathBuf,
    /// Parts of every render.
    pub parts: u32,
    /// Renders of pictures or parts: all can run at once.
    pub tasks: Vec<Task>,
    /// Each needs some of the tasks done.
    pub merges: Vec<Merge>,
}

/// One command that makes one file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Task {
    /// Of the render.
    pub render: String,
    /// From 1; 1 when the render is whole.
    pub part: u32,
    /// Program and arguments.
    pub command: Vec<String>,
    /// The file, absolute.
    pub output: PathBuf,
}

/// One command that puts parts together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Merge {
    /// Of the render.
    pub render: String,
    /// Program and arguments.
    pub command: Vec<String>,
    /// The file, absolute.
    pub output: PathBuf,
    /// First and last of the tasks that it needs, counted from 0.
    pub tasks: (usize, usize),
}

/// Seconds between checkpoints where a render does not say.
const CHECKPOINT: &str = "60";
/// How long a merge waits for parts that a shared file system does not show yet.
const WAIT: &str = "60";
/// Flags that belong to the whole picture, not to its parts.
const OF_THE_WHOLE: [&str; 4] = ["preview", "view", "exposure", "stats"];
/// Of the plan within its folder.
pub const PLAN: &str = "farm.json";

impl Plan {
    /// Every render in `parts` parts; `program` is what to run, `progress` how it reports.
    ///
    /// # Errors
    /// [`Error::Usage`] for parts of a render that stops by time or noise: each part would stop elsewhere.
    pub fn new(
        name: &str,
        folder: &Path,
        program: &str,
        progress: &str,
        renders: &[Render],
        parts: u32,
    ) -> Result<Self> {
        let mut plan =
            Self { schema: 1, name: name.into(), folder: folder.into(), parts, tasks: Vec::new(), merges: Vec::new() };
        for render in renders {
            if parts > 1
                && let Some((flag, _)) = render.flags.iter().find(|(flag, _)| flag == "time" || flag == "noise")
            {
                return Err(Error::Usage(format!(
                    "'{}' stops by {flag}, and its parts would stop at different numbers of paths: give it --spp instead",
                    render.name
                )));
            }
            plan.add(render, program, progress);
        }
        Ok(plan)
    }

    fn add(&mut self, render: &Render, program: &str, progress: &str) {
        let parts = self.parts;
        let first = self.tasks.len();
        let flag = |(name, value): &(String, Option<String>)| match value {
            Some(value) => format!("--{name}={value}"),
            None => format!("--{name}"),
        };
        let (whole, own): (Vec<_>, Vec<_>) =
            render.flags.iter().partition(|(name, _)| parts > 1 && OF_THE_WHOLE.contains(&name.as_str()));
        let checkpoints = own.iter().any(|(name, _)| name == "checkpoint");
        for part in 1..=parts {
            let output = match parts {
                1 => render.output.clone(),
                _ => self.folder.join("parts").join(format!("{}.{part}-of-{parts}.exr", render.name)),
            };
            let mut command = vec![program.into(), "render".into(), text(&render.scene)];
            command.extend(own.iter().map(|f| flag(f)));
            if parts > 1 {
                command.push(format!("--part={part}/{parts}"));
            }
            if !checkpoints {
                command.push(format!("--checkpoint={CHECKPOINT}"));
            }
            command.extend([
                "--resume".into(),
                format!("--progress={progress}"),
                format!("--output={}", text(&output)),
            ]);
            self.tasks.push(Task { render: render.name.clone(), part, command, output });
        }
        if parts > 1 {
            let mut command: Vec<String> = vec![program.into(), "merge".into(), format!("--wait={WAIT}")];
            // The parts carry statistics because a farm interrupts; the picture only if it was asked to.
            if !checkpoints {
                command.push("--no-statistics".into());
            }
            command.extend(whole.iter().filter(|(name, _)| name != "stats").map(|f| flag(f)));
            command.push(format!("--output={}", text(&render.output)));
            command.extend(self.tasks[first..].iter().map(|task| text(&task.output)));
            let tasks = (first, self.tasks.len() - 1);
            self.merges.push(Merge { render: render.name.clone(), command, output: render.output.clone(), tasks });
        }
    }

    /// Reads a folder's plan.
    ///
    /// # Errors
    /// [`Error::Missing`] and [`Error::Data`], with the file.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(PLAN);
        let bytes = std::fs::read(&path).map_err(|e| Error::reading(&path, &e))?;
        let plan: Self = serde_json::from_slice(&bytes)
            .map_err(|e| Error::Data(format!("{}: is no plan of `farm submit`: {e}", path.display())))?;
        Ok(plan)
    }

    /// The log that a task writes; tasks are counted from 1.
    pub fn log(&self, number: usize) -> PathBuf {
        self.folder.join("logs").join(format!("task-{number}.log"))
    }
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Two renders in so many parts.
    pub(crate) fn plan(parts: u32) -> Plan {
        let render = |name: &str| Render {
            name: name.into(),
            scene: "/s/it's a hall.glb".into(),
            output: format!("/o/{name}.exr").into(),
            flags: vec![("spp".into(), Some("64".into())), ("preview".into(), Some(format!("/o/{name}.png")))],
        };
        Plan::new("shots", Path::new("/f"), "bismar", "plain", &[render("a"), render("b")], parts).unwrap()
    }

    #[test]
    fn every_part_is_a_task_and_its_merge_needs_all_of_them() {
        let plan = plan(3);
        assert_eq!(plan.tasks.len(), 6);
        assert_eq!(plan.merges.iter().map(|m| m.tasks).collect::<Vec<_>>(), [(0, 2), (3, 5)]);
        let command = plan.tasks[4].command.join(" ");
        assert!(
            command.contains("--part=2/3") && command.contains("--resume") && !command.contains("preview"),
            "{command}"
        );
        let merge = plan.merges[1].command.join(" ");
        assert!(merge.contains("--preview=/o/b.png") && merge.contains("/f/parts/b.3-of-3.exr"), "{merge}");
    }

    #[test]
    fn a_whole_render_needs_no_merge_and_parts_no_rule_but_samples() {
        let whole = plan(1);
        assert!(whole.merges.is_empty() && !whole.tasks[0].command.join(" ").contains("--part"));
        assert_eq!(whole.tasks[1].output, Path::new("/o/b.exr"));
        let timed = Render {
            name: "a".into(),
            scene: "/a.glb".into(),
            output: "/a.exr".into(),
            flags: vec![("time".into(), Some("3".into()))],
        };
        let refused = Plan::new("x", Path::new("/f"), "bismar", "plain", std::slice::from_ref(&timed), 2).unwrap_err();
        assert_eq!(refused.exit_code(), 64);
        assert!(Plan::new("x", Path::new("/f"), "bismar", "plain", &[timed], 1).is_ok());
    }
}
