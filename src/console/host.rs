//! Queries of the host: instruction sets, threads, memory.

use std::env;
use std::fs;
use std::thread;

use crate::{Error, Result};

/// Checks that the CPU has the instruction sets that this program is compiled for.
///
/// `is_x86_feature_detected!` is no help: it is constant for features that the compiler assumes.
/// Errors: [`Error::Host`] with the missing features.
#[cfg(target_arch = "x86_64")]
pub fn check_isa() -> Result<()> {
    use std::arch::x86_64::{__cpuid, __cpuid_count};
    let extended = if __cpuid(0x8000_0000).eax >= 0x8000_0001 { __cpuid(0x8000_0001).ecx } else { 0 };
    let basic = __cpuid(1).ecx;
    let structured = if __cpuid(0).eax >= 7 { __cpuid_count(7, 0).ebx } else { 0 };
    // OSXSAVE: the operating system saves the wide registers.
    let needed = [
        ("FMA", basic, 12),
        ("MOVBE", basic, 22),
        ("OSXSAVE", basic, 27),
        ("AVX", basic, 28),
        ("F16C", basic, 29),
        ("BMI1", structured, 3),
        ("AVX2", structured, 5),
        ("BMI2", structured, 8),
        ("LZCNT", extended, 5),
    ];
    let missing = needed.iter().filter(|(_, register, bit)| register >> bit & 1 == 0).map(|n| n.0).collect::<Vec<_>>();
    if missing.is_empty() {
        return Ok(());
    }
    Err(Error::Host(format!(
        "this CPU has no {}; bismar is compiled for x86-64-v3 (Intel Haswell, AMD Zen and later): run it on a newer \
         machine, or build it with another target-cpu in .cargo/config.toml",
        missing.join(", ")
    )))
}

/// There is nothing to check where the baseline is the compiler's default.
#[cfg(not(target_arch = "x86_64"))]
pub fn check_isa() -> Result<()> {
    Ok(())
}

pub const MAX_THREADS: usize = 4096;

/// Number of threads, and the source of the number: the flag, `BISMAR_THREADS`, `SLURM_CPUS_PER_TASK`, all.
/// Errors: [`Error::Usage`] for a variable that is not a positive number.
pub fn threads(flag: Option<usize>) -> Result<(usize, &'static str)> {
    if let Some(n) = flag {
        return Ok((n, "--threads"));
    }
    for name in ["BISMAR_THREADS", "SLURM_CPUS_PER_TASK"] {
        match env::var(name).as_deref().map(str::trim) {
            Err(_) | Ok("") => continue,
            Ok(value) => match value.parse() {
                Ok(n) if (1..=MAX_THREADS).contains(&n) => return Ok((n, name)),
                _ => return Err(Error::Usage(format!("{name} is '{value}', not a number of threads"))),
            },
        }
    }
    Ok((thread::available_parallelism().map_or(1, usize::from), "all that there are"))
}

/// A rayon pool with this number of threads.
/// Errors: [`Error::Usage`] for no threads, and for more than [`MAX_THREADS`]; [`Error::Host`] if they cannot be started.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    if !(1..=MAX_THREADS).contains(&threads) {
        return Err(Error::Usage(format!("{threads} threads: not a number from 1 to {MAX_THREADS}")));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| Error::Host(format!("cannot start {threads} threads: {e}")))
}

/// Peak resident memory of this process in bytes; 0 if unknown.
pub fn peak_memory_bytes() -> u64 {
    kilobytes("/proc/self/status", "VmHWM:").unwrap_or(0)
}

/// Resident memory of this process in bytes; 0 if unknown.
pub fn resident_memory_bytes() -> u64 {
    kilobytes("/proc/self/status", "VmRSS:").unwrap_or(0)
}

/// Virtual memory of this process in bytes; 0 if unknown.
pub(crate) fn virtual_memory_bytes() -> u64 {
    kilobytes("/proc/self/status", "VmSize:").unwrap_or(0)
}

/// Private writable memory of this process that is mapped, such as stacks, but not resident, in bytes; 0 if unknown.
pub(crate) fn untouched_data_bytes() -> u64 {
    let of = |key: &str| kilobytes("/proc/self/status", key).unwrap_or(0);
    of("VmData:").saturating_sub(of("RssAnon:"))
}

/// Resets [`peak_memory_bytes`] to the current memory, where the system supports it.
pub fn reset_peak_memory() {
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Memory of the machine in bytes, if known.
pub fn total_memory_bytes() -> Option<u64> {
    kilobytes("/proc/meminfo", "MemTotal:")
}

fn kilobytes(file: &str, key: &str) -> Option<u64> {
    let text = fs::read_to_string(file).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|k| k * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_good_enough_and_says_its_memory() {
        check_isa().unwrap();
        assert!(peak_memory_bytes() > 1 << 20);
        assert!(total_memory_bytes().unwrap() > peak_memory_bytes());
    }
}
