//! The machine, and how steadily it runs.

use std::fs;
use std::hint::black_box;

use bismar::Result;
use bismar::console::host::pool;
use bismar::rays::cwbvh;
use rayon::ThreadPool;
use serde::Serialize;

use crate::provenance::Machine;

#[derive(Debug, Clone, Serialize)]
pub struct Host {
    pub machine: String,
    #[serde(flatten)]
    pub hardware: Machine,
    pub isa_baseline: String,
    pub embree: String,
    pub embree_isa: String,
    pub obvhs: String,
    pub flush_to_zero: bool,
    pub denormals_are_zero: bool,
    pub load_before: f64,
    pub load_after: f64,
    pub stolen_share: f64,
    #[serde(skip)]
    ticks: [u64; 2],
}

impl Host {
    /// Describes the machine. Must be called where rays will be traced, for the floating-point mode.
    fn look() -> Self {
        let hardware = Machine::look();
        let (least, denormal) = (black_box(f32::MIN_POSITIVE), black_box(f32::from_bits(1)));
        Self {
            machine: format!("{}, {} cores", hardware.cpu, hardware.cores),
            hardware,
            isa_baseline: cwbvh::ISA_BASELINE.to_owned(),
            embree: String::new(),
            embree_isa: String::new(),
            obvhs: cwbvh::VERSION.to_owned(),
            // A normal number halved is denormal; a denormal one times 2²⁴ is normal unless it counts as zero.
            flush_to_zero: black_box(least * black_box(0.5)) == 0.0,
            denormals_are_zero: black_box(denormal * black_box(16_777_216.0)) == 0.0,
            load_before: load(),
            load_after: load(),
            stolen_share: 0.0,
            ticks: ticks(),
        }
    }

    /// Notes the load and the share of stolen time by now.
    pub fn note(&mut self) {
        self.load_after = load();
        let [stolen, all] = ticks();
        let all = all.saturating_sub(self.ticks[1]).max(1);
        self.stolen_share = stolen.saturating_sub(self.ticks[0]) as f64 / all as f64;
    }
}

/// Threads for measuring, kept from scene to scene.
pub struct Bench {
    pub(super) one: ThreadPool,
    pub(super) all: ThreadPool,
}

impl Bench {
    pub fn new(threads: usize) -> Result<Self> {
        Ok(Self { one: pool(1)?, all: pool(threads)? })
    }

    /// Describes the machine, on a thread that traces.
    pub fn host(&self) -> Host {
        self.one.install(Host::look)
    }
}

fn read(file: &str) -> String {
    fs::read_to_string(file).unwrap_or_default()
}

fn load() -> f64 {
    read("/proc/loadavg").split(' ').next().and_then(|x| x.parse().ok()).unwrap_or(f64::NAN)
}

/// Ticks that a hypervisor gave to others, and all ticks.
fn ticks() -> [u64; 2] {
    let text = read("/proc/stat");
    let line = text.lines().next().unwrap_or_default();
    let ticks = line.split_whitespace().skip(1).filter_map(|x| x.parse::<u64>().ok()).collect::<Vec<_>>();
    [ticks.get(7).copied().unwrap_or(0), ticks.iter().take(8).sum()]
}
