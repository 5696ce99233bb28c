//! Two writers, other builds, too little memory, finished pictures whose companions are gone: nothing is lost, and whoever
//! asks is informed.

use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use bismar::Error;
use bismar::rays::Backend;
use bismar::render::settings::lens::{Aperture, Focus, LensSettings};
use bismar::render::{Balance, Part, RenderSettings, RunOptions, StopReason, StudyOptions, render, replay, run};

use crate::helpers::gltf_parts::floats;
use crate::helpers::program::{self, Running, assert_same_bits, attribute, expect, names, read_json, says, stderr};
use crate::helpers::skipped::skipped;
use crate::helpers::stage::{Stage, hall};
use crate::import_content::{accessor, with};
use crate::resume::folder;

#[test]
fn the_second_of_two_writers_is_told() {
    let folder = folder();
    let long = "render cornell.glb --size 96x64 --spp 100000 -o out.exr --progress plain";
    for checkpoint in ["", " --checkpoint 0.02"] {
        let line = format!("{long}{checkpoint}");
        let mut first = Running::start(&folder, &line);
        first.until("PROGRESS");
        while !checkpoint.is_empty() && !folder.join("out.exr").exists() {
            first.next_line();
        }
        for second in [
            "render cornell.glb --size 8x8 --spp 1 -o ./out.exr",
            "render cornell.glb --size 8x8 --spp 1 -o out.exr --resume",
            "render cornell.glb --size 8x8 --spp 1 -o other.exr --stats out.exr",
        ] {
            says(&folder, second, 73, "another bismar is writing it");
        }
        let (code, said) = first.end("-TERM");
        assert_eq!(code, Some(75), "{said}");
        expect(&folder, "render cornell.glb --size 8x8 --spp 1 -o out.exr -q", 0);
        assert_eq!(names(&folder), ["cornell.glb", "out.exr"]);
        fs::remove_file(folder.join("out.exr")).unwrap();
    }
}

#[test]
fn merge_knows_what_its_parts_have_learned_and_how_passes_were_cut() {
    const TOLD: &str = "was begun with another goal and took other passes";
    let folder = folder();
    let parts = |flags: &str, goals: &[&str]| {
        for (part, goals) in [(1, goals), (2, &goals[goals.len() - 1..])] {
            let _ = fs::remove_file(folder.join(format!("{part}.exr")));
            for goal in goals {
                let line = format!("render cornell.glb --size 40x30 -q --checkpoint 9 --resume {flags}");
                expect(&folder, &format!("{line} --part {part}/2 --spp {goal} -o {part}.exr"), 0);
            }
        }
        expect(&folder, "merge 1.exr 2.exr -o out.exr", 0)
    };
    // As many passes, but others; and the same passes with another field.
    for (flags, goals) in
        [("", &["64", "256"][..]), ("--guiding on", &["64", "128"]), ("--guiding on", &["128", "256"])]
    {
        let said = parts(flags, goals);
        assert!(said.contains(&format!("1.exr {TOLD}")) && !said.contains("2.exr was"), "{flags} {goals:?}: {said}");
    }
    for (flags, goals) in [("", &["128", "256"][..]), ("--guiding on", &["128"])] {
        let said = parts(flags, goals);
        assert!(!said.contains("another goal") && !said.contains("other passes"), "{flags} {goals:?}: {said}");
        let spp = goals[goals.len() - 1];
        expect(&folder, &format!("render cornell.glb --size 40x30 -q {flags} --spp {spp} -o whole.exr"), 0);
        assert_same_bits(&folder.join("whole.exr"), &folder.join("out.exr"));
    }
}

/// Tiles that fewer paths have cut take other passes from there on.
#[test]
fn a_noise_goal_that_goes_on_with_more_paths_says_that_its_bits_are_others() {
    const TOLD: &str = "was begun with another goal";
    let path = &folder();
    let line = "render cornell.glb --size 40x30 --noise 0.02 --checkpoint 9 --spp";
    for (first, told) in [(100, true), (128, false), (64, true)] {
        let _ = fs::remove_file(path.join("out.exr"));
        expect(path, &format!("{line} {first} -q -o out.exr"), 0);
        let said = expect(path, &format!("{line} 300 --resume -o out.exr"), 0);
        assert_eq!(said.contains(TOLD), told, "{first}: {said}");
        expect(path, &format!("{line} 300 -q -o whole.exr"), 0);
        if !told {
            assert_same_bits(&path.join("whole.exr"), &path.join("out.exr"));
        }
    }
}

#[test]
fn parts_of_a_scene_with_and_without_a_texture_are_of_different_renders() {
    let path = &folder();
    let coordinates = accessor(36, 5126, 3, "VEC2", false);
    let primitive = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}"#;
    let mut parts = with(floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), &coordinates, primitive);
    parts.more = r#","materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
        "images":[{"uri":"a.png"}]"#
        .into();
    fs::write(path.join("a.gltf"), parts.json()).unwrap();
    let part = |part: u32, code: i32| {
        let line = format!("render a.gltf --sky --size 40x30 -q --spp 4 --part {part}/2 --resume -o {part}.exr");
        expect(path, &line, code)
    };
    part(1, 0);
    image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0])).save(path.join("a.png")).unwrap();
    part(2, 0);
    says(path, "merge 1.exr 2.exr -o out.exr", 65, "different scene");
    // Neither is what was rendered without it finished.
    assert!(part(1, 65).contains("holds another render"));
    fs::remove_file(path.join("1.exr")).unwrap();
    part(1, 0);
    expect(path, "merge 1.exr 2.exr -o out.exr -q", 0);
}

#[test]
fn only_copies_of_this_render_are_removed() {
    let path = &folder();
    let line = "render cornell.glb --size 40x30 --spp 4 -q --checkpoint 9 -o";
    // A picture of somebody else's, one that is no picture, a link, and an environment.
    expect(path, &format!("{line} k.checkpoint-0001.exr"), 0);
    fs::write(path.join("k.checkpoint-0002.exr"), "mine").unwrap();
    std::os::unix::fs::symlink("k.checkpoint-0001.exr", path.join("k.checkpoint-0003.exr")).unwrap();
    let mine = || fs::read(path.join("k.checkpoint-0001.exr")).unwrap();
    let before = mine();
    let long = "render cornell.glb --size 96x64 --spp 100000 --checkpoint 0.02 --keep 1 -o k.exr --progress plain \
                --env k.checkpoint-0001.exr";
    let mut first = Running::start(path, long);
    let ours = || -> Vec<String> {
        let others = |name: &String| name.starts_with("k.checkpoint-") && name.as_str() > "k.checkpoint-0003.exr";
        names(path).into_iter().filter(others).collect()
    };
    while !ours().iter().any(|name| name.as_str() > "k.checkpoint-0006.exr") {
        first.next_line();
    }
    assert_eq!(first.end("-TERM").0, Some(75));
    assert_eq!(ours().len(), 1, "{:?}", names(path));
    assert_eq!(fs::read(path.join("k.checkpoint-0002.exr")).unwrap(), b"mine");
    assert!(fs::symlink_metadata(path.join("k.checkpoint-0003.exr")).unwrap().is_symlink());
    assert!(mine() == before);
}

#[test]
fn an_output_that_becomes_a_link_is_replaced() {
    let path = &folder().with("mine", "mine");
    let long = "render cornell.glb --size 96x64 --spp 100000 -o k.exr --preview k.png --progress plain";
    let mut first = Running::start(path, long);
    first.until("PROGRESS");
    for name in ["k.exr", "k.png"] {
        std::os::unix::fs::symlink("mine", path.join(name)).unwrap();
    }
    let (code, said) = first.end("-TERM");
    assert_eq!(code, Some(75), "{said}");
    assert_eq!(fs::read(path.join("mine")).unwrap(), b"mine");
    assert!(["k.exr", "k.png"].iter().all(|name| fs::symlink_metadata(path.join(name)).unwrap().is_file()));
}

#[test]
fn a_signal_is_heard_while_a_pre_pass_learns() {
    let folder = folder();
    for (flags, what) in [("--guiding on", "guiding"), ("--adaptive", "adaptive")] {
        let line = format!("render cornell.glb --size 1500x1500 --spp 65536 {flags} --checkpoint 9 -v -o out.exr");
        let mut render = Running::start(&folder, &line);
        // The last line before the pre-pass.
        render.until("no light is added");
        let (code, said) = render.end("-TERM");
        assert_eq!(code, Some(75), "{what}: {said}");
    }
}

#[test]
fn signals_that_arrive_together_are_one_and_a_later_one_ends_the_program_at_once() {
    let path = &folder();
    for signals in ["-TERM -INT", "-HUP -TERM", "-XCPU -XCPU -XCPU", "-QUIT -INT -TERM", "-USR2", "-ALRM -USR1"] {
        let _ = fs::remove_file(path.join("k.exr"));
        let mut render = Running::start(path, "render cornell.glb --size 96x64 --time 600 -o k.exr --progress plain");
        render.until("PROGRESS");
        let (code, said) = render.end(signals);
        assert_eq!(code, Some(75), "{signals}: {said}");
        assert!(said.contains("k.exr is saved") && path.join("k.exr").exists(), "{signals}: {said}");
    }
    // The picture is saved, and a program of the user's runs on.
    let path = &folder().with("wait.sh", "#!/bin/sh\n: >saved; exec sleep 9\n");
    assert!(Command::new("chmod").arg("+x").arg(path.join("wait.sh")).status().unwrap().success());
    let line = "render cornell.glb --size 96x64 --time 600 -o k.exr --checkpoint 600 --on-checkpoint ./wait.sh";
    let mut render = Running::start(path, &format!("{line} --progress plain"));
    render.until("PROGRESS");
    let status = render.end_by_many("-TERM", || path.join("saved").exists());
    assert_eq!(status.signal(), Some(15), "{status}");
}

/// Turns a word of a picture's header into another of the same length, and seals the file again.
fn forge(path: &Path, from: &str, to: &str) {
    let mut file = fs::read(path).unwrap();
    assert_eq!(from.len(), to.len());
    let found: Vec<_> = (0..file.len() - from.len()).filter(|at| file[*at..].starts_with(from.as_bytes())).collect();
    assert!(!found.is_empty(), "{} says nowhere {from}", path.display());
    found.into_iter().for_each(|at| file[at..at + to.len()].copy_from_slice(to.as_bytes()));
    program::seal(&mut file);
    fs::write(path, file).unwrap();
}

/// A part of kilobytes that claims four billion pixels.
#[test]
fn merge_asks_for_memory_before_it_takes_it() {
    let folder = folder();
    let line = "render cornell.glb --size 65535x65535 --crop 0,0,16,16 --spp 1 --part 1/1 -q -o part.exr";
    expect(&folder, line, 0);
    forge(&folder.join("part.exr"), r#""crop":[0,0,16,16]"#, r#""crop":null       "#);
    assert!(fs::metadata(folder.join("part.exr")).unwrap().len() < 16 << 10);
    says(&folder, "merge part.exr -o out.exr", 76, "merging to out.exr needs about");
    assert!(!folder.join("out.exr").exists());
}

#[test]
fn what_another_build_began_goes_on_with_a_word_about_it() {
    let folder = folder();
    let line = "render cornell.glb --size 40x30 --checkpoint 9 --resume -o out.exr";
    expect(&folder, &format!("{line} --spp 8 -q"), 0);
    let record: serde_json::Value = serde_json::from_str(&attribute(&folder.join("out.exr"), "bismar.record")).unwrap();
    let maker = &record["maker"];
    assert!(maker["compiler"].as_str().unwrap().starts_with("rustc 1."), "{maker}");
    assert!(maker["isa"].as_str().unwrap().starts_with("x86-64"), "{maker}");
    let said = expect(&folder, &format!("{line} --spp 16"), 0);
    assert!(!said.contains("another build"), "{said}");
    forge(&folder.join("out.exr"), "\"compiler\":\"rustc 1.", "\"compiler\":\"rustc 0.");
    says(&folder, &format!("{line} --spp 24"), 0, "another build of bismar, compiler (rustc 0.");
    // It was written by this one in the end.
    let said = expect(&folder, &format!("{line} --spp 32"), 0);
    assert!(!said.contains("another build"), "{said}");
}

#[test]
fn statistics_of_a_finished_picture_are_written_again_without_a_render() {
    let folder = folder();
    let at = |name: &str| folder.join(name);
    for more in ["", " --checkpoint 9"] {
        let line = format!("render cornell.glb --size 40x30 --spp 8 -o out.exr --stats out.json{more}");
        expect(&folder, &format!("{line} -q"), 0);
        let picture = fs::read(at("out.exr")).unwrap();
        let first = read_json(&at("out.json"));
        assert!(first["picture"].as_str().unwrap().starts_with(&format!("{:016}-", picture.len())), "{first}");
        let text = fs::read(at("out.json")).unwrap();
        expect(&folder, &format!("{line} --resume"), 0);
        assert_eq!(fs::read(at("out.json")).unwrap(), text, "what is right is left alone");
        for stale in [None, Some(""), Some("{}"), Some("not json"), Some("{\"picture\":\"another\"}")] {
            match stale {
                None => fs::remove_file(at("out.json")).unwrap(),
                Some(text) => fs::write(at("out.json"), text).unwrap(),
            }
            says(&folder, &format!("{line} --resume"), 0, "finished before");
            let again = read_json(&at("out.json"));
            for field in ["schema", "version", "scene", "settings", "samples", "noise", "rays", "picture", "threads"] {
                assert_eq!(again[field], first[field], "{field}");
            }
        }
        assert_eq!(fs::read(at("out.exr")).unwrap(), picture);
    }
}

/// Renders under a limit that the shell sets; the exit code and what was said.
fn limited(folder: &Path, limit: &str, line: &str) -> (Option<i32>, String) {
    let script = format!("{limit} && exec \"$0\" {line}");
    let mut command = Command::new("sh");
    command.args(["-c", &script]).arg(program::program()).current_dir(folder).env("BISMAR_THREADS", "2");
    let output = command.output().unwrap();
    (output.status.code(), stderr(&output))
}

#[test]
fn too_little_memory_is_76_before_or_while_rendering_or_it_fits() {
    let folder = folder();
    let line = "render cornell.glb --size 700x500 --spp 1 --aov all --checkpoint 0.1 -q -o out.exr";
    let mut codes = Vec::new();
    for rays in ["embree", "obvhs"] {
        for unit in ["d", "v"] {
            for mebibytes in [60, 130, 190, 300, 700] {
                // What libraries and stacks map counts as address space; in less than that nothing can be loaded.
                let mapped = if unit == "v" { 128 } else { 0 };
                let limit = format!("ulimit -{unit} {}", (mapped + mebibytes) << 10);
                let (code, said) = limited(&folder, &limit, &format!("{line} --rays {rays}"));
                assert!(matches!(code, Some(0 | 76)), "{limit} {rays}: {code:?}\n{said}");
                codes.push(code);
            }
        }
    }
    assert!(codes.contains(&Some(0)) && codes.contains(&Some(76)), "{codes:?}");
    let (code, said) = limited(&folder, "ulimit -d 102400", line);
    assert_eq!(code, Some(76), "{said}");
    assert!(said.contains("its limit of data allows"), "{said}");
}

/// Neither is a file that does not fit into memory an error of the disk, nor a thread that is refused a bug.
#[test]
fn memory_that_ends_while_files_are_read_or_threads_begin_is_76() {
    let path = &folder();
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000 +X 8000\n";
    for (name, head) in [("sky.hdr", &head[..]), ("text.gltf", b"{")] {
        // Zeros that take no place on the disk.
        let mut file = fs::File::create(path.join(name)).unwrap();
        file.write_all(head).unwrap();
        file.set_len(400 << 20).unwrap();
    }
    for line in [
        "render cornell.glb --env sky.hdr --size 8x8 --spp 1 -q -o out.exr",
        "render text.gltf --size 8x8 --spp 1 -q -o out.exr",
        "inspect text.gltf",
        "compare sky.hdr sky.hdr",
    ] {
        let (code, said) = limited(path, "ulimit -d 204800", line);
        assert!(code == Some(76) && said.contains("not enough memory"), "{line}: {code:?} {said}");
    }
    fs::write(path.join("jobs.toml"), "[[job]]\nscene = 'cornell.glb'\nenv = 'sky.hdr'\nspp = 1\n").unwrap();
    let (code, said) = limited(path, "ulimit -d 204800", "batch jobs.toml -q");
    assert!(code == Some(76) && said.contains("sky.hdr"), "{code:?} {said}");
    for (mebibytes, threads) in [(700, 400), (1000, 400)] {
        let line = format!("render cornell.glb --size 8x8 --spp 1 --threads {threads} -q -o out.exr");
        let (code, said) = limited(path, &format!("ulimit -v {}", mebibytes << 10), &line);
        // The last of the memory may go to a thread or to an allocation.
        let says = said.contains(&format!("cannot start {threads} threads")) || said.contains("memory allocation");
        assert!(code == Some(76) && says, "{code:?} {said}");
    }
}

#[test]
fn a_cgroup_is_found_and_heeded() {
    let group = Path::new("/sys/fs/cgroup/memory").join(format!("bismar-{}", std::process::id()));
    if fs::create_dir(&group).is_err() {
        skipped("this machine does not allow memory cgroups of version 1");
        return;
    }
    let folder = folder();
    let render = |mebibytes: u64, line: &str| {
        fs::write(group.join("memory.limit_in_bytes"), (mebibytes << 20).to_string()).unwrap();
        limited(&folder, &format!("echo 0 > {}/cgroup.procs", group.display()), line)
    };
    let large = render(400, "render cornell.glb --size 3000x3000 --spp 1 -q -o out.exr");
    let small = render(400, "render cornell.glb --size 100x100 --spp 1 -q -o out.exr");
    fs::remove_dir(&group).unwrap();
    assert_eq!(large.0, Some(76), "{}", large.1);
    assert!(large.1.contains("its cgroup allows 400"), "{}", large.1);
    assert_eq!(small.0, Some(0), "{}", small.1);
}

/// Mebibytes that a render or a merge has said it needs.
pub fn said_to_need(said: &str) -> u64 {
    said.split("needs about ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap()
}

/// Most renders are given what they say they need, and not more.
#[test]
fn what_a_render_says_it_needs_is_enough() {
    let folder = folder();
    for (flags, threads) in [("", 1), ("", 8), ("--rays obvhs", 2), ("--part 1/2 --aov all --checkpoint 9", 2)] {
        let line = format!("render cornell.glb --size 640x480 --spp 1 --threads {threads} {flags} -q -o out.exr");
        let need = said_to_need(&expect(&folder, &format!("{line} --memory-limit 1M"), 76));
        expect(&folder, &format!("{line} --memory-limit {need}M"), 0);
    }
}

#[test]
fn settings_that_cannot_be_rendered_are_refused_with_their_name() {
    let stage = Stage::new(hall(), Backend::Embree);
    let settings =
        || RenderSettings { width: 20, height: 10, spp: Some(1), balance: Balance::Half, ..RenderSettings::even() };
    let lens =
        |aperture, focus, blades| RenderSettings { lens: Some(LensSettings { aperture, focus, blades }), ..settings() };
    let second_order = || RenderSettings { balance: Balance::SecondOrder, ..settings() };
    let (radius, distance) = (Aperture::Radius(0.01), Focus::Distance(1.0));
    let mut refused = vec![
        (RenderSettings { camera: 7, ..settings() }, "camera 7"),
        (RenderSettings { width: 0, ..settings() }, "size"),
        (RenderSettings { height: 0, ..settings() }, "size"),
        (RenderSettings { width: u32::MAX, ..settings() }, "size"),
        (RenderSettings { crop: Some([5, 5, 5, 9]), ..settings() }, "crop"),
        (RenderSettings { crop: Some([5, 5, 9, 4]), ..settings() }, "crop"),
        (RenderSettings { crop: Some([0, 0, 21, 10]), ..settings() }, "crop"),
        (RenderSettings { crop: Some([0, 0, 20, u32::MAX]), ..settings() }, "crop"),
        (RenderSettings { max_depth: 0, ..settings() }, "max_depth"),
        (RenderSettings { spp: Some(0), ..settings() }, "spp"),
        (RenderSettings { noise: Some(0.1), min_spp: Some(0), ..settings() }, "min_spp"),
        (RenderSettings { spp: None, ..second_order() }, "second-order needs spp"),
        (RenderSettings { part: Some(Part { number: 0, of: 2 }), ..settings() }, "part 0/2"),
        (RenderSettings { part: Some(Part { number: 1, of: 0 }), ..settings() }, "part 1/0"),
        (lens(radius, Focus::Distance(f64::NAN), 0), "focus"),
        (lens(radius, distance, 2), "2 blades"),
        (lens(radius, distance, 1_000_000), "blades"),
    ];
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused.extend([
            (RenderSettings { time: Some(value), ..settings() }, "time"),
            (RenderSettings { noise: Some(value), ..settings() }, "noise"),
            (RenderSettings { clamp_direct: Some(value), ..settings() }, "clamp_direct"),
            (RenderSettings { clamp_indirect: Some(value), ..settings() }, "clamp_indirect"),
            (RenderSettings { pilot: Some(value), ..second_order() }, "pilot"),
            (lens(Aperture::Stop(value), distance, 0), "aperture"),
            (lens(Aperture::Radius(value), distance, 0), "aperture"),
        ]);
    }
    let stop = AtomicBool::new(false);
    for (settings, word) in refused {
        let error = render(&stage.scene, &settings, &stop, &|_| ()).unwrap_err();
        assert!(matches!(error, Error::Usage(_)) && error.to_string().contains(word), "{word}: {error}");
        assert!(replay(&stage.scene, &settings, [0, 0], None, &mut |_| ()).is_err(), "{word}");
    }
    assert!(replay(&stage.scene, &settings(), [20, 0], None, &mut |_| ()).is_err());
    let study = StudyOptions { tiles: Some(vec![[2, 0]].into()), ..Default::default() };
    assert!(run(&stage.scene, &settings(), RunOptions { study, ..RunOptions::new(&stop, &|_| ()) }).is_err());
    assert_eq!(render(&stage.scene, &settings(), &stop, &|_| ()).unwrap().stop, StopReason::Samples);
}
