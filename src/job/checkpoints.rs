//! After a checkpoint: numbered copies (`--keep`) and the user's program (`--on-checkpoint`).

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use tracing::warn;

use crate::render::record::checkpoint::Earlier;

/// The longest time that the user's program may run on after the render: a scheduler kills both soon after its signal.
const LONGEST_WAIT: Duration = Duration::from_secs(10);

/// Copies checkpoints and starts the user's program. Failures are warnings.
pub struct Checkpoints<'a> {
    output: &'a Path,
    /// Number of copies to keep.
    keep: Option<u32>,
    program: Option<&'a Path>,
    running: Option<Child>,
}

impl<'a> Checkpoints<'a> {
    pub fn new(output: &'a Path, keep: Option<u32>, program: Option<&'a Path>) -> Self {
        Self { output, keep, program, running: None }
    }

    /// Call after a checkpoint has been saved.
    pub fn saved(&mut self) {
        let cannot = |e: &io::Error| warn!("{}: cannot keep a copy of this checkpoint: {e}", self.output.display());
        let copy = self.keep.and_then(|keep| copy(self.output, keep).inspect_err(cannot).ok());
        let Some(program) = self.program else { return };
        // While the program still runs, this checkpoint is skipped.
        if self.running.as_mut().is_some_and(|child| child.try_wait().is_ok_and(|ended| ended.is_none())) {
            return;
        }
        // Standard output belongs to the render.
        let started = Command::new(program)
            .arg(copy.as_deref().unwrap_or(self.output))
            .stdin(Stdio::null())
            .stdout(std::io::stderr())
            .process_group(0)
            .spawn();
        self.running = started.inspect_err(|e| warn!("--on-checkpoint {}: {e}", program.display())).ok();
    }
}

impl Drop for Checkpoints<'_> {
    fn drop(&mut self) {
        let Some(mut child) = self.running.take() else { return };
        let began = Instant::now();
        while child.try_wait().is_ok_and(|ended| ended.is_none()) {
            if began.elapsed() > LONGEST_WAIT {
                warn!("--on-checkpoint: the program still runs after {} s and is ended", LONGEST_WAIT.as_secs());
                let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
                let _ = group.map(|group| kill_process_group(group, Signal::KILL));
                let _ = child.wait();
                return;
            }
            thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Copies the file to the next number, by a hard link where possible, and removes the oldest copies of this render. Other
/// files with such names are left alone.
fn copy(output: &Path, keep: u32) -> io::Result<PathBuf> {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy().into_owned() + ".checkpoint-";
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let number = |name: &str| name.strip_prefix(&stem)?.strip_suffix(".exr")?.parse::<u64>().ok();
    let names = fs::read_dir(folder)?.flatten().map(|entry| entry.file_name());
    let mut named: Vec<(u64, PathBuf)> =
        names.filter_map(|name| Some((number(name.to_str()?)?, folder.join(name)))).collect();
    named.sort();
    let next = named.last().map_or(0, |last| last.0) + 1;
    let copy = folder.join(format!("{stem}{next:04}.exr"));
    // The next checkpoint replaces the output and never writes into it, so a hard link keeps this one.
    match fs::hard_link(output, &copy) {
        Err(e) if e.kind() != ErrorKind::AlreadyExists => {
            io::copy(&mut File::open(output)?, &mut File::create_new(&copy)?)?;
        }
        linked => linked?,
    }
    let mut copies: Vec<_> = named.into_iter().map(|(_, path)| path).filter(|path| is_copy(path, output)).collect();
    copies.truncate((copies.len() + 1).saturating_sub(keep as usize));
    copies.iter().try_for_each(fs::remove_file)?;
    Ok(copy)
}

/// Is the file, which has the name of a copy, a checkpoint of the render in `output`? Its record tells.
fn is_copy(path: &Path, output: &Path) -> bool {
    let record = |path: &Path| Some(Earlier::read(path).ok()??.record);
    let is_file = fs::symlink_metadata(path).is_ok_and(|meta| meta.is_file());
    match (is_file, record(path), record(output)) {
        (true, Some(a), Some(b)) => (a.request, a.identity.settings.part) == (b.request, b.identity.settings.part),
        _ => false,
    }
}
