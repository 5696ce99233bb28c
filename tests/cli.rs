//! The program as scripts and people call it: exit codes, messages, files.

use std::fs;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::gltf_parts::{Parts, TRIANGLE};
use crate::helpers::program::{
    Folder, Running, assert_same_bits, attribute, bismar, expect, names, program, read_json, run, says, stderr, stdout,
};

/// A folder with a scene in it: one triangle, two cameras `a` and `b`, no light.
fn folder() -> Folder {
    Folder::new().with("scene.glb", glb::triangle())
}

fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap()
}

const SMALL: &str = "render scene.glb --size 32x24 --spp 8 -q";

#[test]
fn wrong_usage_exits_with_64_and_says_what_is_wrong() {
    let folder = folder();
    for (line, words) in [
        ("", "Usage"),
        ("paint scene.glb", "paint"),
        ("render", "SCENE"),
        ("render scene.glb --sunny", "--sunny"),
        ("render scene.glb --size 12", "WIDTHxHEIGHT"),
        ("render scene.glb --spp 0", "spp"),
        ("render scene.glb --spp -1", "-1 is not in 1.."),
        ("render scene.glb --time -1", "not a time above 0"),
        ("render scene.glb --time 10x", "90s, 10m, 1.5h"),
        ("render --tev scene.glb", "--tev alone"),
        ("completions tcsh", "possible values"),
        ("render scene.glb --time nan", "above 0"),
        ("render scene.glb --threads 0", "4096"),
        ("render scene.glb --threads=-1", "4096"),
        ("batch jobs.toml --threads 100000", "4096"),
        ("merge a.exr -o b.exr --wait nan", "invalid value"),
        ("merge a.exr -o b.exr --wait inf", "invalid value"),
        ("render scene.glb --env-rotate 90", "--env"),
        ("render scene.glb --sky --env-strength 1e38", "not a number from 0 to 1e10"),
        ("render scene.glb --sunsky 30", "ELEVATION,AZIMUTH"),
        ("render scene.glb --sunsky 95,0", "from 0 to 90"),
        ("render scene.glb --sunsky 30,0,nan", "from 1 to 10"),
        ("render scene.glb --sunsky 30,0 --sky", "--sky"),
        ("render scene.glb --light-radius nan", "not metres from 0 to 1e9"),
        ("render scene.glb --light-radius 1e30", "not metres from 0 to 1e9"),
        ("render scene.glb --sun-angle 181", "not degrees from 0 to 180"),
        ("render scene.glb --env a.hdr --no-env", "--no-env"),
        ("render scene.glb --sky --no-env", "--no-env"),
        ("render scene.glb --env a.hdr --sky", "--sky"),
        ("render scene.glb --camera top", "or framed, which shows the whole scene"),
        ("render scene.glb --aov fog", "there is no AOV 'fog'; there are albedo, normal, depth"),
        ("render scene.glb --balance second-order", "pilot is a share of all samples"),
        ("render scene.glb --balance second-order --spp 8 --pilot 1", "above 0 and below 1"),
        ("render scene.glb --balance second-order --spp 8 --pilot nan", "above 0 and below 1"),
        ("render scene.glb --pilot 0.25", "--pilot needs --balance second-order"),
        ("render scene.glb -o out.png", "must end in .exr"),
        ("render scene.glb -o a.exr --stats a.exr", "two outputs"),
        ("render scene.glb --crop 0,0,2000,10", "not inside the picture"),
        ("compare a.exr", "B"),
        ("compare a.exr b.exr --diff c.txt", ".png or .exr"),
    ] {
        says(&folder, line, 64, words);
    }
    assert_eq!(names(&folder), ["scene.glb"]);
}

#[test]
fn help_and_version_exit_with_0() {
    let folder = folder();
    for line in ["--help", "--version", "-V", "render --help", "help compare"] {
        expect(&folder, line, 0);
    }
    let version = stdout(&folder, "--version", 0);
    for words in ["bismar 0.", "\ncommit ", "\nEmbree 4.", "\ncompiled for "] {
        assert!(version.contains(words), "{version}");
    }
    assert_eq!(stdout(&folder, "-V", 0).lines().count(), 1);
}

#[test]
fn shells_and_manuals_are_told_every_flag() {
    let folder = folder();
    for shell in ["bash", "zsh", "fish"] {
        let script = stdout(&folder, &format!("completions {shell}"), 0);
        assert!(script.contains("checkpoint") && script.contains("bismar"), "{shell}: {script}");
    }
    let said = expect(&folder, "man pages/man1", 0);
    let pages = names(&folder.join("pages/man1"));
    assert!(said.contains(&format!("wrote {} pages", pages.len())), "{said}");
    for page in ["bismar.1", "bismar-render.1", "bismar-farm-submit.1"] {
        assert!(pages.iter().any(|p| p == page), "{pages:?}");
    }
    let page = fs::read_to_string(folder.join("pages/man1/bismar-render.1")).unwrap();
    assert!(page.contains("checkpoint") && page.contains("bismar render"), "{page}");
}

#[test]
fn what_is_logged_follows_flags_and_rust_log() {
    let folder = folder();
    let said = |flags: &str, filter: &str| {
        let line = format!("render scene.glb --size 8x8 --spp 1 --progress none {flags}");
        stderr(&bismar(&folder).args(line.split_whitespace()).env("RUST_LOG", filter).output().unwrap())
    };
    let count = |flags, filter| said(flags, filter).lines().count();
    let (silent, plain, verbose, very) = (count("-q", ""), count("", ""), count("-v", ""), count("-vv", ""));
    assert!(silent == 0 && plain > 0 && plain < verbose && verbose < very, "{silent} {plain} {verbose} {very}");
    // Whoever asks for more gets times, too.
    assert!(said("-v", "").contains("T") && said("-v", "").contains("Z  INFO"), "{}", said("-v", ""));
    assert!(!said("", "").contains("Z  WARN"), "{}", said("", ""));
    let driver = said("", "bismar::render::driver=debug");
    // What other modules say is left out.
    assert!(driver.contains("DEBUG") && !driver.contains("MiB of memory"), "{driver}");
    assert!(said("-v", "").contains("MiB of memory"));
    assert!(said("", "bismar=loud").contains("RUST_LOG is 'bismar=loud'"), "{}", said("", "bismar=loud"));
    for flags in ["--log json", "--log json -vv"] {
        let text = said(flags, "");
        assert!(text.lines().count() > 1, "{text}");
        for line in text.lines() {
            let line = json(line.as_bytes());
            assert!(["timestamp", "level", "message"].iter().all(|key| line[key].is_string()), "{line}");
        }
    }
    let error = json(expect(&folder, "render absent.glb --log json", 66).trim().as_bytes());
    assert_eq!(error["level"], "ERROR");
}

#[test]
fn a_checkpoint_refreshes_the_preview_too() {
    let folder = folder();
    let line = "render scene.glb --size 64x48 --time 1h --checkpoint 0.05 --preview p.png -v";
    let mut render = Running::start(&folder, line);
    render.until("saved scene.exr");
    render.end("-KILL");
    let png = fs::read(folder.join("p.png")).unwrap();
    assert_eq!((&png[1..4], &png[16..24]), (&b"PNG"[..], &[0, 0, 0, 64, 0, 0, 0, 48][..]));
}

/// Reads a whole packet of tev's protocol: its length in 4 bytes, little-endian, that count too, and the rest.
fn packet(from: &mut impl Read) -> Option<Vec<u8>> {
    let mut length = [0; 4];
    from.read_exact(&mut length).ok()?;
    let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
    from.read_exact(&mut rest).ok().map(|()| rest)
}

#[test]
fn a_viewer_is_shown_the_picture_and_one_that_is_not_there_is_no_failure() {
    let folder = folder();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let viewer = std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        std::iter::from_fn(|| packet(&mut stream)).collect::<Vec<_>>()
    });
    expect(&folder, &format!("{SMALL} --tev :{port}"), 0);
    let packets = viewer.join().unwrap();
    // Create: kind 4, grab focus, name, width, height, channels.
    let create = [&[4, 1][..], b"scene.exr\0", &[32, 0, 0, 0, 24, 0, 0, 0, 3, 0, 0, 0], b"R\0G\0B\0"].concat();
    assert_eq!(packets[0], create);
    // Update: kind 6; at its end the pixels.
    let last = packets.last().unwrap();
    assert_eq!(last[0], 6);
    let pixels =
        last[last.len() - 32 * 24 * 3 * 4..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
    let sum: f32 = pixels.sum();
    assert!(sum > 100.0, "{sum}");
    let line = format!("render scene.glb --size 8x8 --spp 1 --tev :{port}");
    says(&folder, &line, 0, "nobody answers; rendering continues without");
}

#[test]
fn time_that_is_over_too_soon_leaves_no_black_pixel_untold() {
    let folder = folder().with_scene("showpiece.glb", "showpiece.glb");
    // Times from a first pass that cannot be finished to several: whatever there is, black places are reported.
    let (mut reported, mut whole) = (0, 0);
    for milliseconds in [100, 200, 400, 800, 1600, 3200, 6400, 12800, 25600] {
        let output =
            run(&folder, &format!("render showpiece.glb --size 320x180 --time {}", f64::from(milliseconds) / 1e3));
        let text = stderr(&output);
        if output.status.code() == Some(64) {
            assert!(text.contains("before the first path"), "{text}");
            continue;
        }
        let fewest = attribute(&folder.join("showpiece.exr"), "bismar.samples");
        let empty = json(fewest.as_bytes())["pixel_min"] == 0;
        assert_eq!(text.contains("have no paths and are black"), empty, "{text}");
        reported += usize::from(empty);
        whole += usize::from(!empty);
        if whole == 1 {
            break;
        }
    }
    assert!(whole == 1, "{reported} pictures were reported as black in places");
}

#[test]
fn a_scene_or_picture_that_is_not_there_exits_with_66_and_is_named() {
    let folder = folder();
    for line in ["render absent.glb", "inspect absent.glb", "compare absent.glb absent.glb"] {
        says(&folder, line, 66, "absent.glb");
    }
}

#[test]
fn an_unknown_camera_exits_with_64_and_the_cameras_are_listed() {
    let text = expect(&folder(), "render scene.glb --camera top", 64);
    assert!(text.contains("0  a") && text.contains("1  b"), "{text}");
}

#[test]
fn an_output_that_cannot_be_created_exits_with_73_before_the_scene_is_read() {
    let folder = folder();
    for line in [
        "render absent.glb -o absent/out.exr",
        "render absent.glb -o scene.glb/out.exr",
        "render absent.glb --preview absent/out.png",
        "render absent.glb --stats absent/out.json",
    ] {
        says(&folder, line, 73, "cannot create");
    }
}

#[test]
fn a_thread_count_that_is_no_number_exits_with_64_and_names_its_variable() {
    let folder = folder();
    for count in ["many", "0", "2147483648", "-1"] {
        let output = bismar(&folder).args(SMALL.split(' ')).env("BISMAR_THREADS", count).output().unwrap();
        assert_eq!(output.status.code(), Some(64));
        assert!(stderr(&output).contains(&format!("BISMAR_THREADS is '{count}'")), "{}", stderr(&output));
    }
    for (flag, variable, taken) in [
        ("--threads=1", "BISMAR_THREADS", "1 threads (--threads)"),
        ("-v", "BISMAR_THREADS", "3 threads (BISMAR_THREADS)"),
        ("-v", "SLURM_CPUS_PER_TASK", "3 threads (SLURM_CPUS_PER_TASK)"),
    ] {
        let line = "render scene.glb --size 8x8 --spp 1 -v";
        let mut command = bismar(&folder);
        command.env_remove("BISMAR_THREADS").env(variable, "3");
        let output = command.args(line.split(' ')).arg(flag).output().unwrap();
        assert!(stderr(&output).contains(taken), "{}", stderr(&output));
    }
}

#[test]
fn a_render_writes_picture_preview_and_statistics_and_nothing_else() {
    let folder = folder();
    expect(&folder, &format!("{SMALL} --preview p.png --stats s.json --crop 4,5,20,21"), 0);
    assert_eq!(names(&folder), ["p.png", "s.json", "scene.exr", "scene.glb"]);
    let stats = read_json(&folder.join("s.json"));
    // Tiles are traced whole, so the crop's corner at (4, 5) costs the picture's 2 x 2 tiles.
    assert_eq!(stats["samples"]["paths"], 32 * 24 * 8);
    assert_eq!(stats["rays"]["camera"], stats["samples"]["paths"]);
    assert_eq!((&stats["stop"], &stats["scene"]), (&"samples".into(), &"scene.glb".into()));
    let share = stats["ray_query_share"].as_f64().unwrap();
    assert!(share > 0.0 && share <= 1.0, "{share}");
    for phase in ["read", "build", "render", "write", "total"] {
        assert!(stats["seconds"][phase].as_f64().unwrap() > 0.0, "{phase}");
    }
    assert!(stats["peak_memory_bytes"].as_u64().unwrap() > 1 << 20);
    let png = fs::read(folder.join("p.png")).unwrap();
    assert_eq!((&png[1..4], &png[16..24]), (&b"PNG"[..], &[0, 0, 0, 16, 0, 0, 0, 16][..]));
}

#[test]
fn a_scene_without_light_gets_a_studio_and_a_warning() {
    let folder = folder();
    says(&folder, "render scene.glb --size 8x8 --spp 1", 0, "scene.glb has no light: soft studio light is added");
    says(&folder, "render scene.glb --size 8x8 --spp 1 --no-env", 0, "black");
}

#[test]
fn progress_off_a_terminal_is_lines_that_machines_read() {
    let folder = folder();
    let line = "render scene.glb --size 32x24 --spp 8";
    let output = run(&folder, line);
    assert!(!output.stderr.contains(&b'\r') && !output.stderr.contains(&0x1b), "{}", stderr(&output));
    assert!(stderr(&output).lines().any(|l| l == "PROGRESS: 100%"), "{}", stderr(&output));
    assert!(output.stdout.is_empty());

    let lines = stdout(&folder, &format!("{line} --progress json"), 0);
    let lines = lines.lines().map(|l| json(l.as_bytes())).collect::<Vec<_>>();
    assert_eq!(lines.last().unwrap()["fraction"], 1.0);

    assert!(stdout(&folder, &format!("{line} --progress openjd"), 0).ends_with("openjd_progress: 100\n"));
    assert!(!expect(&folder, &format!("{line} -q"), 0).contains("PROGRESS"));
}

#[test]
fn an_interrupted_render_saves_what_there_is_and_exits_with_75() {
    for signal in ["-INT", "-TERM"] {
        let folder = folder();
        let line = "render scene.glb --size 64x48 --time 600 --progress plain --stats s.json";
        let mut render = Running::start(&folder, line);
        render.until("PROGRESS");
        let (code, text) = render.end(signal);
        assert!(code == Some(75) && text.contains("scene.exr is saved"), "{code:?} {text}");
        expect(&folder, "compare scene.exr scene.exr", 0);
        assert_eq!(read_json(&folder.join("s.json"))["stop"], "interrupted");
    }
}

#[test]
fn a_build_that_is_interrupted_touches_no_output_and_exits_with_75() {
    let folder = folder().with("thicket.glb", glb::thicket(1_500_000)).with("thicket.exr", b"the old picture");
    let before = names(&folder);
    let line = "render thicket.glb --size 64x48 --time 600 -v -o thicket.exr";
    let mut render = Running::start(&folder, line);
    render.until("read thicket.glb");
    let (code, text) = render.end("-INT");
    assert!(code == Some(75) && text.contains("interrupted while loading"), "{code:?} {text}");
    assert_eq!(names(&folder), before);
    assert_eq!(fs::read(folder.join("thicket.exr")).unwrap(), b"the old picture");
}

#[test]
fn a_full_disk_or_a_file_beyond_the_largest_size_exits_with_74_and_leaves_the_old_picture() {
    let old = b"the old picture".as_slice();
    let folder = folder().with("scene.exr", old);
    // A limit of a few kilobytes a file ends a write in its middle.
    let script = "ulimit -f 8; exec \"$0\" render scene.glb --size 128x128 --spp 8 -q -o scene.exr";
    let output = Command::new("sh").args(["-c", script]).arg(program()).current_dir(&folder).output().unwrap();
    assert_eq!(output.status.code(), Some(74), "{}", stderr(&output));
    assert!(stderr(&output).contains("scene.exr: cannot write"), "{}", stderr(&output));
    assert_eq!(fs::read(folder.join("scene.exr")).unwrap(), old);
    assert_eq!(names(&folder), ["scene.exr", "scene.glb"]);
}

#[test]
fn a_picture_compared_with_itself_has_no_difference_and_z_0() {
    let folder = folder();
    expect(&folder, SMALL, 0);
    let report = json(stdout(&folder, "compare scene.exr scene.exr --json --max-relmse 0 --max-z 0", 0).as_bytes());
    for number in ["rel_mse", "rmse", "mae"] {
        assert_eq!(report[number], 0.0, "{number}");
    }
    assert_eq!(report["bias"], json!([0.0, 0.0, 0.0]));
    assert_eq!(report["statistics"]["bias_z"], json!([0.0, 0.0, 0.0]));
    assert_eq!(report["within"], true);
}

#[test]
fn pictures_beyond_the_threshold_exit_with_1() {
    let folder = folder();
    expect(&folder, &format!("{SMALL} -o a.exr"), 0);
    expect(&folder, &format!("{SMALL} -o b.exr --no-env"), 0);
    expect(&folder, "compare a.exr b.exr", 0);
    let text = expect(&folder, "compare a.exr b.exr --max-relmse 0.001 --diff d.png", 1);
    assert!(text.contains("relMSE") && text.contains("beyond 0.001"), "{text}");
    assert!(folder.join("d.png").exists());
    expect(&folder, "compare a.exr b.exr --max-z 6", 1);
    expect(&folder, "compare a.exr b.exr --diff d.exr", 0);
    expect(&folder, "compare d.exr b.exr", 0);
}

#[test]
fn pictures_that_cannot_be_compared_exit_with_65() {
    let folder = folder();
    expect(&folder, &format!("{SMALL} -o a.exr --aov none"), 0);
    expect(&folder, &format!("{SMALL} -o b.exr").replace("32x24", "16x24"), 0);
    says(&folder, "compare a.exr b.exr", 65, "windows differ: 32 x 24 from (0, 0) and 16 x 24");
    says(&folder, "compare a.exr a.exr --max-z 3", 65, "need variance");
    says(&folder, "compare scene.glb a.exr", 65, "scene.glb: cannot use this OpenEXR file");
    fs::write(folder.join("cut.exr"), &fs::read(folder.join("a.exr")).unwrap()[..500]).unwrap();
    expect(&folder, "compare cut.exr a.exr", 65);
}

#[test]
fn inspect_says_what_is_there_and_what_is_left_out() {
    let map = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x80\x80\x81\x80\x80\x80\x81";
    let folder = folder().with("a.hdr", map);
    let text = stdout(&folder, "inspect scene.glb", 0);
    for words in ["triangles  1", "1  b  perspective  40.1 degrees high", "soft studio light is added"] {
        assert!(text.contains(words), "'{words}' is not in\n{text}");
    }
    let summary = json(&run(&folder, "inspect scene.glb --json").stdout);
    assert_eq!(summary["counts"]["triangles"], 1);
    // With a map of its own no light is added.
    let lit = json(&run(&folder, "inspect scene.glb --env a.hdr --json").stdout);
    assert_eq!((&summary["default_light"], &lit["default_light"]), (&true.into(), &false.into()));
    assert_eq!((&lit["environment"]["width"], &lit["environment"]["height"]), (&2.into(), &1.into()));
    expect(&folder, "inspect scene.glb --env scene.glb", 65);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let folder = folder();
    expect(&folder, SMALL, 0);
    for line in ["compare scene.exr scene.exr", "compare scene.exr scene.exr --json", "--help", "inspect scene.glb"] {
        let mut child =
            bismar(&folder).args(line.split(' ')).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "bismar {line}: {}", stderr(&output));
        assert!(output.stderr.is_empty(), "bismar {line}: {}", stderr(&output));
    }
}

#[test]
fn a_study_is_handed_to_bismar_study_with_its_whole_line() {
    use std::os::unix::fs::PermissionsExt;
    // On the file system of the program, so that it can be linked there: a copy could be busy when it is run.
    let folder = tempfile::TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let bismar = folder.path().join("bismar");
    fs::hard_link(program(), &bismar).unwrap();
    let run = |line: &str| Command::new(&bismar).args(line.split_whitespace()).output().unwrap();

    let missing = run("study rays --quick");
    assert_eq!(missing.status.code(), Some(76));
    let text = stderr(&missing);
    assert!(text.contains("bismar-study: cannot start") && text.contains("make build"), "{text}");

    let script = folder.path().join("bismar-study");
    fs::write(&script, "#!/bin/sh\necho \"$@\"\nexit 3\n").unwrap();
    fs::set_permissions(&script, fs::Permissions::from_mode(0o755)).unwrap();
    for (line, handed) in [
        ("study rays a.glb --out b -q", "rays a.glb --out b -q"),
        ("-q study balance a.glb", "-q balance a.glb"),
        ("study -vv stability", "-v -v stability"),
        ("study --help", "--help"),
        ("study balance -h", "balance -h"),
        ("study help rays", "help rays"),
        ("help study rays", "help rays"),
        ("study", ""),
    ] {
        let output = run(line);
        assert_eq!(output.status.code(), Some(3), "{line}");
        assert_eq!(String::from_utf8_lossy(&output.stdout).trim_end(), handed, "{line}");
    }
}

#[test]
fn more_lights_than_memory_end_with_76_before_they_are_made() {
    // A thousand emissive triangles in one point of a mesh, placed 200,000 times: 36 KB.
    const PLACES: usize = 200_000;
    let mut data = glb::Data::default();
    data.floats(&TRIANGLE, "VEC3");
    data.accessor(&[0, 1, 2].repeat(1000), 5121, 3000, "SCALAR");
    data.accessors.push(json!({ "componentType": 5126, "count": PLACES, "type": "VEC3" }));
    let scene = data.file(json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 2 } } } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "emissiveFactor": [1, 1, 1] }],
    }));
    let folder = Folder::new().with("scene.glb", scene);
    for limit in ["2G", "20G"] {
        let line = format!("render scene.glb -o a.exr --size 8x8 --memory-limit {limit}");
        says(&folder, &line, 76, "200000000 emissive triangles");
    }
    assert_eq!(names(&folder), ["scene.glb"]);
}

fn colors(picture: &Path) -> Vec<[f32; 3]> {
    bismar::film::Picture::open(picture, None).unwrap().rgb
}

#[test]
fn lights_in_watts_are_683_times_as_dark() {
    let nodes = r#"[{"mesh":0,"children":[1]},
        {"translation":[0.3,0.3,2],"extensions":{"KHR_lights_punctual":{"light":0}}}]"#;
    let more = r#","extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":683}]}}"#;
    let parts = Parts { nodes: nodes.into(), more: more.into(), ..Default::default() };
    let folder = Folder::new().with("scene.gltf", parts.json());
    let mean = |unit: &str| {
        let line = format!("render scene.gltf -o {unit}.exr --size 16x16 --spp 4 --no-env --light-unit {unit}");
        expect(&folder, &line, 0);
        colors(&folder.join(format!("{unit}.exr"))).iter().flatten().map(|x| f64::from(*x)).sum::<f64>()
    };
    let (lumen, watt) = (mean("lumen"), mean("watt"));
    // Sums of products that differ by one factor, each rounded to 24 bits.
    assert!(lumen > 0.0 && (lumen / watt - 683.0).abs() < 683.0 * 1e-5, "{lumen} {watt}");
    // Another picture: not gone on with.
    let line = "render scene.gltf -o lumen.exr --size 16x16 --spp 4 --no-env --light-unit watt --resume";
    says(&folder, line, 65, "scene");
}

#[test]
fn a_white_sky_and_the_framed_view_are_there_for_files_with_lamps_and_cameras() {
    let nodes = r#"[{"mesh":0,"children":[1,2]},{"translation":[0,0,9],"extensions":{"KHR_lights_punctual":{"light":0}}},
        {"camera":0,"translation":[0,0,100],"rotation":[0,1,0,0]}]"#;
    let more = r#","cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":1}}],
        "extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":1}]}}"#;
    let parts = Parts { nodes: nodes.into(), more: more.into(), ..Default::default() };
    let folder = Folder::new().with("scene.gltf", parts.json());
    let render = |file: &str, flags: &str| {
        let said = expect(&folder, &format!("render scene.gltf --size 16x16 --spp 4 -o {file} {flags}"), 0);
        (colors(&folder.join(file)), said)
    };
    // The camera looks away.
    let (away, said) = render("away.exr", "");
    assert!(away.iter().flatten().all(|x| *x == 0.0) && said.contains("--camera framed"), "{said}");
    let (framed, _) = render("framed.exr", "--camera framed");
    let shown = framed.iter().filter(|rgb| rgb[1] > 0.0).count();
    assert!(shown > 20 && shown < 256, "{shown}");
    let (sky, _) = render("sky.exr", "--sky --env-strength 0.5");
    assert!(sky.iter().flatten().all(|x| *x == 0.5));
    // Other pictures: not gone on with.
    let line = "render scene.gltf --size 16x16 --spp 8 -o sky.exr --resume";
    for (flags, words) in [("--sky", "environment"), ("--sky --env-strength 0.5 --camera framed", "camera")] {
        says(&folder, &format!("{line} {flags}"), 65, words);
    }
    // In a batch each job has its own.
    let jobs = "[defaults]\nspp = 4\nsize = '16x16'\nscene = 'scene.gltf'\noutput = '{name}.exr'\n[[job]]\nname = '1'\n\
        [[job]]\nname = '2'\ncamera = 'framed'\n[[job]]\nname = '3'\nsky = true\nenv-strength = 0.5\n";
    fs::write(folder.join("jobs.toml"), jobs).unwrap();
    expect(&folder, "batch jobs.toml", 0);
    for (job, picture) in [away, framed, sky].iter().enumerate() {
        assert!(colors(&folder.join(format!("{}.exr", job + 1))) == *picture, "{job}");
    }
}

#[test]
fn control_characters_are_shown() {
    let folder = Folder::new();
    for command in ["render", "inspect"] {
        let output = bismar(&folder).args([command, "a\u{1b}[2J\u{85}.glb"]).output().unwrap();
        assert_eq!(output.status.code(), Some(66));
        assert!(stderr(&output).contains(r"a\u{1b}[2J\u{85}.glb"), "{}", stderr(&output));
    }
}

#[test]
fn a_glb_comes_from_a_pipe_and_gives_the_same_bits() {
    let folder = folder();
    let piped = |line: &str, bytes: &[u8]| {
        let mut command = bismar(&folder);
        command.args(line.split_whitespace()).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        // A program that refuses the beginning closes the pipe.
        let _ = std::io::Write::write_all(&mut child.stdin.take().unwrap(), bytes);
        let output = child.wait_with_output().unwrap();
        (output.status.code(), stderr(&output))
    };
    let glb = glb::triangle();
    assert_eq!(piped("render - --size 32x24 --spp 8 -q -o pipe.exr", &glb).0, Some(0));
    expect(&folder, &format!("{SMALL} -o file.exr"), 0);
    assert_same_bits(&folder.join("pipe.exr"), &folder.join("file.exr"));
    // Longer than its header says, as a file may be.
    assert_eq!(piped("inspect - --pose 0", &[&glb[..], b"more"].concat()).0, Some(0));
    let mut large = glb.clone();
    large[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    for (line, bytes, code, words) in [
        ("render -", &glb[..glb.len() - 1], 65, "standard input: GLB container"),
        ("render -", b"{}", 65, "a .gltf is read by its name"),
        ("render - --memory-limit 1G", &large, 76, "a GLB of 4096 MiB"),
        ("render - --frames 1-2 -o a.####.exr", &glb, 64, "for one picture"),
    ] {
        let (found, text) = piped(line, bytes);
        assert_eq!(found, Some(code), "{line}: {text}");
        assert!(text.contains(words), "{line}: {text}");
    }
    // No golden picture: nothing says what it was rendered from.
    expect(&folder, "check pipe.exr", 65);
}
