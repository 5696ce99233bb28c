//! What tests of farms share.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::program;

/// Says that something is not installed; on CI it must be.
pub fn absent(why: &str) {
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{why}");
    println!("skipped: {why}; scripts/setup.sh --farm installs it");
}

/// With `veach.glb`.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(program::scene("veach.glb"), folder.path().join("veach.glb")).unwrap();
    folder
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
