//! What runs in continuous integration: the script behind `action.yml`, and the steps of the workflows.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::helpers::glb;
use crate::helpers::program::{Folder, expect, program, scene, stderr};
use crate::helpers::skipped::skipped;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn git(folder: &Path, line: &str) {
    let name = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"];
    let output = Command::new("git").current_dir(folder).args(name).args(line.split(' ')).output().unwrap();
    assert!(output.status.success(), "git {line}: {}", stderr(&output));
}

/// Runs the script in a folder; returns its summary.
fn pictures(folder: &Path, line: &str, code: i32) -> String {
    let _ = fs::remove_dir_all(folder.join("bismar-ci"));
    let summary = folder.join("step.md");
    let _ = fs::remove_file(&summary);
    let mut command = Command::new("python3");
    command.current_dir(folder).arg(Path::new(ROOT).join("scripts/pictures-in-ci.py"));
    command.arg("--bismar").arg(program()).args(line.split(' ')).env("GITHUB_STEP_SUMMARY", &summary);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(code), "{line}: {}", stderr(&output));
    let text = fs::read_to_string(folder.join("bismar-ci/summary.md")).unwrap_or_default();
    assert_eq!(text, fs::read_to_string(summary).unwrap_or_default());
    text
}

fn has(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}

#[test]
fn a_change_of_scenes_is_shown_and_goldens_are_checked() {
    if !has("git") || !has("python3") {
        return skipped("git or python3 is not installed");
    }
    let folder = Folder::new().with_scene("assets/deep/room.glb", "cornell.glb");
    let path = &folder.with("assets/same.glb", glb::triangle()).with("assets/gone.glb", glb::triangle());
    let put = |name: &str, bytes: &[u8]| fs::write(path.join("assets").join(name), bytes).unwrap();
    let cornell = fs::read(scene("cornell.glb")).unwrap();
    git(path, "init -q");
    git(path, "add .");
    git(path, "commit -qm base");
    let none = pictures(path, "pairs --base HEAD assets", 0);
    assert!(none.contains("0 changed, 3 unchanged, 0 failed"), "{none}");
    put("deep/room.glb", &glb::triangle());
    put("new|er.glb", &cornell);
    fs::remove_file(path.join("assets/gone.glb")).unwrap();
    let all = pictures(path, "pairs --base HEAD assets", 0);
    assert!(all.contains("1 added, 1 removed, 1 changed, 1 unchanged, 0 failed"), "{all}");
    for words in ["| deep/room.glb | 0.", "triangles: 32 -> 1", "new\\|er"] {
        assert!(all.contains(words), "{all}");
    }
    assert!(path.join("bismar-ci/pairs.png").exists());
    pictures(path, "pairs --base HEAD --max-flip 0.001 assets", 1);
    // A broken scene is named, and the rest is shown; a revision that is not there is an error.
    put("same.glb", b"glTF\x02\0\0\0");
    let broken = pictures(path, "pairs --base HEAD assets", 65);
    assert!(broken.contains("1 failed") && broken.contains("| same.glb |"), "{broken}");
    assert!(pictures(path, "pairs --base nowhere assets", 66).contains("not here"));
    // A folder that is new.
    assert!(pictures(path, "pairs --base HEAD assets/deep", 0).contains("1 changed"));
    fs::create_dir(path.join("fresh")).unwrap();
    fs::write(path.join("fresh/a.glb"), &cornell).unwrap();
    assert!(pictures(path, "pairs --base HEAD fresh", 0).contains("1 added, 0 removed"));

    expect(path, "render fresh/a.glb --size 24x24 --spp 4 --aov none -o g.exr", 0);
    assert!(pictures(path, "goldens g.exr", 0).contains("1 golden pictures, 1 of them identical"));
    fs::write(path.join("fresh/a.glb"), glb::triangle()).unwrap();
    let differs = pictures(path, "goldens --max-flip 0.01 g.exr", 1);
    assert!(differs.contains("| g.exr | differs |"), "{differs}");
}

/// What was compared is counted; everything else is an error that says why.
#[test]
fn both_sides_are_whole_checkouts_and_what_is_not_compared_is_an_error() {
    if !has("git") || !has("python3") {
        return skipped("git or python3 is not installed");
    }
    let folder = Folder::new().with_scene("assets/a.glb", "cornell.glb").with("assets/deep/b.glb", glb::triangle());
    let path = &folder.with("more/c.glb", glb::triangle()).with("broken/x.glb", "no scene");
    fs::create_dir(path.join("lost")).unwrap();
    fs::write(path.join("lost/t.glb"), glb::pictured()).unwrap();
    // Scenes under a filter, as Git LFS has, and left out of archives.
    fs::write(path.join(".gitattributes"), "*.glb filter=lfs export-ignore -text\n").unwrap();
    git(path, "init -q");
    let config = path.join(".git/config");
    let filter = "[filter \"lfs\"]\nclean = base64\nsmudge = base64 -d\nrequired = true\n";
    fs::write(&config, fs::read_to_string(&config).unwrap() + filter).unwrap();
    for (to, link) in [("assets", "models"), ("../more", "assets/more"), ("/usr/share", "broken/out")] {
        symlink(to, path.join(link)).unwrap();
    }
    git(path, "add .");
    git(path, "commit -qm base");
    git(path, &format!("update-index --add --cacheinfo 160000,{},sub/m", "1".repeat(40)));
    fs::write(path.join("assets/a.glb"), glb::triangle()).unwrap();
    let top = path.canonicalize().unwrap();
    let changed = "0 added, 0 removed, 1 changed, 1 unchanged, 0 failed";
    for name in ["assets", "./assets/", "models", "more/../assets", &format!("{}/assets", top.display())] {
        let said = pictures(path, &format!("pairs --base HEAD --max-flip 0.001 {name}"), 1);
        assert!(said.contains(changed) && said.contains("/more`: 0 added, 0 removed, 0 changed, 1 un"), "{said}");
    }
    let said = pictures(&path.join("more"), "pairs --base HEAD --max-flip 0.001 ../assets . ../assets/a.glb", 1);
    assert!(said.contains(changed) && said.contains("`.`: 0 added, 0 removed, 0 changed, 1 unchanged"), "{said}");
    assert!(said.contains("| ../assets/a.glb | 0."), "{said}");
    for (name, code, why) in [
        ("nowhere", 66, "neither"),
        ("..", 64, "outside"),
        ("/tmp", 64, "outside"),
        ("broken", 65, "link that leads out"),
        ("broken/x.glb", 65, "see the log"),
        (".gitattributes", 65, "see the log"),
        ("lost", 65, "left out: files that it names"),
        ("lost/t.glb", 65, "left out: files that it names"),
        ("sub", 65, "submodule"),
        ("sub/m/x.glb", 65, "submodule"),
    ] {
        let said = pictures(path, &format!("pairs --base HEAD {name}"), code);
        assert!(said.contains(why), "{name}: {said}");
    }
    // Scenes that are new and broken, and names that Markdown and a runner would obey.
    let name = "##[group]_*`<b>\u{202e}[x](y)";
    for (ending, bytes) in [("1.glb", &b"no scene"[..]), ("2.glb", &glb::triangle())] {
        fs::write(path.join(format!("more/{name}{ending}")), bytes).unwrap();
    }
    let said = pictures(path, "pairs --base HEAD more", 65);
    assert!(said.contains("1 added, 0 removed, 0 changed, 1 unchanged, 1 failed"), "{said}");
    assert!(said.contains(r"\#\#\[group\]\_\*\`\<b\>\u{202e}\[x\]\(y\)2.glb"), "{said}");
    // The lines of the action's input.
    let action = fs::read_to_string(Path::new(ROOT).join("action.yml")).unwrap();
    let block = action.split("run: |\n").nth(1).unwrap().split("\n    - ").next().unwrap();
    let _ = fs::remove_dir_all(path.join("bismar-ci"));
    let mut command = Command::new("bash");
    command.current_dir(path).args(["-e", "-o", "pipefail", "-c", block]).env("GITHUB_ACTION_PATH", ROOT);
    command.env("MODE", "pairs").env("PATHS", "broken/none\r\nassets/deep\n  assets/a.glb\n").env("BASE", "HEAD");
    let output = command.env("BISMAR", program()).env("MAX_FLIP", "0.001").output().unwrap();
    let said = String::from_utf8(output.stdout.clone()).unwrap();
    assert_eq!(output.status.code(), Some(66), "{said}{}", stderr(&output));
    assert!(
        said.contains("`assets/deep`: 0 added") && said.contains("`assets/a.glb`: 0 added, 0 removed, 1"),
        "{said}"
    );
    // No checkout is left.
    let output = Command::new("git").current_dir(path).args(["worktree", "list"]).output().unwrap();
    assert_eq!(output.stdout.iter().filter(|b| **b == b'\n').count(), 1);
}

#[test]
fn workflows_run_steps_of_the_script_and_the_action_its_inputs() {
    let root = Path::new(ROOT);
    let script = fs::read_to_string(root.join("scripts/workflow.sh")).unwrap();
    for file in fs::read_dir(root.join(".github/workflows")).unwrap() {
        let text = fs::read_to_string(file.unwrap().path()).unwrap();
        let steps: Vec<_> = text.lines().filter_map(|line| line.split("run: ").nth(1)).collect();
        assert!(!steps.is_empty(), "{text}");
        for step in steps {
            let word = step.strip_prefix("scripts/workflow.sh ").unwrap_or_else(|| panic!("{step}"));
            assert!(script.lines().any(|line| line.starts_with(&format!("{word})"))), "{step}");
        }
    }
    let wrong = Command::new(root.join("scripts/workflow.sh")).arg("no-such-step").output().unwrap();
    assert_eq!(wrong.status.code(), Some(64));
    let action = fs::read_to_string(root.join("action.yml")).unwrap();
    for input in action.split("${{ inputs.").skip(1).map(|rest| rest.split(' ').next().unwrap()) {
        assert!(action.contains(&format!("\n  {input}:\n")), "{input}");
    }
}
