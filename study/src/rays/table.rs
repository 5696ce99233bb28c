//! The tables of a study (`docs/study-rays.md` describes every column).

use std::path::Path;

use bismar::Result;
use serde::{Deserialize, Serialize};

use super::agree::Tally;
use super::host::Host;
use crate::files;
use crate::provenance::Provenance;

/// Rises when a column changes its meaning or is removed.
const SCHEMA: u32 = 2;

pub(super) const BASELINE: &str = "embree";

/// All tables, as in `results.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    pub schema: u32,
    pub version: String,
    pub rounds: usize,
    pub runs: Vec<Provenance>,
    pub hosts: Vec<Host>,
    pub traces: Vec<Trace>,
    pub builds: Vec<Build>,
    pub pictures: Vec<Picture>,
    pub agreements: Vec<Agreement>,
    /// Failed measurements and unexplained differences, as sentences.
    pub notes: Vec<String>,
}

/// Speed of a backend on a stream.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Trace {
    pub machine: String,
    pub scene: String,
    pub shape: Option<String>,
    pub triangles: u64,
    pub backend: String,
    pub stream: String,
    pub rays: u64,
    pub hit_share: f64,
    pub rounds: usize,
    pub mrays_per_second: f64,
    pub mrays_spread: f64,
    pub speed_ratio: f64,
    pub speed_ratio_se: f64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Build {
    pub machine: String,
    pub scene: String,
    pub shape: Option<String>,
    pub triangles: u64,
    pub built_triangles: u64,
    pub backend: String,
    pub version: String,
    pub isa: String,
    pub builds: usize,
    pub threads: usize,
    pub wall_seconds: f64,
    pub cpu_seconds: f64,
    pub cpu_seconds_spread: f64,
    pub one_thread_seconds: Option<f64>,
    pub bytes_per_triangle: f64,
    pub peak_bytes_per_triangle: Option<f64>,
    pub peak_process_bytes_per_triangle: f64,
}

/// Pictures by a backend against pictures by the baseline.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Picture {
    pub machine: String,
    pub scene: String,
    pub backend: String,
    pub pixels: u64,
    pub spp: u32,
    pub rounds: usize,
    pub build_cpu_seconds: f64,
    pub cpu_seconds_per_spp: f64,
    pub speed_ratio: f64,
    pub speed_ratio_se: f64,
    pub crossover_spp: Option<f64>,
    pub bias_z: f64,
}

/// Whether a backend hits what the baseline hits.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Agreement {
    pub machine: String,
    pub scene: String,
    pub backend: String,
    pub stream: String,
    pub rays: u64,
    pub same: u64,
    pub edge: u64,
    pub coplanar: u64,
    pub grazing: u64,
    pub self_hit: u64,
    pub alpha: u64,
    pub miss: u64,
    pub unexplained: u64,
}

impl Agreement {
    pub fn new([machine, scene, backend, stream]: [&str; 4], counts: Tally) -> Self {
        let [machine, scene, backend, stream] = [machine, scene, backend, stream].map(str::to_owned);
        let rays = counts.iter().sum();
        let [same, edge, coplanar, grazing, self_hit, alpha, miss, unexplained] = counts;
        Self {
            machine,
            scene,
            backend,
            stream,
            rays,
            same,
            edge,
            coplanar,
            grazing,
            self_hit,
            alpha,
            miss,
            unexplained,
        }
    }
}

/// |z| of a picture's mean above which pictures differ. False alarms: one in thirty studies of a thousand pictures.
const MAX_Z: f64 = 5.0;

impl Results {
    /// Nothing yet, measured on `host`.
    pub fn new(host: Host, rounds: usize) -> Self {
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            rounds,
            // Pictures of a round have the next two.
            runs: vec![Provenance::now(&[("streams", 0), ("pictures", 1), ("shapes", 1)])],
            hosts: vec![host],
            traces: Vec::new(),
            builds: Vec::new(),
            pictures: Vec::new(),
            agreements: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Hits whose difference nothing explains.
    pub fn unexplained(&self) -> u64 {
        self.agreements.iter().map(|a| a.unexplained).sum()
    }

    /// Pictures that differ by more than noise.
    pub(crate) fn differing_pictures(&self) -> usize {
        self.pictures.iter().filter(|p| p.bias_z.abs() > MAX_Z).count()
    }

    /// Writes `results.json` and a CSV file a table.
    pub fn write(&self, folder: &Path) -> Result<()> {
        files::write_json(&folder.join("results.json"), self)?;
        macro_rules! write {
            ($($table:ident)*) => {
                $(files::write_csv(&folder.join(concat!(stringify!($table), ".csv")), &self.$table)?;)*
            };
        }
        write!(traces builds pictures agreements);
        Ok(())
    }
}

/// Names and triangles of the scenes, by size.
pub(super) fn scenes(results: &Results) -> Vec<(&str, u64)> {
    let mut all = distinct(results.builds.iter().map(|row| (&*row.scene, row.triangles)));
    all.sort_by_key(|(_, triangles)| *triangles);
    all
}

/// Each once, in the order in which they were measured, the baseline first.
pub(super) fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut all = Vec::new();
    for value in values {
        if !all.contains(&value) {
            all.push(value);
        }
    }
    all
}
