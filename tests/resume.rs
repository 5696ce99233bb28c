//! Interrupted, killed and finished renders go on, and nobody can tell from the picture.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Instant;

use bismar::balance::method::take_pass_and_update;
use bismar::balance::{LearnedPixels, Method, Moments, Sampler};
use bismar::film::exr_file;
use bismar::rays::Backend;
use bismar::render::record::checkpoint::{fits, pack, unpack};
use bismar::render::{
    Balance, Choice, CustomMethod, Part, Pause, RenderSettings, RenderStats, Rendered, RunOptions, Saved, StopReason,
    Technique, render, run,
};

use crate::helpers::program::{self, Folder, Running, assert_same_bits, bismar, bits, expect, names, paths, says};
use crate::helpers::random::Random;
use crate::helpers::skipped::skipped;
use crate::helpers::stage::{Stage, hall};

fn all_bits(rendered: &Rendered) -> Vec<u8> {
    pack(&rendered.tiles).unwrap()
}

/// Renders with an interruption every few tiles, each time through bytes and back, on changing numbers of threads.
fn in_pieces(stage: &Stage, settings: &RenderSettings, tiles_a_session: u32) -> (Rendered, u32) {
    let mut from = None;
    for session in 1.. {
        let (stop, tiles) = (AtomicBool::new(false), AtomicU32::new(0));
        let progress = |_| {
            if tiles.fetch_add(1, Ordering::Relaxed) + 1 == tiles_a_session {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1 + session as usize % 3).build().unwrap();
        let rendered = pool.install(|| {
            let job = RunOptions { from, ..RunOptions::new(&stop, &progress) };
            run(&stage.scene, settings, job).unwrap()
        });
        if rendered.stop != StopReason::Interrupted {
            return (rendered, session);
        }
        let tiles = unpack(&all_bits(&rendered)).unwrap();
        assert!(fits(&tiles, settings));
        let saved = Saved { tiles, stats: RenderStats { noise: 0.0, ..rendered.stats }, goals: rendered.goals };
        assert!(saved.has_passes_of(settings), "{:?}", saved.stats);
        from = Some(saved);
    }
    unreachable!()
}

#[test]
fn interruptions_anywhere_leave_no_trace() {
    for (backend, balance, crop, part, noise, adaptive) in [
        (Backend::Embree, Balance::Progressive, None, None, None, false),
        (Backend::Embree, Balance::SecondOrder, Some([3, 20, 49, 36]), None, None, false),
        (Backend::Embree, Balance::Half, None, Some(Part { number: 2, of: 3 }), None, false),
        (Backend::Obvhs, Balance::Progressive, None, None, None, false),
        (Backend::Embree, Balance::Progressive, None, None, Some(0.15), false),
        (Backend::Embree, Balance::Kl, Some([3, 20, 49, 36]), None, Some(0.12), false),
        (Backend::Embree, Balance::Progressive, None, None, None, true),
        (Backend::Obvhs, Balance::SecondOrder, Some([3, 20, 49, 36]), Some(Part { number: 1, of: 2 }), None, true),
    ] {
        let stage = Stage::new(hall(), backend);
        let settings = RenderSettings {
            width: 50,
            height: 37,
            spp: Some(if noise.is_some() { 200 } else { 40 }),
            noise,
            aovs: true,
            balance,
            crop,
            part,
            ..RenderSettings::even().with(Technique::Adaptive, adaptive.into())
        };
        let whole = stage.render(&settings);
        let (pieces, sessions) = in_pieces(&stage, &settings, 2);
        assert!(sessions > 1, "{sessions}");
        assert_eq!(all_bits(&whole), all_bits(&pieces), "{balance:?} {crop:?} {part:?}");
        assert_eq!(format!("{:?}", whole.film()), format!("{:?}", pieces.film()));
        assert_eq!(whole.stats.paths, pieces.stats.paths);
        // Where tiles take their own passes, rounds over them are what an interruption adds to.
        assert!(noise.is_some() || adaptive || whole.stats.passes == pieces.stats.passes);
        assert_eq!(whole.stats.noise, pieces.stats.noise);
    }
}

/// `kl` as a method of another crate.
struct Mine;

impl Method for Mine {
    fn name(&self) -> &'static str {
        "mine"
    }

    fn about(&self) -> &'static str {
        "As kl"
    }

    fn sums_moments(&self) -> bool {
        true
    }

    fn scrambles_passes(&self) -> bool {
        true
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        take_pass_and_update(learned, sampler, paths, Moments::kl_linear);
    }
}

#[test]
fn a_method_of_another_crate_is_rendered_with_guiding_and_interrupted_as_ours_are() {
    let stage = Stage::new(hall(), Backend::Embree);
    let of = |balance| {
        let guided = RenderSettings::even().with(Technique::Guiding, Choice::On);
        RenderSettings { width: 50, height: 37, spp: Some(24), balance, aovs: true, ..guided }
    };
    let (mine, kl) = (of(Balance::Custom(CustomMethod(&Mine))), of(Balance::Kl));
    let whole = stage.render(&kl);
    let (pieces, sessions) = in_pieces(&stage, &mine, 3);
    assert!(sessions > 1 && whole.stats.techniques[Technique::Guiding].unwrap().on);
    assert!(all_bits(&whole) == all_bits(&pieces));
    // What it does is not known from its name.
    let name = serde_json::to_value(mine.balance).unwrap();
    assert_eq!(name, "mine");
    assert!(serde_json::from_value::<Balance>(name).unwrap_err().to_string().contains("no balance method `mine`"));
}

#[test]
fn checkpoints_leave_no_trace_and_each_can_go_on() {
    let stage = Stage::new(hall(), Backend::Embree);
    let stop = AtomicBool::new(false);
    // A pause that took long is followed by a long wait: on a busy machine it takes more paths to see a second one.
    let at = |spp| {
        let settings = RenderSettings { width: 50, height: 37, spp: Some(spp), ..RenderSettings::even() };
        let whole = all_bits(&render(&stage.scene, &settings, &stop, &|_| ()).unwrap());
        let mut saved = Vec::new();
        let mut save = |r: &Rendered| saved.push((all_bits(r), r.stats));
        let pauses = vec![Pause { seconds: 1e-3, at: &mut save }];
        let job = RunOptions { pauses, ..RunOptions::new(&stop, &|_| ()) };
        assert_eq!(all_bits(&run(&stage.scene, &settings, job).unwrap()), whole);
        (settings, whole, saved)
    };
    let tried = [100, 400, 1600, 6400].into_iter().map(at).find(|(.., saved)| saved.len() > 1);
    let (settings, whole, saved) = tried.expect("pauses");
    for (bytes, stats) in saved.into_iter().step_by(2) {
        let from = Some(Saved { tiles: unpack(&bytes).unwrap(), stats, goals: Vec::new() });
        let job = RunOptions { from, ..RunOptions::new(&stop, &|_| ()) };
        assert_eq!(all_bits(&run(&stage.scene, &settings, job).unwrap()), whole);
    }
}

/// `scenes/cornell.glb` for about a second on one thread.
const LONG: &str = "cornell.glb --size 96x64 --spp 192";

pub fn folder() -> Folder {
    Folder::new().with_scene("cornell.glb", "cornell.glb")
}

fn start(folder: &Path, line: &str) -> Child {
    bismar(folder).args(line.split_whitespace()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn two_hundred_kills_at_any_moment_lose_nothing_that_was_saved() {
    const KILLS: u32 = 200;
    let folder = folder();
    let (whole, killed) = (folder.join("whole.exr"), folder.join("killed.exr"));
    let start_of_whole = Instant::now();
    expect(&folder, &format!("render {LONG} -o whole.exr -q"), 0);
    // Some are killed while they load, some when they have saved often.
    let longest = start_of_whole.elapsed() / 4;
    // Any moments do; that they are drawn alike every time is a help.
    let mut random = Random(1);
    let (mut kills, mut most_saved) = (0, 0);
    while kills < KILLS {
        let mut child = start(&folder, &format!("render {LONG} -o killed.exr --checkpoint 0.02 --resume -v"));
        thread::sleep(longest.mul_f32(random.f32()));
        let alive = child.try_wait().unwrap().is_none();
        child.kill().unwrap();
        let mut said = String::new();
        child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        child.wait().unwrap();
        kills += u32::from(alive);
        // What it has said that it saved is there, and whole; what is there goes on.
        let of_line = |line: &str| line.split("saved killed.exr with ").nth(1)?.split(' ').next()?.parse::<u64>().ok();
        let saved = said.lines().filter_map(of_line).max();
        most_saved = saved.unwrap_or(most_saved).max(most_saved);
        if killed.exists() {
            assert!(exr_file::read_statistics(&killed).unwrap().is_some());
            assert!(paths(&killed) >= most_saved, "{} of {most_saved}\n{said}", paths(&killed));
        } else {
            assert_eq!(saved, None);
        }
        if !alive {
            assert!(said.contains("killed.exr: 192.0 spp"), "it ended by itself:\n{said}");
            assert_same_bits(&whole, &killed);
            fs::remove_file(&killed).unwrap();
            most_saved = 0;
        }
        let left = names(&folder);
        assert!(left.len() <= 4, "killed processes leave their files: {left:?}");
    }
    expect(&folder, &format!("render {LONG} -o killed.exr --checkpoint 9 --resume -q"), 0);
    assert_same_bits(&whole, &killed);
}

#[test]
fn a_signal_saves_and_the_same_command_goes_on_to_the_same_bits() {
    let folder = folder();
    expect(&folder, "render cornell.glb --size 100x70 --spp 600 --aov all -o whole.exr -q", 0);
    let line = "render cornell.glb --size 100x70 --spp 600 --aov all -o out.exr --resume --progress plain";
    // Started by `nohup`, the program goes on when the terminal closes, as it should.
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    let ignores_hup = u64::from_str_radix(ignored.trim(), 16).unwrap() & 1 == 1;
    let all = ["-INT", "-TERM", "-USR1", "-HUP"];
    let mut signals = all.into_iter().filter(|signal| !(ignores_hup && *signal == "-HUP")).peekable();
    let mut late = 0;
    while let Some(signal) = signals.peek() {
        let mut render = Running::start(&folder, line);
        render.until("PROGRESS");
        let (code, said) = render.end(signal);
        if code == Some(0) {
            // On a busy machine it may be done before it gets the signal.
            late += 1;
            assert!(late < 20, "no {signal} is heard:\n{said}");
            fs::remove_file(folder.join("out.exr")).unwrap();
            continue;
        }
        assert_eq!(code, Some(75), "{said}");
        assert!(said.contains("--resume"), "{said}");
        signals.next();
    }
    expect(&folder, line, 0);
    assert_same_bits(&folder.join("whole.exr"), &folder.join("out.exr"));
}

#[test]
fn a_finished_render_says_so_and_goes_on_to_a_higher_goal() {
    let folder = folder();
    let file = |name| folder.join(name);
    expect(&folder, "render cornell.glb --size 40x30 --spp 256 -o whole.exr -q", 0);
    expect(&folder, "render cornell.glb --size 40x30 --spp 128 -o out.exr --checkpoint 9 -q", 0);
    let before = fs::read(file("out.exr")).unwrap();
    says(&folder, "render cornell.glb --size 40x30 --spp 128 -o out.exr --resume", 0, "finished before, with 128 spp");
    says(&folder, "render cornell.glb --size 40x30 --noise 50 -o out.exr --resume", 0, "finished before");
    assert_eq!(fs::read(file("out.exr")).unwrap(), before);
    expect(&folder, "render cornell.glb --size 40x30 --spp 256 -o out.exr --resume -q", 0);
    assert_same_bits(&file("whole.exr"), &file("out.exr"));
    // A picture that was rendered without statistics is recognised only once it would have to go on.
    says(&folder, "render cornell.glb --size 40x30 --spp 256 -o whole.exr --resume", 0, "finished before");
    says(&folder, "render cornell.glb --size 40x30 --spp 257 -o whole.exr --resume", 65, "carries no statistics");
    // Stop rules count all sessions.
    says(&folder, "render cornell.glb --size 40x30 --time 0.0001 -o out.exr --resume", 0, "finished before");
}

#[test]
fn a_goal_that_cuts_the_passes_otherwise_is_told() {
    const OTHER_PASSES: &str = "took other passes";
    let folder = folder();
    for (balance, first, then, other) in [
        ("progressive", "--spp 64", "--spp 256", true),
        ("progressive", "--spp 200", "--spp 256", true),
        ("progressive", "--spp 128", "--spp 256", false),
        ("progressive", "--noise 9", "--spp 256", true),
        ("progressive", "--noise 9", "--noise 0.5", false),
        ("progressive", "--noise 9 --time 99", "--noise 0.5 --time 98", false),
        // Against the clock the first passes are smaller.
        ("progressive", "--noise 9", "--spp 256 --time 99", true),
        ("half", "--spp 4 --time 99", "--noise 0.5 --time 99", false),
        // For few paths nothing is decided about guiding and path re-use.
        ("progressive", "--spp 4 --time 99", "--noise 0.5 --time 99", true),
        ("half", "--spp 64", "--spp 256", false),
        ("half", "--spp 100", "--spp 256", true),
        ("half", "--noise 9", "--spp 256", false),
        // Guiding learns for as many paths as there are to be.
        ("half --guiding on", "--spp 128", "--spp 256", true),
        ("half --guiding on", "--noise 9", "--noise 0.5", false),
        // Tiles that ended by themselves are brought to one number of paths.
        ("half", "--noise 0.1 --spp 128", "--spp 256", true),
        ("progressive", "--noise 0.1 --spp 128", "--noise 0.05 --spp 256", true),
        // A pass after the first estimate of the noise was cut at a number that is also the end of a planned one, or none was.
        ("half --integrator direct", "--noise 0.1 --spp 128", "--noise 0.1 --spp 256", true),
        ("half", "--noise 0.001 --spp 128", "--noise 0.001 --spp 256", false),
        // Every tile has ended with a whole pass, whatever its number of paths.
        ("progressive --guiding off --adaptive=on", "--spp 128", "--spp 192", false),
    ] {
        let line = format!("render cornell.glb --size 20x20 --balance {balance}");
        expect(&folder, &format!("{line} {first} -o out.exr --checkpoint 9 -q"), 0);
        let said = expect(&folder, &format!("{line} {then} -o out.exr --resume"), 0);
        assert_eq!(said.contains(OTHER_PASSES), other, "{balance} {first}, {then}: {said}");
        expect(&folder, &format!("{line} {then} -o whole.exr -q"), 0);
        let whole = bits(&folder.join("whole.exr"));
        assert!(other || whole == bits(&folder.join("out.exr")), "{balance} {first}, {then}");
    }
}

#[test]
fn another_render_is_refused_by_name_and_left_alone() {
    let folder = folder().with_scene("veach.glb", "veach.glb");
    expect(&folder, "render cornell.glb --size 40x30 --spp 16 -o out.exr --checkpoint 9 -q", 0);
    let before = fs::read(folder.join("out.exr")).unwrap();
    for (flags, words) in [
        ("cornell.glb --size 40x30 --spp 32 --seed 5", "seed (0 there, 5 here)"),
        ("cornell.glb --size 40x31 --spp 32", "size (40x30 there, 40x31 here)"),
        ("cornell.glb --size 40x30 --spp 32 --crop 0,0,9,9", "crop"),
        ("cornell.glb --size 40x30 --spp 32 --integrator direct", "integrator"),
        ("cornell.glb --size 40x30 --spp 32 --max-depth 3", "max-depth"),
        ("cornell.glb --size 40x30 --spp 32 --balance half", "balance"),
        ("cornell.glb --size 40x30 --spp 32 --filter box", "filter"),
        ("cornell.glb --size 40x30 --spp 32 --rays obvhs", "rays"),
        ("cornell.glb --size 40x30 --spp 32 --no-env", "environment"),
        ("cornell.glb --size 40x30 --spp 32 --aov albedo", "AOVs"),
        ("cornell.glb --size 40x30 --spp 32 --part 1/2", "not part 1/2"),
        ("veach.glb --size 40x30 --spp 32", "scene"),
    ] {
        says(&folder, &format!("render {flags} -o out.exr --resume"), 65, words);
    }
    let paper = "render cornell.glb --size 40x30 --spp 16 --balance second-order -o paper.exr --checkpoint 9";
    expect(&folder, &format!("{paper} --pilot 0.25 -q"), 0);
    says(&folder, &format!("{paper} --resume"), 65, "pilot (0.25 there, 0.5 here)");
    says(&folder, &format!("{paper} --pilot 0.25 --resume"), 0, "nothing to do");
    let of_format = |format| exr_file::Header::from([("bismar.format".into(), exr_file::HeaderValue::Number(format))]);
    let film = bismar::film::Film::new(4, 4, [0, 0, 4, 4], false);
    for (header, words) in [
        (of_format(99.0), "from a newer bismar"),
        (of_format(3.0), "from an older bismar"),
        (Vec::new(), "no picture that bismar can go on from"),
    ] {
        exr_file::write(&folder.join("other.exr"), &film, exr_file::Layers::default(), &header, None).unwrap();
        says(&folder, "render cornell.glb -o other.exr --resume", 65, words);
    }
    assert_eq!(fs::read(folder.join("out.exr")).unwrap(), before);
}

#[test]
fn a_checkpoint_that_fails_does_not_end_the_render_and_a_full_disk_leaves_the_old_file() {
    let folder = folder();
    expect(&folder, "render cornell.glb --size 64x48 --spp 128 -o out.exr --checkpoint 9 -q", 0);
    let before = bits(&folder.join("out.exr"));
    // A limit of a few kilobytes a file fails like a full disk: in the middle of a write.
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" render cornell.glb --size 64x48 --spp 512 -o out.exr \
                  --checkpoint 0.01 --resume";
    let output = Command::new("sh").args(["-c", script]).arg(program::program()).current_dir(&folder).output();
    let output = output.unwrap();
    let said = program::stderr(&output);
    assert_eq!(output.status.code(), Some(74), "{said}");
    assert!(said.contains("checkpoint not saved, rendering continues"), "{said}");
    assert_eq!(bits(&folder.join("out.exr")), before);
    expect(&folder, "render cornell.glb --size 64x48 --spp 512 -o out.exr --resume -q", 0);
    expect(&folder, "render cornell.glb --size 64x48 --spp 512 -o whole.exr -q", 0);
    assert_same_bits(&folder.join("whole.exr"), &folder.join("out.exr"));
}

#[test]
fn a_read_only_place_is_found_out_before_the_work() {
    let folder = folder();
    let script = "mount -t tmpfs -o size=1m none shots && cp out.exr shots/ && mount -o remount,ro shots && \
                  ! \"$0\" render cornell.glb --size 40x30 -o shots/out.exr --resume --spp 99 2> said; \
                  cmp out.exr shots/out.exr && echo alike >> said";
    expect(&folder, "render cornell.glb --size 40x30 --spp 8 -o out.exr --checkpoint 9 -q", 0);
    fs::create_dir(folder.join("shots")).unwrap();
    let namespace = Command::new("unshare").args(["-rm", "true"]).status();
    if !namespace.is_ok_and(|s| s.success()) {
        skipped("this machine does not allow a read-only mount (unshare -rm)");
        return;
    }
    let script = ["-rm", "sh", "-c", script];
    let status = Command::new("unshare").args(script).arg(program::program()).current_dir(&folder).status().unwrap();
    let said = fs::read_to_string(folder.join("said")).unwrap();
    assert!(status.success() && said.contains("the file system is read-only") && said.contains("alike"), "{said}");
}

#[test]
fn memory_that_would_not_suffice_is_told_before_loading() {
    let folder = folder();
    let said = expect(&folder, "render cornell.glb --size 8000x8000 --memory-limit 500M", 76);
    assert!(said.contains("needs about") && said.contains("--memory-limit allows 500"), "{said}");
    let output = bismar(&folder)
        .args(["render", "cornell.glb", "--size", "8000x8000"])
        .env("SLURM_MEM_PER_NODE", "600")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(76));
    assert!(program::stderr(&output).contains("SLURM_MEM_PER_NODE allows 600"), "{}", program::stderr(&output));
    expect(&folder, "render cornell.glb --size 40x30 --spp 1 --memory-limit 500M -q", 0);
    assert_eq!(names(&folder), ["cornell.exr", "cornell.glb"]);
}

/// Hours of work.
const ENDLESS: &str = "cornell.glb --size 96x64 --spp 1000000000 -o out.exr";

#[test]
fn nohup_is_heard() {
    let folder = folder();
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("trap '' HUP; exec \"$0\" render {ENDLESS} --progress plain")]).arg(program::program());
    let mut child = shell.current_dir(&folder).env("BISMAR_THREADS", "1").stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap());
    let mut wait_for_progress = || {
        let mut said = String::new();
        while !said.contains("PROGRESS") {
            assert_ne!(lines.read_line(&mut said).unwrap(), 0, "it ended by itself:\n{said}");
        }
    };
    wait_for_progress();
    program::signal(&child, "-HUP");
    // Two more lines are a second and more of rendering.
    wait_for_progress();
    wait_for_progress();
    assert!(!folder.join("out.exr").exists());
    program::signal(&child, "-TERM");
    assert_eq!(child.wait().unwrap().code(), Some(75));
}

#[test]
fn whoever_does_not_read_keeps_nobody_from_saving() {
    let folder = folder();
    for line in ["--progress plain", "--progress json", "--progress openjd", "-vv --progress plain"] {
        // A pipe that is full already, and that nobody reads from.
        let (_reader, mut writer) = std::io::pipe().unwrap();
        let filler = writer.try_clone().unwrap();
        let mut fill = Command::new("sh");
        fill.args(["-c", "exec dd if=/dev/zero of=/dev/stdout bs=4096 oflag=nonblock"]).stdout(filler);
        fill.stderr(Stdio::null()).status().unwrap();
        std::io::Write::flush(&mut writer).unwrap();
        let mut render = bismar(&folder);
        render.args(format!("render {ENDLESS} {line} --checkpoint 0.1 --resume").split(' '));
        let mut child = render.stdout(writer.try_clone().unwrap()).stderr(writer).spawn().unwrap();
        let out = folder.join("out.exr");
        let before = if out.exists() { paths(&out) } else { 0 };
        let mut saved = 0;
        // It goes on, checkpoint after checkpoint.
        while saved < 2 || paths(&out) <= before {
            assert!(child.try_wait().unwrap().is_none(), "{line}: it ended by itself");
            let now = if out.exists() { paths(&out) } else { 0 };
            saved += u32::from(now > before);
            thread::sleep(std::time::Duration::from_millis(20));
        }
        program::signal(&child, "-TERM");
        assert_eq!(child.wait().unwrap().code(), Some(75), "{line}");
    }
}

#[test]
fn a_signal_in_the_first_milliseconds_ends_with_75_or_leaves_everything_untouched() {
    let folder = folder();
    let whole = names(&folder);
    let mut codes = std::collections::BTreeMap::new();
    for microseconds in (0..60_000).step_by(3_000) {
        let child = start(&folder, &format!("render {ENDLESS}"));
        thread::sleep(std::time::Duration::from_micros(microseconds));
        program::signal(&child, "-TERM");
        let ended = child.wait_with_output().unwrap();
        // 75, or by the signal itself before anybody listened.
        let code = ended.status.code();
        assert!(code.is_none_or(|code| code == 75), "{code:?}: {}", program::stderr(&ended));
        *codes.entry(code).or_insert(0) += 1;
        let out = folder.join("out.exr");
        if out.exists() {
            assert!(code.is_some() && exr_file::read_statistics(&out).unwrap().is_some());
            fs::remove_file(out).unwrap();
        }
        assert_eq!(names(&folder), whole);
    }
    assert!(codes.contains_key(&Some(75)), "{codes:?}");
}

#[test]
fn checkpoints_are_kept_by_number_and_handed_on_and_the_first_is_early() {
    let folder = folder();
    fs::write(folder.join("told.sh"), "#!/bin/sh\necho \"$1\" >>told\n").unwrap();
    assert!(Command::new("chmod").args(["+x", "told.sh"]).current_dir(&folder).status().unwrap().success());
    let in_folder = |prefix: &str| names(&folder).into_iter().filter(|n| n.starts_with(prefix)).collect::<Vec<_>>();
    // An hour between checkpoints; the first does not wait for it.
    let line =
        format!("render {ENDLESS} --checkpoint 3600 --keep 3 --on-checkpoint ./told.sh --resume --progress plain");
    let mut render = Running::start(&folder, &line);
    while in_folder("told").len() < 2 {
        render.next_line();
    }
    assert_eq!(render.end("-TERM").0, Some(75));
    let lines = || fs::read_to_string(folder.join("told")).unwrap();
    assert_eq!(lines(), "./out.checkpoint-0001.exr\n./out.checkpoint-0002.exr\n");
    let mut render = Running::start(&folder, &line.replace("3600", "0.05"));
    while in_folder("out.checkpoint-").last().is_none_or(|last| last.as_str() < "out.checkpoint-0007.exr") {
        render.next_line();
    }
    render.end("-TERM");
    let kept = in_folder("out.checkpoint-");
    assert_eq!(kept.len(), 3, "{kept:?}");
    let held: Vec<_> = kept.iter().map(|name| paths(&folder.join(name))).collect();
    assert!(held.is_sorted() && held[0] < held[2] && held[2] == paths(&folder.join("out.exr")), "{held:?}");
    // A program that is not there is a warning.
    let short = "render cornell.glb --size 96x64 --spp 64 -o b.exr --checkpoint 0.01 --on-checkpoint ./none";
    says(&folder, short, 0, "./none");
}
