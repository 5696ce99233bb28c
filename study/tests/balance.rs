//! `bismar study balance` from end to end on a small scene, and the two hooks that it renders through.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::rays::Backend;
use bismar::render::{Balance, Integrator, RenderSettings, RunOptions, StudyOptions, run};
use bismar::scene::{Environment, Scene};
use bismar_study::balance::cell::Cell;
use bismar_study::files;
use glam::Vec3;
use serde_json::Value;

use crate::helpers::glb;
use crate::helpers::stage::{Stage, area_light, look, metal, rectangle};
use crate::helpers::statistics::z_limit;

fn study(folder: &Path, more: &str) -> Output {
    let line = "--size 24x16 --spp 4,16 --replicas 8 --reference-spp 256 --balance second-order";
    balance(folder, &format!("{line} {more}"))
}

fn balance(folder: &Path, more: &str) -> Output {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("bismar-study"));
    let line = format!("balance scene.glb --out out --progress none -q {more}");
    command.current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

fn succeeds(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

fn rows(folder: &Path) -> Vec<Value> {
    let text = fs::read_to_string(folder.join("out/results.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["rows"].as_array().unwrap().clone()
}

fn cells(folder: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let scene = fs::read_dir(folder.join("out/cells")).unwrap().next().unwrap().unwrap().path();
    let mut files: Vec<_> = fs::read_dir(scene).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    files.into_iter().map(|f| (f.clone(), fs::read(f).unwrap())).collect()
}

#[test]
fn a_study_measures_once_reports_everything_and_notices_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("scene.glb"), glb::triangle()).unwrap();
    succeeds(&study(folder, "--footprint none"));

    let all = rows(folder);
    let named: Vec<_> = all.iter().map(|r| format!("{} {}", r["estimator"].as_str().unwrap(), r["spp"])).collect();
    let three = ["half", "half-again", "second-order"];
    let expected: Vec<_> = [4, 16].iter().flat_map(|spp| three.map(|name| format!("{name} {spp}"))).collect();
    assert_eq!(named, expected);
    for row in &all {
        let left_out = row["undetermined"].as_u64().unwrap() + row["constant"].as_u64().unwrap();
        assert!(row["pixels"].as_u64().unwrap() + left_out <= 24 * 16);
        assert!(row["rel_mse"].as_f64().unwrap() > 0.0);
        // Eight pictures of three channels.
        assert!(row["bias_z"].as_f64().unwrap().abs() < z_limit(24), "{row}");
    }
    assert_eq!(all[3]["ratio"], 1.0);
    // A header and a line a row.
    assert_eq!(fs::read_to_string(folder.join("out/results.csv")).unwrap().lines().count(), 7);

    let page = fs::read_to_string(folder.join("out/report.html")).unwrap();
    assert!(page.contains("Share of light samples") && page.matches("<svg").count() == 4);
    assert_eq!(fs::read_dir(folder.join("out/charts")).unwrap().count(), 4);

    // Again: nothing is taken, the results are the same to the byte.
    let (before, csv) = (cells(folder), fs::read(folder.join("out/results.csv")).unwrap());
    succeeds(&study(folder, "--footprint 24x16"));
    assert!(cells(folder) == before);
    assert!(fs::read(folder.join("out/results.csv")).unwrap() == csv);

    // A cell of another program (its first picture differs), a lost one, one cut off: those three are taken again, and
    // the pictures are the same.
    let path = |name: &str| before.iter().find(|(f, _)| f.ends_with(name)).unwrap().clone();
    let cell = |file: &Path| files::kept::<Cell>(file).unwrap().unwrap();
    let numbers = |cell: &Cell| cell.values.iter().chain(&cell.shares).map(|x| x.to_bits()).collect::<Vec<_>>();
    let old_numbers = before.iter().map(|(file, _)| numbers(&cell(file))).collect::<Vec<_>>();
    let (other, _) = path("second-order-16.cell");
    let mut changed = cell(&other);
    changed.values[..24 * 16 * 3].fill(1.1e-28);
    changed.write(&other).unwrap();
    let (lost, _) = path("half-again-4.cell");
    fs::remove_file(&lost).unwrap();
    let (cut, bytes) = path("half-16.cell");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    succeeds(&study(folder, "--footprint 24x16"));
    for (file, bytes) in cells(folder) {
        let i = before.iter().position(|(f, _)| *f == file).unwrap();
        let (_, old) = &before[i];
        assert!(numbers(&cell(&file)) == old_numbers[i], "{file:?}");
        let anew = [&other, &lost, &cut].contains(&&file);
        assert_eq!(bytes != *old, anew, "{file:?}");
    }
}

/// The pixels of a study of a mosaic are those of the same tiles in the whole picture, to the bit.
#[test]
fn a_footprint_measures_tiles_of_the_large_picture() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("scene.glb"), glb::triangle()).unwrap();
    let pictures = |more: &str| {
        let line = "--balance progressive --spp 32 --replicas 4 --reference-spp 16";
        succeeds(&balance(folder, &format!("{line} {more}")));
        let cells = fs::read_dir(folder.join("out/cells")).unwrap().map(|e| e.unwrap().path());
        let last = cells.max_by_key(|path| fs::metadata(path).unwrap().modified().unwrap()).unwrap();
        ["half-32.cell", "progressive-32.cell"].map(|name| files::kept::<Cell>(&last.join(name)).unwrap().unwrap())
    };
    // Of 10 x 5 tiles the two at columns 2 and 7, row 2; of the second one half.
    let [tiles, whole] = [pictures("--size 24x16 --footprint 160x90"), pictures("--size 160x90 --footprint none")];
    let json: Value = serde_json::from_str(&fs::read_to_string(folder.join("out/results.json")).unwrap()).unwrap();
    assert!(json["footprint"].is_null());
    for (tiles, whole) in tiles.iter().zip(&whole) {
        assert_eq!((tiles.pixels, whole.pixels), (24 * 16, 160 * 90));
        for (x, y) in (0..24).flat_map(|x| (0..16).map(move |y| (x, y))) {
            let (own, at) = (24 * y + x, 160 * (32 + y) + if x < 16 { 32 + x } else { 112 + x - 16 });
            assert_eq!(tiles.picture(3)[3 * own..][..3], whole.picture(3)[3 * at..][..3]);
            assert_eq!(tiles.shares_of(3)[own], whole.shares_of(3)[at]);
            assert_eq!(tiles.paths_of(3)[own], 32.0);
        }
    }
}

/// Whole pictures: nothing is taken twice, and the ratios are those of the numbers next to them.
#[test]
fn whole_pictures_show_error_against_seconds() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.glb"), glb::triangle()).unwrap();
    let line = "--whole --size 24x16 --spp 4,32 --replicas 4 --reference-spp 256";
    let run = || {
        succeeds(&balance(folder.path(), line));
        (rows(folder.path()), cells(folder.path()))
    };
    let (all, kept) = run();
    let named: Vec<_> = all.iter().map(|r| format!("{} {}", r["estimator"].as_str().unwrap(), r["spp"])).collect();
    let aids = ["", "+guiding", "+adaptive", "+guiding+adaptive"];
    let names = aids.into_iter().flat_map(|aid| ["half", "progressive"].map(|name| format!("{name}{aid}")));
    let names = names.collect::<Vec<_>>();
    let expected = [4, 32].iter().flat_map(|spp| names.iter().map(move |name| format!("{name} {spp}")));
    assert_eq!(named, expected.collect::<Vec<_>>());
    for (i, row) in all.iter().enumerate() {
        let number = |name: &str| row[name].as_f64().unwrap();
        let aid = aids[i % 8 / 2];
        // Paths of two tiles come in doublings of the mean.
        let times = number("paths_mean") / number("spp");
        assert!(times == 1.0 || (aid.contains("adaptive") && (0.5..=2.0).contains(&times)), "{row}");
        let half = all[i / 8 * 8]["rel_mse"].as_f64().unwrap();
        assert!((number("rel_mse_ratio") / (number("rel_mse") / half) - 1.0).abs() < 1e-9, "{row}");
        assert_eq!(number("product_ratio"), number("rel_mse_ratio") * number("time_ratio"));
        assert!(number("bias_z").abs() < z_limit(24), "{row}");
        assert_eq!(row["guided"].is_number(), aid.contains("guiding") && number("spp") > 4.0, "{row}");
        assert_eq!(row["adaptive_left"].is_number(), aid.contains("adaptive") && number("spp") > 4.0, "{row}");
    }
    assert_eq!(all[0]["product_ratio"], 1.0);
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(page.matches("<svg").count() == 3);
    assert_eq!(fs::read_dir(folder.path().join("out/charts")).unwrap().count(), 3);
    let again = run();
    assert!(again.0 == all && again.1 == kept);
}

#[test]
fn wrong_usage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.glb"), glb::triangle()).unwrap();
    for (line, words) in [
        ("--bogus", "--bogus"),
        ("--camera 1", "--camera"),
        ("--footprint 9", "nor none"),
        ("--size 24x16 --footprint 20x20", "--size 24x16"),
        ("--whole --footprint 64x64", "--footprint"),
        ("--balance half,best", "there is no 'best'"),
        ("--balance half+bogus", "there is no"),
    ] {
        let output = balance(folder.path(), line);
        assert_eq!(output.status.code(), Some(64), "{line}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(words), "{line}");
    }
}

/// A glossy floor, an area light and an environment: both techniques matter.
fn stage() -> Stage {
    let mut scene = Scene { environment: Some(Environment::constant([0.4; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, metal(0.4));
    rectangle(&mut scene, 1.0, [-0.4, 0.4], [-0.9, -0.3], false, area_light(6.0));
    look(&mut scene, Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, 0.2, 0.0), 0.5);
    Stage::new(Arc::new(scene), Backend::Embree)
}

fn settings() -> RenderSettings {
    let integrator = Integrator::Direct;
    RenderSettings {
        width: 20,
        height: 18,
        spp: Some(16),
        balance: Balance::Half,
        integrator,
        ..RenderSettings::even()
    }
}

/// Green of each pixel.
fn green(stage: &Stage, settings: &RenderSettings, study: StudyOptions) -> Vec<f64> {
    let stop = AtomicBool::new(false);
    let options = RunOptions { study, ..RunOptions::new(&stop, &|_| ()) };
    let film = run(&stage.scene, settings, options).unwrap().film();
    film.pixels.iter().map(|p| p.sum[1] / f64::from(p.samples)).collect()
}

#[test]
fn a_render_can_stop_before_its_last_pass() {
    let stage = stage();
    let balance = Balance::SecondOrder;
    let pilot = RenderSettings { balance, ..settings() };
    let one_pass = StudyOptions { max_passes: Some(1), ..Default::default() };
    // The pilot of 16 paths is 8 at a half: as 8 paths by half.
    assert_eq!(green(&stage, &pilot, one_pass), stage.green(&RenderSettings { spp: Some(8), ..settings() }));
}
