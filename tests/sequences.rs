//! Sequences: each frame is the picture that a command of its own gives, whatever is shared, killed or missing.

use std::collections::HashSet;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::Duration;

use serde_json::Value;

use crate::helpers::farm::{HOSTILE, kill, workers};
use crate::helpers::glb;
use crate::helpers::program::{
    Folder, assert_same_bits, attribute, bismar, bits, expect, names, read_json, says, stderr,
};
use crate::import_reach::chunks;

const FLAGS: &str = "--size 24x18 --spp 4 --fps 10";

fn folder() -> Folder {
    Folder::new().with("moving.glb", glb::moving())
}

/// A placeholder can stand for the number in the scene's own name, or in that of a file that the scene names.
#[test]
fn no_frame_overwrites_what_it_is_made_of() {
    let path = &folder();
    let glb = glb::moving();
    fs::write(path.join("own.0001.glb"), &glb).unwrap();
    let (mut json, binary) = chunks(&glb).unwrap();
    json["buffers"][0]["uri"] = "own.0001.bin".into();
    fs::write(path.join("own.gltf"), json.to_string()).unwrap();
    fs::write(path.join("own.0001.bin"), binary).unwrap();
    for (scene, stats, file) in
        [("own.0001.glb", "own.####.glb", "own.0001.glb"), ("own.gltf", "own.{frame:04}.bin", "own.0001.bin")]
    {
        let before = fs::read(path.join(file)).unwrap();
        says(path, &format!("render {scene} --frames 1 --stats {stats} {FLAGS} -o a.####.exr"), 64, "would overwrite");
        assert!(fs::read(path.join(file)).unwrap() == before);
    }
}

#[test]
fn frames_are_the_pictures_of_single_commands_and_again_only_what_is_missing_is_done() {
    let path = &folder();
    let line = format!("render moving.glb --frames 1-5x2,8 {FLAGS} -o out/a.####.exr --preview out/{{frame:03}}.png");
    expect(path, &line, 0);
    let files = ["003.png", "005.png", "008.png", "a.0001.exr", "a.0003.exr", "a.0005.exr", "a.0008.exr"];
    assert_eq!(names(&path.join("out")), [&["001.png"], &files[..]].concat());
    for frame in [1, 3, 5, 8] {
        expect(path, &format!("render moving.glb --frame {frame} --seed-per-frame {FLAGS} -o single.exr -q"), 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("out/a.000{frame}.exr")));
    }
    let all: HashSet<_> = [1, 3, 5, 8].map(|n| bits(&path.join(format!("out/a.000{n}.exr")))).into();
    assert_eq!(all.len(), 4, "nothing moves");
    let date = |name: String| fs::metadata(path.join("out").join(name)).unwrap().modified().unwrap();
    let dates = || names(&path.join("out")).into_iter().map(date).collect::<Vec<_>>();
    let before = dates();
    says(path, &line, 0, "4 done before");
    assert_eq!(dates(), before);
    fs::remove_file(path.join("out/a.0005.exr")).unwrap();
    says(path, &line, 0, "1 done, 3 done before");
    // One seed for all is another picture, and is asked for by name.
    let fixed = format!("render moving.glb --frames 3,4 --seed-per-frame false {FLAGS} -o fixed.####.exr -q");
    expect(path, &fixed, 0);
    expect(path, &format!("render moving.glb --frame 3 {FLAGS} -o single.exr -q"), 0);
    assert_same_bits(&path.join("single.exr"), &path.join("fixed.0003.exr"));
    assert_ne!(bits(&path.join("fixed.0003.exr")), bits(&path.join("out/a.0003.exr")));
    let request = |name: &str| attribute(&path.join(name), "bismar.request");
    assert_ne!(request("fixed.0003.exr"), request("out/a.0003.exr"));
    // The default name is the scene's.
    expect(path, &format!("render moving.glb --frames 2 {FLAGS} -q"), 0);
    assert!(path.join("moving.0002.exr").exists());
}

#[test]
fn what_has_not_moved_is_shared_and_changes_no_bit() {
    let path = &folder().with_scene("sky.hdr", "field.hdr");
    // After a second all stands still.
    let flags = format!("{FLAGS} --env sky.hdr --aov all --camera a");
    let said = expect(path, &format!("render moving.glb --frames 9-13x2,12 {flags} -o a.##.exr -vv"), 0);
    assert_eq!(said.matches("no geometry has moved").count(), 2, "{said}");
    for frame in [9, 11, 12, 13] {
        expect(path, &format!("render moving.glb --frame {frame} --seed-per-frame {flags} -o single.exr -q"), 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("a.{frame:02}.exr")));
    }
}

#[test]
fn jobs_that_differ_in_their_light_or_view_alone_share_neither() {
    let path = &folder().with_scene("sky.hdr", "field.hdr");
    let jobs = [
        ("plain", ""),
        ("sky", "sky = true"),
        ("clear", "sunsky = '30,120,4'"),
        ("bright", "sky = true\nenv-strength = 2"),
        ("dark", "no-env = true"),
        ("map", "env = 'sky.hdr'"),
        ("turned", "env = 'sky.hdr'\nenv-rotate = 90"),
        ("framed", "camera = 'framed'"),
        ("framed-sky", "camera = 'framed'\nsky = true"),
        ("watt", "light-unit = 'watt'"),
    ];
    // At a moment, where scenes of the same files share their meshes, and at rest.
    let defaults =
        "[defaults]\nscene = 'moving.glb'\nsize = '24x18'\nspp = 4\naov = 'all'\noutput = 'out/{name}.exr'\n";
    for (pose, flags) in [("frame = 12\nfps = 10\n", "--frame 12 --fps 10 "), ("", "")] {
        let listed = jobs.map(|(name, keys)| format!("[[job]]\nname = '{name}'\n{keys}\n")).concat();
        fs::write(path.join("jobs.toml"), format!("{defaults}{pose}{listed}")).unwrap();
        expect(path, "batch jobs.toml -q", 0);
        let mut seen = HashSet::new();
        for (name, keys) in jobs {
            let mut own = String::new();
            for key in keys.lines().filter(|key| !key.is_empty()) {
                let (key, value) = key.split_once(" = ").unwrap();
                let value = if value == "true" { String::new() } else { format!(" {}", value.trim_matches('\'')) };
                own += &format!("--{key}{value} ");
            }
            let line = format!("render moving.glb {flags}{own}--size 24x18 --spp 4 --aov all -o single.exr -q");
            expect(path, &line, 0);
            assert_same_bits(&path.join("single.exr"), &path.join(format!("out/{name}.exr")));
            seen.insert(bits(&path.join("single.exr")));
        }
        // Lights in watts are as in lumens where there are none.
        assert_eq!(seen.len(), jobs.len() - 1);
    }
}

#[test]
fn what_is_no_sequence_is_refused_before_anything_is_written() {
    let path = &folder();
    for (flags, words) in [
        ("--frames 1-1e9", "is not a frame"),
        ("--frames=-5", "is not a frame"),
        ("--frames 1-4 -o out.exr", "####"),
        ("--frames 1-4 -o a#/out.exr", "####"),
        ("--frames 1-4 --preview out.png", "####"),
        ("--frames 1-4 -o out.{frame:4}.exr", "####"),
        ("--frames 1-4 --stats s.json", "####"),
        ("--frames 1-4 -o a.#.exr --preview b.#.gif", ".png"),
        ("--frames 1-4 --frame 2", "cannot be used with"),
        ("--frames 1-4 --pose 2", "cannot be used with"),
        ("--seed-per-frame", "needs a frame"),
        ("--frames 1-4 --balance second-order", "--spp"),
    ] {
        says(path, &format!("render moving.glb {flags}"), 64, words);
    }
    assert_eq!(names(path), ["moving.glb"]);
}

#[test]
fn a_frame_that_fails_stops_no_other() {
    let path = &folder().with("a.0002.exr", "somebody else's");
    fs::create_dir(path.join("a.0003.exr")).unwrap();
    let said = expect(path, &format!("render moving.glb --frames 1-4 {FLAGS} -o a.####.exr"), 73);
    assert!(said.contains("a.0002: ") && said.contains("2 done, 2 failed"), "{said}");
    assert_eq!(fs::read(path.join("a.0002.exr")).unwrap(), b"somebody else's");
    fs::remove_file(path.join("a.0002.exr")).unwrap();
    fs::remove_dir(path.join("a.0003.exr")).unwrap();
    says(path, &format!("render moving.glb --frames 1-4 {FLAGS} -o a.####.exr"), 0, "2 done, 2 done before");
    // Keys that make no sense are each frame's own error.
    let broken = glb::moving();
    fs::write(path.join("broken.glb"), broken.strip_suffix(&[0; 4][..]).unwrap_or(&broken[..broken.len() - 40]))
        .unwrap();
    expect(path, &format!("render broken.glb --frames 1-2 {FLAGS} -o b.####.exr"), 65);
}

#[test]
fn a_batch_combines_frames_with_scenes_cameras_and_settings() {
    let path = &folder();
    fs::copy(path.join("moving.glb"), path.join("other.glb")).unwrap();
    let file = "[defaults]\nsize = '24x18'\nspp = 2\nfps = 10\noutput = 'out/{name}.exr'\n[[matrix]]\n\
                scene = ['moving.glb', 'other.glb']\ncamera = ['a', 'b']\nframes = '2-6x2'\nseed = [0, 7]\n\
                [[job]]\nscene = 'moving.glb'\nname = 'still'\nframe = 4\n";
    fs::write(path.join("jobs.toml"), file).unwrap();
    expect(path, "batch jobs.toml -q --jobs 2", 0);
    assert_eq!(names(&path.join("out")).len(), 25);
    let report = read_json(&path.join("jobs-report.json"));
    assert_eq!((&report["done"], &report["jobs"][5]["job"]), (&25.into(), &"moving-a-7.0006".into()));
    for (name, flags) in [
        ("moving-a-0.0004", "moving.glb --camera a --frame 4 --seed-per-frame"),
        ("other-b-7.0006", "other.glb --camera b --frame 6 --seed-per-frame --seed 7"),
        ("still", "moving.glb --frame 4"),
    ] {
        expect(path, &format!("render {flags} --size 24x18 --spp 2 --fps 10 -o single.exr -q"), 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("out/{name}.exr")));
    }
    expect(path, "batch jobs.toml -q --only *-b-7.*", 0);
    let report = read_json(&path.join("jobs-report.json"));
    assert_eq!(report["before"], 6, "{report}");
}

#[test]
fn names_are_taken_as_they_are() {
    for name in HOSTILE {
        let path = &folder();
        let scene = format!("{name}#.glb");
        fs::rename(path.join("moving.glb"), path.join(&scene)).unwrap();
        let out =
            bismar(path).args(["render", &scene, "--frames", "1-2", "--size", "8x6", "--spp", "1"]).output().unwrap();
        assert!(out.status.success(), "{}", stderr(&out));
        let (one, two) = (format!("{name}#.0001.exr"), format!("{name}#.0002.exr"));
        assert!(path.join(one).exists() && path.join(two).exists(), "{:?}", names(path));
    }
}

/// Paths of `out` that are there, as bits.
fn pictures(out: &Path) -> Vec<Vec<(String, Vec<u32>)>> {
    names(out).iter().filter(|n| n.ends_with(".exr")).map(|n| bits(&out.join(n))).collect()
}

#[test]
fn killed_at_any_moment_a_sequence_ends_with_the_same_bits() {
    let path = &folder();
    let flags = "--frames 0-11 --size 48x36 --spp 64 --fps 10 --checkpoint 0.05";
    expect(path, &format!("render moving.glb {flags} -o whole/a.##.exr -q"), 0);
    let line = format!("render moving.glb {flags} -o out/a.##.exr");
    for round in 0..40_u64 {
        let mut child = bismar(path).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        thread::sleep(Duration::from_millis(20 + 37 * (round % 7)));
        if child.try_wait().unwrap().is_some_and(|status| status.success()) {
            break;
        }
        // The command, or the process that works for it.
        match workers(child.id()).first() {
            Some(&worker) if round % 2 == 0 => kill(worker),
            _ => child.kill().unwrap(),
        }
        child.wait().unwrap();
    }
    expect(path, &line, 0);
    let (whole, out) = (pictures(&path.join("whole")), pictures(&path.join("out")));
    assert_eq!(whole.len(), 12);
    assert!(whole == out, "a frame has other bits");
    let left = names(&path.join("out"));
    assert_eq!(left.len(), 12, "{left:?}");
}

#[test]
fn sequences_are_compared_frame_by_frame() {
    let path = &folder();
    let flags = "--size 24x18 --spp 8 --fps 10 --sky -q";
    expect(path, &format!("render moving.glb --frames 1-5 {flags} --camera b -o a.##.exr"), 0);
    expect(path, &format!("render moving.glb --frames 1-4 {flags} --camera b --seed 7 -o b.{{frame:03}}.exr"), 0);
    expect(path, &format!("render moving.glb --frame 3 {flags} --camera a -o b.003.exr"), 0);
    let compare = |flags: &str| {
        let line = format!("compare a.##.exr b.{{frame:03}}.exr {flags}");
        let output = bismar(path).args(line.trim().split(' ')).output().unwrap();
        (output.status.code().unwrap(), String::from_utf8(output.stdout.clone()).unwrap(), stderr(&output))
    };
    let (code, table, said) = compare("--page page.html --csv rows.csv");
    assert_eq!(code, 0, "{said}");
    assert!(table.contains("4 frames") && table.contains("worst is frame 3"), "{table}");
    assert!(said.contains("only of a.##.exr, not compared: frame 5"), "{said}");
    let page = fs::read_to_string(path.join("page.html")).unwrap();
    assert!(["a.03.exr", "Error over frames: 4 frames"].iter().all(|words| page.contains(words)), "{page}");
    assert!(!page.contains("{{"), "{page}");
    assert_eq!(page.matches("<polyline").count(), 2);
    assert_eq!(fs::read_to_string(path.join("rows.csv")).unwrap().lines().count(), 5);
    let (code, json, _) = compare("--json --max-relmse 1e-9");
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &json["worst_frame"], &json["within"]), (1, &3.into(), &false.into()));
    let frames = json["frames"].as_array().unwrap();
    let errors: Vec<f64> = frames.iter().map(|frame| frame["rel_mse"].as_f64().unwrap()).collect();
    assert_eq!(frames.iter().map(|frame| frame["frame"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2, 3, 4]);
    assert!(errors.iter().all(|e| *e <= errors[2]), "{errors:?}");
    assert!((json["mean_rel_mse"].as_f64().unwrap() - errors.iter().sum::<f64>() / 4.0).abs() < 1e-12);
    assert_eq!(compare("--diff d.png").0, 64);
    expect(path, "compare a.##.exr c.##.exr", 66);
}

#[test]
fn a_contact_sheet_shows_the_frames() {
    let path = &folder();
    expect(path, &format!("render moving.glb --frames 8-10 {FLAGS} -o f.##.exr --preview f.##.png -q"), 0);
    expect(path, "sheet f.##.png -o s.png", 0);
    let sheet = image::open(path.join("s.png")).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (480, 360));
    let before = names(path);
    for (line, code, words) in [
        ("sheet f.##.png --frames 8-12 -o t.png", 66, "f.11.png"),
        ("sheet g.##.png -o t.png", 66, "no such pictures"),
        ("sheet f.08.png -o t.png", 64, "####"),
        ("sheet f.##.png -o f.09.png", 64, "would overwrite"),
    ] {
        let said = expect(path, line, code);
        assert!(said.contains(words), "{line}: {said}");
    }
    assert_eq!(names(path), before);
}
