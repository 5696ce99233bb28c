//! `bismar study means` from end to end.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::helpers::glb;

fn means(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("bismar-study"));
    command
        .current_dir(folder)
        .arg("means")
        .args(line.split_whitespace())
        .args(["--progress", "none"])
        .output()
        .unwrap()
}

/// Every technique, balance and stop rule has one mean in forty random scenes, which never change.
#[test]
fn all_ways_to_render_forty_random_scenes_have_one_mean() {
    let folder = tempfile::tempdir().unwrap();
    let output = means(folder.path(), "--scenes 40 --seed 1 --out out");
    let said = String::from_utf8_lossy(&output.stderr);
    let text = fs::read_to_string(folder.path().join("out/results.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    assert!(json["ways"].as_array().unwrap().iter().all(|way| way["wrong"] == false), "{said}");
    assert!(json["rows"].as_array().unwrap().iter().all(|row| row["wrong"] == false), "{said}");
    let controls = json["controls"].as_array().unwrap();
    assert!(controls.iter().all(|control| control["least"].as_u64().unwrap() > 0), "{text}");
    // One scene with rare light can hide lost paths in so few scenes. A per cent of the light is always noticed.
    assert!(controls[0]["caught"].as_u64() >= controls[0]["least"].as_u64(), "{said}");
    let noticed = controls.iter().all(|control| control["caught"].as_u64() >= control["least"].as_u64());
    assert_eq!(output.status.code(), Some(i32::from(!noticed)), "{said}");
    let rows = json["rows"].as_array().unwrap().len();
    assert_eq!(fs::read_to_string(folder.path().join("out/results.csv")).unwrap().lines().count(), 1 + rows);
    assert!(fs::read_to_string(folder.path().join("out/report.html")).unwrap().contains("One mean"));
}

#[test]
fn a_file_is_tested_as_scenes_are_and_wrong_usage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.glb"), glb::triangle()).unwrap();
    let output = means(folder.path(), "scene.glb --replicas 6 --spp 16 --only depth:2");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("half+path-reuse"));
    for (line, words) in [
        ("--only floor:gold", "half-metal"),
        ("--only roof:mirror", "floor"),
        ("--scenes 0", "--scenes"),
        ("--replicas 2", "--replicas"),
    ] {
        let output = means(folder.path(), line);
        assert_eq!(output.status.code(), Some(64), "{line}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(words), "{line}");
    }
    assert_eq!(means(folder.path(), "none.glb").status.code(), Some(66));
}
