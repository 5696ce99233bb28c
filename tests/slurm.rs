//! A real Slurm of two nodes on this machine: whatever happens to tasks, the picture is that of a single machine.

use std::collections::BTreeSet;
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use crate::helpers::farm::{HOSTILE, absent, folder, kill, parent, status, succeeds, writer};
use crate::helpers::glb;
use crate::helpers::program::{self, Folder, assert_same_bits, bismar, expect, paths};
use crate::reliability::said_to_need;

/// So long nothing happens only where something hangs: no new path in a picture, no task in a state that is new to it.
/// Slurm itself lets seconds go by before it begins a task again, and a busy machine makes minutes of them.
const PATIENCE: Duration = Duration::from_secs(600);

#[test]
fn whatever_happens_to_tasks_the_picture_is_that_of_a_single_machine() {
    let path = format!("{}:/usr/sbin:/sbin", std::env::var("PATH").unwrap_or_default());
    let has = |program: &str| std::env::split_paths(&path).any(|folder| folder.join(program).exists());
    if let Some(missing) = ["sbatch", "slurmctld", "slurmd", "munged"].into_iter().find(|p| !has(p)) {
        return absent(&format!("{missing} is not installed (Debian: slurmctld slurmd slurm-client munge)"));
    }
    let work = measured_work();
    let scenarios: [(&str, Scenario); _] = [
        ("two nodes", an_array_over_two_nodes_and_its_merge_are_the_single_machines_picture),
        ("frames", frames_over_two_nodes_outlive_kill_9),
        ("dead node", a_task_whose_node_dies_goes_on_at_the_other_one),
        ("requeue and cancel", a_requeued_task_and_a_cancelled_job_go_on),
        ("time limit", a_task_longer_than_its_time_limit_ends_all_the_same),
        ("failed task", a_failed_task_cancels_its_own_merge_and_no_other),
        ("hostile names", names_are_data_to_slurm_too),
        ("out of memory", a_task_out_of_memory_gets_more_or_is_held_and_its_merge_waits),
        ("killed for memory", a_task_killed_for_want_of_memory_is_begun_again),
    ];
    // All at once, whatever the number of CPUs: they spend most of their time waiting for Slurm to begin a task again.
    thread::scope(|scope| {
        for (name, scenario) in scenarios {
            let work = &work;
            let timed = move || {
                let start = Instant::now();
                let stepped_in = work.iter().any(|flags| scenario(&Slurm::start(), flags));
                assert!(stepped_in, "it was over before anything happened to it: a longer render is wanted");
                println!("{name}: {:.0} s", start.elapsed().as_secs_f64());
            };
            thread::Builder::new().name(name.into()).spawn_scoped(scope, timed).unwrap();
        }
    });
}

/// Given the flags of a render, on a Slurm of its own: false where it was over before the scenario could step in.
type Scenario = fn(&Slurm, &str) -> bool;

/// Flags of renders of `veach.glb` that take several seconds on two free CPUs, whatever the machine: long enough to step
/// in, and for a limit of three. The second takes longer, where the first was over before anybody stepped in: a machine
/// that was busy when it was measured may be free later.
fn measured_work() -> [String; 2] {
    const SPP: f64 = 32.0;
    const SIZE: &str = "--size 192x128";
    let folder = folder();
    // Processor time, which a busy machine does not change.
    let line = format!("\"$0\" render veach.glb {SIZE} --spp {SPP} --threads 2 -q && times");
    let mut shell = Command::new("sh");
    shell.args(["-c", &line]).arg(program::program()).current_dir(&folder);
    let said = succeeds(shell);
    // The second line is of the shell's children, user and system: "0m1.250s 0m0.040s".
    let times = said.lines().nth(1).unwrap().split(' ').map(|time| {
        let (minutes, seconds) = time.split_once('m').unwrap();
        60.0 * minutes.parse::<f64>().unwrap() + seconds.trim_end_matches('s').parse::<f64>().unwrap()
    });
    let second = SPP / times.sum::<f64>().max(0.01);
    // In whole passes.
    [16.0, 96.0].map(|seconds| format!("{SIZE} --spp {}", (seconds * second / 128.0).ceil() * 128.0))
}

/// Two nodes of two CPUs, with everything of theirs in one folder; down when dropped. And a folder with `veach.glb` for
/// their tasks.
struct Slurm {
    folder: Folder,
    port: u16,
    work: Folder,
}

impl Slurm {
    fn start() -> Self {
        let slurm = Self { folder: Folder::new(), port: free_ports(), work: folder() };
        succeeds(slurm.script(&["start", "2", "2"]));
        slurm
    }

    fn script(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new("bash");
        command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/slurm/start-slurm.sh")).args(arguments);
        command.env("SLURM_CI", &*self.folder).env("CTLD_PORT", self.port.to_string());
        command
    }

    fn conf(&self) -> PathBuf {
        self.folder.join("slurm.conf")
    }

    fn ask(&self, line: &str) -> String {
        let mut words = line.split(' ');
        let mut command = Command::new(words.next().unwrap());
        command.args(words).env("SLURM_CONF", self.conf());
        succeeds(command)
    }

    /// `bismar farm submit`: job numbers, in order.
    fn submit(&self, folder: &Path, line: &str) -> Vec<String> {
        let mut command = bismar(folder);
        // Tasks inherit this: they are to see what Slurm gives them.
        command.env_remove("BISMAR_THREADS").env("SLURM_CONF", self.conf());
        let output = command.args(["farm", "submit"]).args(line.split(' ')).output().unwrap();
        let said = program::stderr(&output);
        assert!(output.status.success(), "{said}");
        let ids = said.lines().filter_map(|line| line.split_once(": job ")).map(|(_, id)| id.to_owned());
        ids.collect()
    }

    /// What Slurm says of a job, or of all (""). On a busy machine its controller may be too late with an answer.
    fn show(&self, job: &str) -> String {
        for _ in 0..20 {
            let mut question = Command::new("scontrol");
            question.args(["-o", "show", "job"]).args(job.split_whitespace()).env("SLURM_CONF", self.conf());
            let answer = question.output().unwrap();
            if answer.status.success() {
                return String::from_utf8_lossy(&answer.stdout).into_owned();
            }
            println!("{question:?}: {} {}", answer.status, program::stderr(&answer));
            thread::sleep(Duration::from_secs(1));
        }
        panic!("Slurm does not answer");
    }

    /// A value of each of a job's tasks, such as `NodeList`.
    fn values(&self, job: &str, key: &str) -> Vec<String> {
        let text = self.show(job);
        let value = |line: &str| {
            let word = line.split(' ').find(|word| word.split('=').next() == Some(key))?;
            Some(word.split_once('=')?.1.to_owned())
        };
        text.lines().filter_map(value).collect()
    }

    /// The nodes of a job's tasks that have begun.
    fn nodes(&self, job: &str) -> BTreeSet<String> {
        self.values(job, "NodeList").into_iter().filter(|node| node.starts_with('n')).collect()
    }

    fn state(&self, job: &str) -> Vec<String> {
        self.values(job, "JobState")
    }

    /// Waits until all tasks of a job are in one of these states.
    fn wait_for(&self, job: &str, states: &[&str]) {
        self.wait(&format!("job {job} is {states:?}"), || {
            self.state(job).iter().all(|state| states.contains(&state.as_str()))
        });
    }

    #[track_caller]
    fn wait(&self, what: &str, mut holds: impl FnMut() -> bool) {
        let (mut since, mut states, mut most) = (Instant::now(), BTreeSet::new(), 0);
        while !holds() {
            let known = states.len();
            let (now, paths) = self.look();
            states.extend(now);
            if states.len() > known || paths > most {
                (since, most) = (Instant::now(), most.max(paths));
            }
            if since.elapsed() > PATIENCE {
                let logs = fs::read_dir(self.work.join("veach.farm/logs")).into_iter().flatten();
                let logs = logs.map(|log| fs::read_to_string(log.unwrap().path()).unwrap_or_default());
                let logs = logs.collect::<Vec<_>>().join("\n");
                panic!("nothing has moved for {PATIENCE:?}: {what}\n{}\n{logs}", self.show(""));
            }
            thread::sleep(Duration::from_millis(200));
        }
    }

    /// States of tasks, in Slurm's words, and the paths that all pictures have together.
    fn look(&self) -> (Vec<String>, u64) {
        let word = |line: &str, key: &str| line.split(' ').find(|word| word.starts_with(key)).map(str::to_owned);
        let state = |job: &str| Some(word(job, "JobId=")? + &word(job, "JobState=")?);
        let states = self.show("").lines().filter_map(state).collect();
        let mut paths = 0;
        let mut folders = vec![self.work.to_path_buf()];
        while let Some(folder) = folders.pop() {
            for file in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
                if file.is_dir() {
                    folders.push(file);
                } else if file.extension().is_some_and(|extension| extension == "exr") {
                    paths += program::paths(&file);
                }
            }
        }
        (states, paths)
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // Jobs first: they outlive the daemons.
        let _ =
            Command::new("scancel").args(["--me", "--signal=KILL", "--full"]).env("SLURM_CONF", self.conf()).status();
        let _ = self.script(&["stop"]).output();
    }
}

/// Three ports in a row that nobody listens on.
fn free_ports() -> u16 {
    for _ in 0..100 {
        let first = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = first.local_addr().unwrap().port();
        if (1..=2).all(|i| port.checked_add(i).is_some_and(|p| TcpListener::bind(("127.0.0.1", p)).is_ok())) {
            return port;
        }
    }
    panic!("no three free ports in a row");
}

/// The single machine's picture, `whole.exr`.
fn single_machine(folder: &Path, flags: &str) -> PathBuf {
    expect(folder, &format!("render veach.glb {flags} -o whole.exr -q --threads 2"), 0);
    folder.join("whole.exr")
}

/// Percents that a task's log tells, in order.
fn percents(folder: &Path) -> Vec<u32> {
    let log = fs::read_to_string(folder.join("veach.farm/logs/task-1.log")).unwrap();
    log.lines().filter_map(|line| line.strip_prefix("PROGRESS: ")?.strip_suffix('%')?.parse().ok()).collect()
}

/// Nowhere does a log fall back to the beginning: what was interrupted went on from what was saved.
#[track_caller]
fn assert_went_on(folder: &Path) {
    let percents = percents(folder);
    let restarts = percents.windows(2).filter(|pair| pair[1] < pair[0]);
    assert!(percents.last() == Some(&100), "{percents:?}");
    for pair in restarts {
        assert!(pair[1] > 0 && pair[0] - pair[1] <= pair[0] / 2 + 15, "it began anew: {percents:?}");
    }
}

fn an_array_over_two_nodes_and_its_merge_are_the_single_machines_picture(slurm: &Slurm, _: &str) -> bool {
    let folder = &slurm.work;
    let flags = "--size 160x120 --spp 256 --aov all";
    let whole = single_machine(folder, flags);
    let line = format!("veach.glb --parts 6 --cpus 2 -- {flags} -o out.exr --preview out.png");
    let jobs = slurm.submit(folder, &line);
    let [array, merge] = &jobs[..] else { panic!("{jobs:?}") };
    slurm.wait_for(merge, &["COMPLETED"]);
    assert_eq!(slurm.nodes(array), ["n1", "n2"].map(Into::into).into());
    assert_same_bits(&whole, &folder.join("out.exr"));
    assert!(folder.join("out.png").exists());
    let status = status(folder, "veach.farm");
    assert_eq!((&status["complete"], &status["fraction"]), (&true.into(), &1.0.into()));

    // The same command again does nothing twice.
    let before: Vec<_> = status["tasks"].as_array().unwrap().iter().map(modified).collect();
    let jobs = slurm.submit(folder, &line);
    slurm.wait_for(&jobs[1], &["COMPLETED"]);
    let after: Vec<_> = status["tasks"].as_array().unwrap().iter().map(modified).collect();
    assert_eq!(before, after);
    assert_same_bits(&whole, &folder.join("out.exr"));
    true
}

fn frames_over_two_nodes_outlive_kill_9(slurm: &Slurm, _: &str) -> bool {
    let folder = &slurm.work;
    fs::write(folder.join("moving.glb"), glb::moving()).unwrap();
    let flags = "--frames 1-8 --size 160x120 --spp 256 --fps 10 --shutter -1,1 --sky --aov velocity";
    expect(folder, &format!("render moving.glb {flags} -o whole/a.##.exr -q --threads 2"), 0);
    let line = format!("moving.glb --chunk 2 --cpus 2 -- {flags} --checkpoint 0.1 -o out/a.##.exr");
    let jobs = slurm.submit(folder, &line);
    let there = |frame: u32| folder.join(format!("out/a.{frame:02}.exr")).exists();
    slurm.wait("a frame is there", || (1..=8).any(there));
    slurm.ask(&format!("scancel --signal=KILL --full {}", jobs[0]));
    let mut nodes = slurm.nodes(&jobs[0]);
    slurm.wait_for(&jobs[0], &["FAILED", "CANCELLED", "COMPLETED", "NODE_FAIL"]);
    let jobs = slurm.submit(folder, &line);
    slurm.wait_for(&jobs[0], &["COMPLETED"]);
    nodes.extend(slurm.nodes(&jobs[0]));
    assert_eq!(nodes, ["n1", "n2"].map(Into::into).into());
    for frame in 1..=8 {
        let name = format!("a.{frame:02}.exr");
        assert_same_bits(&folder.join("whole").join(&name), &folder.join("out").join(&name));
    }
    true
}

fn modified(task: &serde_json::Value) -> std::time::SystemTime {
    fs::metadata(task["output"].as_str().unwrap()).unwrap().modified().unwrap()
}

/// Did the node die before the render was finished?
fn a_task_whose_node_dies_goes_on_at_the_other_one(slurm: &Slurm, flags: &str) -> bool {
    let folder = &slurm.work;
    let output = folder.join("out.exr");
    let line = format!("veach.glb --cpus 2 -- {flags} --checkpoint 0.5 -o out.exr");
    let jobs = slurm.submit(folder, &line);
    slurm.wait("a picture is saved", || output.exists());
    let node = slurm.values(&jobs[0], "NodeList").remove(0);
    // As a power cut does it: the daemon, Slurm's keeper of the task, the task, and its render.
    let Some(render) = writer(&output) else { return false };
    let task = parent(render);
    let keeper = parent(task);
    succeeds(slurm.script(&["kill-node", &node[1..]]));
    [keeper, task, render].into_iter().for_each(kill);
    let saved = paths(&output);
    let whole = single_machine(folder, flags);
    if saved == paths(&whole) {
        return false;
    }
    slurm.wait_for(&jobs[0], &["COMPLETED"]);
    assert_eq!(slurm.values(&jobs[0], "Restarts"), ["1"]);
    assert_ne!(slurm.values(&jobs[0], "NodeList"), [node]);
    // Nothing that was saved is rendered again.
    let percents = percents(folder);
    let again = percents.windows(2).find(|pair| pair[1] < pair[0]).map(|pair| u64::from(pair[1]));
    assert!(again.is_none_or(|again| again >= 100 * saved / paths(&whole)), "{saved} paths were saved: {percents:?}");
    assert_same_bits(&whole, &output);
    true
}

/// Was the job requeued and cancelled before it was finished?
fn a_requeued_task_and_a_cancelled_job_go_on(slurm: &Slurm, flags: &str) -> bool {
    let folder = &slurm.work;
    let output = folder.join("out.exr");
    let line = format!("veach.glb --cpus 2 -- {flags} --checkpoint 0.5 -o out.exr");
    let jobs = slurm.submit(folder, &line);
    slurm.wait("a picture is saved", || output.exists());
    if slurm.state(&jobs[0]) == ["COMPLETED"] {
        return false;
    }
    slurm.ask(&format!("scontrol requeue {}", jobs[0]));
    let state = || slurm.state(&jobs[0]).remove(0);
    let again = || slurm.values(&jobs[0], "Restarts") == ["1"];
    slurm.wait("it runs again", || again() && ["RUNNING", "COMPLETED"].contains(&state().as_str()));
    let before = percents(folder).len();
    slurm.wait("it goes on", || percents(folder).len() > before || state() == "COMPLETED");
    slurm.ask(&format!("scancel {}", jobs[0]));
    slurm.wait_for(&jobs[0], &["CANCELLED", "COMPLETED"]);
    if state() == "COMPLETED" {
        return false;
    }
    // Nobody begins it again but who submitted it.
    slurm.wait("it has ended", || {
        let log = fs::read_to_string(folder.join("veach.farm/logs/task-1.log")).unwrap();
        log.matches("continues from there").count() == 2
    });
    let unfinished = status(folder, "veach.farm");
    assert_eq!((&unfinished["complete"], &unfinished["tasks"][0]["state"]), (&false.into(), &"begun".into()));
    let jobs = slurm.submit(folder, &line);
    slurm.wait_for(&jobs[0], &["COMPLETED"]);
    assert_went_on(folder);
    assert_same_bits(&single_machine(folder, flags), &output);
    true
}

/// Did the limit interrupt the render?
fn a_task_longer_than_its_time_limit_ends_all_the_same(slurm: &Slurm, flags: &str) -> bool {
    let folder = &slurm.work;
    // A limit is a minute at least; signalled 57 seconds before it, a task has three.
    let line = format!("veach.glb --cpus 2 --minutes 1 --sbatch=--signal=B:TERM@57 -- {flags} -o out.exr");
    let jobs = slurm.submit(folder, &line);
    slurm.wait_for(&jobs[0], &["COMPLETED"]);
    let restarts: u32 = slurm.values(&jobs[0], "Restarts")[0].parse().unwrap();
    assert_went_on(folder);
    assert_same_bits(&single_machine(folder, flags), &folder.join("out.exr"));
    restarts > 0
}

fn a_failed_task_cancels_its_own_merge_and_no_other(slurm: &Slurm, _: &str) -> bool {
    let folder = &slurm.work;
    fs::write(folder.join("broken.glb"), b"glTF but not really").unwrap();
    let file = "[defaults]\nsize = '48x32'\nspp = 8\noutput = 'out/{name}.exr'\n\n[[matrix]]\n\
                scene = ['broken.glb', 'veach.glb']\n";
    fs::write(folder.join("jobs.toml"), file).unwrap();
    let jobs = slurm.submit(folder, "jobs.toml --parts 2");
    let [array, broken, whole] = &jobs[..] else { panic!("{jobs:?}") };
    slurm.wait_for(broken, &["CANCELLED"]);
    slurm.wait_for(whole, &["COMPLETED"]);
    slurm.wait_for(array, &["COMPLETED", "FAILED"]);
    let codes = slurm.values(array, "ExitCode");
    assert_eq!(codes.iter().filter(|code| *code == "65:0").count(), 2, "{codes:?}");
    let status = status(folder, "jobs.farm");
    assert_eq!(status["complete"], false);
    let message = status["tasks"][0]["error"].as_str().unwrap();
    assert!(message.contains("broken.glb"), "{message}");
    assert_eq!([0, 1].map(|i| status["merges"][i]["done"].clone()), [false, true]);
    expect(folder, "render veach.glb --size 48x32 --spp 8 -o whole.exr -q", 0);
    assert_same_bits(&folder.join("whole.exr"), &folder.join("out/veach.exr"));
    true
}

fn names_are_data_to_slurm_too(slurm: &Slurm, _: &str) -> bool {
    let flags = "--size 40x20 --spp 2";
    let whole = single_machine(&slurm.work, flags);
    let submitted = HOSTILE.map(|name| {
        let folder = slurm.work.join(name);
        fs::create_dir(&folder).unwrap();
        fs::copy(slurm.work.join("veach.glb"), folder.join("veach.glb")).unwrap();
        let jobs = slurm.submit(&folder, &format!("veach.glb --parts 2 -- {flags}"));
        (folder, jobs)
    });
    for (folder, jobs) in submitted {
        slurm.wait_for(&jobs[1], &["COMPLETED"]);
        assert_same_bits(&whole, &folder.join("veach.exr"));
        // Slurm's own log is there too, where Slurm can be given the place, and nowhere else.
        let logs = program::names(&folder.join("veach.farm/logs"));
        let own = format!("slurm-{}_", jobs[0]);
        let expected = if folder.to_str().unwrap().contains(['%', '\\']) { 0 } else { 2 };
        assert_eq!(logs.iter().filter(|log| log.starts_with(&own)).count(), expected, "{logs:?}");
    }
    let mut names = program::names(&slurm.work);
    names.retain(|name| !HOSTILE.contains(&name.as_str()));
    assert_eq!(names, ["veach.glb", "whole.exr"]);
    true
}

/// Mebibytes that a render says it needs.
fn need(folder: &Path, flags: &str) -> u64 {
    let line = format!("render veach.glb {flags} --part 1/2 --threads 1 --memory-limit 1M -o no.exr");
    said_to_need(&expect(folder, &line, 76))
}

/// A task's state and its merge's, as `farm status` tells them with Slurm's help.
fn states(slurm: &Slurm) -> [String; 2] {
    let mut status = bismar(&slurm.work);
    status.args(["farm", "status", "veach.farm", "--json"]).env("SLURM_CONF", slurm.conf());
    let status: serde_json::Value = serde_json::from_str(&succeeds(status)).unwrap();
    ["tasks", "merges"].map(|of| status[of][0]["state"].as_str().unwrap().to_owned())
}

fn a_task_out_of_memory_gets_more_or_is_held_and_its_merge_waits(slurm: &Slurm, _: &str) -> bool {
    let flags = "--size 960x640 --spp 2";
    let folder = &slurm.work;
    let need = need(folder, flags);
    let log = || fs::read_to_string(folder.join("veach.farm/logs/task-1.log")).unwrap_or_default();
    // Half as much again is enough.
    let line = |memory: u64| {
        let merge = 2 * need;
        format!(
            "veach.glb --parts 2 --cpus 1 --memory {memory}M --merge-memory {merge}M --retry-memory -- {flags} -o {memory}.exr"
        )
    };
    let jobs = slurm.submit(folder, &line(need * 3 / 4));
    slurm.wait_for(&jobs[1], &["COMPLETED"]);
    let raised = need * 3 / 4 + (need * 3 / 4).div_ceil(2);
    assert!(log().contains(&format!("Slurm requeues it with {raised} MiB")), "{}", log());
    assert_eq!(slurm.values(&format!("{}_1", jobs[0]), "MinMemoryNode"), [format!("{raised}M")]);
    let whole = single_machine(folder, flags);
    assert_same_bits(&whole, &folder.join(format!("{}.exr", need * 3 / 4)));

    // It is not: after the second try both wait for somebody who gives them more.
    fs::remove_dir_all(folder.join("veach.farm")).unwrap();
    let jobs = slurm.submit(folder, &line(need / 2));
    let [array, merge] = &jobs[..] else { panic!("{jobs:?}") };
    slurm.wait("it is held", || states(slurm) == ["held", "waiting"]);
    assert!(log().contains("Slurm requeues it with") && log().contains("Slurm holds it"), "{}", log());
    for task in [1, 2].map(|number| format!("{array}_{number}")) {
        slurm.wait("it is held", || {
            let reason = slurm.values(&task, "Reason").remove(0).to_lowercase();
            // While it completes, a release would be undone by the task's own request to hold it.
            slurm.state(&task) == ["PENDING"] && reason.contains("held")
        });
        slurm.ask(&format!("scontrol update JobId={task} MinMemoryNode={}", need * 9 / 8));
        slurm.ask(&format!("scontrol release {task}"));
    }
    slurm.wait_for(merge, &["COMPLETED"]);
    assert_same_bits(&whole, &folder.join(format!("{}.exr", need / 2)));
    true
}

/// Was a task killed, as the system does it for want of memory, before it was finished?
fn a_task_killed_for_want_of_memory_is_begun_again(slurm: &Slurm, flags: &str) -> bool {
    let folder = &slurm.work;
    let part = folder.join("veach.farm/parts/veach.1-of-2.exr");
    let line = format!("veach.glb --parts 2 --memory 700M --retry-memory -- {flags} --checkpoint 0.5 -o out.exr");
    let jobs = slurm.submit(folder, &line);
    let [array, merge] = &jobs[..] else { panic!("{jobs:?}") };
    let task = format!("{array}_1");
    let over = || slurm.state(&task) == ["COMPLETED"];
    slurm.wait("the task runs", || writer(&part).is_some() || over());
    let Some(render) = writer(&part) else { return false };
    kill(render);
    let log = || fs::read_to_string(folder.join("veach.farm/logs/task-1.log")).unwrap_or_default();
    slurm.wait("it is told", || log().contains("Slurm requeues it with 1050 MiB") || over());
    if !log().contains("1050 MiB") {
        return false;
    }
    slurm.wait_for(merge, &["COMPLETED"]);
    assert_eq!(slurm.values(&task, "MinMemoryNode"), ["1050M"]);
    assert_same_bits(&single_machine(folder, flags), &folder.join("out.exr"));
    true
}
