//! What other programs make of our pictures: OpenImageIO and Blender open every kind of file, and see what we mean.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::Duration;

use crate::helpers::pictures::{python, run};
use crate::helpers::program::{self, bismar, bits, expect, scene};

/// A folder with `cornell.glb`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(scene("cornell.glb"), folder.path().join("cornell.glb")).unwrap();
    fs::copy(scene("field.hdr"), folder.path().join("field.hdr")).unwrap();
    folder
}

/// `out.exr`, saved by a render that was then interrupted.
fn interrupted(folder: &Path, line: &str) {
    let mut child = bismar(folder).args(line.split(' ')).stderr(Stdio::null()).spawn().unwrap();
    while !folder.join("out.exr").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        thread::sleep(Duration::from_millis(10));
    }
    program::signal(&child, "-TERM");
    assert_eq!(child.wait().unwrap().code(), Some(75));
}

#[test]
fn every_kind_of_file_opens_in_openimageio_and_blender_without_a_word() {
    let Some(python) = python() else { return };
    let folder = folder();
    let line = "render cornell.glb --size 80x60 -q --spp 4 --threads 1";
    interrupted(folder.path(), "render cornell.glb --size 80x60 --spp 100000 --checkpoint 0.05 -q -o out.exr");
    fs::rename(folder.path().join("out.exr"), folder.path().join("interrupted.exr")).unwrap();
    for (flags, name) in [
        ("", "finished"),
        ("--aov all --checkpoint 9", "all"),
        ("--aov all --half --env field.hdr", "half"),
        ("--env field.hdr --transparent", "transparent"),
        ("--part 1/2", "part1"),
        ("--part 2/2", "part2"),
        ("--crop 13,9,50,33 --checkpoint 9", "crop"),
    ] {
        expect(folder.path(), &format!("{line} {flags} -o {name}.exr"), 0);
    }
    expect(folder.path(), "merge part1.exr part2.exr -o merged.exr -q", 0);
    let names = ["finished", "interrupted", "part1", "merged", "crop", "all", "half", "transparent"];
    let files: Vec<_> = names.iter().map(|name| format!("{name}.exr")).collect();
    let seen = run(&python, "look.py", folder.path(), &files.iter().map(String::as_str).collect::<Vec<_>>());
    for file in &files {
        let of = &seen[file];
        assert_eq!((&of["said"], &of["parts"]), (&"".into(), &1.into()), "{file}: {of}");
        let Some(blender) = of["blender"].as_object() else {
            println!("skipped: no Blender (bpy wants Python 3.11)");
            continue;
        };
        assert_eq!(blender["ended"], 0, "{file}: {of}");
        assert!(blender.get("difference").is_none_or(|d| *d == 0.0), "{file}: {of}");
    }
    assert_eq!(seen["half.exr"]["channels"]["R"], "half");
    assert_eq!(seen["half.exr"]["channels"]["depth.Z"], "float");
    let [all, half] = ["all.exr", "half.exr"].map(|name| fs::metadata(folder.path().join(name)).unwrap().len());
    assert!(2 * half < all, "{half} for {all} bytes");
}

#[test]
fn alpha_is_1_where_the_sky_is_shown_and_coverage_where_it_is_left_out() {
    let folder = folder();
    let line = "render cornell.glb --size 40x30 --spp 8 -q --env field.hdr";
    expect(folder.path(), &format!("{line} -o sky.exr"), 0);
    expect(folder.path(), &format!("{line} -o open.exr --transparent --preview open.png"), 0);
    expect(folder.path(), "render cornell.glb --size 40x30 --spp 8 -q --no-env -o none.exr", 0);
    let channel = |file: &str, name: &str| -> Vec<f32> {
        let all = bits(&folder.path().join(file));
        all.into_iter().find(|(n, _)| n == name).unwrap().1.into_iter().map(f32::from_bits).collect()
    };
    let (sky, open, none) = (channel("sky.exr", "A"), channel("open.exr", "A"), channel("none.exr", "A"));
    assert!(sky.iter().all(|a| *a == 1.0));
    assert!(open == none && open.contains(&0.0) && open.contains(&1.0), "{open:?}");
    // Where nothing is, nothing is shown; where everything is, it is lit all the same.
    let (shown, left) = (channel("sky.exr", "G"), channel("open.exr", "G"));
    for ((a, b), alpha) in shown.iter().zip(&left).zip(&open) {
        match alpha {
            0.0 => assert!(*b == 0.0 && *a > 0.0),
            1.0 => assert_eq!(a, b),
            _ => assert!(b <= a, "{b} {a}"),
        }
    }
    let png = image::open(folder.path().join("open.png")).unwrap();
    assert_eq!(png.color(), image::ColorType::Rgba8);
    let opaque: Vec<_> = png.into_rgba8().pixels().map(|p| f32::from(p.0[3]) / 255.0).collect();
    assert!(opaque.iter().zip(&open).all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6));
}

#[test]
fn where_nothing_is_depth_is_finite() {
    let folder = folder();
    expect(folder.path(), "render cornell.glb --size 40x30 --spp 2 -q --aov depth -o a.exr", 0);
    let all = bits(&folder.path().join("a.exr"));
    let depth = &all.iter().find(|(n, _)| n == "depth.Z").unwrap().1;
    let depth: Vec<_> = depth.iter().map(|b| f32::from_bits(*b)).collect();
    assert!(depth.contains(&1e10) && depth.iter().all(|d| *d > 0.0 && *d <= 1e10));
}
