//! Programs of others that read pictures, where `scripts/setup.sh --pictures` has put them.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Python with OpenImageIO, FLIP and, for Python 3.11, Blender; or `None` with a word about it. On CI it must be there.
pub fn python() -> Option<PathBuf> {
    let python = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/pictures/bin/python");
    if python.exists() {
        return Some(python);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing", python.display());
    super::skipped::skipped("no OpenImageIO and Blender (scripts/setup.sh --pictures installs them)");
    None
}

/// Runs a script of `tests/pictures` in a folder; its JSON.
#[track_caller]
pub fn run(python: &Path, script: &str, folder: &Path, arguments: &[&str]) -> Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pictures").join(script);
    let output = Command::new(python).arg(script).args(arguments).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {said}"))
}
