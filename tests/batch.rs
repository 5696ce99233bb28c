//! A batch does all that can be done, says what cannot, and does nothing twice.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};

use serde_json::Value;

use crate::helpers::farm::{kill, until, until_alive, workers};
use crate::helpers::glb;
use crate::helpers::program::{
    Folder, Running, assert_same_bits, bismar, expect, names, read_json, says, scene, signal, stdout,
};

fn report(folder: &Path) -> Value {
    read_json(&folder.join("jobs-report.json"))
}

#[test]
fn of_300_jobs_with_10_broken_ones_290_are_done_and_again_only_10_are_tried() {
    let path = &Folder::new().with("scene.glb", glb::triangle()).with("broken.glb", b"glTF but not really");
    let seeds: Vec<_> = (1..=145).map(|n| n.to_string()).collect();
    let mut file = format!(
        "[defaults]\nsize = '12x9'\nspp = 2\noutput = 'out/{{name}}.exr'\n\n[[matrix]]\nscene = ['scene.glb']\n\
         camera = ['a', 'b']\nseed = [{}]\n",
        seeds.join(", ")
    );
    for n in 0..10 {
        let what = match n % 4 {
            0 => "scene = 'broken.glb'",
            1 => "scene = 'absent.glb'",
            2 => "scene = 'scene.glb'\ncamera = 'none such'",
            _ => "scene = 'scene.glb'\noutput = 'scene.glb/out.exr'",
        };
        let what = what.replace("out.exr", &format!("out{n}.exr"));
        writeln!(file, "[[job]]\nname = 'broken{n}'\n{what}").unwrap();
    }
    fs::write(path.join("jobs.toml"), file).unwrap();

    let table = stdout(path, "batch jobs.toml --jobs 2 --events events.jsonl", 73);
    let first = report(path);
    assert_eq!((&first["done"], &first["failed"], &first["before"]), (&290.into(), &10.into(), &0.into()));
    let jobs = first["jobs"].as_array().unwrap();
    let codes: Vec<_> = jobs.iter().skip(290).map(|j| j["exit_code"].as_u64().unwrap()).collect();
    assert_eq!(codes, [65, 66, 64, 73, 65, 66, 64, 73, 65, 66]);
    for job in jobs.iter().take(290) {
        assert_eq!(job["status"], "done");
        let stats = &job["stats"];
        for key in ["noise", "peak_memory_bytes"] {
            assert!(stats[key].as_f64().unwrap() > 0.0, "{key} of {}", job["job"]);
        }
        assert!(stats["rays"]["total"].as_u64().unwrap() > 0 && job["seconds"].as_f64().unwrap() > 0.0);
    }
    assert_eq!(names(&path.join("out")).len(), 290);
    assert_eq!(table.lines().count(), 301);
    let events = fs::read_to_string(path.join("events.jsonl")).unwrap();
    let ends = events.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    assert_eq!(ends.filter(|e| e["event"] == "job-ends").count(), 300);

    // One output is gone, one job has changed, one broken scene is repaired.
    fs::remove_file(path.join("out/scene-a-7.exr")).unwrap();
    let untouched = fs::metadata(path.join("out/scene-b-9.exr")).unwrap().modified().unwrap();
    fs::write(path.join("absent.glb"), glb::triangle()).unwrap();
    let file = fs::read_to_string(path.join("jobs.toml")).unwrap();
    fs::write(path.join("jobs.toml"), file.replace("seed = [1, 2,", "seed = [1001, 2,")).unwrap();
    expect(path, "batch jobs.toml -q", 73);
    let second = report(path);
    // Gone: 1. Changed: 2 cameras of one seed. Repaired: 3 jobs.
    assert_eq!((&second["done"], &second["before"], &second["failed"]), (&6.into(), &287.into(), &7.into()));
    assert_eq!(fs::metadata(path.join("out/scene-b-9.exr")).unwrap().modified().unwrap(), untouched);
}

#[test]
fn a_job_whose_settings_or_scene_have_changed_is_rendered_anew() {
    let path = &Folder::new().with_scene("scene.glb", "cornell.glb");
    let write = |spp: u32, seed: u32| {
        let text = format!("[[job]]\nscene = 'scene.glb'\nsize = '24x18'\nspp = {spp}\nseed = {seed}\n");
        fs::write(path.join("jobs.toml"), text).unwrap();
    };
    let run = || {
        expect(path, "batch jobs.toml -q", 0);
        report(path)["jobs"][0]["status"].as_str().unwrap().to_owned()
    };
    write(8, 1);
    assert_eq!((run(), run()), ("done".into(), "before".into()));
    write(8, 2);
    assert_eq!((run(), run()), ("done".into(), "before".into()));
    write(16, 2);
    assert_eq!((run(), run()), ("done".into(), "before".into()));
    fs::copy(scene("veach.glb"), path.join("scene.glb")).unwrap();
    assert_eq!((run(), run()), ("done".into(), "before".into()));
    expect(path, "render scene.glb --size 24x18 --spp 16 --seed 2 -o whole.exr -q", 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("scene.exr"));
}

#[test]
fn an_interrupted_batch_goes_on_to_the_same_pictures() {
    let jobs = "[[matrix]]\nscene = 'scene.glb'\nsize = '64x48'\nspp = 256\nseed = [1, 2, 3]\ncheckpoint = 0.1\n";
    let path = &Folder::new().with_scene("scene.glb", "cornell.glb").with("jobs.toml", jobs);
    let mut batch = Running::start(path, "batch jobs.toml");
    batch.until("scene-1: 256 spp");
    assert_eq!(batch.end("-TERM").0, Some(75));
    let first = report(path);
    assert_eq!((&first["done"], &first["failed"]), (&1.into(), &0.into()), "{first}");
    for error in first["jobs"].as_array().unwrap().iter().filter_map(|job| job["error"].as_str()) {
        // The same command goes on; it has no --resume.
        assert!(!error.contains("--resume"), "{error}");
    }
    expect(path, "batch jobs.toml -q", 0);
    let second = report(path);
    assert_eq!((&second["done"], &second["before"]), (&2.into(), &1.into()), "{second}");
    // What was done before keeps its numbers.
    assert_eq!(second["jobs"][0]["stats"], first["jobs"][0]["stats"]);
    assert_eq!(second["jobs"][0]["seconds"], first["jobs"][0]["seconds"]);
    assert!(second["jobs"][0]["stats"]["noise"].as_f64().unwrap() > 0.0, "{second}");
    for seed in 1..=3 {
        expect(path, &format!("render scene.glb --size 64x48 --spp 256 --seed {seed} -o whole.exr -q"), 0);
        assert_same_bits(&path.join("whole.exr"), &path.join(format!("scene-{seed}.exr")));
    }
}

#[test]
fn a_dry_run_says_what_would_be_done_and_does_nothing() {
    let jobs = "[[matrix]]\nscene = 'scene.glb'\nspp = 1\nsize = '8x8'\ncamera = ['a', 'b']\n";
    let path = &Folder::new().with("scene.glb", glb::triangle()).with("jobs.toml", jobs);
    expect(path, "render scene.glb --spp 1 --size 8x8 --camera b -o scene-b.exr -q", 0);
    let before = names(path);
    let text = stdout(path, "batch jobs.toml --dry-run", 0);
    assert!(text.contains("scene-a: render\n") && text.contains("scene-b: done before\n"), "{text}");
    assert_eq!(names(path), before);
}

#[test]
fn only_some_jobs_are_done_and_the_report_keeps_the_others() {
    let jobs = "[[matrix]]\nscene = '*.glb'\nspp = 1\nsize = [[8, 8]]\ncamera = ['a', 'b']\n";
    let path = &Folder::new().with("one.glb", glb::triangle()).with("two.glb", glb::triangle()).with("jobs.toml", jobs);
    says(path, "batch jobs.toml --only three-*", 64, "no job's name matches; the jobs are one-8x8-a, one-8x8-b");
    let counts = |report: &Value| [&report["done"], &report["before"]].map(|n| n.as_u64().unwrap());
    expect(path, "batch jobs.toml -q --only *-b", 0);
    assert_eq!(counts(&report(path)), [2, 0]);
    says(path, "batch jobs.toml --only one-* --only two-*-b", 0, "3 jobs: 1 done, 2 done before");
    let all = report(path);
    assert_eq!(counts(&all), [1, 2]);
    says(path, "batch jobs.toml --only two-*-a", 0, "1 jobs: 1 done");
    let names: Vec<_> = report(path)["jobs"].as_array().unwrap().iter().map(|j| j["job"].clone()).collect();
    assert_eq!(names, ["one-8x8-a", "one-8x8-b", "two-8x8-a", "two-8x8-b"]);
    // A picture that somebody else has made anew has other numbers.
    expect(path, "render one.glb --size 8x8 --spp 2 --camera a -o one-8x8-a.exr -q", 0);
    expect(path, "batch jobs.toml -q", 0);
    assert!(report(path)["jobs"][0]["stats"].is_null());
}

#[test]
fn a_dry_run_prints_commands_that_a_shell_takes() {
    let odd = "a 'b' $(c).glb";
    let jobs = format!("[[job]]\nscene = \"{odd}\"\nspp = 1\nsize = [8, 8]\naov = ['depth', 'normal']\n");
    let path = &Folder::new().with(odd, glb::triangle()).with("jobs.toml", jobs);
    let text = stdout(path, "batch jobs.toml --dry-run", 0);
    let command = text.lines().nth(1).unwrap().trim().strip_prefix("bismar").unwrap();
    let line = format!("'{}'{command} -q", crate::helpers::program::program().display());
    let status = std::process::Command::new("sh").args(["-c", &line]).current_dir(path).status().unwrap();
    assert!(status.success(), "{line}");
    assert!(path.join("a 'b' $(c).exr").exists(), "{:?}", names(path));
}

#[test]
fn mistakes_in_the_file_exit_with_78_and_their_place() {
    let path = &Folder::new();
    for (text, words) in [
        ("[[job]]\nscene = 'a.glb'\nspp = 'many'\n", "jobs.toml:3:1: job 'a': invalid value 'many' for '--spp"),
        ("[[job]]\nscene = 'a.glb'\nspq = 3\n", "jobs.toml:3:1: there is no key `spq`"),
        ("[[job]]\nscene = 'a.glb'\nresume = true\n", "jobs.toml:3:1: there is no key `resume`"),
        ("[[job]]\nscene = 'a.glb'\nreplay-pixel = '3,4'\n", "jobs.toml:3:1: there is no key `replay-pixel`"),
        ("[[job]]\nscene = 'a.glb'\nspp = = 3\n", "jobs.toml:3:7"),
        ("[[job]]\nscene = 'a.glb'\nbalance = 'second-order'\n", "needs --spp"),
        ("[[job]]\nscene = 'a.glb'\nsize = '3'\n", "WIDTHxHEIGHT"),
    ] {
        fs::write(path.join("jobs.toml"), text).unwrap();
        says(path, "batch jobs.toml", 78, words);
    }
    expect(path, "batch absent.toml", 66);
    assert_eq!(names(path), ["jobs.toml"]);
}

/// Six short jobs, and in the middle of them one that takes hours.
fn with_an_endless_job() -> Folder {
    let file = "[defaults]\nscene = 'scene.glb'\nsize = '24x18'\nspp = 4\n\n[[matrix]]\nseed = [1, 2, 3]\n\n[[job]]\n\
                name = 'endless'\nsize = '64x48'\nspp = 1_000_000_000\n\n[[matrix]]\nseed = [4, 5, 6]\n";
    Folder::new().with("scene.glb", glb::triangle()).with("jobs.toml", file)
}

/// Waits until the endless job has begun so often, as long as the batch lives; the process that renders it.
#[track_caller]
fn worker_of_endless(folder: &Path, batch: &mut Child, begun: usize) -> u32 {
    let id = batch.id();
    let mut found = Vec::new();
    until_alive(batch, || {
        let events = fs::read_to_string(folder.join("events.jsonl")).unwrap_or_default();
        let of_endless = |line: &&str| line.contains("job-begins") && line.contains("endless");
        found = workers(id);
        events.lines().filter(of_endless).count() == begun && found.len() == 1
    });
    found[0]
}

#[test]
fn a_job_that_takes_its_process_along_takes_no_other_job() {
    for (flags, begun) in [("--jobs 2", 2), ("--isolate", 1)] {
        let path = &with_an_endless_job();
        let line = format!("batch jobs.toml -q --events events.jsonl {flags}");
        let mut batch = bismar(path).args(line.split(' ')).stdout(Stdio::null()).spawn().unwrap();
        // Where jobs share a process, those that were at work when it died are tried again alone.
        for begun in 1..=begun {
            kill(worker_of_endless(path, &mut batch, begun));
        }
        assert_eq!(batch.wait().unwrap().code(), Some(76), "{flags}");
        let report = report(path);
        // A job whose process dies between its picture and the word of it is found done.
        let count = |of: &str| report[of].as_u64().unwrap();
        assert_eq!((count("done") + count("before"), count("failed")), (6, 1), "{flags}: {report:#}");
        let jobs = report["jobs"].as_array().unwrap();
        assert_eq!(jobs.len(), 7);
        assert_eq!((&jobs[3]["job"], &jobs[3]["exit_code"]), (&"endless".into(), &76.into()));
        assert!(jobs[3]["error"].as_str().unwrap().contains("killed"), "{report:#}");
        assert!(jobs.iter().all(|job| job["status"] != "done" || job["stats"]["noise"].is_number()), "{report:#}");
    }
}

#[test]
fn a_killed_batch_takes_its_processes_along_and_the_next_one_accounts_for_all() {
    let path = &with_an_endless_job();
    let mut batch = bismar(path).args(["batch", "jobs.toml", "-q", "--events", "events.jsonl"]).spawn().unwrap();
    let worker = worker_of_endless(path, &mut batch, 1);
    batch.kill().unwrap();
    batch.wait().unwrap();
    // Of a process that nobody waits for the number may stay, but no words.
    until(|| fs::read(format!("/proc/{worker}/cmdline")).unwrap_or_default().is_empty());
    let text = fs::read_to_string(path.join("jobs.toml")).unwrap().replace("1_000_000_000", "4");
    fs::write(path.join("jobs.toml"), text).unwrap();
    expect(path, "batch jobs.toml -q", 0);
    let report = report(path);
    assert_eq!((&report["done"], &report["before"]), (&4.into(), &3.into()), "{report:#}");
}

/// A job that needs more than the limit fails with 76 before it begins, and the process that renders the others is held to it.
#[test]
fn jobs_are_refused_and_held_by_the_memory_limit() {
    let path = &with_an_endless_job();
    let file = fs::read_to_string(path.join("jobs.toml")).unwrap();
    let file = file.replace("spp = 1_000_000_000", "spp = 1_000_000_000\ncheckpoint = 0.05");
    fs::write(path.join("jobs.toml"), format!("{file}\n[[job]]\nname = 'large'\nsize = '8000x8000'\n")).unwrap();
    let only = |name: &str| {
        let mut batch = bismar(path);
        batch.args(["batch", "jobs.toml", "-q", "--events", "events.jsonl", "--only", name]).stdout(Stdio::null());
        batch.env("SLURM_MEM_PER_NODE", "300");
        batch
    };
    assert_eq!(only("large").status().unwrap().code(), Some(76));
    let report = report(path);
    let large = report["jobs"].as_array().unwrap().iter().find(|job| job["job"] == "large").unwrap();
    assert_eq!(large["exit_code"], 76, "{large}");
    assert!(large["error"].as_str().unwrap().contains("SLURM_MEM_PER_NODE allows 300"), "{large}");
    // Frames are jobs, too.
    fs::write(path.join("moving.glb"), glb::moving()).unwrap();
    let line = "render moving.glb --frames 1-2 --fps 10 --size 8000x8000 --spp 1 -q -o a.##.exr --memory-limit 300M";
    says(path, line, 76, "--memory-limit allows 300");
    let mut batch = only("endless").spawn().unwrap();
    let worker = worker_of_endless(path, &mut batch, 1);
    // Once something is saved, it renders.
    until_alive(&mut batch, || path.join("endless.exr").exists());
    let limits = fs::read_to_string(format!("/proc/{worker}/limits")).unwrap();
    let data = limits.lines().find_map(|line| line.strip_prefix("Max data size")).unwrap();
    // Stacks of threads count as mapped.
    let held = data.split_whitespace().next().unwrap().parse::<u64>();
    signal(&batch, "-TERM");
    assert_eq!(batch.wait().unwrap().code(), Some(75));
    assert!(held.is_ok_and(|held| held < 600 << 20), "{data}");
}

/// As many as a file may reasonably hold, each a table of its own.
#[test]
fn twenty_thousand_jobs_are_read() {
    let path = &Folder::new().with("scene.glb", glb::triangle());
    let job = |n: u32| format!("[[job]]\nname = 'job {n}'\nscene = 'scene.glb'\nseed = {n}\n");
    fs::write(path.join("jobs.toml"), (0..20_000).map(job).collect::<String>()).unwrap();
    assert_eq!(stdout(path, "batch jobs.toml --dry-run", 0).matches(": render\n").count(), 20_000);
}
