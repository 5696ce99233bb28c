//! What a render will need of memory, and what there is.

use std::env;

use crate::console::host;
use crate::console::memory::{allowed, hold_to};
use crate::rays::Backend;
use crate::render::tile::{Columns, Tile};
use crate::scene::import::Survey;
use crate::{Error, Result};

/// Bytes of a `SIZE` such as 900M, 6G or 1.5T; without a unit, bytes. Units are those of Slurm: K is 1024.
pub fn parse_size(text: &str) -> std::result::Result<u64, String> {
    let bad = || "not a size as in 900M or 6G".to_owned();
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

/// What a render is made of, as far as memory goes.
#[derive(Debug, Clone, Copy)]
pub struct Need<'a> {
    /// The scene's files.
    pub scene: &'a Survey,
    /// Bytes of the environment, decoded and prepared.
    pub environment_bytes: u64,
    /// Of the window.
    pub pixels: u64,
    /// What each of them keeps.
    pub columns: Columns,
    /// Are statistics saved?
    pub saves: bool,
    /// Bytes for what pilots learn.
    pub pilots: u64,
    /// What traces rays.
    pub rays: Backend,
    /// Threads of the render.
    pub threads: usize,
}

/// The program and its libraries, at rest.
const PROGRAM: u64 = 48 << 20;
/// Buffers of one thread.
const A_THREAD: u64 = 12 << 20;
/// What a byte of tiles takes: measured between pictures of 0.5, 2 and 8 million pixels, 1.104 and 1.073.
const A_BYTE: f64 = 1.085;
/// Of the triangles' share while an acceleration structure is built.
const EMBREE_TRIANGLE: u64 = 190;
const OBVHS_TRIANGLE: u64 = 260;
/// What shading keeps of a triangle and its vertices beside the mesh.
const SHADING_TRIANGLE: u64 = 16;

/// Bytes of the program before it has a scene.
pub fn at_rest(threads: usize) -> u64 {
    PROGRAM + threads as u64 * A_THREAD
}

impl Need<'_> {
    /// Bytes at the worst moment, by what the files say of themselves: an estimate from above, within about a factor
    /// of two for scenes that are mostly shown.
    pub fn bytes(&self) -> u64 {
        let s = self.scene;
        let a_triangle = SHADING_TRIANGLE
            + match self.rays {
                Backend::Embree => EMBREE_TRIANGLE,
                Backend::Obvhs => OBVHS_TRIANGLE,
            };
        let tile = Tile::bytes_per_pixel(self.columns);
        // Pictures are written from tiles; statistics are packed first, and seldom to more than half.
        let saving = if self.saves { tile / 2 } else { 0 };
        let loading = s.read_bytes;
        let scene = s.read_bytes + s.geometry_bytes + s.image_bytes + self.environment_bytes;
        let pixels = (self.pixels as f64 * (tile + saving) as f64 * A_BYTE) as u64;
        at_rest(self.threads) + self.pilots + scene + loading.max(s.triangles * a_triangle) + pixels
    }
}

/// A limit in bytes, and who sets it.
pub type Limit = (u64, &'static str);

const MACHINE: &str = "this machine";

/// Most memory that may be used, and who says so: the flag, else Slurm, else what the machine has; but never more than
/// cgroups and resource limits allow.
///
/// # Errors
/// [`Error::Usage`] for a variable of Slurm's that is no number.
pub fn limit(flag: Option<u64>) -> Result<Limit> {
    let asked = match flag {
        Some(bytes) => Some((bytes, "--memory-limit")),
        None => slurm()?,
    };
    let asked = asked.unwrap_or((host::total_memory_bytes().unwrap_or(u64::MAX), MACHINE));
    Ok(allowed().filter(|allowed| allowed.0 < asked.0).unwrap_or(asked))
}

/// Makes what is beyond a limit end with exit code 76 at once, before the system kills; not where the machine is the limit.
pub fn hold((limit, source): Limit) {
    if source != MACHINE {
        // Page tables and files that are being written count into a cgroup too.
        hold_to(limit - limit / 25);
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

/// Fails if `bytes` are more than the limit.
///
/// # Errors
/// [`Error::Host`] with both numbers and what to do.
pub fn check(what: &str, bytes: u64, (limit, source): Limit) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    // Rounded up, so that asking for what is shown is enough.
    let mebibytes = bytes.div_ceil(1 << 20);
    Err(Error::Host(format!(
        "{what} needs about {mebibytes} MiB of memory; {source} allows {}: give it {mebibytes}M, or render smaller or in \
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
