//! The plan of a farm: every render and merge as a command.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::names::{printable, utf8};
use crate::batch::frames::{Frames, Sequence};
use crate::batch::job::Job;
use crate::batch::numbering::numbered;
use crate::job::argument;
use crate::scene::import::read_own;
use crate::{Error, Result};

/// The work of a farm, stored as `farm.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    schema: u32,
    /// Name, shown by schedulers.
    pub name: String,
    /// Folder of scripts, logs and parts; absolute.
    pub folder: PathBuf,
    /// The batch file or scene that was submitted; absolute.
    pub input: String,
    pub parts: u32,
    /// Whether a task that ran out of memory is run again, once, with 1.5 times as much.
    pub retries_memory: bool,
    /// Renders of pictures or parts; all can run at the same time.
    pub tasks: Vec<Task>,
    /// Merges of parts; each depends on some of the tasks.
    pub merges: Vec<Merge>,
}

/// A command that renders one file, or one file per frame.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Task {
    pub render: String,
    /// Number of the part, from 1; 1 for a whole picture.
    pub part: u32,
    pub command: Vec<String>,
    /// Absolute path of the file; for frames, with a placeholder for the number.
    pub output: PathBuf,
    pub frames: Option<Frames>,
}

/// A command that merges parts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Merge {
    pub render: String,
    pub command: Vec<String>,
    /// Absolute path of the file; for frames, with a placeholder for the number.
    pub output: PathBuf,
    pub frames: Option<Frames>,
    /// Index of the first and of the last task that it depends on.
    pub tasks: (usize, usize),
}

/// Seconds between checkpoints of renders without --checkpoint.
const CHECKPOINT_SECONDS: &str = "60";
/// Seconds that a merge waits for parts, which shared file systems may show late.
const WAIT_SECONDS: &str = "60";
/// Flags for the merged picture, not for its parts.
const FLAGS_OF_MERGE: [&str; 5] = ["preview", "view", "view-space", "exposure", "stats"];
/// Version of the plan's format. Plans of other versions are not run.
const SCHEMA: u32 = 2;
/// File name of the plan in its folder.
pub const PLAN: &str = "farm.json";

impl Plan {
    /// A plan with every picture in `parts` parts, and sequences in tasks of `chunk` frames. `program` is the executable,
    /// `progress` the value of its flag. All paths are absolute.
    /// Errors: [`Error::Usage`] for parts of a render that stops by time, because each would stop at another number of
    /// paths; for names that are not UTF-8 or hold control characters.
    pub fn new(
        name: &str,
        folder: &Path,
        program: &Path,
        progress: &str,
        renders: &[Job],
        (parts, chunk): (u32, u32),
    ) -> Result<Self> {
        let (tasks, merges) = (Vec::new(), Vec::new());
        let (name, folder) = (name.into(), folder.into());
        let mut plan =
            Self { schema: SCHEMA, name, folder, input: String::new(), parts, retries_memory: false, tasks, merges };
        for render in renders {
            if parts > 1 && render.request.time.is_some() {
                return Err(Error::Usage(format!(
                    "'{}' stops by --time, so its parts would stop at different numbers of paths: use --spp or --noise instead",
                    render.name
                )));
            }
            match &render.sequence {
                Some(Sequence::Frames(frames)) => {
                    for frames in frames.chunks(chunk as usize) {
                        plan.add(render, Some(frames), utf8(program)?, progress)?;
                    }
                }
                _ => plan.add(render, None, utf8(program)?, progress)?,
            }
        }
        plan.check()?;
        Ok(plan)
    }

    fn add(&mut self, render: &Job, frames: Option<Frames>, program: &str, progress: &str) -> Result<()> {
        let parts = self.parts;
        let first = self.tasks.len();
        let which = match (&frames, &render.sequence) {
            (Some(frames), _) => Some(format!("--frames={frames}")),
            (None, Some(Sequence::Turntable(count))) => Some(format!("--turntable={count}")),
            (None, Some(Sequence::Cameras(file))) => Some(format!("--cameras={}", utf8(file)?)),
            _ => None,
        };
        let request = &render.request;
        let (of_merge, of_tasks): (Vec<_>, Vec<_>) =
            request.flags()?.into_iter().partition(|(name, _)| parts > 1 && FLAGS_OF_MERGE.contains(&name.as_str()));
        let checkpoints = request.checkpoint.is_some();
        for part in 1..=parts {
            let output = match parts {
                1 => request.output.clone(),
                _ => self.folder.join("parts").join(format!("{}.{part}-of-{parts}.exr", render.name)),
            };
            let mut command = vec![program.into(), "render".into(), utf8(&request.scene)?.into()];
            command.extend(of_tasks.iter().map(argument));
            command.extend(which.clone());
            if parts > 1 {
                command.push(format!("--part={part}/{parts}"));
            }
            if !checkpoints {
                command.push(format!("--checkpoint={CHECKPOINT_SECONDS}"));
            }
            command.extend([
                "--resume".into(),
                format!("--progress={progress}"),
                format!("--output={}", utf8(&output)?),
            ]);
            self.tasks.push(Task { render: render.name.clone(), part, command, output, frames: frames.clone() });
        }
        if parts > 1 {
            let mut command: Vec<String> = vec![program.into(), "merge".into(), format!("--wait={WAIT_SECONDS}")];
            command.extend(which);
            // Parts are resumable because farms interrupt; the merged picture only if --checkpoint was given.
            if !checkpoints {
                command.push("--no-statistics".into());
            }
            command.extend(of_merge.iter().filter(|(name, _)| name != "stats").map(argument));
            command.push(format!("--output={}", utf8(&request.output)?));
            for task in &self.tasks[first..] {
                command.push(utf8(&task.output)?.into());
            }
            let (tasks, output) = ((first, self.tasks.len() - 1), request.output.clone());
            self.merges.push(Merge { render: render.name.clone(), command, output, frames, tasks });
        }
        Ok(())
    }

    /// Checks that tasks render and merges merge, and that no name holds control characters.
    fn check(&self) -> Result<()> {
        let tasks = self.tasks.iter().map(|t| ("render", &t.render, &t.command));
        let merges = self.merges.iter().map(|m| ("merge", &m.render, &m.command));
        utf8(&self.folder).and_then(printable)?;
        printable(&self.name)?;
        for (what, render, command) in tasks.chain(merges) {
            printable(render)?;
            command.iter().try_for_each(|word| printable(word))?;
            let acts = |word: &&String| ["--on-checkpoint", "--tev"].iter().any(|flag| word.starts_with(flag));
            if let Some(word) = command.iter().find(acts) {
                return Err(Error::Usage(format!(
                    "{word}: not allowed in a plan, which starts no programs and opens no connections"
                )));
            }
            if command.get(1).is_none_or(|word| word != what) {
                return Err(Error::Usage(format!("the command of '{render}' is not `bismar {what}`")));
            }
        }
        if let Some(merge) = self.merges.iter().find(|m| m.tasks.0 > m.tasks.1 || m.tasks.1 >= self.tasks.len()) {
            return Err(Error::Usage(format!("the merge of '{}' depends on tasks that do not exist", merge.render)));
        }
        Ok(())
    }

    /// Reads a plan's file.
    /// Errors: [`Error::Missing`] and [`Error::Data`], with the file.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_own(path)?;
        let bad = |why: &dyn Display| Error::Data(format!("{}: not a plan of `farm submit`: {why}", path.display()));
        let plan: serde_json::Value = serde_json::from_slice(&bytes).map_err(|e| bad(&e))?;
        if let Some(schema) = plan["schema"].as_u64().filter(|schema| *schema != u64::from(SCHEMA)) {
            let why =
                format!("it has format {schema}, and this bismar runs format {SCHEMA}: use the one that wrote it");
            return Err(bad(&why));
        }
        let plan = Self::deserialize(plan).map_err(|e| bad(&e))?;
        plan.check().map_err(|e| bad(&e))?;
        Ok(plan)
    }

    /// Path of the log of a task or a merge, whose number counts from 1.
    pub fn log(&self, number: usize, merge: bool) -> PathBuf {
        let what = if merge { "merge" } else { "task" };
        self.folder.join("logs").join(format!("{what}-{number}.log"))
    }

    /// Command and output files of a task or a merge, whose number counts from 1.
    /// Errors: [`Error::Usage`] if there is no such task.
    pub fn command(&self, number: usize, merge: bool) -> Result<(&[String], Vec<PathBuf>)> {
        let at = number.checked_sub(1);
        let found = match merge {
            true => at.and_then(|i| self.merges.get(i)).map(|m| (&m.command, &m.output, &m.frames)),
            false => at.and_then(|i| self.tasks.get(i)).map(|t| (&t.command, &t.output, &t.frames)),
        };
        let found = found.map(|(command, output, frames)| (&command[..], files(output, frames.as_ref())));
        let (tasks, merges) = (self.tasks.len(), self.merges.len());
        found.ok_or_else(|| {
            Error::Usage(format!("there is no number {number}: the plan has {tasks} tasks, {merges} merges"))
        })
    }
}

/// The files of an output: one per frame.
pub fn files(output: &Path, frames: Option<&Frames>) -> Vec<PathBuf> {
    match frames {
        None => vec![output.to_owned()],
        Some(frames) => frames.numbers().iter().filter_map(|&frame| numbered(output, frame)).collect(),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::job::RenderRequest;

    /// Two renders in `parts` parts.
    pub fn plan(parts: u32) -> Plan {
        let request = |name: &str| RenderRequest {
            scene: "/s/it's a hall.glb".into(),
            output: format!("/o/{name}.exr").into(),
            spp: Some(64),
            preview: Some(format!("/o/{name}.png").into()),
            ..RenderRequest::default()
        };
        let render = |name: &str| Job { name: name.into(), request: request(name), ..Job::default() };
        Plan::new("shots", Path::new("/f"), Path::new("bismar"), "plain", &[render("a"), render("b")], (parts, 1))
            .unwrap()
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

    /// Frames 1 to 7 in tasks of `chunk` frames and `parts` parts.
    pub fn sequence(parts: u32, chunk: u32) -> Plan {
        let request = RenderRequest {
            scene: "/s/a.glb".into(),
            output: "/o/a.####.exr".into(),
            preview: Some("/o/a.####.png".into()),
            ..RenderRequest::default()
        };
        let sequence = "1-7".parse().ok().map(Sequence::Frames);
        let render = Job { name: "a.####".into(), request, sequence, ..Job::default() };
        Plan::new("shots", Path::new("/f"), Path::new("bismar"), "plain", &[render], (parts, chunk)).unwrap()
    }

    #[test]
    fn frames_are_tasks_in_chunks_and_parts_are_inside_frames() {
        let plan = sequence(2, 3);
        let tasks: Vec<_> =
            plan.tasks.iter().map(|t| (t.frames.clone().unwrap().to_string(), t.part, t.output.clone())).collect();
        assert_eq!(tasks.len(), 6);
        assert_eq!(tasks[3], ("4-6".into(), 2, "/f/parts/a.####.2-of-2.exr".into()));
        assert_eq!(plan.merges.iter().map(|m| m.tasks).collect::<Vec<_>>(), [(0, 1), (2, 3), (4, 5)]);
        let (command, files) = plan.command(2, true).unwrap();
        let line = command.join(" ");
        assert!(line.contains("--frames=4-6") && line.contains("--preview=/o/a.####.png"), "{line}");
        assert_eq!(files[2], Path::new("/o/a.0006.exr"));
        assert_eq!(plan.command(6, false).unwrap().1, [Path::new("/f/parts/a.0007.2-of-2.exr")]);
        let read: Plan = serde_json::from_str(&serde_json::to_string(&plan).unwrap()).unwrap();
        assert_eq!(read, plan);
    }

    #[test]
    fn a_plan_of_another_format_is_not_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(PLAN);
        let read = |schema: u32| {
            std::fs::write(&path, serde_json::to_string(&Plan { schema, ..plan(2) }).unwrap()).unwrap();
            Plan::read(&path)
        };
        assert_eq!(read(SCHEMA).unwrap(), plan(2));
        let refused = read(99).unwrap_err();
        assert!(refused.exit_code() == 65 && refused.to_string().contains("format 99"), "{refused}");
    }

    #[test]
    fn a_whole_render_needs_no_merge_and_parts_no_rule_but_samples() {
        let whole = plan(1);
        assert!(whole.merges.is_empty() && !whole.tasks[0].command.join(" ").contains("--part"));
        assert_eq!(whole.tasks[1].output, Path::new("/o/b.exr"));
        let request = RenderRequest { time: Some(3.0), ..RenderRequest::default() };
        let timed = Job { name: "a".into(), request, ..Job::default() };
        let in_parts = |parts: u32| {
            Plan::new("x", Path::new("/f"), Path::new("bismar"), "plain", std::slice::from_ref(&timed), (parts, 1))
        };
        assert_eq!(in_parts(2).unwrap_err().exit_code(), 64);
        assert!(in_parts(1).is_ok());
    }
}
