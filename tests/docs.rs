//! The commands of documentation pages run as they stand. `scripts/try-docs.sh` runs those of longer pages.

use std::fs;
use std::path::Path;
use std::process::Command;

use bismar::render::Technique;
use serde_json::Value;

use crate::helpers::program::{Folder, bismar, program};

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
        ("looks.md", "out/again.png"),
    ] {
        // Copies: `check` refuses files that a link leads to.
        let folder = Folder::new().with_scene("scenes/cornell.glb", "cornell.glb");
        let folder = folder.with_scene("scenes/veach.glb", "veach.glb");
        let path = format!("{}:{}", program().parent().unwrap().display(), std::env::var("PATH").unwrap());
        let script = commands(page);
        assert!(script.contains("bismar "));
        let mut shell = Command::new("bash");
        shell.args(["-euo", "pipefail", "-c", &format!("mkdir -p out\n{script}")]).current_dir(&folder);
        let output = shell.env("PATH", path).output().unwrap();
        assert!(output.status.success(), "{page}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(folder.join(file).exists(), "{page}: no {file}");
    }
}

/// Flags that Python's functions lack: files that a process writes or that many pictures share, and its interruption.
const NOT_IN_PYTHON: [(&str, &str); 5] = [
    (
        "render",
        "cameras checkpoint frames keep on-checkpoint output part path-mapping preview replay-pixel resume stats tev \
         turntable",
    ),
    ("merge", "frames no-statistics path-mapping wait"),
    ("labels", ""),
    ("develop", ""),
    ("look", "output page"),
];

#[test]
fn every_option_is_a_keyword_of_the_python_package() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/bismar/__init__.py");
    let package = fs::read_to_string(package).unwrap();
    // The parameters of a function, after what precedes it in the file.
    let keywords = |after: &str, function: &str| {
        let rest = &package[package.find(after).unwrap()..];
        let rest = rest.split_once(&format!("def {function}(")).unwrap().1;
        rest.split_once(") ->").unwrap().0.to_owned()
    };
    let options = bismar(Path::new(".")).arg("options").output().unwrap().stdout;
    let options: Value = serde_json::from_slice(&options).unwrap();
    for (command, missing) in NOT_IN_PYTHON {
        let functions = match command {
            "render" => &[("", "load"), ("class Scene:", "render"), ("class Picture:", "save")][..],
            other => &[("", other)],
        };
        let all: String = functions.iter().map(|(after, function)| keywords(after, function)).collect();
        let lacks =
            |option: &&Value| !all.contains(&format!(" {}: ", option["name"].as_str().unwrap().replace('-', "_")));
        let found: Vec<_> = options[command].as_array().unwrap().iter().filter(lacks).collect();
        let mut found: Vec<_> = found.iter().map(|option| option["flag"].as_str().unwrap()).collect();
        found.sort();
        assert_eq!(found.join(" "), missing, "flags of `bismar {command}`");
    }
}

#[test]
fn the_page_of_statistics_has_every_technique() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/stats.md");
    let page = fs::read_to_string(path).unwrap();
    let techniques = page.lines().find(|line| line.starts_with("| `techniques`")).unwrap();
    for technique in Technique::ALL {
        assert!(techniques.contains(&format!("`{}`", technique.name())), "{technique:?}");
        assert!(page.contains(&format!("\n| `{}` |", technique.name())), "{technique:?}");
    }
}
