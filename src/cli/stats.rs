//! What a render took: `--stats` (schema in `docs/stats.md`) and the picture's header.

use std::fs;
use std::path::Path;

use clap::ValueEnum;
use serde::Serialize;
use serde_json::Value;

use crate::console::host;
use crate::film::atomic;
use crate::film::exr_file::{Header, HeaderValue};
use crate::rays::BackendInfo;
use crate::render::checkpoint::{json, text};
use crate::render::stats::{AdaptiveStats, GuidingStats, LearnedLightsStats, Samples};
use crate::render::{Fireflies, Guiding, RenderSettings, Rendered, StopReason};
use crate::scene::Scene;
use crate::{Error, Result};

/// Raised when a field changes its meaning or goes away.
const SCHEMA: u32 = 1;

/// Everything that is known of a render; what is written so far for headers, all of it for `--stats`.
#[derive(Debug, Clone, Serialize)]
pub struct Stats {
    schema: u32,
    version: &'static str,
    /// File name only: a picture tells nobody where its maker keeps files.
    scene: String,
    camera: String,
    environment: Option<Sky>,
    settings: RenderSettings,
    backend: Backend,
    threads: usize,
    stop: StopReason,
    /// Of the PNG, in stops.
    pub exposure: f32,
    /// Is there a PNG?
    #[serde(skip)]
    pub shown: bool,
    /// Null before the first pass is complete.
    noise: f64,
    noise_worst_tile: f64,
    samples: Samples,
    /// Of the pilot of lamps, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    lamps: Option<LearnedLightsStats>,
    /// Of guiding's pilot, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    guiding: Option<GuidingStats>,
    /// Of the allocation of paths to tiles, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    adaptive: Option<AdaptiveStats>,
    fireflies: Fireflies,
    not_finite: NotFinite,
    /// Wall seconds by phase.
    pub seconds: Seconds,
    rays: Rays,
    mpaths_per_second: f64,
    mrays_per_second: f64,
    /// Thread seconds inside ray queries and inside tiles, over all threads, and the first's share of the second.
    ray_query_seconds: f64,
    tile_seconds: f64,
    ray_query_share: f64,
    peak_memory_bytes: u64,
    /// Checksum of the picture's file; empty before that is written.
    pub picture: String,
}

/// The attribute that holds all of it.
const IN_HEADER: &str = "bismar.stats";

/// Can [`write_again`] do its work?
pub fn are_in(header: &Header) -> bool {
    text(header, IN_HEADER).is_some()
}

/// Writes the JSON file of `--stats` from a picture's header, unless it is there and of this file, by its checksum. What was
/// not known when the picture was written stays as it was then: the seconds of writing, and the total.
///
/// # Errors
/// [`Error::Data`] for a header that is not so; as [`atomic::write`].
pub fn write_again(path: &Path, header: &Header, checksum: &str) -> Result<()> {
    let there = fs::metadata(path).is_ok_and(|meta| meta.is_file()).then(|| fs::read(path).unwrap_or_default());
    let there = there.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    if there.is_some_and(|stats| stats["picture"] == checksum) {
        return Ok(());
    }
    let Some(text) = text(header, IN_HEADER) else { return Ok(()) };
    let stats = serde_json::from_str::<Value>(text).ok().filter(Value::is_object);
    let mut stats = stats.ok_or_else(|| Error::Data(format!("{}: {IN_HEADER} is no JSON object", path.display())))?;
    stats["picture"] = checksum.into();
    write(path, &stats)
}

fn write(path: &Path, stats: &impl Serialize) -> Result<()> {
    atomic::write(path, |file| {
        serde_json::to_writer_pretty(&mut *file, stats)?;
        std::io::Write::write_all(file, b"\n")?;
        Ok(Ok(()))
    })
}

/// Wall seconds by phase.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Seconds {
    /// Scene, textures, environment.
    pub read: f64,
    /// Acceleration structure.
    pub build: f64,
    /// Passes.
    pub render: f64,
    /// Pictures.
    pub write: f64,
    /// Start of the command to the writing of the statistics.
    pub total: f64,
}

/// Samples that were left out.
#[derive(Debug, Clone, Copy, Serialize)]
struct NotFinite {
    count: u64,
    /// Column, row, path.
    first: Option<[u32; 3]>,
}

#[derive(Debug, Clone, Serialize)]
struct Sky {
    name: String,
    rotate_degrees: f32,
    strength: f32,
}

#[derive(Debug, Clone, Serialize)]
struct Backend {
    name: &'static str,
    version: String,
    isa: String,
    build_seconds: f64,
    memory_bytes: u64,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Rays {
    camera: u64,
    first_bounce: u64,
    later_bounce: u64,
    shadow: u64,
    total: u64,
}

/// The file's name without its folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

impl Stats {
    /// Gathers what a finished render says; `seconds` may still lack its last phases.
    pub fn new(
        scene_path: &Path,
        scene: &Scene,
        backend: &BackendInfo,
        threads: usize,
        rendered: &Rendered,
        seconds: Seconds,
    ) -> Self {
        let Rendered { settings, stats, .. } = rendered;
        let mega_per_second = |count: u64| count as f64 / stats.render_seconds.max(1e-9) / 1e6;
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            scene: file_name(scene_path),
            camera: scene.cameras.get(settings.camera).map(|c| c.name.clone()).unwrap_or_default(),
            environment: scene.environment.as_ref().map(|e| Sky {
                name: file_name(Path::new(&e.name)),
                rotate_degrees: e.rotation.to_degrees(),
                strength: e.strength,
            }),
            settings: settings.clone(),
            backend: Backend {
                name: backend.name,
                version: backend.version.clone(),
                isa: backend.isa.clone(),
                build_seconds: backend.build_seconds,
                memory_bytes: backend.memory_bytes,
            },
            threads,
            stop: rendered.stop,
            exposure: 0.0,
            shown: false,
            noise: stats.noise,
            noise_worst_tile: rendered.worst_noise(),
            samples: Samples::of(rendered),
            lamps: stats.learned_lights,
            guiding: stats.guiding,
            adaptive: stats.adaptive,
            fireflies: Fireflies::of(rendered),
            not_finite: NotFinite { count: stats.not_finite, first: stats.first_not_finite },
            seconds,
            rays: Rays {
                camera: stats.camera_rays,
                first_bounce: stats.first_bounce_rays,
                later_bounce: stats.later_bounce_rays,
                shadow: stats.shadow_rays,
                total: stats.rays(),
            },
            mpaths_per_second: mega_per_second(stats.paths),
            mrays_per_second: mega_per_second(stats.rays()),
            ray_query_seconds: stats.ray_query_seconds,
            tile_seconds: stats.tile_seconds,
            ray_query_share: stats.ray_query_seconds / stats.tile_seconds.max(1e-9),
            peak_memory_bytes: host::peak_memory_bytes(),
            picture: String::new(),
        }
    }

    /// Header attributes of the picture, beside those of its record.
    ///
    /// # Errors
    /// [`Error::Bug`] if JSON cannot say it.
    pub fn header(&self) -> Result<Header> {
        let text = |s: &str| HeaderValue::Text(s.to_owned());
        // Writing has not happened yet.
        let Seconds { read, build, render, .. } = self.seconds;
        let phases = serde_json::json!({ "read": read, "build": build, "render": render });
        let mut header = vec![
            ("bismar.version".into(), text(self.version)),
            ("bismar.scene".into(), text(&self.scene)),
            ("bismar.camera".into(), text(&self.camera)),
            ("bismar.exposure".into(), HeaderValue::Number(self.exposure.into())),
            ("bismar.backend".into(), json(&self.backend)?),
            ("bismar.seconds".into(), json(&phases)?),
            ("bismar.fireflies".into(), json(&self.fireflies)?),
            ("bismar.not_finite".into(), json(&self.not_finite)?),
            (IN_HEADER.into(), json(self)?),
        ];
        if let Some(sky) = &self.environment {
            header.push(("bismar.environment".into(), json(sky)?));
        }
        Ok(header)
    }

    /// Writes the JSON file of `--stats`.
    ///
    /// # Errors
    /// As [`atomic::write`].
    pub fn write(&mut self, path: &Path) -> Result<()> {
        self.peak_memory_bytes = host::peak_memory_bytes();
        write(path, self)
    }

    /// One line for people.
    pub fn summary(&self) -> String {
        let s = &self.samples;
        let spp = if s.pixel_min == s.pixel_max { s.pixel_min.to_string() } else { format!("{:.1}", s.pixel_mean) };
        let replay = |x, y, path| {
            let RenderSettings { spp, noise, min_spp, seed, adaptive, guiding, .. } = self.settings;
            let adaptive = adaptive && spp.is_some();
            let guided = guiding.to_possible_value().filter(|_| guiding != Guiding::Off);
            let spp = spp.or(Some(s.pixel_max).filter(|_| noise.is_none()));
            let flag =
                |name: &str, value: Option<String>| value.map(|value| format!("--{name} {value} ")).unwrap_or_default();
            let stop = flag("spp", spp.map(|n| n.to_string()))
                + &flag("noise", noise.map(|x| x.to_string()))
                + &flag("min-spp", min_spp.map(|n| n.to_string()))
                + if adaptive { "--adaptive " } else { "" }
                + &flag("guiding", guided.map(|value| value.get_name().to_owned()));
            format!("{stop}--seed {seed} --replay-pixel {x},{y},{path}")
        };
        let mut told = String::new();
        if let Some(spot) = self.fireflies.brightest.first() {
            let Fireflies { count, per_megapixel, .. } = self.fireflies;
            let by = replay(spot.x, spot.y, spot.path);
            told += &format!("; {count} fireflies ({per_megapixel:.0} a megapixel), the brightest by {by}");
        }
        if let Some([x, y, path]) = self.not_finite.first {
            told +=
                &format!("; {} samples were not finite, the first by {}", self.not_finite.count, replay(x, y, path));
        }
        let exposure = if self.shown { format!(", exposure {} EV", self.exposure) } else { String::new() };
        let noise = match (self.noise.is_finite(), self.settings.noise) {
            (false, _) => "unknown".into(),
            (true, None) => format!("{:.4}", self.noise),
            (true, Some(_)) => format!("{:.4} (noisiest tile {:.4})", self.noise, self.noise_worst_tile),
        };
        format!(
            "{spp} spp in {:.2} s, noise {noise}, {:.2} Mpaths/s, {:.2} Mrays/s{exposure}{told}",
            self.seconds.render, self.mpaths_per_second, self.mrays_per_second
        )
    }
}
