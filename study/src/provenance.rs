//! Program, command and machine of a measurement.

use std::collections::BTreeMap;
use std::fs;

use bismar::console;
use bismar::console::host::total_memory_bytes;
use serde::Serialize;

/// The object `run` in the JSON of every study.
#[derive(Debug, Clone, Serialize)]
pub struct Provenance {
    pub version: String,
    /// Commit of the program, if it is a release.
    pub commit: String,
    /// The words of the command line.
    pub command: Vec<String>,
    pub machine: Machine,
    /// First seed of each use; replica r adds r.
    pub seeds: BTreeMap<String, u32>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    pub cpu: String,
    /// Threads that can run at a time.
    pub cores: usize,
    pub memory_bytes: u64,
    pub kernel: String,
}

impl Provenance {
    pub fn now(seeds: &[(&str, u32)]) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: console::COMMIT.to_owned(),
            command: std::env::args().collect(),
            machine: Machine::look(),
            seeds: seeds.iter().map(|(name, seed)| ((*name).to_owned(), *seed)).collect(),
        }
    }
}

impl Machine {
    pub fn look() -> Self {
        let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
        let cpus = read("/proc/cpuinfo");
        let field = |line: &str| Some(line.strip_prefix("model name")?.trim().strip_prefix(':')?.trim().to_owned());
        Self {
            cpu: cpus.lines().find_map(field).unwrap_or_else(|| "unknown processor".to_owned()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: total_memory_bytes().unwrap_or(0),
            kernel: read("/proc/sys/kernel/osrelease").trim().to_owned(),
        }
    }
}
