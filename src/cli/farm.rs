//! `bismar farm submit`, `bismar farm status` and `bismar farm task`

mod site;
mod status;
mod task;

use std::ffi::OsString;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf, absolute};

use clap::{Args, Subcommand, ValueEnum};

use super::options::{has_ending, reason};
use super::render::{self, command};
use crate::batch::frames::Sequence;
use crate::batch::job::Job;
use crate::batch::numbering::with_placeholder;
use crate::batch::split::split;
use crate::cli::batch;
use crate::console::{Verdict, print, print_json, say};
use crate::farm::sessions::{Sessions, record_path};
use crate::farm::slurm::{self, Submitted, TaskOptions, quoted};
use crate::farm::{PLAN, Plan, openjd, utf8};
use crate::film::atomic;
use crate::film::lock::{Claim, claim};
use crate::job::DEFAULT_SIZE;
use crate::render::{RenderSettings, tile_positions};
use crate::{Error, Result};
use site::{DEFAULT_ARRAY_SIZE, Queue, QueueState, Site, sbatch};
use status::StatusArgs;
use task::TaskArgs;

/// Render on many machines (docs/farm.md).
#[derive(Debug, Args)]
pub struct FarmArgs {
    #[command(subcommand)]
    command: FarmCommand,
}

#[derive(Debug, Subcommand)]
enum FarmCommand {
    Submit(Box<SubmitArgs>),
    Status(StatusArgs),
    Task(TaskArgs),
}

/// Scheduler that the plan is written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Slurm: a job array of tasks and merges that depend on it, submitted with sbatch
    Slurm,
    /// Open Job Description: a job template, to be submitted to a farm manager that runs these
    Openjd,
    /// None: write the folder, whose tasks are `bismar farm task auto` in an array of Kubernetes or AWS Batch
    Plan,
}

/// Submit a batch file or a scene to a farm, with each picture in --parts parts.
///
/// Frames of a sequence (`frames` in the file, --frames for a scene) are tasks as well, --chunk frames per task. Scripts,
/// logs and parts are written to a folder. Running the same command again submits all tasks again: finished tasks end at
/// once, the others resume from their last checkpoint.
#[derive(Debug, Args)]
struct SubmitArgs {
    /// A batch file (.toml) or a scene (.gltf, .glb).
    input: PathBuf,
    /// Number of parts of each picture, one task per part.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    parts: u32,
    /// Number of frames per task, rendered one after the other.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    chunk: u32,
    /// Scheduler to submit to.
    #[arg(long, value_enum, default_value_t = Format::Slurm)]
    format: Format,
    /// Folder of scripts, logs and parts, which all machines must be able to access [default: the input's name with .farm, in
    /// the same folder].
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Folder below which the outputs of a batch file may lie; may be repeated [default: the batch file's folder].
    #[arg(long, value_name = "DIR")]
    root: Vec<PathBuf>,
    /// Print what would be written and submitted, without doing it.
    #[arg(long)]
    dry_run: bool,
    /// CPUs per task (sbatch --cpus-per-task).
    #[arg(long, value_name = "N", help_heading = "Slurm")]
    cpus: Option<u32>,
    /// Memory per task, such as 4G (sbatch --mem).
    #[arg(long, value_name = "SIZE", help_heading = "Slurm")]
    memory: Option<String>,
    /// Memory of a merge, which holds a whole picture [default: as --memory].
    #[arg(long, value_name = "SIZE", help_heading = "Slurm")]
    merge_memory: Option<String>,
    /// Time limit of a task in minutes, after which it is saved, requeued and resumed (sbatch --time).
    #[arg(long, value_name = "N", help_heading = "Slurm")]
    minutes: Option<u32>,
    /// Run a task that ran out of memory again, once, with 1.5 times as much.
    #[arg(long, help_heading = "Slurm")]
    retry_memory: bool,
    /// Largest number of tasks at the same time.
    #[arg(long, value_name = "N", help_heading = "Slurm")]
    throttle: Option<u32>,
    /// Additional option of sbatch, as in --sbatch=--partition=night; may be repeated.
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true, help_heading = "Slurm")]
    sbatch: Vec<String>,
    /// Flags of `bismar render`, for a scene.
    #[arg(last = true, value_name = "RENDER FLAGS")]
    flags: Vec<OsString>,
}

pub fn run(args: &FarmArgs) -> Result<Verdict> {
    match &args.command {
        FarmCommand::Submit(args) => submit(args),
        FarmCommand::Status(args) => status::run(args),
        FarmCommand::Task(args) => task::run(args),
    }
}

fn submit(args: &SubmitArgs) -> Result<Verdict> {
    let is_batch = has_ending(&args.input, &["toml"]);
    let renders = match (is_batch, args.flags.is_empty()) {
        (true, true) => renders_of_batch(args)?,
        (true, false) => return Err(Error::Usage("a batch file contains its flags: none may follow --".into())),
        (false, _) => vec![render_of_scene(args)?],
    };
    let folder = args.folder.clone().unwrap_or_else(|| args.input.with_extension("farm"));
    if args.folder.is_none() {
        atomic::check_folder(&folder, "--folder")?;
    }
    let folder = absolute_path(&folder)?;
    let progress = if args.format == Format::Openjd { "openjd" } else { "plain" };
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy();
    let mut plan = Plan::new(&name, &folder, &this_program()?, progress, &renders, (args.parts, args.chunk))?;
    plan.retries_memory = args.retry_memory;
    plan.input = utf8(&absolute_path(&args.input)?)?.to_owned();
    match args.format {
        Format::Slurm => submit_to_slurm(args, &plan),
        Format::Openjd => write_template(args, &plan),
        Format::Plan => write_plan(args, &plan),
    }
}

fn renders_of_batch(args: &SubmitArgs) -> Result<Vec<Job>> {
    let path = &args.input;
    let jobs = batch::read(path)?;
    // Flags are checked per frame; tasks take whole sequences.
    let roots = batch::roots(path, &args.root);
    for job in batch::plan(Some(path), &jobs)?.0 {
        job.request.outputs().try_for_each(|output| atomic::check_below(output, &roots))?;
        check_parts(&job, args.parts)?;
    }
    jobs.into_iter().map(absolute_job).collect()
}

/// Every part of a picture needs a tile.
fn check_parts(Job { name, request, .. }: &Job, parts: u32) -> Result<()> {
    // A scene that is not read has no aspect ratio; no other picture without a size has thousands of parts.
    let (width, height) = request.size.map_or(DEFAULT_SIZE, |size| (size.0, size.1));
    let settings = RenderSettings { width, height, ..request.settings() };
    let tiles = tile_positions(&settings).len();
    if parts as usize > tiles {
        let [x0, y0, x1, y1] = settings.window();
        let size = format!("{} x {}", x1.saturating_sub(x0), y1.saturating_sub(y0));
        let why = format!("a picture of {size} pixels has {tiles} tiles: give fewer parts, or --size");
        return Err(Error::Usage(format!("--parts {parts}: '{name}': {why}")));
    }
    Ok(())
}

/// The job with absolute paths.
fn absolute_job(mut job: Job) -> Result<Job> {
    let Job { request, sequence, .. } = &mut job;
    for path in [&mut request.scene, &mut request.output] {
        *path = absolute_path(path)?;
    }
    for path in request.paths_mut() {
        *path = absolute_path(path)?;
    }
    if let Some(Sequence::Cameras(file)) = sequence {
        *file = absolute_path(file)?;
    }
    Ok(job)
}

fn render_of_scene(args: &SubmitArgs) -> Result<Job> {
    let command = command();
    let line = [OsString::from("render"), args.input.clone().into()].into_iter().chain(args.flags.iter().cloned());
    let render = render::read(&command, line).map_err(|e| Error::Usage(format!("after --: {}", reason(&e))))?;
    if let Some(flag) = render.of_farm() {
        return Err(Error::Usage(format!("after --: {flag} is set by the farm")));
    }
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut job = absolute_job(render.job(name)?)?;
    if let Some(Sequence::Frames(_)) = job.sequence {
        job.name = with_placeholder(job.name);
    }
    for frame in split(&job).map_err(|(_, why)| Error::Usage(format!("after --: {why}")))? {
        check_parts(&frame, args.parts)?;
    }
    Ok(job)
}

fn absolute_path(path: &Path) -> Result<PathBuf> {
    absolute(path).map_err(|e| Error::Usage(format!("{}: {e}", path.display())))
}

fn this_program() -> Result<PathBuf> {
    std::env::current_exe().map_err(|e| Error::Host(format!("cannot find this program's file: {e}")))
}

fn submit_to_slurm(args: &SubmitArgs, plan: &Plan) -> Result<Verdict> {
    let options = TaskOptions {
        cpus: args.cpus,
        memory: args.memory.clone(),
        merge_memory: args.merge_memory.clone(),
        minutes: args.minutes,
        throttle: args.throttle,
        others: args.sbatch.clone(),
    };
    let files = slurm::files(plan, &options)?;
    if args.dry_run {
        let folder = plan.folder.display();
        let shown = files.iter().map(|(name, content)| format!("# {folder}/{name}\n{content}"));
        let mut text = shown.collect::<Vec<_>>().join("\n");
        for (what, commands) in [
            ("tasks", plan.tasks.iter().map(|t| &t.command).collect::<Vec<_>>()),
            ("merges", plan.merges.iter().map(|m| &m.command).collect()),
        ] {
            text += &format!("\n# {what}, in {folder}/{PLAN}\n");
            commands.iter().for_each(|command| text += &format!("{}\n", quoted(command)));
        }
        text += "\n# to be submitted\n";
        let mut arrays = Vec::new();
        for (mut array, arguments) in slurm::arrays(plan, &options, DEFAULT_ARRAY_SIZE)? {
            array.job = format!("$ARRAY{}", arrays.len() + 1);
            text += &format!("{}=$(sbatch --parsable {})\n", &array.job[1..], quoted(&arguments));
            arrays.push(array);
        }
        for number in 0..plan.merges.len() {
            let arguments = slurm::merge(plan, number, &arrays)?;
            // The first argument refers to shell variables and must not be quoted.
            text += &format!("sbatch --parsable {} {}\n", arguments[0], quoted(&arguments[1..]));
        }
        print(text.trim_end())?;
        return Ok(Verdict::Done);
    }
    let site = Site::query()?;
    let _claim = check_folder(plan)?;
    write_folder(plan, &files)?;
    if !site.requeues {
        say(
            "warning: this site does not requeue tasks that exit with 75 (RequeueExit in slurm.conf): a task interrupted by \
             its time limit is saved, and resumes when this command is run again",
        );
    }
    let mut submitted = Submitted::default();
    for (mut array, arguments) in slurm::arrays(plan, &options, site.max_array_size)? {
        array.job = sbatch(&arguments)?;
        say(format_args!("tasks {} to {}: job {}", array.first + 1, array.first + array.count, array.job));
        submitted.arrays.push(array);
        submitted.write(&plan.folder)?;
    }
    for (number, merge) in plan.merges.iter().enumerate() {
        let id = sbatch(&slurm::merge(plan, number, &submitted.arrays)?)?;
        say(format_args!("merge of {}: job {id}", merge.render));
        submitted.merges.push(id);
        submitted.write(&plan.folder)?;
    }
    say(format_args!("`bismar farm status {}` shows the progress", plan.folder.display()));
    Ok(Verdict::Done)
}

/// Checks that nobody works by the plan that the folder holds already, and keeps other submissions out.
/// Errors: [`Error::CannotCreate`] for a folder of another scene or batch file, or one whose tasks are queued or running.
fn check_folder(plan: &Plan) -> Result<Claim> {
    let (folder, path) = (plan.folder.display(), plan.folder.join(PLAN));
    create(&plan.folder)?;
    atomic::confine(std::slice::from_ref(&plan.folder));
    let claim = claim(&path)?;
    let Ok(earlier) = Plan::read(&path) else { return Ok(claim) };
    let other_folder = "give this one another with --folder";
    if earlier.input != plan.input {
        return Err(Error::CannotCreate(format!("{folder}: the farm of {}: {other_folder}", earlier.input)));
    }
    let submitted = Submitted::read(&plan.folder).unwrap_or_default();
    let queue = Queue::query(&submitted);
    let queued = |state: Option<QueueState>| matches!(state, Some(QueueState::Waiting | QueueState::Running));
    let busy = |number: usize, merge: bool| {
        let state = queue.as_ref().and_then(|queue| if merge { queue.merge(number) } else { queue.task(number) });
        let record = record_path(&earlier.log(number + 1, merge));
        queued(state) || queue.is_none() && Sessions::read(&record).is_running(&record)
    };
    let tasks = (0..earlier.tasks.len()).filter(|&number| busy(number, false)).count();
    let merges = (0..earlier.merges.len()).filter(|&number| busy(number, true)).count();
    if tasks + merges > 0 {
        return Err(Error::CannotCreate(format!(
            "{folder}: {tasks} tasks and {merges} merges of an earlier submission are queued or running by the plan in it: wait \
             for them (`bismar farm status`), cancel them (scancel), or {other_folder}"
        )));
    }
    Ok(claim)
}

fn create(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", folder.display())))
}

fn write_folder(plan: &Plan, files: &[(String, String)]) -> Result<()> {
    // Neither is a link that leads elsewhere.
    ["logs", "parts"].iter().try_for_each(|name| atomic::create_folder(&plan.folder.join(name).join("a")))?;
    // Folder names hold no frame numbers, so there is one folder for all frames.
    let outputs = plan.tasks.iter().map(|t| &t.output).chain(plan.merges.iter().map(|m| &m.output));
    for folder in outputs.filter_map(|path| path.parent()) {
        create(folder)?;
    }
    let json = serde_json::to_string_pretty(plan).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
    for (name, content) in files.iter().chain([&(PLAN.to_owned(), json)]) {
        atomic::write(&plan.folder.join(name), |file| Ok(Ok(file.write_all(content.as_bytes())?)))?;
    }
    Ok(())
}

fn write_plan(args: &SubmitArgs, plan: &Plan) -> Result<Verdict> {
    if args.dry_run {
        print_json(plan)?;
        return Ok(Verdict::Done);
    }
    let _claim = check_folder(plan)?;
    write_folder(plan, &[])?;
    let file = plan.folder.join(PLAN);
    let (file, tasks) = (file.display(), plan.tasks.len());
    say(format_args!("{tasks} tasks: bismar farm task auto --plan {file}"));
    if !plan.merges.is_empty() {
        say(format_args!("then {} merges: bismar farm task auto --merge --plan {file}", plan.merges.len()));
    }
    Ok(Verdict::Done)
}

fn write_template(args: &SubmitArgs, plan: &Plan) -> Result<Verdict> {
    let template = openjd::template(plan)?;
    if args.dry_run {
        print_json(&template)?;
        return Ok(Verdict::Done);
    }
    let text = serde_json::to_string_pretty(&template).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
    let _claim = check_folder(plan)?;
    write_folder(plan, &[("template.json".into(), text)])?;
    say(format_args!("wrote {}", plan.folder.join("template.json").display()));
    Ok(Verdict::Done)
}
