//! Statistics of a render, for `--stats` (schema in `docs/stats.md`) and the picture's header.

use std::fs;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use crate::console::host;
use crate::film::atomic;
use crate::film::exr_file::{Header, HeaderValue};
use crate::rays::BackendInfo;
use crate::render::record::checkpoint::{json, text};
use crate::render::{Choice, Decisions, Fireflies, Found, RenderSettings, Rendered, Samples, StopReason, Technique};
use crate::scene::Scene;
use crate::{Error, Result};

/// Schema version; raised when a field changes its meaning or is removed.
const SCHEMA: u32 = 4;

/// Statistics of a render. The copy in the picture's header lacks what is known only after writing it.
#[derive(Debug, Clone, Serialize)]
pub struct Stats {
    schema: u32,
    version: &'static str,
    /// File name without its folder: pictures are shared, and folders are private.
    scene: String,
    camera: String,
    environment: Option<EnvironmentInfo>,
    settings: RenderSettings,
    backend: Backend,
    threads: usize,
    stop: StopReason,
    /// Exposure of the PNG, in stops.
    pub exposure: f32,
    /// Whether a PNG was written.
    #[serde(skip)]
    pub has_preview: bool,
    /// Estimated relative error; null (infinite) before the first pass is complete.
    noise: f64,
    noise_worst_tile: f64,
    samples: Samples,
    /// Which techniques are used, and why.
    techniques: Decisions,
    /// What the pre-passes found.
    #[serde(flatten)]
    prepasses: Found,
    /// Settings by which the picture's mean is not that of the scene's light, and depends on techniques.
    biased_by: Vec<&'static str>,
    fireflies: Fireflies,
    not_finite: NotFinite,
    /// Wall seconds by phase.
    pub seconds: Seconds,
    /// By kind.
    rays: Value,
    mpaths_per_second: f64,
    mrays_per_second: f64,
    /// Thread seconds inside ray queries, summed over all threads.
    ray_query_seconds: f64,
    /// Thread seconds inside tiles, summed over all threads.
    tile_seconds: f64,
    /// `ray_query_seconds` / `tile_seconds`.
    ray_query_share: f64,
    peak_memory_bytes: u64,
    /// Checksum of the picture's file; empty in the picture itself.
    pub picture: String,
}

/// Header attribute with the statistics as JSON.
const HEADER_ATTRIBUTE: &str = "bismar.stats";

/// The clamps that are set.
fn clamps(settings: &RenderSettings) -> Vec<&'static str> {
    let clamps = [("clamp_direct", settings.clamp_direct), ("clamp_indirect", settings.clamp_indirect)];
    clamps.into_iter().filter(|(_, limit)| limit.is_some()).map(|(name, _)| name).collect()
}

/// Whether the header holds statistics.
pub(crate) fn are_in(header: &Header) -> bool {
    text(header, HEADER_ATTRIBUTE).is_some()
}

/// Writes the JSON file of `--stats` from a picture's header, unless the file exists and names this picture's `checksum`.
/// The write and total seconds stay as they were when the picture was written.
/// Errors: [`Error::Data`] for a damaged header; those of [`atomic::write`].
pub(crate) fn write_again(path: &Path, header: &Header, checksum: &str) -> Result<()> {
    let existing = fs::metadata(path).is_ok_and(|meta| meta.is_file()).then(|| fs::read(path).unwrap_or_default());
    let existing = existing.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    if existing.is_some_and(|stats| stats["picture"] == checksum) {
        return Ok(());
    }
    let Some(text) = text(header, HEADER_ATTRIBUTE) else { return Ok(()) };
    let stats = serde_json::from_str::<Value>(text).ok().filter(Value::is_object);
    let mut stats =
        stats.ok_or_else(|| Error::Data(format!("{}: {HEADER_ATTRIBUTE} is no JSON object", path.display())))?;
    stats["picture"] = checksum.into();
    write_json(path, &stats)
}

pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    atomic::write(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        std::io::Write::write_all(file, b"\n")?;
        Ok(Ok(()))
    })
}

/// Wall seconds by phase.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Seconds {
    /// Reading scene, textures and environment.
    pub read: f64,
    /// Building the acceleration structure.
    pub build: f64,
    /// Building the tables of lights and materials, and the first pass that decides about the default light.
    pub prepare: f64,
    /// Render passes.
    pub render: f64,
    /// Writing pictures.
    pub write: f64,
    /// From the start of the command to the writing of the statistics.
    pub total: f64,
}

/// Samples that were discarded because they were not finite.
#[derive(Debug, Clone, Copy, Serialize)]
struct NotFinite {
    count: u64,
    /// Column, row and path of the first one.
    first: Option<[u32; 3]>,
}

#[derive(Debug, Clone, Serialize)]
struct EnvironmentInfo {
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

/// File name without its folder.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

impl Stats {
    /// Statistics of a finished render; `seconds` may still lack its last phases.
    pub fn new(
        scene_path: &Path,
        scene: &Scene,
        backend: &BackendInfo,
        threads: usize,
        rendered: &Rendered,
        seconds: Seconds,
    ) -> Self {
        let Rendered { settings, stats, .. } = rendered;
        let BackendInfo { name, version, isa, build_seconds, memory_bytes, .. } = backend.clone();
        let mega_per_second = |count: u64| count as f64 / stats.render_seconds.max(1e-9) / 1e6;
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            scene: file_name(scene_path),
            camera: scene.cameras.get(settings.camera).map(|c| c.name.clone()).unwrap_or_default(),
            environment: scene.environment.as_ref().map(|e| EnvironmentInfo {
                name: file_name(Path::new(&e.name)),
                rotate_degrees: e.rotation.to_degrees(),
                strength: e.strength,
            }),
            settings: settings.clone(),
            backend: Backend { name, version, isa, build_seconds, memory_bytes },
            threads,
            stop: rendered.stop,
            exposure: 0.0,
            has_preview: false,
            noise: stats.noise,
            noise_worst_tile: rendered.worst_noise(),
            samples: Samples::of(rendered),
            techniques: Decisions::of(settings, &stats.techniques),
            prepasses: stats.techniques,
            biased_by: clamps(settings),
            fireflies: Fireflies::of(rendered),
            not_finite: NotFinite { count: stats.not_finite, first: stats.first_not_finite },
            seconds,
            rays: serde_json::json!({
                "camera": stats.camera_rays,
                "first_bounce": stats.first_bounce_rays,
                "later_bounce": stats.later_bounce_rays,
                "shadow": stats.shadow_rays,
                "total": stats.rays(),
            }),
            mpaths_per_second: mega_per_second(stats.paths),
            mrays_per_second: mega_per_second(stats.rays()),
            ray_query_seconds: stats.ray_query_seconds,
            tile_seconds: stats.tile_seconds,
            ray_query_share: stats.ray_query_seconds / stats.tile_seconds.max(1e-9),
            peak_memory_bytes: host::peak_memory_bytes(),
            picture: String::new(),
        }
    }

    /// Header attributes of the picture, in addition to those of its record.
    ///
    /// # Errors
    /// [`Error::Bug`] if they cannot be written as JSON.
    pub fn header(&self) -> Result<Header> {
        let text = |s: &str| HeaderValue::Text(s.to_owned());
        let Seconds { read, build, prepare, render, .. } = self.seconds;
        let phases = serde_json::json!({ "read": read, "build": build, "prepare": prepare, "render": render });
        let mut header = vec![
            ("bismar.version".into(), text(self.version)),
            ("bismar.scene".into(), text(&self.scene)),
            ("bismar.camera".into(), text(&self.camera)),
            ("bismar.exposure".into(), HeaderValue::Number(self.exposure.into())),
            ("bismar.backend".into(), json(&self.backend)?),
            ("bismar.seconds".into(), json(&phases)?),
            ("bismar.fireflies".into(), json(&self.fireflies)?),
            ("bismar.not_finite".into(), json(&self.not_finite)?),
            (HEADER_ATTRIBUTE.into(), json(self)?),
        ];
        if let Some(environment) = &self.environment {
            header.push(("bismar.environment".into(), json(environment)?));
        }
        Ok(header)
    }

    /// Writes the JSON file of `--stats`.
    ///
    /// # Errors
    /// Those of [`atomic::write`].
    pub fn write(&mut self, path: &Path) -> Result<()> {
        self.peak_memory_bytes = host::peak_memory_bytes();
        write_json(path, self)
    }

    /// One line of text: paths per pixel, seconds, noise, speed, and how to replay the brightest firefly.
    pub fn summary(&self) -> String {
        let s = &self.samples;
        let spp = if s.pixel_min == s.pixel_max { s.pixel_min.to_string() } else { format!("{:.1}", s.pixel_mean) };
        let replay = |x, y, path| {
            let RenderSettings { spp, noise, min_spp, seed, balance, techniques, reuse_sizes, .. } = &self.settings;
            let uses_prepasses = balance.method().uses_prepasses();
            let unusual = techniques.iter().filter(|(technique, choice)| **choice != technique.usual(uses_prepasses));
            let value = |technique, choice: &Choice| match reuse_sizes {
                Some(sizes) if technique == Technique::PathReuse => sizes.to_string(),
                _ => choice.name().to_string(),
            };
            let unusual: String = unusual
                .map(|(technique, choice)| format!("--{}={} ", technique.row().flag, value(technique, choice)))
                .collect();
            let spp = spp.or(Some(s.pixel_max).filter(|_| noise.is_none()));
            let flag =
                |name: &str, value: Option<String>| value.map(|value| format!("--{name} {value} ")).unwrap_or_default();
            let stop = flag("spp", spp.map(|n| n.to_string()))
                + &flag("noise", noise.map(|x| x.to_string()))
                + &flag("min-spp", min_spp.map(|n| n.to_string()))
                + &unusual;
            format!("{stop}--seed {seed} --replay-pixel {x},{y},{path}")
        };
        let mut remarks = String::new();
        if let Some(spot) = self.fireflies.brightest.first() {
            let Fireflies { count, per_megapixel, .. } = self.fireflies;
            let by = replay(spot.x, spot.y, spot.path);
            remarks += &format!("; {count} fireflies ({per_megapixel:.0} per megapixel), the brightest by {by}");
        }
        if let Some([x, y, path]) = self.not_finite.first {
            remarks +=
                &format!("; {} samples were not finite, the first by {}", self.not_finite.count, replay(x, y, path));
        }
        if !self.biased_by.is_empty() {
            let flags = self.biased_by.iter().map(|name| format!("--{}", name.replace('_', "-"))).collect::<Vec<_>>();
            remarks += &format!(
                "; {} makes the picture darker than the truth, by how much depends on --balance and techniques",
                flags.join(" and ")
            );
        }
        let exposure = if self.has_preview { format!(", exposure {} EV", self.exposure) } else { String::new() };
        let noise = match (self.noise.is_finite(), self.settings.noise) {
            (false, _) => "unknown".into(),
            (true, None) => format!("{:.4}", self.noise),
            (true, Some(_)) => format!("{:.4} (noisiest tile {:.4})", self.noise, self.noise_worst_tile),
        };
        format!(
            "{spp} spp in {:.2} s, noise {noise}, {:.2} Mpaths/s, {:.2} Mrays/s{exposure}{remarks}",
            self.seconds.render, self.mpaths_per_second, self.mrays_per_second
        )
    }
}
