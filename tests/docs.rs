//! The commands of documentation pages run as they stand. `scripts/try-docs.sh` runs those of longer pages.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::helpers::program::{program, scene};

/// What stands between ```sh and ```.
fn commands(page: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(page);
    let text = fs::read_to_string(path).unwrap();
    text.split("\n```sh\n").skip(1).map(|rest| rest.split("\n```").next().unwrap().to_owned() + "\n").collect()
}

#[test]
fn commands_of_short_pages_run() {
    for (page, file) in [
        ("cameras.md", "out/third.exr"),
        ("check.md", "out/check/index.html"),
        ("datasets.md", "out/set/0003.normal.npy"),
        ("look.md", "out/versions.png"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        // Copies: `check` refuses files that a link leads to.
        fs::create_dir(folder.path().join("scenes")).unwrap();
        for name in ["cornell.glb", "veach.glb"] {
            fs::copy(scene(name), folder.path().join("scenes").join(name)).unwrap();
        }
        let path = format!("{}:{}", program().parent().unwrap().display(), std::env::var("PATH").unwrap());
        let script = commands(page);
        assert!(script.contains("bismar "));
        let mut shell = Command::new("bash");
        shell.args(["-euo", "pipefail", "-c", &format!("mkdir -p out\n{script}")]).current_dir(folder.path());
        let output = shell.env("PATH", path).output().unwrap();
        assert!(output.status.success(), "{page}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(folder.path().join(file).exists(), "{page}: no {file}");
    }
}
