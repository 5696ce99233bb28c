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

pub(super) const BASELINE: &str = "embree";

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

/// The rows of a scene on a machine.
pub(super) struct SceneRows<'a> {
    pub results: &'a Results,
    pub machine: &'a str,
    pub name: &'a str,
    pub triangles: u64,
}

pub(super) fn scenes(results: &Results) -> Vec<SceneRows<'_>> {
    let mut all: Vec<SceneRows> = Vec::new();
    for row in &results.builds {
        if !all.iter().any(|s| s.machine == row.machine && s.name == row.scene) {
            all.push(SceneRows { results, machine: &row.machine, name: &row.scene, triangles: row.triangles });
        }
    }
    all.sort_by_key(|s| s.triangles);
    all
}

impl<'a> SceneRows<'a> {
    pub(super) fn traces(&self) -> impl Iterator<Item = &'a Trace> {
        let (machine, name) = (self.machine, self.name);
        self.results.traces.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    pub(super) fn builds(&self) -> impl Iterator<Item = &'a Build> {
        let (machine, name) = (self.machine, self.name);
        self.results.builds.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    pub(super) fn agreements(&self) -> impl Iterator<Item = &'a Agreement> {
        let (machine, name) = (self.machine, self.name);
        self.results.agreements.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    pub(super) fn base_build(&self) -> Option<&'a Build> {
        self.builds().next()
    }

    /// Name of the scene, with the machine if there are several.
    pub(super) fn title(&self) -> String {
        let several = self.results.builds.iter().any(|b| b.machine != self.machine);
        if several { format!("{}, {}", self.name, self.machine) } else { self.name.to_owned() }
    }

    pub(super) fn file(&self) -> String {
        let machines = self.results.hosts.iter().map(|h| &h.machine).collect::<Vec<_>>();
        match machines.iter().position(|m| **m == self.machine) {
            None | Some(0) => self.name.to_owned(),
            Some(other) => format!("{}-machine{}", self.name, other + 1),
        }
    }
}

/// In the order in which they were measured, the baseline first.
pub(super) fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut all: Vec<&str> = Vec::new();
    for name in names {
        if !all.contains(&name) {
            all.push(name);
        }
    }
    all
}
