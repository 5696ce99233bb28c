//! Templates in the Open Job Description format, checked and run by its own command line tool.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;

use crate::helpers::farm::{HOSTILE, absent, folder, status, succeeds};
use crate::helpers::glb;
use crate::helpers::program::{self, assert_same_bits, bismar, expect};

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

#[test]
fn a_template_is_accepted_and_its_run_is_the_single_machines_picture() {
    let Some(tool) = tool() else { return };
    let folder = folder();
    let flags = "--size 96x64 --spp 64 --aov all";
    let mut submit = bismar(&folder);
    submit.args(["farm", "submit", "veach.glb", "--parts", "3", "--format", "openjd", "--"]);
    submit.args(flags.split(' ')).args(["-o", "out.exr"]);
    succeeds(submit);
    let template = folder.join("veach.farm/template.json");
    let of = |what: &str| {
        let mut command = Command::new(&tool);
        command.arg(what).arg(&template).current_dir(&folder);
        command
    };
    succeeds(of("check"));
    let said = succeeds(of("run"));
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
    for (parts, chunk) in [("1", "2"), ("2", "1")] {
        let mut submit = bismar(path);
        submit.args(["farm", "submit", "moving.glb", "--parts", parts, "--chunk", chunk, "--format", "openjd", "--"]);
        submit.args(flags.split(' ')).args(["-o", "out.####.exr"]);
        succeeds(submit);
        let of = |what: &str| {
            let mut command = Command::new(&tool);
            command.arg(what).arg(path.join("moving.farm/template.json")).current_dir(path);
            command
        };
        succeeds(of("check"));
        let said = succeeds(of("run"));
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
    let folder = folder();
    let (there, here) = (folder.join("there"), folder.join("here"));
    fs::create_dir(&there).unwrap();
    fs::copy(folder.join("veach.glb"), there.join("veach.glb")).unwrap();
    fs::copy(program::scene("field.hdr"), there.join("sky.hdr")).unwrap();
    let flags = "--size 40x30 --spp 8 --env sky.hdr -o out.exr --preview out.png";
    let mut submit = bismar(&there);
    submit.args(["farm", "submit", "veach.glb", "--parts", "2", "--format", "openjd", "--"]).args(flags.split(' '));
    succeeds(submit);
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
        let mut submit = bismar(&inner);
        submit.args(["farm", "submit", &scene, "--parts", "2", "--format", "openjd", "--"]).args(flags.split(' '));
        succeeds(submit);
        let mut run = Command::new(&tool);
        run.arg("run").arg(inner.join(format!("{name}.farm/template.json"))).current_dir(&inner);
        succeeds(run);
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
        let mut submit = bismar(&folder);
        submit.args(["farm", "submit", &format!("{file}.toml"), "--parts", "2", "--format", "openjd"]);
        succeeds(submit);
        let mut check = Command::new(&tool);
        check.arg("check").arg(folder.join(format!("{file}.farm/template.json")));
        succeeds(check);
    }
}
