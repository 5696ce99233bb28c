//! Checkpoints in a picture's file: the record of a render in the header, its tiles behind the picture.

use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::build_info::BuildInfo;
use super::goals;
use super::identity::{Identity, RequestedOutputs};
use crate::color::ColorSpace;
use crate::film::exr_file::{self, Checksum, Header, HeaderValue, Layers, MEAN_VARIANCE, RELATED};
use crate::film::{Aov, Background};
use crate::integrator::clients::MeanVariance;
use crate::rays::BackendInfo;
use crate::render::pass::goal::Goal;
use crate::render::pass::rendered::{Rendered, Samples, paths_range, tile_positions};
use crate::render::pass::scheduler;
use crate::render::pass::stats::{RenderStats, StopReason};
use crate::render::settings::part::Part;
use crate::render::settings::techniques::{Choice, Technique};
use crate::render::settings::{RenderSettings, variant_name};
use crate::render::{pass::tile::Tile, settings::part::TILE};
use crate::{Error, Result};

/// A render that can be resumed.
#[derive(Debug)]
pub struct Saved {
    /// Its tiles, row by row.
    pub tiles: Vec<Tile>,
    /// Counts and times of all sessions so far.
    pub stats: RenderStats,
    /// The goals that it was begun and continued with, in order.
    pub goals: Vec<Goal>,
}

impl Saved {
    /// Does what it has learned depend on the goal? A guiding field does, and what was learned from the same rounds.
    pub fn learns_by_goal(&self, settings: &RenderSettings) -> bool {
        let guiding = Technique::Guiding;
        let mut learned = self.stats.techniques.iter().filter(|(technique, _)| technique.row().learns);
        settings.techniques[guiding] != Choice::Off
            && learned.any(|(technique, stats)| {
                stats.is_some_and(|stats| stats.on || (technique != guiding && stats.why.is_none()))
            })
    }

    /// Are its passes those that a render of these settings begins with? Then the resumed render has the bits of an
    /// uninterrupted one ([`scheduler::begins_as`]).
    pub fn has_passes_of(&self, settings: &RenderSettings) -> bool {
        if !goals::are_as_one(&self.goals, settings, self.learns_by_goal(settings)) {
            return false;
        }
        let (done, ahead) = paths_range(&self.tiles);
        match settings.noise_goal() {
            // Tiles have their own counts, and any count once the noise has been estimated, unless an earlier goal has cut it.
            // A pass after the first estimate ends at a goal by chance alone.
            Some(goal) => self.tiles.iter().map(Tile::paths).all(|n| {
                if n <= goal.min_paths {
                    scheduler::is_planned(settings, n)
                } else {
                    self.goals.iter().all(|goal| goal.spp != Some(n) || goal.spp == settings.spp)
                        || scheduler::begins_as(settings, n, n, self.stats.passes)
                }
            }),
            // Tiles have their own goals.
            None if self.stats.techniques[Technique::Adaptive].is_some() => true,
            None => scheduler::begins_as(settings, done, ahead, self.stats.passes),
        }
    }
}

/// Version of the record and of the packed tiles. Files of other versions are not read.
pub const FORMAT: u32 = 11;
/// Header attribute with the seeds of a mean, in place of a record.
const SEEDS: &str = "bismar.seeds";

/// The record of a render in its picture's header: all that resuming and merging need besides the tiles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Record {
    /// What it was made of.
    pub identity: Identity,
    /// [`Identity::request`] of the command that made it.
    pub request: String,
    /// Names of its AOVs, with commas between.
    pub aovs: String,
    /// Counts and times of all sessions.
    pub stats: RenderStats,
    /// The goals that it was begun and continued with.
    pub goals: Vec<Goal>,
    /// Why it ended.
    pub stop: StopReason,
    /// Estimated relative error; `None` before a pass is complete.
    pub noise: Option<f64>,
    /// Minimum paths per pixel of a tile.
    pub paths: u32,
    /// Noise of the noisiest tile.
    pub worst_noise: Option<f64>,
    /// Does the file keep the statistics that a resumed render needs, even when the render is finished?
    #[serde(rename = "keeps")]
    pub resumable: bool,
    /// The host that traced its rays last.
    pub host: Host,
    /// Are its colours stored as 16-bit floats?
    pub half: bool,
    /// Primaries of its colours.
    pub colorspace: ColorSpace,
    /// What the picture shows behind all surfaces.
    pub background: Background,
    /// The build that wrote it.
    #[serde(rename = "maker")]
    pub build: BuildInfo,
    /// The seeds that the picture is the mean of, if several; such a picture cannot be resumed.
    #[serde(skip)]
    pub seeds: Vec<u32>,
}

/// Properties of a host that bits depend on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Host {
    /// Version of the ray library.
    pub version: String,
    /// Instruction set of the ray library.
    pub isa: String,
}

impl Host {
    /// This host, with a ray library.
    pub fn of(backend: &BackendInfo) -> Self {
        Self { version: backend.version.clone(), isa: backend.isa.clone() }
    }
}

impl Record {
    /// The record of a render.
    pub fn new(
        identity: &Identity,
        requested: &RequestedOutputs,
        rendered: &Rendered,
        host: Host,
        resumable: bool,
    ) -> Self {
        Self {
            identity: identity.clone(),
            request: identity.request(requested),
            aovs: requested.aovs.clone(),
            stats: rendered.stats,
            goals: rendered.goals.clone(),
            stop: rendered.stop,
            noise: Some(rendered.stats.noise).filter(|noise| noise.is_finite()),
            paths: rendered.paths_range().0,
            worst_noise: Some(rendered.worst_noise()).filter(|noise| noise.is_finite()),
            resumable,
            host,
            half: requested.half,
            colorspace: requested.colorspace,
            background: rendered.background,
            build: BuildInfo::here(),
            seeds: Vec::new(),
        }
    }

    /// Was it made by a command with this identity and these outputs, for this part?
    pub fn matches(&self, identity: &Identity, requested: &RequestedOutputs) -> bool {
        self.request == identity.request(requested) && self.identity.settings.part == identity.settings.part
    }

    /// Paths per pixel of a finished render: the minimum of a tile, or the mean where tiles have their own goals.
    pub fn spp(&self) -> u32 {
        let settings = &self.identity.settings;
        let mean = settings.spp.filter(|_| settings.asks_for(Technique::Adaptive) && self.stop == StopReason::Samples);
        mean.unwrap_or(self.paths)
    }

    /// Is one of the stop rules of these settings fulfilled?
    pub fn is_done(&self, settings: &RenderSettings) -> bool {
        if self.stop == StopReason::Interrupted {
            return false;
        }
        let seconds = match self.stop {
            // A render may end before the limit when no more paths fit.
            StopReason::Time => self.identity.settings.time.unwrap_or(0.0),
            _ => self.stats.seconds,
        };
        let before = &self.identity.settings;
        let same =
            settings.noise.is_some() && (settings.noise_goal(), settings.spp) == (before.noise_goal(), before.spp);
        let worst = self.worst_noise.unwrap_or(f64::INFINITY);
        settings.spp.is_some_and(|goal| self.spp() >= goal)
            || settings.time.is_some_and(|limit| seconds >= limit)
            || (same && self.stop != StopReason::Time)
            || settings.noise_goal().is_some_and(|goal| worst <= goal.error && self.paths >= goal.min_paths)
    }

    /// The header attributes, including those that `docs/stats.md` lists for scripts.
    fn header(&self, rendered: &Rendered) -> Result<Header> {
        let settings = &rendered.settings;
        let mut header: Header = vec![
            ("bismar.request".into(), HeaderValue::Text(self.request.clone())),
            ("bismar.sessions".into(), json(&self.stats)?),
            ("bismar.keeps".into(), HeaderValue::Number(if self.resumable { 1.0 } else { 0.0 })),
            ("bismar.aov".into(), HeaderValue::Text(self.aovs.clone())),
            ("bismar.settings".into(), json(settings)?),
            ("bismar.seed".into(), HeaderValue::Number(settings.seed.into())),
            ("bismar.samples".into(), json(&Samples::of(rendered))?),
            ("bismar.stop".into(), HeaderValue::Text(variant_name(&self.stop))),
            ("bismar.noise".into(), HeaderValue::Number(rendered.stats.noise)),
            ("bismar.background".into(), HeaderValue::Text(variant_name(&self.background))),
        ];
        if let Some(MeanVariance { over_independent, related }) = rendered.mean_variance() {
            header.push((MEAN_VARIANCE.into(), json(&over_independent)?));
            if related > 1.0 {
                header.push((RELATED.into(), HeaderValue::Number(related)));
            }
        }
        if self.seeds.is_empty() {
            header.push(("bismar.format".into(), HeaderValue::Number(FORMAT.into())));
            header.push(("bismar.record".into(), json(self)?));
            header.push(("bismar.fingerprint".into(), json(&self.identity.bits())?));
        } else {
            let seeds: Vec<_> = self.seeds.iter().map(u32::to_string).collect();
            header.push((SEEDS.into(), HeaderValue::Text(seeds.join(","))));
        }
        Ok(header)
    }
}

/// A value as JSON in a text attribute.
///
/// # Errors
/// [`Error::Bug`] if it cannot be serialised.
pub fn json(value: &impl Serialize) -> Result<HeaderValue> {
    serde_json::to_string(value).map(HeaderValue::Text).map_err(|e| Error::Bug(format!("JSON: {e}")))
}

/// The number attribute with this name.
pub fn number(header: &Header, name: &str) -> Option<f64> {
    header.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
        HeaderValue::Number(x) => Some(*x),
        _ => None,
    })
}

/// The text attribute with this name.
pub fn text<'a>(header: &'a Header, name: &str) -> Option<&'a str> {
    header.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
        HeaderValue::Text(text) => Some(text.as_str()),
        _ => None,
    })
}

/// Writes a render's picture with its record, `more` attributes, denoised layers and, if `with_tiles`, its tiles.
///
/// # Errors
/// Those of [`exr_file::write`]; [`Error::Bug`] if a value cannot be serialised.
pub fn write(
    path: &Path,
    rendered: &Rendered,
    record: &Record,
    more: Header,
    denoised: &[(String, Vec<[f32; 3]>)],
    with_tiles: bool,
) -> Result<()> {
    let mut header = record.header(rendered)?;
    header.extend(more);
    let tiles = with_tiles.then(|| pack(&rendered.tiles)).transpose()?;
    let layers = Layers { aovs: &Aov::named(&record.aovs), half: record.half, colorspace: record.colorspace, denoised };
    exr_file::write(path, &rendered.pixels(), layers, &header, tiles.as_deref())
}

/// An existing picture that bismar wrote.
#[derive(Debug, Clone)]
pub struct Earlier {
    /// Its path.
    pub path: PathBuf,
    /// Its record.
    pub record: Record,
    /// All header attributes.
    pub header: Header,
}

impl Earlier {
    /// Reads the header of a picture; `None` if there is no file.
    ///
    /// # Errors
    /// Those of [`exr_file::read_header`]; [`Error::Data`] for pictures of other programs and other formats.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        let refused = |why: String| Error::Data(format!("{}: {why}", path.display()));
        // It would wait for a writer.
        if path.metadata().is_ok_and(|meta| meta.file_type().is_fifo()) {
            return Err(refused("is a named pipe, no picture".into()));
        }
        let header = match exr_file::read_header(path) {
            Err(Error::Missing(_)) => return Ok(None),
            other => other?,
        };
        let record = match number(&header, "bismar.format") {
            None => {
                let why = match text(&header, SEEDS) {
                    Some(seeds) => format!("is the mean of pictures with the seeds {seeds}: use those"),
                    None => "is no picture that bismar can go on from".into(),
                };
                return Err(refused(why));
            }
            Some(format) if format != f64::from(FORMAT) => {
                let age = if format > f64::from(FORMAT) { "a newer" } else { "an older" };
                let why = format!("is from {age} bismar (format {format}, this one reads {FORMAT}): use that version");
                return Err(refused(why));
            }
            Some(_) => text(&header, "bismar.record").and_then(|record| serde_json::from_str(record).ok()),
        };
        let record = record.ok_or_else(|| refused("does not say what it was made of".into()))?;
        Ok(Some(Self { path: path.into(), record, header }))
    }

    /// Checks that the file has the bytes that were written.
    ///
    /// # Errors
    /// [`Error::Data`] for a damaged file; those of [`exr_file::check`].
    pub fn verify(&self) -> Result<()> {
        let damaged = |why: &str| {
            let path = self.path.display();
            Error::Data(format!("{path}: is damaged: {why}; delete it, or render without --resume"))
        };
        match exr_file::check(&self.path)? {
            Checksum::Whole(_) => Ok(()),
            Checksum::Broken => Err(damaged("its bytes are not those that were written")),
            Checksum::Missing => Err(damaged("its checksum is not where it was written")),
        }
    }

    /// Its tiles; `None` if it carries none.
    ///
    /// # Errors
    /// Those of [`exr_file::read_statistics`]; [`Error::Data`] if they are not tiles of a render with `settings`.
    pub fn tiles(&self, settings: &RenderSettings) -> Result<Option<Vec<Tile>>> {
        let Some(bytes) = exr_file::read_statistics(&self.path)? else { return Ok(None) };
        let tiles = unpack(&bytes).filter(|tiles| fits(tiles, settings));
        let refused = || Error::Data(format!("{}: its statistics are not those of such a render", self.path.display()));
        tiles.map(Some).ok_or_else(refused)
    }

    /// The saved state from which a render of this identity is resumed.
    ///
    /// # Errors
    /// [`Error::Data`], with the differences, for another render; for a damaged file and for one without statistics.
    pub fn saved(&self, ours: &Identity) -> Result<Saved> {
        let refused = |why: String| {
            Error::Data(format!("--resume: {}: {why}; without --resume it is rendered anew", self.path.display()))
        };
        self.verify()?;
        let theirs = &self.record.identity;
        let differences = ours.differences(theirs);
        if !differences.is_empty() {
            return Err(refused(format!("holds another render: different {differences}")));
        }
        if theirs.settings.part != ours.settings.part {
            let part = |part: Option<Part>| part.map_or("the whole".into(), |p| format!("part {p}"));
            let (theirs, ours) = (part(theirs.settings.part), part(ours.settings.part));
            return Err(refused(format!("holds {theirs}, not {ours}")));
        }
        let Some(tiles) = self.tiles(&ours.settings)? else {
            return Err(refused("carries no statistics to go on from, as it was rendered without --checkpoint".into()));
        };
        Ok(Saved { tiles, stats: self.record.stats, goals: self.record.goals.clone() })
    }
}

/// Maximum bytes of an unpacked tile.
const MAX_TILE_BYTES: usize = 1 << 24;

/// Serialises tiles. Each has its length in bytes (32 bits, little-endian) and its data: postcard, compressed
/// with LZ4, which is faster than a disk.
///
/// # Errors
/// [`Error::Bug`] if a tile cannot be serialised.
pub fn pack(tiles: &[Tile]) -> Result<Vec<u8>> {
    let record = |tile: &Tile| Ok(lz4_flex::compress_prepend_size(&postcard::to_stdvec(tile)?));
    let mut bytes = Vec::new();
    // In chunks, to limit memory.
    for some in tiles.chunks(1024) {
        let records: std::result::Result<Vec<_>, postcard::Error> = some.par_iter().map(record).collect();
        for record in records.map_err(|e| Error::Bug(format!("a tile cannot be saved: {e}")))? {
            bytes.extend((record.len() as u32).to_le_bytes());
            bytes.extend(record);
        }
    }
    Ok(bytes)
}

/// Deserialises tiles that [`pack`] wrote. The bytes are not trusted: `None` if they are invalid.
pub fn unpack(bytes: &[u8]) -> Option<Vec<Tile>> {
    let mut records = Vec::new();
    let mut rest = bytes;
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let (record, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        records.push(record);
        rest = after;
    }
    if !rest.is_empty() {
        return None;
    }
    records.par_iter().map(|record| unpack_tile(record)).collect()
}

fn unpack_tile(record: &[u8]) -> Option<Tile> {
    let (size, packed) = lz4_flex::block::uncompressed_size(record).ok().filter(|(size, _)| *size <= MAX_TILE_BYTES)?;
    let bytes = lz4_flex::decompress(packed, size).ok()?;
    let (tile, rest): (Tile, _) = postcard::take_from_bytes(&bytes).ok()?;
    rest.is_empty().then_some(tile)
}

/// Are these the complete tiles of a render with these settings?
pub fn fits(saved: &[Tile], settings: &RenderSettings) -> bool {
    // First their number: the settings of a file may ask for more tiles than there is memory.
    let [x0, y0, x1, y1] = settings.window().map(u64::from);
    let tile = u64::from(TILE);
    let tiles = (x1.div_ceil(tile) - x0 / tile) * (y1.div_ceil(tile) - y0 / tile);
    let expected = settings.part.map_or(tiles, |part| part.count(tiles));
    let fresh = |position| Tile::new(position, settings.width, settings.height, settings.columns());
    saved.len() as u64 == expected
        && saved.iter().zip(tile_positions(settings)).all(|(tile, position)| tile.covers(&fresh(position)))
}

#[cfg(test)]
mod tests;
