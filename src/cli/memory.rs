//! Memory that a render is estimated to need, and the limit.

mod need;

use std::env;

use crate::console::host;
use crate::console::memory::{allowed, hold_to};
use crate::{Error, Result};
pub use need::{Need, Steps, at_rest, placed_bytes};

/// Parses a size such as 900M, 6G or 1.5T into bytes; a plain number is bytes, and K is 1024 as in Slurm.
///
/// # Errors
/// A message for clap.
pub fn parse_size(text: &str) -> std::result::Result<u64, String> {
    let bad = || "not a size such as 900M or 6G".to_owned();
    let (number, shift) = match text.char_indices().last() {
        Some((at, unit)) if unit.is_ascii_alphabetic() => {
            let shift = "KMGT".find(unit.to_ascii_uppercase()).ok_or_else(bad)?;
            (&text[..at], 10 * (shift + 1))
        }
        _ => (text, 0),
    };
    let number: f64 = number.parse().map_err(|_| bad())?;
    let bytes = number * (1_u64 << shift) as f64;
    if (1.0..1e18).contains(&bytes) { Ok(bytes as u64) } else { Err(bad()) }
}

/// A limit in bytes, and its source.
pub type Limit = (u64, &'static str);

const MACHINE: &str = "this machine";

/// Memory limit: the flag, else Slurm's, else the machine's memory; never more than cgroups and resource limits allow.
///
/// # Errors
/// [`Error::Usage`] for a Slurm variable that is not a number.
pub fn limit(flag: Option<u64>) -> Result<Limit> {
    let requested = match flag {
        Some(bytes) => Some((bytes, "--memory-limit")),
        None => slurm()?,
    };
    let requested = requested.unwrap_or((host::total_memory_bytes().unwrap_or(u64::MAX), MACHINE));
    Ok(allowed().filter(|allowed| allowed.0 < requested.0).unwrap_or(requested))
}

/// Makes the process end with exit code 76 when it exceeds the limit, before the system kills it. Does nothing where the
/// machine's memory is the limit.
pub fn hold((limit, source): Limit) {
    if source != MACHINE {
        // A cgroup also counts page tables and dirty file pages: 4 % are left for them.
        hold_to(limit - limit / 25, rayon::current_num_threads());
    }
}

fn slurm() -> Result<Option<Limit>> {
    let variable = |name: &str| env::var(name).ok().filter(|v| !v.trim().is_empty());
    // Slurm counts in MiB; 0 means all of the node.
    let mebibytes = |name: &str, value: String| match value.trim().parse::<u64>() {
        Ok(n) => Ok(n << 20),
        Err(_) => Err(Error::Usage(format!("{name} is '{value}', not a number of MiB"))),
    };
    if let Some(value) = variable("SLURM_MEM_PER_NODE") {
        let bytes = mebibytes("SLURM_MEM_PER_NODE", value)?;
        if bytes > 0 {
            return Ok(Some((bytes, "SLURM_MEM_PER_NODE")));
        }
    } else if let (Some(each), Some(cpus)) = (variable("SLURM_MEM_PER_CPU"), variable("SLURM_CPUS_ON_NODE")) {
        let cpus: u64 = cpus.trim().parse().unwrap_or(1);
        let bytes = mebibytes("SLURM_MEM_PER_CPU", each)?.saturating_mul(cpus);
        if bytes > 0 {
            return Ok(Some((bytes, "SLURM_MEM_PER_CPU")));
        }
    }
    Ok(None)
}

/// Fails if `bytes` exceed the limit.
///
/// # Errors
/// [`Error::Host`] with both numbers.
pub fn check(what: &str, bytes: u64, (limit, source): Limit) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    // Rounded up, so that the number shown is enough.
    let mebibytes = bytes.div_ceil(1 << 20);
    Err(Error::Host(format!(
        "{what} needs about {mebibytes} MiB of memory; {source} allows {}: raise the limit to {mebibytes}M, or use a smaller picture or \
         fewer threads",
        limit >> 20
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_or_refused() {
        assert_eq!(parse_size("900M"), Ok(900 << 20));
        assert_eq!(parse_size("1.5g"), Ok(3 << 29));
        assert_eq!(parse_size("4096"), Ok(4096));
        for bad in ["", "M", "-1G", "0", "1X", "nanM", "infG", "1e300", "6GB"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn what_is_too_much_is_said_with_what_would_be_enough() {
        assert!(check("a", 5 << 20, (5 << 20, "x")).is_ok());
        let error = check("hall.glb", (5 << 20) + 1, (5 << 20, "--memory-limit")).unwrap_err();
        assert_eq!(error.exit_code(), 76);
        assert!(error.to_string().contains("needs about 6 MiB"), "{error}");
    }
}
