//! What tests of farms share.

use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::thread;
use std::time::Duration;

use serde_json::Value;

use super::program::{self, Folder};

/// Says that something is not installed; on CI it must be.
pub fn absent(why: &str) {
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{why}");
    super::skipped::skipped(&format!("{why}; scripts/setup.sh --farm installs it"));
}

/// Names that mean something to shells, to Slurm (`%j`, `\\`) or to Open Job Description.
pub const HOSTILE: [&str; 6] = [
    "it's %j",
    "%A_%a %% 100%",
    r#"back\slash "quoted""#,
    "$(touch X)`touch X`",
    "a; touch X #&|<>*?!~",
    "{{Param.X}} {{{x}}}",
];

/// With `veach.glb`.
pub fn folder() -> Folder {
    Folder::new().with_scene("veach.glb", "veach.glb")
}

/// Its stdout; both streams if it fails.
#[track_caller]
pub fn succeeds(mut command: Command) -> String {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let out = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{command:?}: {}\n{out}\n{}", output.status, program::stderr(&output));
    out
}

/// `bismar farm status --json`.
#[track_caller]
pub fn status(folder: &Path, farm: &str) -> Value {
    let mut command = program::bismar(folder);
    command.args(["farm", "status", farm, "--json"]);
    serde_json::from_str(&succeeds(command)).unwrap()
}

/// The process that renders an output; `None` if nobody does any more.
pub fn writer(output: &Path) -> Option<u32> {
    let argument = format!("--output={}", output.display());
    processes().into_iter().find(|(_, words)| words.contains(&argument)).map(|(id, _)| id)
}

/// The processes that a batch has at work.
pub fn workers(batch: u32) -> Vec<u32> {
    let of_batch = |(id, words): &(u32, Vec<String>)| {
        words.get(1).is_some_and(|word| word == "batch-worker") && parent(*id) == batch
    };
    processes().into_iter().filter(of_batch).map(|(id, _)| id).collect()
}

fn processes() -> Vec<(u32, Vec<String>)> {
    let process = |entry: fs::DirEntry| {
        let id = entry.file_name().to_str()?.parse().ok()?;
        let words = fs::read(entry.path().join("cmdline")).ok()?;
        Some((id, words.split(|b| *b == 0).map(|word| String::from_utf8_lossy(word).into_owned()).collect()))
    };
    fs::read_dir("/proc").unwrap().flatten().filter_map(process).collect()
}

/// 0 for a process that has gone.
pub fn parent(process: u32) -> u32 {
    // "id (name) state parent …", and the name may hold anything.
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    stat.rsplit_once(')').and_then(|(_, rest)| rest.split_whitespace().nth(1)?.parse().ok()).unwrap_or(0)
}

/// Waits until this holds.
pub fn until(mut holds: impl FnMut() -> bool) {
    while !holds() {
        thread::sleep(Duration::from_millis(5));
    }
}

/// The same, as long as `child` lives.
#[track_caller]
pub fn until_alive(child: &mut Child, mut holds: impl FnMut() -> bool) {
    while !holds() {
        assert!(child.try_wait().unwrap().is_none(), "it has ended by itself");
        thread::sleep(Duration::from_millis(5));
    }
}

/// `kill -KILL`; a process that has just ended is as good. By the shell's own: small systems have no other.
pub fn kill(process: u32) {
    let _ = Command::new("sh").args(["-c", &format!("kill -KILL {process}")]).status().unwrap();
}
