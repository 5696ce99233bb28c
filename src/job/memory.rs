//! Memory that a render is estimated to need before anything is decoded, and the limit.

use std::env;

use crate::console::host;
use crate::console::memory::{allowed, hold_to};
use crate::rays::Backend;
use crate::render::pass::tile::Tile;
use crate::render::settings::GUIDING_MEMORY;
use crate::render::{RenderSettings, Technique};
use crate::scene::import::{EnvironmentSize, Survey};
use crate::{Error, Result};

/// What the memory of a render depends on most. What it does not see (motion, shared forms, many paths that teach) is caught
/// while it renders ([`hold`]).
#[derive(Debug, Clone, Copy)]
pub struct Need<'a> {
    /// The scene's files.
    pub scene: &'a Survey,
    /// The environment's picture, if there is one.
    pub environment: Option<EnvironmentSize>,
    /// The settings, with the picture's size.
    pub settings: &'a RenderSettings,
    /// Pixels that are rendered: of the crop window, or of a part of it.
    pub pixels: u64,
    /// Pixels of the file: of the crop window, of which a part leaves most empty.
    pub window_pixels: u64,
    /// Are their statistics written into the picture's file?
    pub saves: bool,
    /// Is the picture denoised?
    pub denoises: bool,
    /// Ray tracing library.
    pub rays: Backend,
    /// Number of render threads.
    pub threads: usize,
}

/// Bytes of the program and its libraries, and of the buffers of one thread.
const PROGRAM_BYTES: u64 = 30 << 20;
const BYTES_PER_THREAD: u64 = 4 << 20;
/// Bytes per vertex, per primitive outside of its arrays, and per value of the document's text.
const BYTES_PER_VERTEX: u64 = 40;
const BYTES_PER_MESH: u64 = 4500;
const BYTES_PER_VALUE: u64 = 200;
/// Bytes per placement: in the document, the scene, the ray queries and shading; and of a moving one at one time.
const BYTES_PER_INSTANCE: u64 = 1000;
const BYTES_PER_KEY: u64 = 472;
/// Bytes of an emissive triangle and its part of the light tree while both are built.
const BYTES_PER_LIGHT: u64 = 250;
/// Bytes of the paths that teach in pre-passes, with guiding and without it.
const LEARNING_BYTES: [u64; 2] = [64 << 20, 16 << 20];
/// Bytes per pixel of the file while it is written, with AOVs and without them.
const WRITING_BYTES_PER_PIXEL: [u64; 2] = [80, 14];
/// Bytes of the denoiser's process with Open Image Denoise 2.3, per pixel of the pictures that are passed to it, and of its
/// network, which takes tiles of at most so many pixels.
const DENOISER_BYTES: [u64; 3] = [40 << 20, 130, 790];
const DENOISER_TILE_PIXELS: u64 = 2160 * 2160;

/// Bytes of the program without a scene.
pub fn at_rest(threads: usize) -> u64 {
    PROGRAM_BYTES + threads as u64 * BYTES_PER_THREAD
}

/// Bytes of placements, of so many keys of their motion in all, and of the emissive triangles in them.
pub(crate) fn placed_bytes(instances: u64, keys: u64, emissive_triangles: u64) -> u64 {
    instances * BYTES_PER_INSTANCE + keys * BYTES_PER_KEY + emissive_triangles * BYTES_PER_LIGHT
}

impl Need<'_> {
    /// Estimated bytes of the scene alone, with its files, in a program of so many threads.
    pub(crate) fn of_scene(scene: &Survey, rays: Backend, threads: usize) -> u64 {
        let c = &scene.census;
        // At the peak of the build, and indices.
        let per_triangle = match rays {
            Backend::Embree => 125 + 12,
            Backend::Obvhs => 360 + 12,
        };
        let decoding = scene.decoding_bytes.iter().take(threads).sum::<u64>();
        let meshes = c.vertices * BYTES_PER_VERTEX + c.triangles * per_triangle + c.meshes * BYTES_PER_MESH;
        at_rest(threads)
            + (scene.read_bytes + c.values * BYTES_PER_VALUE + scene.image_bytes + decoding)
            + meshes
            + placed_bytes(c.instances, 0, c.emissive_triangles)
    }

    /// Estimated peak memory in bytes, by the sizes that the files' headers state.
    pub fn bytes(&self) -> u64 {
        let Self { settings, pixels, .. } = *self;
        let tiles = Tile::memory_bytes(pixels, settings.columns());
        // Statistics are compressed before writing, usually to less than half.
        let saving = if self.saves { tiles / 2 } else { 0 };
        let writing = self.window_pixels * WRITING_BYTES_PER_PIXEL[usize::from(!settings.aovs)];
        let [process, pictures, network] = DENOISER_BYTES;
        let denoiser = match self.denoises {
            true => {
                let layers = settings.columns().layers as u64 * size_of::<[f32; 3]>() as u64;
                process + pixels * (pictures + layers) + pixels.min(DENOISER_TILE_PIXELS) * network
            }
            false => 0,
        };
        let [guiding, lights] = LEARNING_BYTES;
        let learning = if settings.asks_for(Technique::Guiding) {
            settings.guiding_memory.unwrap_or(GUIDING_MEMORY).min(guiding)
        } else {
            lights
        };
        Self::of_scene(self.scene, self.rays, self.threads)
            + self.environment.map_or(0, EnvironmentSize::bytes)
            + tiles
            + writing
            + saving.max(denoiser).max(learning)
    }
}

/// Parses a size such as 900M, 6G or 1.5T into bytes; a plain number is bytes, and K is 1024 as in Slurm.
pub(crate) fn parse_size(text: &str) -> std::result::Result<u64, String> {
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
    let (of_node, of_cpu) = ("SLURM_MEM_PER_NODE", "SLURM_MEM_PER_CPU");
    let limit = if let Some(value) = variable(of_node) {
        (mebibytes(of_node, value)?, of_node)
    } else if let (Some(each), Some(cpus)) = (variable(of_cpu), variable("SLURM_CPUS_ON_NODE")) {
        (mebibytes(of_cpu, each)?.saturating_mul(cpus.trim().parse().unwrap_or(1)), of_cpu)
    } else {
        return Ok(None);
    };
    Ok(Some(limit).filter(|(bytes, _)| *bytes > 0))
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
