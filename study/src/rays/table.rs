//! The tables of a study (`docs/study-rays.md` describes every column).

use std::fs;
use std::path::Path;

use bismar::{Error, Result};
use serde::{Deserialize, Serialize};

use super::agree::{Class, Tally};
use super::host::Host;
use crate::files;
use crate::provenance::Provenance;

/// Rises when a column changes its meaning or is removed.
const SCHEMA: u32 = 1;

/// All tables, as in `results.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs, reason = "docs/study-rays.md")]
pub struct Results {
    pub schema: u32,
    pub version: String,
    pub rounds: usize,
    #[serde(default)]
    pub runs: Vec<Provenance>,
    pub hosts: Vec<Host>,
    pub traces: Vec<Trace>,
    pub builds: Vec<Build>,
    pub pictures: Vec<Picture>,
    pub scalings: Vec<Scaling>,
    pub agreements: Vec<Agreement>,
    /// Failed measurements and unexplained differences, as sentences.
    pub notes: Vec<String>,
}

/// Speed of a backend on a stream.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs, reason = "docs/study-rays.md")]
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
    #[serde(default)]
    pub instructions_per_ray: Option<f64>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs, reason = "docs/study-rays.md")]
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
#[allow(missing_docs, reason = "docs/study-rays.md")]
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

#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs, reason = "docs/study-rays.md")]
pub struct Scaling {
    pub machine: String,
    pub scene: String,
    pub backend: String,
    pub stream: String,
    pub threads: usize,
    pub speedup: f64,
    pub speedup_se: f64,
}

/// Whether a backend hits what the baseline hits.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[allow(missing_docs, reason = "docs/study-rays.md")]
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
    pub fn new([machine, scene, backend, stream]: [&str; 4], counts: &Tally) -> Self {
        Self {
            machine: machine.to_owned(),
            scene: scene.to_owned(),
            backend: backend.to_owned(),
            stream: stream.to_owned(),
            rays: counts.0.iter().sum(),
            same: counts.of(Class::Same),
            edge: counts.of(Class::Edge),
            coplanar: counts.of(Class::Coplanar),
            grazing: counts.of(Class::Grazing),
            self_hit: counts.of(Class::SelfHit),
            alpha: counts.of(Class::Alpha),
            miss: counts.of(Class::Miss),
            unexplained: counts.of(Class::Unexplained),
        }
    }
}

/// |z| of a picture's mean above which pictures differ. False alarms: one in thirty studies of a thousand pictures.
pub const MAX_Z: f64 = 5.0;

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
            scalings: Vec::new(),
            agreements: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Hits whose difference nothing explains.
    pub fn unexplained(&self) -> u64 {
        self.agreements.iter().map(|a| a.unexplained).sum()
    }

    /// Pictures that differ by more than noise.
    pub fn differing_pictures(&self) -> usize {
        self.pictures.iter().filter(|p| p.bias_z.abs() > MAX_Z).count()
    }

    /// Whether this machine measured a scene with all of these contenders.
    pub fn has(&self, machine: &str, scene: &str, contenders: &[String]) -> bool {
        let is = |b: &&Build| b.machine == machine && b.scene == scene;
        let there = self.builds.iter().filter(is).map(|b| &b.backend).collect::<Vec<_>>();
        !there.is_empty() && contenders.iter().all(|name| there.contains(&name))
    }

    /// Removes a machine's rows of a scene.
    pub fn forget(&mut self, machine: &str, scene: &str) {
        macro_rules! forget {
            ($($table:ident)*) => { $(self.$table.retain(|r| r.machine != machine || r.scene != scene);)* };
        }
        forget!(traces builds pictures scalings agreements);
    }

    /// Removes this study's own host if it measured nothing and there are others.
    pub fn forget_idle_host(&mut self) {
        if self.hosts.len() > 1 && self.hosts[0].spin_seconds.is_empty() {
            self.hosts.remove(0);
        }
    }

    /// Adds the results of another study, except for scenes that this one has of the same machine.
    pub fn merge(&mut self, other: Self) {
        let mine = self.builds.iter().map(|t| (t.machine.clone(), t.scene.clone())).collect::<Vec<_>>();
        let new = |machine: &str, scene: &str| !mine.iter().any(|(m, s)| m == machine && s == scene);
        macro_rules! merge {
            ($($table:ident)*) => {
                $(self.$table.extend(other.$table.into_iter().filter(|r| new(&r.machine, &r.scene)));)*
            };
        }
        merge!(traces builds pictures scalings agreements);
        self.runs.extend(other.runs);
        self.hosts.extend(other.hosts);
        self.notes.extend(other.notes);
    }

    /// Reads what [`write`](super::write) wrote.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = fs::read(path).map_err(|e| Error::reading(path, &e))?;
        let data = |what: String| Error::Data(format!("{}: {what}", path.display()));
        let results: Self = serde_json::from_slice(&bytes)
            .map_err(|e| data(format!("not the results.json of a study of rays by this version: {e}")))?;
        if results.schema != SCHEMA {
            return Err(data(format!("schema {}, this program writes {SCHEMA}", results.schema)));
        }
        Ok(results)
    }

    /// Writes `results.json` and a CSV file a table.
    pub fn write(&self, folder: &Path) -> Result<()> {
        files::write_json(&folder.join("results.json"), self)?;
        macro_rules! write {
            ($($table:ident)*) => {
                $(files::write_csv(&folder.join(concat!(stringify!($table), ".csv")), &self.$table)?;)*
            };
        }
        write!(traces builds pictures scalings agreements);
        Ok(())
    }
}
