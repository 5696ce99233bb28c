//! The program under test, and its pictures to the bit.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Output, Stdio};
use std::result::Result;
use std::thread;
use std::time::Duration;

use exr::prelude::*;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// A scene that ships with the project.
pub fn scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

/// A new folder for a test; removed when dropped.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// With one more file, in folders that are made for it.
    pub fn with(self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        let path = self.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
        self
    }

    /// With a copy of a scene that ships with the project.
    pub fn with_scene(self, name: &str, shipped: &str) -> Self {
        let bytes = fs::read(scene(shipped)).unwrap();
        self.with(name, bytes)
    }
}

impl Deref for Folder {
    type Target = Path;

    fn deref(&self) -> &Path {
        self.0.path()
    }
}

impl AsRef<Path> for Folder {
    fn as_ref(&self) -> &Path {
        self
    }
}

pub fn program() -> &'static Path {
    assert_cmd::cargo::cargo_bin!("bismar")
}

/// The program in a folder, one thread, without what the surroundings say about threads, memory and arrays of tasks.
pub fn bismar(folder: &Path) -> Command {
    let mut command = Command::new(program());
    command.current_dir(folder).env("BISMAR_THREADS", "1");
    for name in [
        "SLURM_CPUS_PER_TASK",
        "SLURM_MEM_PER_NODE",
        "SLURM_MEM_PER_CPU",
        "SLURM_RESTART_COUNT",
        "SLURM_ARRAY_TASK_ID",
        "SLURM_ARRAY_TASK_COUNT",
        "SLURM_ARRAY_TASK_MAX",
        "AWS_BATCH_JOB_ARRAY_INDEX",
        "JOB_COMPLETION_INDEX",
    ] {
        command.env_remove(name);
    }
    command
}

/// Sends signals, as in `-TERM` or `-HUP -TERM`. By the shell's own `kill`: small systems have no other.
#[track_caller]
pub fn signal(child: &Child, signals: &str) {
    let kill: String = signals.split(' ').map(|signal| format!("kill {signal} {};", child.id())).collect();
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs `bismar LINE`.
pub fn run(folder: &Path, line: &str) -> Output {
    bismar(folder).args(line.split_whitespace()).output().unwrap()
}

/// Runs `bismar LINE`, expects an exit code, and returns stderr.
#[track_caller]
pub fn expect(folder: &Path, line: &str, code: i32) -> String {
    both(folder, line, code).1
}

/// The same for stdout.
#[track_caller]
pub fn stdout(folder: &Path, line: &str, code: i32) -> String {
    both(folder, line, code).0
}

#[track_caller]
fn both(folder: &Path, line: &str, code: i32) -> (String, String) {
    let output = run(folder, line);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "bismar {line}\n{text}");
    (String::from_utf8(output.stdout).unwrap(), text)
}

/// The same, and these words must be on stderr.
#[track_caller]
pub fn says(folder: &Path, line: &str, code: i32, words: &str) {
    let text = expect(folder, line, code);
    assert!(text.contains(words), "bismar {line}: no '{words}' in\n{text}");
}

/// A render whose messages are read while it goes on.
pub struct Running {
    child: Child,
    stderr: BufReader<ChildStderr>,
    /// What it has said so far.
    pub said: String,
}

impl Running {
    /// Starts `bismar LINE`.
    pub fn start(folder: &Path, line: &str) -> Self {
        let mut command = bismar(folder);
        command.args(line.split_whitespace()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        Self { child, stderr, said: String::new() }
    }

    /// Reads on until it has said these words.
    #[track_caller]
    pub fn until(&mut self, words: &str) {
        while !self.said.contains(words) {
            self.next_line();
        }
    }

    #[track_caller]
    pub fn next_line(&mut self) {
        assert_ne!(self.stderr.read_line(&mut self.said).unwrap(), 0, "it ended by itself:\n{}", self.said);
    }

    /// Sends signals as [`signal`] does, and waits for the end: the exit code, and all that was said.
    #[track_caller]
    pub fn end(mut self, by: &str) -> (Option<i32>, String) {
        signal(&self.child, by);
        self.stderr.read_to_string(&mut self.said).unwrap();
        (self.child.wait().unwrap().code(), self.said)
    }

    /// Sends a signal, and as soon as it `has` done something because of it again and again, until it ends.
    pub fn end_by_many(mut self, by: &str, has: impl Fn() -> bool) -> ExitStatus {
        signal(&self.child, by);
        loop {
            match self.child.try_wait().unwrap() {
                Some(status) => return status,
                None if has() => signal(&self.child, by),
                None => {}
            }
            thread::sleep(Duration::from_millis(20));
        }
    }
}

#[track_caller]
pub fn read_json(path: &Path) -> serde_json::Value {
    let bytes = fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_slice(&bytes).unwrap()
}

/// The values of a channel.
#[track_caller]
pub fn channel(path: &Path, name: &str) -> Vec<f32> {
    let found = bits(path).into_iter().find(|(own, _)| own == name);
    let (_, values) = found.unwrap_or_else(|| panic!("{} has no {name}", path.display()));
    values.into_iter().map(f32::from_bits).collect()
}

/// Every channel of the picture's first part, as bits.
pub fn bits(path: &Path) -> Vec<(String, Vec<u32>)> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let channel = |c: &AnyChannel<FlatSamples>| {
        let bits = match &c.sample_data {
            FlatSamples::F32(values) => values.iter().map(|x| x.to_bits()).collect(),
            FlatSamples::U32(values) => values.clone(),
            FlatSamples::F16(_) => panic!("half floats"),
        };
        (c.name.to_string(), bits)
    };
    image.layer_data.channel_data.list.iter().map(channel).collect()
}

/// Are two pictures the same in every bit of every channel?
#[track_caller]
pub fn assert_same_bits(a: &Path, b: &Path) {
    let (ours, theirs) = (bits(a), bits(b));
    assert!(!ours.is_empty() && ours.iter().all(|(_, bits)| !bits.is_empty()));
    for ((name, ours), (other, theirs)) in ours.iter().zip(&theirs) {
        assert_eq!(name, other);
        let differing = ours.iter().zip(theirs).filter(|(a, b)| a != b).count();
        assert_eq!(
            differing,
            0,
            "{name}: {differing} of {} pixels differ, {} and {}",
            ours.len(),
            a.display(),
            b.display()
        );
    }
    assert_eq!(ours.len(), theirs.len());
}

pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A header attribute of a picture that the program wrote.
pub fn attribute(path: &Path, name: &str) -> String {
    use bismar::film::exr_file::{HeaderValue, read_header};
    let header = read_header(path).unwrap_or_else(|e| panic!("{e}"));
    match header.into_iter().find(|(n, _)| n == name) {
        Some((_, HeaderValue::Text(text))) => text,
        Some((_, HeaderValue::Number(x))) => x.to_string(),
        Some((_, HeaderValue::Matrix(m))) => format!("{m:?}"),
        None => panic!("{} has no {name}", path.display()),
    }
}

/// Tries every number below `n` on two threads: what came of each, or a failure with all that went wrong.
#[track_caller]
pub fn try_all<T: Send>(n: usize, attempt: impl Fn(usize) -> Result<T, String> + Sync) -> Vec<T> {
    let attempt = |i| attempt(i).map_err(|e| format!("number {i}: {e}"));
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let outcomes: Vec<_> = threads.install(|| (0..n).into_par_iter().map(attempt).collect());
    let failures: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().err().cloned()).collect();
    assert!(failures.is_empty(), "{} failures:\n{}", failures.len(), failures.join("\n"));
    outcomes.into_iter().flatten().collect()
}

/// Makes a changed picture's seal right again, as a forger would.
pub fn seal(file: &mut [u8]) {
    let place = b"bismar.seal\0string\0\x51\0\0\0";
    let at = file.windows(place.len()).position(|w| w == place).unwrap() + place.len();
    file[at..at + 81].copy_from_slice(format!("{:016}-{:064}", 0, 0).as_bytes());
    let seal = format!("{:016}-{}", file.len(), blake3::hash(file).to_hex());
    file[at..at + 81].copy_from_slice(seal.as_bytes());
}

/// Paths that a picture holds.
pub fn paths(path: &Path) -> u64 {
    let samples: serde_json::Value = serde_json::from_str(&attribute(path, "bismar.samples")).unwrap();
    samples["paths"].as_u64().unwrap()
}
