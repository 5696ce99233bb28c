//! What a render needs to go on, in a picture's file: its record in the header, its tiles in a part of their own.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::identity::{RequestedOutputs, variant_name};
use super::scheduler;
use super::stats::Samples;
use super::tile::Tile;
use super::{BuildInfo, Identity, Part, RenderSettings, RenderStats, Rendered, StopReason, fresh_tiles, paths_range};
use crate::film::exr_file::{self, Checksum, Header, HeaderValue, Layers};
use crate::film::{Aov, Background};
use crate::rays::BackendInfo;
use crate::{Error, Result};

/// A render that can go on.
#[derive(Debug)]
pub struct Saved {
    /// Row by row.
    pub tiles: Vec<Tile>,
    /// Over all sessions so far.
    pub stats: RenderStats,
}

impl Saved {
    /// As [`scheduler::is_on_the_way`].
    pub fn is_on_the_way(&self, settings: &RenderSettings) -> bool {
        let (done, ahead) = paths_range(&self.tiles);
        match settings.noise_goal() {
            // Each tile goes its own way, and from the first look at the noise on any.
            Some(goal) => {
                let own_way = |n: u32| n > goal.least || scheduler::is_planned(settings, n);
                self.tiles.iter().all(|tile| own_way(tile.paths()))
            }
            // Each tile has a goal of its own.
            None if settings.adaptive => true,
            None => scheduler::is_on_the_way(settings, done, ahead, self.stats.passes),
        }
    }
}

/// Raised whenever an older version could no longer read what is written.
pub const FORMAT: u32 = 4;

/// What a picture says of its making: all that going on and merging ask for, but the tiles.
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
    /// Why it ended.
    pub stop: StopReason,
    /// Estimated relative error, once a pass is complete.
    pub noise: Option<f64>,
    /// Fewest paths of a tile.
    pub paths: u32,
    /// Noise of its noisiest tile.
    pub worst_noise: Option<f64>,
    /// Does the file keep the statistics that a resumed render needs, even when the render is finished?
    #[serde(rename = "keeps")]
    pub resumable: bool,
    /// Who traced its rays last.
    pub host: Host,
    /// Are its colours 16-bit floats?
    pub half: bool,
    /// What is behind everything.
    pub background: Background,
    /// The build that wrote it.
    #[serde(rename = "maker")]
    pub build: BuildInfo,
    /// The seeds that it is the mean of, if of several: nothing can go on from that.
    #[serde(skip)]
    pub seeds: Vec<u32>,
}

/// What bits depend on beside the command: the same on hosts of one kind.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Host {
    /// Of the library that traces rays.
    pub version: String,
    /// Its instruction set.
    pub isa: String,
}

impl Host {
    /// Of a backend that is here.
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
            stop: rendered.stop,
            noise: Some(rendered.stats.noise).filter(|noise| noise.is_finite()),
            paths: rendered.paths_range().0,
            worst_noise: Some(rendered.worst_noise()).filter(|noise| noise.is_finite()),
            resumable,
            host,
            half: requested.half,
            background: rendered.background,
            build: BuildInfo::here(),
            seeds: Vec::new(),
        }
    }

    /// Was it made by a command with this identity and these wishes, for this part?
    pub fn answers(&self, identity: &Identity, requested: &RequestedOutputs) -> bool {
        self.request == identity.request(requested) && self.identity.settings.part == identity.settings.part
    }

    /// Paths a pixel that it is finished with: the fewest of a tile, or, where tiles have goals of their own, the mean.
    pub fn spp(&self) -> u32 {
        let settings = &self.identity.settings;
        let mean = settings.spp.filter(|_| settings.adaptive && self.stop == StopReason::Samples);
        mean.unwrap_or(self.paths)
    }

    /// Does it fulfil one of the stop rules of these settings?
    pub fn is_done(&self, settings: &RenderSettings) -> bool {
        if self.stop == StopReason::Interrupted {
            return false;
        }
        let seconds = match self.stop {
            // It may end before its time, when no path fits any more.
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
            || settings.noise_goal().is_some_and(|goal| worst <= goal.error && self.paths >= goal.least)
    }

    /// As header attributes, with those that `docs/stats.md` promises to scripts.
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
        if self.seeds.is_empty() {
            header.push(("bismar.format".into(), HeaderValue::Number(FORMAT.into())));
            header.push(("bismar.record".into(), json(self)?));
            header.push(("bismar.fingerprint".into(), json(&self.identity.bits())?));
        } else {
            let seeds: Vec<_> = self.seeds.iter().map(u32::to_string).collect();
            header.push(("bismar.seeds".into(), HeaderValue::Text(seeds.join(","))));
        }
        Ok(header)
    }
}

/// JSON as a header's text.
///
/// # Errors
/// [`Error::Bug`] if JSON cannot say it.
pub fn json(value: &impl Serialize) -> Result<HeaderValue> {
    serde_json::to_string(value).map(HeaderValue::Text).map_err(|e| Error::Bug(format!("JSON: {e}")))
}

/// A number of a header.
pub fn number(header: &Header, name: &str) -> Option<f64> {
    header.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
        HeaderValue::Number(x) => Some(*x),
        _ => None,
    })
}

/// A text of a header.
pub fn text<'a>(header: &'a Header, name: &str) -> Option<&'a str> {
    header.iter().find(|(n, _)| n == name).and_then(|(_, value)| match value {
        HeaderValue::Text(text) => Some(text.as_str()),
        _ => None,
    })
}

/// Writes a render's picture with its record, `more` attributes and a layer `denoised`; with its tiles, if `with_tiles`.
///
/// # Errors
/// As [`exr_file::write`].
pub fn write(
    path: &Path,
    rendered: &Rendered,
    record: &Record,
    more: Header,
    denoised: Option<&[[f32; 3]]>,
    with_tiles: bool,
) -> Result<()> {
    let mut header = record.header(rendered)?;
    header.extend(more);
    let tiles = with_tiles.then(|| pack(&rendered.tiles)).transpose()?;
    let layers = Layers { aovs: &Aov::named(&record.aovs), half: record.half, denoised };
    exr_file::write(path, &rendered.pixels(), layers, &header, tiles.as_deref())
}

/// A picture of ours that is there already.
#[derive(Debug, Clone)]
pub struct Earlier {
    /// Where it is.
    pub path: PathBuf,
    /// What it says of its making.
    pub record: Record,
    /// All that it says.
    pub header: Header,
}

impl Earlier {
    /// Reads the header of a picture; `None` if there is no file.
    ///
    /// # Errors
    /// As [`exr_file::read_header`]; [`Error::Data`] for pictures of others and of newer versions.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        let header = match exr_file::read_header(path) {
            Err(Error::Missing(_)) => return Ok(None),
            other => other?,
        };
        let refused = |why: String| Error::Data(format!("{}: {why}", path.display()));
        let record = match number(&header, "bismar.format") {
            None => return Err(refused("is no picture that bismar can go on from".into())),
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

    /// Checks that the file is what was written, to the last byte.
    ///
    /// # Errors
    /// [`Error::Data`] for a file that is damaged; others as [`exr_file::check`].
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
    /// As [`exr_file::read_statistics`]; [`Error::Data`] if they are not those of a render of `settings`.
    pub fn tiles(&self, settings: &RenderSettings) -> Result<Option<Vec<Tile>>> {
        let Some(bytes) = exr_file::read_statistics(&self.path)? else { return Ok(None) };
        let tiles = unpack(&bytes).filter(|tiles| fits(tiles, settings));
        let refused = || Error::Data(format!("{}: its statistics are not those of such a render", self.path.display()));
        tiles.map(Some).ok_or_else(refused)
    }

    /// What a render of this identity goes on from.
    ///
    /// # Errors
    /// [`Error::Data`], with what differs, when it is another render, is damaged, or carries no statistics.
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
        Ok(Saved { tiles, stats: self.record.stats })
    }
}

/// Maximum bytes of an unpacked tile.
const MAX_TILE_BYTES: usize = 1 << 24;

/// Tiles as bytes: for each its length (32 bits, little-endian) and itself (postcard in LZ4, which is faster than a disk
/// and leaves out what is zero), velocities behind it if there are any.
///
/// # Errors
/// [`Error::Bug`] if a tile cannot be said.
pub fn pack(tiles: &[Tile]) -> Result<Vec<u8>> {
    let record = |tile: &Tile| {
        let mut bytes = postcard::to_stdvec(tile)?;
        if let Some(velocities) = tile.velocities() {
            bytes.extend(postcard::to_stdvec(&velocities)?);
        }
        Ok(lz4_flex::compress_prepend_size(&bytes))
    };
    let mut bytes = Vec::new();
    // Some at a time, so that they are not all in memory twice.
    for some in tiles.chunks(1024) {
        let records: std::result::Result<Vec<_>, postcard::Error> = some.par_iter().map(record).collect();
        for record in records.map_err(|e| Error::Bug(format!("a tile cannot be saved: {e}")))? {
            bytes.extend((record.len() as u32).to_le_bytes());
            bytes.extend(record);
        }
    }
    Ok(bytes)
}

/// Reads what [`pack`] made; nothing in it is trusted. `None` if it is not that.
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
    if rest.is_empty() {
        return Some(tile);
    }
    let (velocities, rest) = postcard::take_from_bytes(rest).ok()?;
    if rest.is_empty() { tile.with_velocities(velocities) } else { None }
}

/// Are these the tiles of a render of these settings, each whole?
pub fn fits(saved: &[Tile], settings: &RenderSettings) -> bool {
    let fresh = fresh_tiles(settings);
    saved.len() == fresh.len() && saved.iter().zip(&fresh).all(|(a, b)| a.covers(b))
}

#[cfg(test)]
mod tests;
