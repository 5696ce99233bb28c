//! The machine, and how steadily it runs.

use std::fs;
use std::hint::black_box;

use bismar::Result;
use bismar::console::host::pool;
use bismar::rays::cwbvh;
use bismar::sampling::SplitMix64;
use rayon::ThreadPool;
use serde::Serialize;

use crate::clock::thread_seconds;
use crate::provenance::Machine;

/// The machine that measured.
#[derive(Debug, Clone, Serialize)]
pub struct Host {
    pub machine: String,
    #[serde(flatten)]
    pub hardware: Machine,
    pub virtual_machine: bool,
    pub frequency_governor: Option<String>,
    pub isa_baseline: String,
    pub embree: String,
    pub embree_isa: String,
    pub obvhs: String,
    pub hardware_counters: bool,
    pub flush_to_zero: bool,
    pub denormals_are_zero: bool,
    pub load_before: f64,
    pub load_after: f64,
    pub stolen_share: f64,
    pub spin_seconds: Vec<f64>,
    pub chase_seconds: Vec<f64>,
}

impl Host {
    /// Describes the machine. Must be called where rays will be traced, for the floating-point mode.
    pub fn look() -> Self {
        let cpus = read("/proc/cpuinfo");
        let field = |key: &str| cpus.lines().find_map(|l| l.strip_prefix(key)?.trim().strip_prefix(':')).map(str::trim);
        let hardware = Machine::look();
        let (flushes, zeroes) = floating_point_mode();
        Self {
            machine: format!("{}, {} cores", hardware.cpu, hardware.cores),
            hardware,
            virtual_machine: field("flags").is_some_and(|flags| flags.split(' ').any(|f| f == "hypervisor")),
            frequency_governor: fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
                .ok()
                .map(|text| text.trim().to_owned()),
            isa_baseline: cwbvh::ISA_BASELINE.to_owned(),
            embree: String::new(),
            embree_isa: String::new(),
            obvhs: cwbvh::VERSION.to_owned(),
            hardware_counters: instructions(|| ()).is_some(),
            flush_to_zero: flushes,
            denormals_are_zero: zeroes,
            load_before: load(),
            load_after: load(),
            stolen_share: 0.0,
            spin_seconds: Vec::new(),
            chase_seconds: Vec::new(),
        }
    }
}

/// Threads and gauges for measuring, kept from scene to scene.
pub struct Bench {
    pub(super) one: ThreadPool,
    pub(super) all: ThreadPool,
    pub(super) gauge: Gauge,
}

impl Bench {
    pub fn new(threads: usize) -> Result<Self> {
        Ok(Self { one: pool(1)?, all: pool(threads)?, gauge: Gauge::start() })
    }

    /// Describes the machine, on a thread that traces.
    pub fn host(&self) -> Host {
        self.one.install(Host::look)
    }
}

/// Times two fixed computations repeatedly: one without memory accesses, one that only waits for memory.
pub struct Gauge {
    next: Vec<u32>,
    stolen: (u64, u64),
}

/// Entries of the chain through memory: 64 MiB, more than most caches hold.
const CHAIN: usize = 1 << 24;
/// Steps along it.
const STEPS: usize = 1 << 19;
/// Rounds of the computation.
const ROUNDS: u32 = 10_000_000;

impl Gauge {
    /// Prepares the chain: one cycle through all its entries (Sattolo's algorithm).
    fn start() -> Self {
        let mut next = (0..CHAIN as u32).collect::<Vec<_>>();
        let mut random = SplitMix64(1);
        for i in (1..CHAIN).rev() {
            next.swap(i, random.bits() as usize % i);
        }
        Self { next, stolen: stolen() }
    }

    /// Processor seconds of the computation and of the walk through memory.
    pub fn read(&self) -> (f64, f64) {
        let start = thread_seconds();
        // Eight chains side by side keep the core's units busy: a neighbour on the same core shows.
        let mut chains = black_box([1_u64, 2, 3, 4, 5, 6, 7, 8]);
        for _ in 0..ROUNDS {
            for x in &mut chains {
                *x = (*x ^ *x >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            }
        }
        black_box(chains);
        let middle = thread_seconds();
        let mut at = black_box(0_u32);
        for _ in 0..STEPS {
            at = self.next[at as usize];
        }
        black_box(at);
        (middle - start, thread_seconds() - middle)
    }

    /// Adds a reading to `host`, and what the load and the share of stolen time are by now.
    pub fn note(&self, host: &mut Host) {
        let (spin, chase) = self.read();
        host.spin_seconds.push(spin);
        host.chase_seconds.push(chase);
        host.load_after = load();
        let (now, all) = stolen();
        let all = all.saturating_sub(self.stolen.1).max(1);
        host.stolen_share = now.saturating_sub(self.stolen.0) as f64 / all as f64;
    }
}

/// Whether this thread flushes results to zero, and whether it treats denormal operands as zero.
fn floating_point_mode() -> (bool, bool) {
    let (least, denormal) = (black_box(f32::MIN_POSITIVE), black_box(f32::from_bits(1)));
    // A normal number halved is denormal; a denormal one times 2²⁴ is normal unless it counts as zero.
    (black_box(least * black_box(0.5)) == 0.0, black_box(denormal * black_box(16_777_216.0)) == 0.0)
}

/// Instructions of this thread, outside the kernel, while it does something; `None` where the processor's counters are not
/// there for us: in most virtual machines, and where `perf_event_paranoid` forbids them.
#[cfg(feature = "counters")]
pub fn instructions(work: impl FnOnce()) -> Option<u64> {
    counted(perf_event::events::Hardware::INSTRUCTIONS, work)
}

/// This program was built without the feature `counters`: it does the work, and has counted nothing.
#[cfg(not(feature = "counters"))]
pub fn instructions(work: impl FnOnce()) -> Option<u64> {
    work();
    None
}

#[cfg(feature = "counters")]
fn counted(event: impl perf_event::events::Event, work: impl FnOnce()) -> Option<u64> {
    let mut counter = perf_event::Builder::new(event).build().ok()?;
    counter.enable().ok()?;
    work();
    counter.disable().ok()?;
    let count = counter.read_full().ok()?;
    // Zero if others had the counter all the time; scaled up if they had it for some of it.
    let (enabled, running) = (count.time_enabled()?.as_secs_f64(), count.time_running()?.as_secs_f64());
    (running > 0.0).then(|| (count.count() as f64 * (enabled / running)) as u64)
}

fn read(file: &str) -> String {
    fs::read_to_string(file).unwrap_or_default()
}

fn load() -> f64 {
    read("/proc/loadavg").split(' ').next().and_then(|x| x.parse().ok()).unwrap_or(f64::NAN)
}

/// Ticks that a hypervisor gave to others, and all ticks.
fn stolen() -> (u64, u64) {
    let text = read("/proc/stat");
    let line = text.lines().next().unwrap_or_default();
    let ticks = line.split_whitespace().skip(1).filter_map(|x| x.parse::<u64>().ok()).collect::<Vec<_>>();
    (ticks.get(7).copied().unwrap_or(0), ticks.iter().take(8).sum())
}

#[cfg(all(test, feature = "counters"))]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_can_count_is_counted() {
        let spin = |n: u64| (0..n).for_each(|i| _ = black_box(i));
        // The processor's instructions: at least one a step. Nanoseconds of the thread, which any Linux that allows
        // counters has: a million steps take more than a hundredth of one each.
        for count in
            [instructions(|| spin(1_000_000)), counted(perf_event::events::Software::TASK_CLOCK, || spin(1_000_000))]
        {
            assert!(count.is_none_or(|n| (10_000..1_000_000_000).contains(&n)), "{count:?}");
        }
    }
}
