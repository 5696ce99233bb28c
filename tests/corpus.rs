//! The program renders every scene file of the shared test data, or refuses it with a reason, as the manifest says:
//! in proportion to the file's size, never by a panic, never with half an output.

use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::helpers::program::{Folder, names, try_all};
use crate::helpers::shared;

/// Limits per file: 60 s of processor time, and writable memory (`RLIMIT_DATA`, which counts stacks whole) of
/// 192 MiB for the program and Embree, 16 MiB more for each processor's threads, and 48 times the bytes of the scene
/// with its buffers and pictures: PNG and JPEG decode to about ten times their size, a triangle of 36 bytes gets normals,
/// tangents and a share of the BVH. Five minutes without any processor time are a hang.
fn limits(bytes: u64) -> String {
    let threads = thread::available_parallelism().map_or(1, usize::from) as u64;
    let kibibytes = (192 + 16 * threads) * 1024 + 48 * bytes / 1024;
    format!("ulimit -t 60; ulimit -d {kibibytes}; exec \"$0\" \"$@\"")
}
const HANG: Duration = Duration::from_secs(300);

/// Renders one tiny picture into `folder`; the exit code (a signal's number plus 128) and stderr.
fn render(scene: &Path, bytes: u64, folder: &Path) -> (i32, String) {
    let log = folder.join("log");
    let (output, stats) = (folder.join("out.exr"), folder.join("stats.json"));
    let mut child = Command::new("sh")
        .args(["-c", &limits(bytes)])
        .arg(assert_cmd::cargo::cargo_bin!("bismar"))
        .args(["render", "--size", "16x16", "--spp", "1", "--threads", "1", "-q", "-o"])
        .args([&output, Path::new("--stats"), &stats, scene])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let (mut since, mut before) = (Instant::now(), None);
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        let now = processor_time(child.id());
        if now != before {
            (since, before) = (Instant::now(), now);
        } else if since.elapsed() > HANG {
            child.kill().unwrap();
        }
        thread::sleep(Duration::from_millis(2));
    };
    let text = fs::read_to_string(&log).unwrap();
    fs::remove_file(log).unwrap();
    (status.code().unwrap_or_else(|| 128 + status.signal().unwrap()), text)
}

/// User and system ticks of a process, if it is there.
fn processor_time(id: u32) -> Option<[u64; 2]> {
    let stat = fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // "id (name) state ...", and the name may hold anything; the state is the third field, utime and stime 14 and 15.
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11).map_while(|field| field.parse().ok());
    Some([fields.next()?, fields.next()?])
}

/// Does an error's text start with the file, and then say where in it?
fn names_file_and_place(text: &str, scene: &Path) -> bool {
    let Some(rest) = text.strip_prefix(&format!("error: {}: ", scene.display())) else { return false };
    let json_path = [
        "accessors[",
        "animations[",
        "asset",
        "bufferViews[",
        "buffers[",
        "cameras[",
        "extensions.",
        "extensionsRequired:",
        "images[",
        "materials[",
        "meshes[",
        "nodes[",
        "samplers[",
        "scene:",
        "scenes[",
        "skins[",
        "textures[",
        "the document:",
    ];
    json_path.iter().any(|start| rest.starts_with(start))
        || rest.starts_with("byte ")
        || rest.starts_with("GLB container: byte ")
        || (rest.starts_with("not valid JSON: ") && rest.contains(" at line "))
}

fn judge(scene: &Path, name: &str, verdict: &str, class: &str, bytes: u64) -> Result<&'static str, String> {
    let folder = Folder::new();
    let (code, text) = render(scene, bytes, &folder);
    let files = names(&folder);
    let left = if code == 0 { vec!["out.exr", "stats.json"] } else { vec![] };
    if files != left {
        return Err(format!("exit code {code} leaves {files:?}: {text}"));
    }
    if !matches!(code, 0 | 65 | 66) {
        return Err(format!("exit code {code}: {text}"));
    }
    if code != 0 && !names_file_and_place(&text, scene) {
        return Err(format!("the message does not say which file or where: {text}"));
    }
    let must_reject = class == "must_reject";
    match (code, shared::must_accept(verdict)) {
        (0, true) => Ok("rendered"),
        (_, true) => Err(format!("must render: {text}")),
        (0, false) if must_reject && !shared::must_be_noted(name) => Err("must be rejected, but renders".to_owned()),
        (0, false) => Ok("rendered"),
        (_, false) if must_reject => Ok("rejected"),
        (_, false) => Ok("rejected, though it may be tolerated"),
    }
}

#[test]
fn every_shared_file_renders_or_is_refused_as_its_manifest_says() {
    let Some(folder) = shared::folder() else { return };
    let rows = shared::scenes(&folder);
    let outcomes = try_all(rows.len(), |i| {
        let [name, verdict, class] = ["path", "expected_verdict", "reject_class"].map(|c| rows[i][c].as_str());
        let bytes = rows[i]["bytes_total"].parse().unwrap();
        judge(&folder.join(name), name, verdict, class, bytes).map_err(|e| format!("{name}: {e}"))
    });
    let count = |what: &str| outcomes.iter().filter(|outcome| **outcome == what).count();
    for what in ["rendered", "rejected", "rejected, though it may be tolerated"] {
        println!("{} {what}", count(what));
    }
    assert!(count("rejected") > 100 && count("rendered") > 200, "the manifest has lost its rows");
}
