//! A file that somebody else may have made is data: it starts no program, names no output, and leads nowhere outside.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::helpers::glb;
use crate::helpers::program::{Folder, bismar, expect, names, run, says, seal, stderr, stdout};

/// A folder with a scene of a triangle.
fn folder() -> Folder {
    Folder::new().with("s.glb", glb::triangle())
}

/// A pipe, which waits for whoever reads or writes it.
fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// A golden picture whose header has `command` in place of its own.
fn golden(folder: &Path, command: &str) {
    // A name so long that its header has room for all commands that are put in its place.
    let scene = format!("{}.glb", "s".repeat(104));
    fs::write(folder.join(&scene), glb::triangle()).unwrap();
    let flags = "--size 12x9 --spp 2 --no-env --balance half --max-depth 3 --seed 7 --filter box --aov none";
    expect(folder, &format!("render {scene} -o golden.exr {flags}"), 0);
    let path = folder.join("golden.exr");
    let mut bytes = fs::read(&path).unwrap();
    let name = bytes.windows(15).position(|part| part == b"bismar.command\0").unwrap();
    let at = name + bytes[name..].iter().position(|b| *b == b'{').unwrap();
    let end = at + bytes[at..].iter().position(|b| *b == 0 || *b > 127).unwrap();
    let length = bytes[at..end].iter().rposition(|b| *b == b'}').unwrap() + 1;
    assert!(command.len() <= length, "{length}");
    bytes[at..at + length].fill(b' ');
    bytes[at..at + command.len()].copy_from_slice(command.as_bytes());
    seal(&mut bytes);
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_header_runs_nothing_writes_nothing_and_reads_nothing_outside() {
    let path = &folder().with("run.sh", "#!/bin/sh\ntouch \"$(dirname \"$0\")/ran\"\n");
    assert!(Command::new("chmod").arg("+x").arg(path.join("run.sh")).status().unwrap().success());
    let sizes = r#""size":"12x9","spp":2,"no-env":true,"balance":"half","max-depth":3,"seed":7,"filter":"box""#;
    for flag in [r#""on-checkpoint":"./run.sh","checkpoint":1e-9"#, r#""stats":"s""#, r#""threads":9999"#] {
        golden(path, &format!(r#"{{"scene":"s.glb",{flag},{sizes}}}"#));
        fs::write(path.join("s"), "mine").unwrap();
        expect(path, "check golden.exr", 0);
        assert!(!path.join("ran").exists() && fs::read(path.join("s")).unwrap() == b"mine", "{flag}");
    }
    golden(path, r#"{"scene":"s.glb","no-such-flag":1}"#);
    assert!(expect(path, "check golden.exr", 65).contains("no-such-flag"));
    // Paths and links that lead out of the folder.
    let other = folder();
    symlink(&other, path.join("out")).unwrap();
    for scene in [other.join("s.glb").to_str().unwrap(), "../s.glb", "out/s.glb"] {
        golden(path, &format!(r#"{{"scene":"{scene}","size":"12x9","spp":2}}"#));
        let said = expect(path, "check golden.exr", 65);
        assert!(said.contains("not below a folder") || said.contains("by a link"), "{said}");
    }
    // Values out of range, as on the command line.
    for value in [r#""light-radius":-1"#, r#""max-depth":0"#, r#""motion-steps":9999"#, r#""spp":"many""#] {
        golden(path, &format!(r#"{{"scene":"s.glb",{value}}}"#));
        says(path, "check golden.exr", 65, "its ");
    }
    // The fields decide the cost, and not what the rest of the header says.
    for fields in
        [r#""size":"12x9""#, r#""size":"900x900","spp":1"#, r#""spp":99999"#, r#""noise":1e-6"#, r#""time":1e9"#]
    {
        golden(path, &format!(r#"{{"scene":"s.glb",{fields}}}"#));
        let said = expect(path, "check golden.exr --max-paths 99", 65);
        assert!(said.contains("--max-paths") || said.contains("--time"), "{fields}: {said}");
    }
    // The folder of the results may come with the pictures.
    golden(path, r#"{"scene":"s.glb","size":"12x9","spp":2}"#);
    fs::remove_dir_all(path.join("bismar-check")).unwrap();
    symlink(&other, path.join("bismar-check")).unwrap();
    assert!(expect(path, "check golden.exr", 73).contains("link"));
    assert_eq!(names(&other), ["s.glb"]);
}

#[test]
fn outputs_that_a_file_names_stay_in_its_folder_and_replace_nothing_of_others() {
    let (path, other) = (&folder().with("notes.txt", "mine"), Folder::new().with("theirs", "theirs"));
    fs::create_dir(path.join("linked")).unwrap();
    symlink(&other, path.join("away")).unwrap();
    symlink(other.join("theirs"), path.join("linked/stats.json")).unwrap();
    let root = other.display();
    let job = "[[job]]\nname = 'a'\nscene = 's.glb'\nsize = '8x8'\nspp = 1\n";
    for (line, why) in [
        (format!("stats = '{root}/stats.json'"), "outside"),
        ("stats = '../../up.json'".into(), "outside"),
        ("stats = 'notes.txt'".into(), "has not written"),
        ("stats = 'linked/stats.json'".into(), "link"),
        ("output = 'away/new/p.exr'".into(), "outside"),
    ] {
        let output = if line.starts_with("output") { String::new() } else { "output = 'p.exr'\n".into() };
        fs::write(path.join("jobs.toml"), format!("{job}{output}{line}\n")).unwrap();
        let _ = fs::remove_file(path.join("p.exr"));
        says(path, "batch jobs.toml", 73, why);
        if why != "has not written" {
            let said = expect(path, "farm submit jobs.toml --format plan", 73);
            assert!(said.contains(why) && !path.join("jobs.farm").exists(), "{line}: {said}");
        }
    }
    assert_eq!((fs::read(path.join("notes.txt")).unwrap(), names(&other)), (b"mine".to_vec(), vec!["theirs".into()]));
    assert_eq!(fs::read(other.join("theirs")).unwrap(), b"theirs");
    // The command line names another folder, and what bismar has written is replaced.
    fs::write(path.join("jobs.toml"), format!("{job}output = '{root}/p.exr'\n")).unwrap();
    expect(path, &format!("batch jobs.toml --root {root}"), 0);
    fs::write(path.join("s.glb"), [glb::triangle(), vec![]].concat()).unwrap();
    expect(path, &format!("batch jobs.toml --root {root}"), 0);
    expect(path, &format!("farm submit jobs.toml --root {root} --format plan"), 0);
    // A plan may be of others, too.
    let picture = other.join("p.exr");
    let task = |code| expect(path, "farm task 1 --plan jobs.farm/farm.json", code);
    fs::write(&picture, "mine").unwrap();
    task(73);
    assert_eq!(fs::read(&picture).unwrap(), b"mine");
    fs::remove_file(&picture).unwrap();
    symlink(other.join("new"), &picture).unwrap();
    task(73);
    assert!(!other.join("new").exists());
    fs::remove_file(&picture).unwrap();
    task(0);
}

#[test]
fn what_a_command_derives_is_not_written_through_links_or_over_files_of_others() {
    let path = &folder();
    expect(path, "render s.glb -o p.exr --size 8x8 --spp 4 --aov object", 0);
    fs::write(path.join("mine"), "mine").unwrap();
    symlink("mine", path.join("p.object.png")).unwrap();
    assert!(expect(path, "labels p.exr --ids", 73).contains("link"));
    fs::remove_file(path.join("p.object.png")).unwrap();
    for _ in 0..2 {
        expect(path, "labels p.exr --ids", 0);
        expect(path, "develop p.exr", 0);
    }
    fs::write(path.join("transforms.json"), r#"{"frames": [], "mine": true}"#).unwrap();
    let turn = "render s.glb --turntable 2 --size 8x8 --spp 1 -o v.#.exr";
    assert!(expect(path, turn, 73).contains("has not written"));
    fs::remove_file(path.join("transforms.json")).unwrap();
    expect(path, turn, 0);
    expect(path, turn, 0);
    // A view that waits for a reader is no picture.
    fs::remove_file(path.join("v.1.exr")).unwrap();
    pipe(&path.join("v.1.exr"));
    assert!(expect(path, turn, 73).contains("link or a device"));
    // `-o` on the command line is the user's own word.
    fs::write(path.join("named.exr"), "mine").unwrap();
    symlink("mine", path.join("named.png")).unwrap();
    expect(path, "render s.glb --size 8x8 --spp 1 -o named.exr --preview named.png", 0);
    assert!(fs::symlink_metadata(path.join("named.png")).unwrap().is_symlink());
    // A folder of results that is a link.
    let other = Folder::new();
    expect(path, "render s.glb --size 8x8 --spp 1 -o golden.exr", 0);
    fs::create_dir(path.join("bismar-check")).unwrap();
    symlink(&other, path.join("bismar-check/new")).unwrap();
    expect(path, "check golden.exr", 73);
    assert!(names(&other).is_empty());
}

#[test]
fn what_bismar_has_not_written_or_others_have_changed_is_replaced_only_by_name() {
    let path = &folder();
    let batch = |line: &str, code| {
        let job = "[[job]]\nscene = 's.glb'\nsize = '8x8'\nspp = 1\naov = 'object,depth'\noutput = 'p.exr'\n";
        fs::write(path.join("jobs.toml"), format!("{job}{line}\n")).unwrap();
        expect(path, "batch jobs.toml", code)
    };
    let turn = |_: &str, code| expect(path, "render s.glb --turntable 2 --size 8x8 --spp 1 -o v.#.exr", code);
    let labels = |_: &str, code| expect(path, "labels p.exr --ids --depth npy", code);
    let check = |_: &str, code| expect(path, "check p.exr", code);
    let by_default = |_: &str, code| expect(path, "render s.glb --size 8x8 --spp 1", code);
    let picture = |format| {
        let mut file = std::io::Cursor::new(Vec::new());
        image::RgbImage::new(8, 8).write_to(&mut file, format).unwrap();
        file.into_inner()
    };
    let [png, jpg, webp] = [image::ImageFormat::Png, image::ImageFormat::Jpeg, image::ImageFormat::WebP].map(picture);
    let json = br#"{"schema": 3, "bismar.mark": "0", "generator": "bismar", "frames": []}"#.to_vec();
    type Run<'a> = &'a dyn Fn(&str, i32) -> String;
    for part in 1..=2 {
        let line = format!("render s.glb --turntable 2 --size 32x8 --spp 1 --part {part}/2 -o half{part}.#.exr");
        expect(path, &line, 0);
    }
    let merged = |_: &str, code| expect(path, "merge half1.#.exr half2.#.exr --frames 0-1 -o m.#.exr", code);
    let part = |_: &str, code| {
        let mut task = bismar(path);
        task.args("render s.glb --size 32x8 --spp 1 --part auto/2 -o q.#.exr".split(' '));
        let output = task.env("AWS_BATCH_JOB_ARRAY_INDEX", "0").output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        stderr(&output)
    };
    let runs: [(Run, _, _, _); 12] = [
        (&merged, "", "m.1.exr", vec![]),
        (&part, "", "q.1.exr", vec![]),
        (&batch, "", "p.exr", b"v/1\x01 bismar".to_vec()),
        (&batch, "preview = 'p.png'", "p.png", png),
        (&batch, "preview = 'p.jpg'", "p.jpg", jpg),
        (&batch, "preview = 'p.webp'", "p.webp", webp),
        (&batch, "stats = 'p.json'", "p.json", json.clone()),
        (&batch, "", "jobs-report.json", json.clone()),
        (&by_default, "", "s.exr", vec![]),
        (&turn, "", "transforms.json", json),
        (&labels, "", "p.depth.npy", b"\x93NUMPY\x01\x00\x10\x00{'descr':'<f4'}\n".to_vec()),
        (&check, "", "bismar-check/index.html", b"<!-- bismar -->".to_vec()),
    ];
    for (run, line, name, of_others) in runs {
        // It is made, and made again over itself.
        (0..2).for_each(|_| drop(run(line, 0)));
        let file = path.join(name);
        let own = fs::read(&file).unwrap();
        let last = own.len() - 1;
        let changed = [&own[..last], &[own[last] ^ 1]].concat();
        for bytes in [of_others, changed, [&own[..], b"\n"].concat(), vec![]] {
            fs::write(&file, &bytes).unwrap();
            let said = run(line, 73);
            assert!(said.contains("has not written"), "{name}: {said}");
            assert!(fs::read(&file).unwrap() == bytes, "{name}");
        }
        fs::write(&file, own).unwrap();
        run(line, 0);
    }
    // Arrays and ids of another size over their own files.
    expect(path, "render s.glb --size 9x9 --spp 1 --aov object,depth -o p.exr", 0);
    labels("", 0);
    ["s.exr", "p.webp"].iter().for_each(|name| fs::write(path.join(name), "mine").unwrap());
    expect(path, "render s.glb --size 8x8 --spp 1 -o s.exr --preview p.webp", 0);
}

#[test]
fn names_that_wait_for_a_render_do_not_stop_it() {
    let path = &folder();
    for name in [".q.exr.lock.tmp", ".q.exr.AbCdEf.tmp"] {
        pipe(&path.join(name));
    }
    expect(path, "render s.glb --size 8x8 --spp 1 -o q.exr", 0);
    // As links they lead nowhere.
    symlink("made", path.join(".r.exr.lock.tmp")).unwrap();
    expect(path, "render s.glb --size 8x8 --spp 1 -o r.exr", 0);
    assert!(!path.join("made").exists());
    // Somebody who may read an output locks it.
    let held = File::open(path.join("r.exr")).unwrap();
    held.try_lock_shared().unwrap();
    expect(path, "render s.glb --size 8x8 --spp 2 -o r.exr", 0);
}

#[test]
fn the_plan_of_another_farm_is_not_replaced() {
    let path = &folder().with_scene("c.glb", "cornell.glb");
    let submit =
        |scene: &str| format!("farm submit {scene} --parts 2 --format plan --folder farm -- --size 40x8 --spp 1");
    expect(path, &submit("s.glb"), 0);
    expect(path, &submit("s.glb"), 0);
    // The folder that nobody has named may come with the scene.
    symlink("farm", path.join("s.farm")).unwrap();
    assert!(expect(path, "farm submit s.glb --parts 2 --format plan -- --size 40x8", 73).contains("--folder"));
    let before = fs::read(path.join("farm/farm.json")).unwrap();
    assert!(expect(path, &submit("c.glb"), 73).contains("--folder"));
    assert_eq!(fs::read(path.join("farm/farm.json")).unwrap(), before);
}

#[test]
fn what_lies_in_the_folder_of_a_farm_leads_nowhere_and_does_not_wait() {
    let path = &folder().with("mine", "mine");
    let submit =
        |format: &str| format!("farm submit s.glb --parts 2 --format {format} --folder farm -- --size 40x40 --spp 1");
    let task = "farm task 1 --plan farm/farm.json";
    ["plan", "openjd", "plan", "openjd"].iter().for_each(|format| drop(expect(path, &submit(format), 0)));
    fs::create_dir(path.join("away")).unwrap();
    for (name, lines) in [
        ("farm.json", vec![submit("plan"), submit("openjd")]),
        ("template.json", vec![submit("openjd")]),
        ("logs/task-1.json", vec![task.into()]),
        ("logs/task-1.log", vec![task.into()]),
        ("logs", vec![task.into(), submit("plan")]),
        ("parts", vec![task.into(), submit("plan")]),
        ("slurm.json", vec![]),
    ] {
        let place = path.join("farm").join(name);
        let (to, missing) = if name.contains('/') { ("../../mine", "../../made") } else { ("../mine", "../made") };
        for to in [to, missing, "../away", "pipe"] {
            let _ = fs::remove_dir_all(path.join("farm"));
            expect(path, &submit("plan"), 0);
            let _ = fs::remove_file(&place).or_else(|_| fs::remove_dir_all(&place));
            match (to, name) {
                ("../away", "logs" | "parts") => symlink(to, &place).unwrap(),
                (_, "logs" | "parts") => continue,
                ("pipe", _) => pipe(&place),
                _ => symlink(to, &place).unwrap(),
            }
            lines.iter().for_each(|line| drop(expect(path, line, 73)));
            let status = run(path, "farm status farm");
            assert!(matches!(status.status.code(), Some(0 | 65 | 66 | 74)), "{name}: {}", stderr(&status));
            assert_eq!(fs::read(path.join("mine")).unwrap(), b"mine");
            assert!(!path.join("made").exists() && names(&path.join("away")).is_empty(), "{name} {to}");
        }
    }
    // A report of a batch neither.
    fs::write(path.join("jobs.toml"), "[[job]]\nscene = 's.glb'\nsize = '8x8'\nspp = 1\n").unwrap();
    pipe(&path.join("jobs-report.json"));
    expect(path, "batch jobs.toml", 73);
}

#[test]
fn the_pictures_of_a_folder_are_inputs_too() {
    let path = &folder();
    for name in ["a", "b"] {
        fs::create_dir(path.join(name)).unwrap();
        expect(path, &format!("render s.glb -o {name}/p.exr --size 8x8 --spp 1 --aov object"), 0);
    }
    symlink("a/p.exr", path.join("t.csv")).unwrap();
    let before = fs::read(path.join("a/p.exr")).unwrap();
    for line in ["labels a -o a/p.exr", "compare a b --csv t.csv"] {
        assert!(expect(path, line, 64).contains("would overwrite"), "{line}");
    }
    // The new picture of the first would take the place of the second.
    expect(path, "check a/p.exr --out c --max-flip 0", 0);
    fs::copy(path.join("a/p.exr"), path.join("c/new/0001-p.exr")).unwrap();
    assert!(expect(path, "check a/p.exr c/new/0001-p.exr --out c", 64).contains("would overwrite"));
    assert_eq!(fs::read(path.join("c/new/0001-p.exr")).unwrap(), before);
    assert_eq!(fs::read(path.join("a/p.exr")).unwrap(), before);
}

#[test]
fn a_folder_that_is_gone_and_paths_that_cannot_be_are_messages() {
    let path = &folder();
    let away = path.join("away");
    for line in [
        "render ../s.glb --size 8x8 --spp 1",
        "render ../s.glb --size 8x8 --spp 1 -o p.exr",
        "look ../s.glb",
        "labels p.exr --ids",
        "compare a.exr b.exr",
        "merge a.exr b.exr -o c.exr",
        "batch jobs.toml",
        "check .",
    ] {
        fs::create_dir(&away).unwrap();
        // The shell is in a folder that it removes.
        let program = env!("CARGO_BIN_EXE_bismar");
        let script = format!("cd away && rmdir ../away && exec {program} {line}");
        let output = Command::new("sh").args(["-c", &script]).current_dir(path).output().unwrap();
        let said = stderr(&output);
        assert!(matches!(output.status.code(), Some(66 | 73)) && said.starts_with("error: "), "{line}: {said}");
    }
    symlink("m2/a/".to_owned() + &"a/".repeat(2000), path.join("m1")).unwrap();
    symlink("m1/a/".to_owned() + &"a/".repeat(2000), path.join("m2")).unwrap();
    for name in ["a/".repeat(60_000) + "p.exr", "m1/p.exr".into()] {
        expect(path, &format!("render s.glb --size 8x8 --spp 1 -o {name}"), 73);
    }
}

#[test]
fn names_turn_no_text_of_a_page() {
    let path = &folder().with_scene("c.glb", "cornell.glb");
    let name = "s\u{202e}bmg\u{2066}.glb";
    fs::rename(path.join("s.glb"), path.join(name)).unwrap();
    let small = "--size 16x16 --spp 1 -q";
    expect(path, &format!("look {name} c.glb {small} --views front --page p.html"), 0);
    expect(path, &format!("render {name} {small} -o {name}.exr"), 0);
    expect(path, &format!("compare {name}.exr {name}.exr --page q.html"), 0);
    expect(path, &format!("check {name}.exr"), 0);
    for page in ["p.html", "q.html", "bismar-check/junit.xml"] {
        let text = fs::read_to_string(path.join(page)).unwrap();
        assert!(text.contains("\\u{202e}bmg") && !text.contains(['\u{202e}', '\u{2066}']), "{page}");
    }
    // Nor lines of a terminal, logs and JSON among them.
    let compared = stdout(path, &format!("compare {name}.exr {name}.exr --json"), 0);
    assert_eq!(serde_json::from_str::<serde_json::Value>(&compared).unwrap()["a"], format!("{name}.exr"));
    for log in ["text", "json"] {
        let said = expect(path, &format!("render {name} --size 16x16 --spp 1 -v --log {log} -o r.exr"), 0);
        assert!(said.contains("202e"), "{said}");
        assert!(![said, compared.clone()].concat().contains(['\u{202e}', '\u{2066}']), "{log}");
    }
}

#[test]
fn a_text_of_a_file_begins_no_line_of_what_is_said() {
    let scene = r#"{"asset": {"version": "2.0"}, "extensionsUsed": ["X\nopenjd_env: A=B"], "extensionsRequired": ["X\nopenjd_env: A=B"]}"#;
    let said = expect(&Folder::new().with("s.gltf", scene), "render s.gltf --progress openjd", 65);
    assert!(said.contains("openjd_env: A=B") && said.lines().all(|line| !line.starts_with("openjd_env")), "{said}");
}
