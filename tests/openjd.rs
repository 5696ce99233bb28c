//! Templates in the Open Job Description format, checked and run by its own command line tool.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;

use crate::helpers::farm::{HOSTILE, absent, folder, status, succeeds};
use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, bismar, expect};

/// The tool: on the path, or where `scripts/setup.sh --farm` puts it.
fn tool() -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/openjd/bin");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain([own]);
    let found = folders.map(|folder| folder.join("openjd")).find(|file| file.exists());
    if found.is_none() {
        absent("openjd is not installed (PyPI: openjd-cli)");
    }
    found
}

/// `bismar farm submit SCENE LINE`, as a template.
#[track_caller]
fn submit(folder: &Path, scene: &str, line: &str) {
    let mut command = bismar(folder);
    command.args(["farm", "submit", scene, "--format", "openjd"]).args(line.split(' '));
    succeeds(command);
}

/// Checks or runs a folder's template; stdout.
#[track_caller]
fn openjd(tool: &Path, what: &str, folder: &Path, template: &str) -> String {
    let mut command = Command::new(tool);
    command.arg(what).arg(folder.join(template)).current_dir(folder);
    succeeds(command)
}

#[test]
fn a_template_is_accepted_and_its_run_is_the_single_machines_picture() {
    let Some(tool) = tool() else { return };
    let folder = folder();
    let flags = "--size 96x64 --spp 64 --aov all";
    submit(&folder, "veach.glb", &format!("--parts 3 -- {flags} -o out.exr"));
    let [_, said] = ["check", "run"].map(|what| openjd(&tool, what, &folder, "veach.farm/template.json"));
    assert!(said.contains("openjd_progress: 100"), "{said}");
    expect(&folder, &format!("render veach.glb {flags} -o whole.exr -q"), 0);
    assert_same_bits(&folder.join("whole.exr"), &folder.join("out.exr"));
    assert_eq!(status(&folder, "veach.farm")["complete"], true);
}

#[test]
fn a_sequence_runs_as_a_parameter_space() {
    let Some(tool) = tool() else { return };
    let path = &folder().with("moving.glb", glb::moving());
    let flags = "--frames 2-6x2 --size 40x30 --spp 4 --fps 10";
    expect(path, &format!("render moving.glb {flags} -o whole.####.exr -q"), 0);
    for (parts, chunk) in [(1, 2), (2, 1)] {
        submit(path, "moving.glb", &format!("--parts {parts} --chunk {chunk} -- {flags} -o out.####.exr"));
        let [_, said] = ["check", "run"].map(|what| openjd(&tool, what, path, "moving.farm/template.json"));
        assert!(said.contains("openjd_progress: 100"), "{said}");
        for frame in [2, 4, 6] {
            let out = path.join(format!("out.000{frame}.exr"));
            assert_same_bits(&path.join(format!("whole.000{frame}.exr")), &out);
            fs::remove_file(out).unwrap();
        }
        fs::remove_dir_all(path.join("moving.farm")).unwrap();
    }
}

#[test]
fn a_job_runs_where_its_files_lie_elsewhere() {
    let Some(tool) = tool() else { return };
    let folder = Folder::new().with_scene("there/veach.glb", "veach.glb").with_scene("there/sky.hdr", "field.hdr");
    let (there, here) = (folder.join("there"), folder.join("here"));
    let flags = "--size 40x30 --spp 8 --env sky.hdr -o out.exr --preview out.png";
    submit(&there, "veach.glb", &format!("--parts 2 -- {flags}"));
    fs::rename(&there, &here).unwrap();
    let rules = json!({ "version": "pathmapping-1.0", "path_mapping_rules": [
        { "source_path_format": "POSIX", "source_path": there, "destination_path": here }] });
    let mut run = Command::new(&tool);
    run.arg("run").arg(here.join("veach.farm/template.json")).args(["--path-mapping-rules", &rules.to_string()]);
    succeeds(run);
    assert!(here.join("out.png").exists() && !there.exists());
    expect(&here, &format!("render veach.glb {} -q", flags.replace("out.", "whole.")), 0);
    assert_same_bits(&here.join("whole.exr"), &here.join("out.exr"));
}

#[test]
fn names_are_no_references() {
    let Some(tool) = tool() else { return };
    let folder = folder();
    let flags = "--size 40x20 --spp 2";
    expect(&folder, &format!("render veach.glb {flags} -o whole.exr -q"), 0);
    let inner = folder.join("{{Param.Y}} }} {{");
    fs::create_dir(&inner).unwrap();
    for name in HOSTILE {
        let scene = format!("{name}.glb");
        fs::copy(folder.join("veach.glb"), inner.join(&scene)).unwrap();
        submit(&inner, &scene, &format!("--parts 2 -- {flags}"));
        openjd(&tool, "run", &inner, &format!("{name}.farm/template.json"));
        assert_same_bits(&folder.join("whole.exr"), &inner.join(format!("{name}.exr")));
        assert!(!inner.join("X").exists() && !folder.join("X").exists());
    }
}

#[test]
fn templates_with_any_braces_and_jobs_called_like_merges_pass_the_check() {
    let Some(tool) = tool() else { return };
    let folder = folder();
    for (file, jobs) in
        [("b}", ["a", "merge a"]), ("b}}", ["j}", "}}}}"]), ("}}}", ["merge }", "}"]), ("b{{}", ["merge merge a", "a"])]
    {
        let job = |name: &str| format!("[[job]]\nscene = 'veach.glb'\nname = '{name}'\n");
        fs::write(folder.join(format!("{file}.toml")), jobs.map(job).concat()).unwrap();
        submit(&folder, &format!("{file}.toml"), "--parts 2");
        openjd(&tool, "check", &folder, &format!("{file}.farm/template.json"));
    }
}
