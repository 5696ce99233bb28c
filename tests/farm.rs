//! Farms, against a stand-in for Slurm: names are data, of which nothing is run on the way; tasks that are interrupted,
//! killed or starved are begun again as long as that helps; and `farm status` says what has become of them.

use std::ffi::{OsStr, OsString};
use std::fmt::Debug;
use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, SystemTime};

use serde_json::Value;

use crate::helpers::farm::{HOSTILE, kill, parent, status, succeeds, until, until_alive, writer};
use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, bismar, expect, paths, read_json, signal, stderr};

/// An `sbatch` that runs tasks at once, one after the other, as Slurm would: the script by bash, its arguments as they
/// are, in the given folder.
const SBATCH: &str = r#"#!/bin/bash
echo "$0 $*" >>"$CALLS"
tasks=0
while [[ $1 == --* ]]; do
    case $1 in
        --dependency=afterok:*) needs=${1#*:} ;;
        --array=1-*) tasks=${1#--array=1-}; tasks=${tasks%%%*} ;;
        --chdir=*) cd "${1#--chdir=}" || exit 1 ;;
    esac
    shift
done
if [[ -e $HOLD ]]; then echo 7; exit; fi
for ((i = 1; i <= tasks; i++)); do SLURM_ARRAY_TASK_ID=$i bash "$@" >&2 || failed+=" 7_$i"; done
[[ $tasks == 0 ]] || echo "$failed" >"$CALLS.failed"
for id in ${needs//:/ }; do grep -q "$id\\>" "$CALLS.failed" && tasks=none; done
[[ $tasks != 0 ]] || bash "$@" >&2
echo 7
"#;

/// Says what a site is like; keeps other orders.
const SCONTROL: &str = "#!/bin/sh\n[ $1 = show ] || echo scontrol $* >>$CALLS\necho 'RequeueExit = 75'\n";
/// Answers what a test has written down, if anything.
const SQUEUE: &str = "#!/bin/sh\ncat $QUEUE\n";

/// A folder with a scene, with programs that stand in for Slurm's.
struct Site {
    home: Folder,
    folder: PathBuf,
}

impl Site {
    fn new(folder: &str) -> Self {
        let home = Folder::new();
        let bin = home.join("bin");
        fs::create_dir(&bin).unwrap();
        for (name, script) in [("sbatch", SBATCH), ("scontrol", SCONTROL), ("squeue", SQUEUE)] {
            fs::write(bin.join(name), script).unwrap();
            fs::set_permissions(bin.join(name), fs::Permissions::from_mode(0o755)).unwrap();
        }
        let folder = home.join(folder);
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("scene.glb"), glb::triangle()).unwrap();
        Self { home, folder }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.home.join(name)
    }

    /// `bismar farm …` where these programs are Slurm's.
    fn farm(&self) -> Command {
        let path = format!("{}:{}", self.file("bin").display(), std::env::var("PATH").unwrap());
        let mut command = bismar(&self.folder);
        command.env("PATH", path).env("CALLS", self.file("calls"));
        command.env("QUEUE", self.file("queue")).env("HOLD", self.file("hold")).arg("farm");
        command
    }

    fn submit(&self, arguments: &[impl AsRef<OsStr>]) -> Output {
        self.farm().arg("submit").args(arguments).output().unwrap()
    }

    /// Submits the scene, whole and on one task, which nobody begins.
    #[track_caller]
    fn submit_only(&self, line: &str) {
        fs::write(self.file("hold"), "").unwrap();
        self.submit_line(line);
    }

    #[track_caller]
    fn submit_line(&self, line: &str) {
        let said = self.submit(&words(line));
        assert!(said.status.success(), "{line}: {}", stderr(&said));
    }

    /// Begins the first task as Slurm would, job 7.
    fn begin(&self) -> Child {
        self.begin_with(900)
    }

    /// With so many MiB.
    fn begin_with(&self, memory: u32) -> Child {
        let mut command = self.farm();
        command.args(["task", "1", "--plan", "scene.farm/farm.json"]);
        command
            .env("SLURM_ARRAY_JOB_ID", "7")
            .env("SLURM_ARRAY_TASK_ID", "1")
            .env("SLURM_JOB_ID", "7")
            .env("SLURM_MEM_PER_NODE", memory.to_string())
            .env("SLURM_RESTART_COUNT", "20");
        command.spawn().unwrap()
    }

    fn sessions(&self) -> Value {
        let bytes = fs::read(self.folder.join("scene.farm/logs/task-1.json")).unwrap_or_default();
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    fn status(&self) -> Value {
        let mut command = self.farm();
        command.args(["status", "scene.farm", "--json"]);
        serde_json::from_str(&succeeds(command)).unwrap()
    }

    #[track_caller]
    fn assert_state(&self, name: &str, words: &str) {
        let status = self.status();
        let task = &status["tasks"][0];
        assert_eq!(task["state"], name, "{status:#}");
        assert!(task["error"].as_str().unwrap_or_default().contains(words), "{status:#}");
        assert_eq!(status["complete"], name == "done", "{status:#}");
    }

    /// Submits, and expects that it is refused with this code before Slurm hears of it; returns what is said.
    #[track_caller]
    fn refuses(&self, code: i32, arguments: &[impl AsRef<OsStr> + Debug]) -> String {
        let said = self.submit(arguments);
        let text = stderr(&said);
        self.assert_nothing_ran();
        assert_eq!(said.status.code(), Some(code), "{arguments:?}: {text}");
        assert!(!self.home.join("calls").exists(), "{arguments:?} was submitted");
        // Nor does it reach a terminal as it is.
        assert!(text.trim_end().chars().all(|c| !c.is_control()), "{text:?}");
        text
    }

    /// Names of hostile files are `touch X` in some shell's eyes.
    #[track_caller]
    fn assert_nothing_ran(&self) {
        let folders = [&*self.home, &self.folder].map(Path::to_owned);
        let below = fs::read_dir(&self.folder).unwrap().map(|entry| entry.unwrap().path());
        for folder in folders.into_iter().chain(below) {
            assert!(!folder.join("X").exists(), "a name was run in {}", folder.display());
        }
    }
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

#[test]
fn a_hostile_batch_file_runs_nothing() {
    let site = Site::new("shots");
    for line in [
        r#"camera = "a\ntouch X #""#,
        r#"name = "a\ntouch X #""#,
        r#"name = "a\u001b[2J""#,
        r#"name = "a\u0085touch X""#,
        r#"output = "a\ntouch X #.exr""#,
        r#"preview = "a\rtouch X #.png""#,
        r#"env = "a\ntouch X #""#,
        r#"scene = "a\ntouch X #.glb""#,
    ] {
        let scene = if line.starts_with("scene") { "" } else { "scene = 'scene.glb'\n" };
        fs::write(site.folder.join("jobs.toml"), format!("[[job]]\n{scene}spp = 1\n{line}\n")).unwrap();
        for format in ["slurm", "openjd"] {
            let said = site.refuses(78, &["jobs.toml", "--format", format]);
            assert!(said.contains("jobs.toml:") && said.contains("control character"), "{line}: {said}");
        }
        // Nor are they names on this machine.
        expect(&site.folder, "batch jobs.toml", 78);
        site.assert_nothing_ran();
    }
}

#[test]
fn a_name_that_cannot_travel_is_refused_before_submission() {
    let site = Site::new("shots");
    for line in [
        &["scene.glb", "--", "--camera", "a\ntouch X #"][..],
        &["scene.glb", "--", "-o", "a\ntouch X #.exr"],
        &["scene.glb", "--folder", "f\ntouch X #"],
        &["scene.glb", "--sbatch=--comment=a\ntouch X #"],
        &["scene.glb", "--memory", "1G\ntouch X #"],
        &["a\ntouch X #.glb"],
    ] {
        let said = site.refuses(64, line);
        assert!(said.contains("control character"), "{line:?}: {said}");
    }
    let other =
        |prefix: &str, suffix: &str| OsString::from_vec([prefix.as_bytes(), &[0xff], suffix.as_bytes()].concat());
    fs::write(site.folder.join(other("s", ".glb")), glb::triangle()).unwrap();
    for line in [
        vec![other("s", ".glb")],
        vec!["scene.glb".into(), "--folder".into(), other("f", "")],
        vec!["scene.glb".into(), "--".into(), "-o".into(), other("o", ".exr")],
        vec!["scene.glb".into(), "--".into(), "--preview".into(), other("p", ".png")],
    ] {
        let said = site.refuses(64, &line);
        assert!(said.contains("UTF-8"), "{line:?}: {said}");
    }
}

#[test]
fn any_other_name_travels_as_it_is() {
    for folder in HOSTILE {
        let site = Site::new(folder);
        // In a batch file a brace begins a template.
        let name = folder.replace(['{', '}'], "_");
        let job = format!("[[job]]\nscene = 'scene.glb'\nsize = '40x20'\nspp = 2\nname = '''{name}'''\n");
        let other = "[[job]]\nscene = 'scene.glb'\nname = 'no camera'\ncamera = '$(touch X)`touch X`;touch X'\n";
        fs::write(site.folder.join("jobs.toml"), job + other).unwrap();
        site.submit_line("jobs.toml --parts 2 --memory 1G");
        site.assert_nothing_ran();
        expect(&site.folder, "render scene.glb --size 40x20 --spp 2 -o whole.exr -q", 0);
        assert_same_bits(&site.folder.join("whole.exr"), &site.folder.join(format!("{name}.exr")));
        let status = status(&site.folder, "jobs.farm");
        let last = status["tasks"].as_array().unwrap().last().unwrap();
        assert!(last["error"].as_str().is_some_and(|error| error.contains("$(touch X)")), "{last}");
    }
}

#[test]
fn a_task_is_an_entry_of_its_plan() {
    let site = Site::new("shots");
    site.submit_line("scene.glb --parts 2 -- --size 40x20 --spp 2");
    let plan = site.folder.join("scene.farm/farm.json");
    for (line, code) in [
        ("farm task 1 --plan scene.farm/farm.json", 0),
        ("farm task 2 --plan scene.farm/farm.json", 0),
        ("farm task 1 --merge --plan scene.farm/farm.json", 0),
        ("farm task 0 --plan scene.farm/farm.json", 64),
        ("farm task 3 --plan scene.farm/farm.json", 64),
        ("farm task 2 --merge --plan scene.farm/farm.json", 64),
        ("farm task 1 --plan absent.json", 66),
        ("farm task 1 --plan scene.glb", 65),
    ] {
        expect(&site.folder, line, code);
    }
    // Whatever a plan says, its tasks render and its merges merge.
    let good = read_json(&plan);
    for command in [vec![], vec!["touch"], vec!["touch", "X"], vec!["bismar", "farm", "task", "1"]]
        .into_iter()
        .chain(["--on-checkpoint=touch X", "--tev=localhost:1"].map(|flag| vec!["bismar", "render", "scene.glb", flag]))
    {
        let mut bad = good.clone();
        bad["tasks"][0]["command"] = command.into();
        fs::write(&plan, bad.to_string()).unwrap();
        expect(&site.folder, "farm task 1 --plan scene.farm/farm.json", 65);
        site.assert_nothing_ran();
    }
}

/// Kills a task, and waits until nobody renders its output any more.
fn kill_with_its_render(mut task: Child, output: &Path) {
    task.kill().unwrap();
    task.wait().unwrap();
    until(|| writer(output).is_none());
}

/// Hours of work, on one tile after the other.
const ENDLESS: &str = "--size 64x48 --spp 1000000000 -o out.exr";

#[test]
fn twenty_preemptions_with_progress_hold_nothing_and_three_in_a_row_without_do() {
    let site = Site::new("shots");
    let output = site.folder.join("out.exr");
    let log = || fs::read_to_string(site.folder.join("scene.farm/logs/task-1.log")).unwrap_or_default();
    let saved = || if output.exists() { paths(&output) } else { 0 };
    site.submit_only(&format!("scene.glb -- {ENDLESS}"));
    // Nothing is saved yet when it is killed.
    let fruitless = || {
        let mut child = site.begin();
        until_alive(&mut child, || writer(&output).is_some());
        kill_with_its_render(child, &output);
    };
    for preemption in 0..20 {
        let (before, said) = (saved(), log().len());
        let mut child = site.begin();
        until_alive(&mut child, || log()[said..].contains("PROGRESS"));
        signal(&child, "-TERM");
        assert_eq!(child.wait().unwrap().code(), Some(75), "{preemption}: {}", log());
        assert!(saved() > before);
        if preemption % 5 == 2 {
            (0..2).for_each(|_| fruitless());
        }
    }
    (0..3).for_each(|_| fruitless());
    assert_eq!(site.begin().wait().unwrap().code(), Some(76), "{}", log());
    site.assert_state("held", "3 times in a row");
}

#[test]
fn a_task_that_is_killed_takes_its_render_along_and_is_counted() {
    let site = Site::new("shots");
    let output = site.folder.join("out.exr");
    site.submit_only(&format!("scene.glb -- {ENDLESS} --checkpoint 9999"));
    site.assert_state("waiting", "");
    for session in 1..=3 {
        let mut child = site.begin();
        until_alive(&mut child, || writer(&output).is_some() && site.sessions()["begun"] == session);
        let render = writer(&output).unwrap();
        assert_eq!(parent(render), child.id());
        site.assert_state("running", "");
        kill_with_its_render(child, &output);
    }
    // Its last sign of life is long ago.
    let record = fs::File::options().append(true).open(site.folder.join("scene.farm/logs/task-1.json")).unwrap();
    record.set_modified(SystemTime::now() - Duration::from_secs(600)).unwrap();
    site.assert_state("dead", "");
    assert_eq!(site.begin().wait().unwrap().code(), Some(76));
    site.assert_state("held", "3 times in a row");
}

#[test]
fn a_task_out_of_memory_is_begun_again_once_with_more_and_then_held() {
    let site = Site::new("shots");
    let output = site.folder.join("out.exr");
    site.submit_only(&format!("scene.glb --retry-memory -- {ENDLESS}"));
    // As the system does when a task's memory is used up: one process dies, the largest.
    let starve = |memory| {
        let mut child = site.begin_with(memory);
        until_alive(&mut child, || writer(&output).is_some());
        kill(writer(&output).unwrap());
        child.wait().unwrap().code()
    };
    let calls = || fs::read_to_string(site.file("calls")).unwrap();
    // A second time where Slurm has ended it before it heard how much.
    for _ in 0..2 {
        assert_eq!(starve(900), Some(75));
        let orders = "scontrol requeue 7_1\nscontrol update JobId=7_1 MinMemoryNode=1350\n";
        assert!(calls().ends_with(orders), "{}", calls());
        site.assert_state("begun", "out of memory (limit 900 MiB)");
    }
    assert_eq!(starve(1350), Some(76));
    assert!(calls().ends_with("scontrol requeuehold 7_1\n"), "{}", calls());
    site.assert_state("held", "its merge waits");
    assert_eq!(site.sessions()["out_of_memory"], true);
    // Nobody asked for more.
    fs::remove_dir_all(site.folder.join("scene.farm")).unwrap();
    site.submit_only(&format!("scene.glb -- {ENDLESS}"));
    assert_eq!(starve(900), Some(76));
    assert_eq!(calls().matches("MinMemoryNode").count(), 2);
}

/// A plan is not changed while its tasks wait or run, and two inputs have two folders.
#[test]
fn a_farm_in_use_keeps_its_plan() {
    let site = Site::new("shots");
    let refused = |line: &str, word: &str| {
        let said = site.submit(&words(line));
        assert_eq!(said.status.code(), Some(73), "{}", stderr(&said));
        assert!(stderr(&said).contains(word), "{}", stderr(&said));
    };
    let plan = || fs::read(site.folder.join("scene.farm/farm.json")).unwrap();
    site.submit_only("scene.glb -- --size 40x20 --spp 4");
    let first = plan();
    for said in ["RUNNING None", "PENDING Priority"] {
        fs::write(site.file("queue"), format!("7 1 {said}\n")).unwrap();
        refused("scene.glb -- --size 40x20 --spp 64", "1 tasks and 0 merges");
        // The same again: its task would find its output in use.
        refused("scene.glb -- --size 40x20 --spp 4", "queued or running");
        assert_eq!(plan(), first);
    }
    site.submit_only("scene.glb --folder other.farm -- --size 40x20 --spp 64");
    // Slurm holds it, or has ended it.
    for said in ["7 1 PENDING JobHeldUser\n", ""] {
        fs::write(site.file("queue"), said).unwrap();
        site.submit_only("scene.glb -- --size 40x20 --spp 64");
    }
    let first = plan();
    fs::write(site.folder.join("scene.toml"), "[[job]]\nscene = 'scene.glb'\nsize = '8x8'\n").unwrap();
    refused("scene.toml", "scene.glb: give this one another with --folder");
    assert_eq!(plan(), first);
    assert_eq!(site.submit(&["scene.toml", "--format", "openjd"]).status.code(), Some(73));
    site.submit_only("scene.toml --folder toml.farm");
}

#[test]
fn of_two_submissions_at_once_the_second_is_told_and_changes_nothing() {
    let site = Site::new("shots");
    // It answers once the second submission has ended, or has come as far as the first.
    let sbatch = "#!/bin/sh\necho >>\"$CALLS.begun\"\nwhile [ ! -e \"$CALLS.go\" ]; do sleep 0.02; done\necho 7\n";
    fs::write(site.file("bin/sbatch"), sbatch).unwrap();
    let submit = |spp: &str| {
        let mut command = site.farm();
        command.args(["submit", "scene.glb", "--", "--size", "40x20", "--spp", spp]).stderr(Stdio::piped());
        command.spawn().unwrap()
    };
    let begun = || fs::read(site.file("calls.begun")).map_or(0, |lines| lines.len());
    let plan = || fs::read(site.folder.join("scene.farm/farm.json")).unwrap();
    let mut first = submit("4");
    until_alive(&mut first, || begun() == 1);
    let before = plan();
    let mut second = submit("64");
    until(|| second.try_wait().unwrap().is_some() || begun() != 1);
    let after = plan();
    fs::write(site.file("calls.go"), "").unwrap();
    let (first, second) = (first.wait().unwrap(), second.wait_with_output().unwrap());
    assert!(first.success() && before == after);
    assert_eq!(second.status.code(), Some(73), "{}", stderr(&second));
    assert!(stderr(&second).contains("another bismar is writing it"), "{}", stderr(&second));
}

#[test]
fn status_asks_the_plan_and_not_the_file() {
    let site = Site::new("shots");
    let flags = "--parts 2 -- --size 40x20 -o out.exr --spp";
    let states = |of: &str| {
        let status = site.status();
        status[of].as_array().unwrap().iter().map(|s| s["state"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    site.submit_line(&format!("scene.glb {flags} 4"));
    site.assert_state("done", "");
    assert_eq!((states("tasks"), states("merges")), (vec!["done".into(); 2], vec!["done".into()]));
    // The same with a higher goal, which nobody begins: the parts have a sixteenth of it, and the picture is not it.
    site.submit_only(&format!("scene.glb {flags} 64"));
    site.assert_state("begun", "");
    assert_eq!(states("merges"), ["begun"]);
    assert_eq!(site.status()["fraction"], 4.0 / 64.0);
    // Another scene with the same outputs.
    fs::write(site.folder.join("scene.glb"), glb::thicket(3)).unwrap();
    site.assert_state("stale", "another render than the plan asks for");
    assert_eq!(states("merges"), ["stale"]);
    // Slurm knows better what happens to it now.
    for (said, state) in [("RUNNING None", "running"), ("PENDING Priority", "stale"), ("PENDING JobHeldUser", "held")] {
        fs::write(site.file("queue"), format!("7 1 {said}\n")).unwrap();
        site.assert_state(state, "");
    }
    fs::write(site.folder.join("scene.glb"), glb::triangle()).unwrap();
    fs::write(site.file("queue"), "7 1 PENDING Priority\n").unwrap();
    site.assert_state("waiting", "");
    // And without the file that it is made of, nobody can tell for certain.
    fs::remove_file(site.folder.join("scene.glb")).unwrap();
    site.assert_state("waiting", "scene.glb");
}

#[test]
fn parts_without_tiles_are_refused_before_anything_is_written() {
    let site = Site::new("shots");
    let batch =
        "[[job]]\nscene = 'scene.glb'\nsize = '99x99'\n[[job]]\nname = 'small'\nscene = 'scene.glb'\nsize = '8x8'\n";
    fs::write(site.folder.join("jobs.toml"), batch).unwrap();
    for (line, tiles) in [
        ("scene.glb --parts 2 -- --size 16x16", 1),
        ("scene.glb --parts 7 --dry-run -- --size 48x32", 6),
        ("scene.glb --parts 3 -- --size 160x160 --crop 10,10,20,12", 2),
        ("scene.glb --parts 2 -- --size 16x16 --turntable 3 -o v.#.exr", 1),
        ("scene.glb --parts 2041 -- --spp 1", 2040),
        ("jobs.toml --parts 2 --format plan", 1),
    ] {
        let said = site.refuses(64, &words(line));
        assert!(said.contains(&format!("{tiles} tiles")), "{line}: {said}");
    }
    assert!(!site.folder.join("scene.farm").exists() && !site.folder.join("jobs.farm").exists());
    site.submit_only("scene.glb --parts 6 -- --size 48x32 --spp 1");
}

#[test]
fn no_plan_makes_other_machines_run_programs() {
    let site = Site::new("shots");
    let said = site.refuses(64, &words("scene.glb -- --checkpoint 9 --on-checkpoint /bin/true"));
    assert!(said.contains("on-checkpoint"), "{said}");
    fs::write(site.folder.join("jobs.toml"), "[[job]]\nscene = 'scene.glb'\non-checkpoint = 'X'\n").unwrap();
    site.refuses(78, &["jobs.toml"]);
    site.submit_only("scene.glb -- --size 8x6 --spp 1");
    let plan = site.folder.join("scene.farm/farm.json");
    let text = fs::read_to_string(&plan).unwrap().replace("--resume", "--on-checkpoint=touch");
    fs::write(&plan, text).unwrap();
    expect(&site.folder, "farm task 1 --plan scene.farm/farm.json", 65);
}

#[test]
fn frames_on_a_farm_are_those_of_one_machine() {
    let site = Site::new("shots");
    let path = &site.folder;
    fs::write(path.join("moving.glb"), glb::moving()).unwrap();
    let flags = "--size 40x30 --spp 4 --fps 10";
    expect(path, &format!("render moving.glb --frames 1-5 {flags} -o whole/a.####.exr -q"), 0);
    for (parts, chunk, tasks) in [(1, 1, 5), (1, 2, 5), (2, 1, 10), (2, 3, 10)] {
        let out = format!("out-{parts}-{chunk}");
        let line = format!("moving.glb --parts {parts} --chunk {chunk} --folder f-{out} -- --frames 1-5 {flags}");
        site.submit_line(&format!("{line} -o {out}/a.####.exr --preview {out}/a.####.png"));
        for frame in 1..=5 {
            let name = format!("a.000{frame}.exr");
            assert_same_bits(&path.join("whole").join(&name), &path.join(&out).join(&name));
            assert!(path.join(&out).join(name.replace("exr", "png")).exists());
        }
        let status = status(path, &format!("f-{out}"));
        let rows = status["tasks"].as_array().unwrap();
        assert_eq!((rows.len(), &status["complete"]), (tasks, &true.into()), "{status:#}");
        assert_eq!(status["merges"].as_array().unwrap().len(), if parts > 1 { 5 } else { 0 });
        assert_eq!((&rows[0]["render"], &rows[0]["frame"]), (&"moving.0001".into(), &1.into()));
        let last = &rows[tasks - 1];
        assert_eq!((&last["render"], &last["task"]), (&"moving.0005".into(), &(5_u32.div_ceil(chunk) * parts).into()));
    }
    // From a batch file, with a frame that cannot be written.
    fs::create_dir_all(path.join("b/x.0002.exr")).unwrap();
    let file = "[[job]]\nscene = 'moving.glb'\nframes = '1-3'\nsize = '40x30'\nspp = 4\nfps = 10\n\
                output = 'b/x.####.exr'\n";
    fs::write(path.join("jobs.toml"), file).unwrap();
    site.submit_line("jobs.toml --chunk 3");
    let status = status(path, "jobs.farm");
    let states: Vec<_> = status["tasks"].as_array().unwrap().iter().map(|t| t["state"].clone()).collect();
    assert_eq!(states, ["done", "failed", "done"], "{status:#}");
    assert!(status["tasks"][1]["error"].as_str().unwrap().contains("0002"), "{status:#}");
    assert_same_bits(&path.join("whole/a.0003.exr"), &path.join("b/x.0003.exr"));
    for (line, why) in [("--frames 1-4 -o x.exr", "####"), ("--frames 4-1", "ends before")] {
        let said = site.submit(&words(&format!("moving.glb -- {line}")));
        assert_eq!(said.status.code(), Some(64));
        assert!(stderr(&said).contains(why), "{}", stderr(&said));
    }
}

#[test]
fn a_task_is_begun_once_and_its_plan_stays_and_a_merge_that_waits_can_be_stopped() {
    let path = &Folder::new().with("s.glb", glb::triangle());
    let submit = |spp: u32| {
        format!("farm submit s.glb --parts 2 --format plan --folder farm -- --size 64x64 --noise 1e-9 --spp {spp}")
    };
    expect(path, &submit(1 << 24), 0);
    let begin = |line: &[&str]| {
        bismar(path).args(["farm", "task", "1", "--plan", "farm/farm.json"]).args(line).spawn().unwrap()
    };
    let mut first = begin(&[]);
    until(|| status(path, "farm")["tasks"][0]["state"] == "running");
    expect(path, "farm task 1 --plan farm/farm.json", 73);
    assert_eq!(status(path, "farm")["tasks"][0]["state"], "running");
    expect(path, &submit(8), 73);
    signal(&first, "-TERM");
    assert_eq!(first.wait().unwrap().code(), Some(75));
    // It would wait for a minute for the second part, and then miss it (66).
    let mut merge = begin(&["--merge"]);
    let log = path.join("farm/logs/merge-1.json");
    until(|| log.exists());
    signal(&merge, "-TERM");
    assert_eq!(merge.wait().unwrap().code(), Some(75));
}
