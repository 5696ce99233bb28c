//! Merging: parts of a picture are combined, pictures with different seeds are averaged.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use tracing::warn;

use super::checkpoint::{self, Earlier, Record, Saved, fits};
use crate::film::cryptomatte::PREFIX;
use crate::film::exr_file::{self, CALIBRATION, Header, HeaderValue};
use crate::render::pass::rendered::{Rendered, noise};
use crate::render::pass::stats::{RenderStats, StopReason};
use crate::render::pass::tile::Tile;
use crate::render::settings::RenderSettings;
use crate::render::settings::part::Part;
use crate::{Error, Result};

/// The result of merging parts or seeds.
pub struct Merged {
    /// The whole picture.
    pub rendered: Rendered,
    /// The record of the first input, with the counts of all.
    pub record: Record,
    /// Header attributes besides the record's.
    pub more: Header,
}

/// Merges pictures, given in any order, with all parts of each seed. Merged parts have the bits of the whole render. Seeds
/// are averaged with the same weight for every path.
///
/// # Errors
/// [`Error::Data`], with the file, for a picture of another program or another render, for one that is unfinished, given
/// twice or without statistics, and for missing parts; [`Error::Missing`] and those of [`Earlier::read`].
pub fn merge(paths: &[PathBuf]) -> Result<Merged> {
    let mut inputs = paths.iter().map(|path| read(path)).collect::<Result<Vec<_>>>()?;
    inputs.sort_by_key(|i| (settings(i).seed, settings(i).part.map(|p| p.number), i.path.clone()));
    let Some(first) = inputs.first().cloned() else { return Err(Error::Usage("nothing to merge".into())) };
    check_same_render(&first, &inputs)?;
    // Where tiles end by noise or by samples, the whole ends by samples if any tile does.
    let by_samples = inputs.iter().any(|input| input.record.stop == StopReason::Samples);
    let mut seeds: BTreeMap<u32, Vec<Earlier>> = BTreeMap::new();
    for input in inputs {
        seeds.entry(settings(&input).seed).or_default().push(input);
    }
    let several = seeds.len() > 1;
    let names = seeds.keys().copied().collect();
    let mut whole: Option<Whole> = None;
    for parts in seeds.values() {
        let next = assemble(parts)?;
        match &mut whole {
            Some(whole) => whole.add(&next),
            None => whole = Some(next),
        }
    }
    let Some(Whole { tiles, stats }) = whole else { return Err(Error::Bug("no seed".into())) };
    let settings = RenderSettings { part: None, ..first.record.identity.settings.clone() };
    let stats = RenderStats { noise: noise(&tiles, settings.window()), ..stats };
    let Record { stop, background, .. } = first.record;
    let stop = if by_samples { StopReason::Samples } else { stop };
    let goals = first.record.goals.clone();
    let rendered = Rendered { settings: settings.clone(), tiles, stats, goals, stop, background };
    let mut record = Record {
        stats,
        stop,
        noise: Some(stats.noise).filter(|noise| noise.is_finite()),
        paths: rendered.paths_range().0,
        worst_noise: Some(rendered.worst_noise()).filter(|noise| noise.is_finite()),
        resumable: !several && first.record.resumable,
        seeds: if several { names } else { Vec::new() },
        ..first.record
    };
    record.identity.settings = settings;
    let kept = [
        "bismar.version",
        "bismar.scene",
        "bismar.camera",
        CALIBRATION,
        "bismar.backend",
        "bismar.environment",
        "bismar.command",
    ];
    let text = |name: &&'static str| {
        checkpoint::text(&first.header, name).map(|text| ((*name).into(), HeaderValue::Text(text.into())))
    };
    let more = first.header.iter().filter(|(name, value)| {
        let lists = ["bismar.objects", "bismar.categories", "bismar.materials"];
        let named = name.starts_with(PREFIX) || lists.contains(&name.as_ref());
        named || matches!(value, HeaderValue::Matrix(_))
    });
    Ok(Merged { rendered, record, more: kept.iter().filter_map(text).chain(more.cloned()).collect() })
}

impl Merged {
    /// Writes the picture, with its statistics if the inputs are resumable.
    ///
    /// # Errors
    /// Those of [`checkpoint::write`].
    pub fn write(&self, path: &Path) -> Result<()> {
        checkpoint::write(path, &self.rendered, &self.record, self.more.clone(), &[], self.record.resumable)
    }
}

/// Estimated peak memory in bytes of merging these pictures, by their headers.
///
/// # Errors
/// Those of [`merge`] for pictures that cannot be read.
pub fn memory_bytes(paths: &[PathBuf]) -> Result<u64> {
    let (mut tiles, mut statistics, mut saved): (u64, u64, u64) = (0, 0, 0);
    let mut seeds = BTreeSet::new();
    for path in paths {
        let input = read(path)?;
        let settings = settings(&input);
        let [x0, y0, x1, y1] = settings.window().map(u64::from);
        let pixels = x1.saturating_sub(x0).saturating_mul(y1.saturating_sub(y0));
        tiles = tiles.max(Tile::memory_bytes(pixels, settings.columns()));
        seeds.insert(settings.seed);
        // The statistics are most of a file. One file's are in memory at a time, before and after they are decompressed.
        let file = exr_file::length(path)?;
        statistics = statistics.max(file);
        saved += if input.record.resumable { file } else { 0 };
    }
    // The sum, and the picture that is added to it.
    let sums = tiles.saturating_mul(seeds.len().min(2) as u64);
    Ok(sums.saturating_add(statistics.max(if seeds.len() > 1 { 0 } else { saved })))
}

fn settings(input: &Earlier) -> &RenderSettings {
    &input.record.identity.settings
}

fn read(path: &Path) -> Result<Earlier> {
    let Some(input) = Earlier::read(path)? else {
        return Err(Error::Missing(format!("{}: is not there", path.display())));
    };
    if input.record.stop == StopReason::Interrupted {
        return Err(Error::Data(format!("{}: is not finished: render it with --resume first", path.display())));
    }
    Ok(input)
}

/// Checks that these are parts and seeds of one render, each given once.
fn check_same_render(first: &Earlier, inputs: &[Earlier]) -> Result<()> {
    let first_name = first.path.display();
    for other in inputs {
        let name = other.path.display();
        let differences = first.record.identity.differences_but_for_seeds(&other.record.identity);
        if !differences.is_empty() {
            return Err(Error::Data(format!("{name} is of another render than {first_name}: different {differences}")));
        }
        if other.record.aovs != first.record.aovs {
            return Err(Error::Data(format!("{name} has other AOVs than {first_name}")));
        }
        if other.record.half != first.record.half {
            return Err(Error::Data(format!("{name} and {first_name}: only one of them has 16-bit colours (--half)")));
        }
        if other.record.colorspace != first.record.colorspace {
            return Err(Error::Data(format!(
                "{name} and {first_name}: their colours have other primaries (--colorspace)"
            )));
        }
        let [ours, theirs] = [first, other].map(|i| settings(i).part);
        if ours.map(|p| p.of) != theirs.map(|p| p.of) {
            let of = |part: Option<Part>| part.map_or("the whole".into(), |p| format!("part {p}"));
            let (ours, theirs) = (of(ours), of(theirs));
            return Err(Error::Data(format!(
                "{name} is {theirs}, but {first_name} is {ours}: parts must be of one division"
            )));
        }
        let [ours, theirs] = [first, other].map(|i| &i.record.host);
        if ours != theirs {
            warn!(
                "{name} was rendered by {} ({}) and {first_name} by {} ({}): the picture is correct, but \
                 its bits are not those of a single host",
                theirs.version, theirs.isa, ours.version, ours.isa
            );
        }
    }
    let builds =
        |other: &&Earlier| Some(first.record.build.differences(&other.record.build)).filter(|text| !text.is_empty());
    if let Some((other, differences)) = inputs.iter().find_map(|other| Some((other, builds(&other)?))) {
        warn!(
            "{} and {first_name} were written by different builds of bismar, {differences}: the picture is as right as \
             ever, but perhaps not to the last bit that of one build",
            other.path.display()
        );
    }
    for pair in inputs.windows(2) {
        let [a, b] = [settings(&pair[0]), settings(&pair[1])];
        if (a.seed, a.part) == (b.seed, b.part) {
            let what = match a.part {
                Some(part) => format!("part {part} of seed {}", a.seed),
                None => format!("seed {}, so that they are no independent pictures", a.seed),
            };
            let [a, b] = [pair[0].path.display(), pair[1].path.display()];
            return Err(Error::Data(format!("{a} and {b} are both {what}")));
        }
    }
    Ok(())
}

/// One whole picture.
struct Whole {
    tiles: Vec<Tile>,
    stats: RenderStats,
}

/// Combines the parts of one seed.
fn assemble(parts: &[Earlier]) -> Result<Whole> {
    let Some(first) = parts.first() else { return Err(Error::Bug("no parts".into())) };
    let seed = settings(first).seed;
    if let Some(Part { of, .. }) = settings(first).part {
        let there = |number: &u32| parts.iter().any(|p| settings(p).part.is_some_and(|p| p.number == *number));
        const MAX_NAMED: usize = 100;
        let named: Vec<_> = (1..=of).filter(|n| !there(n)).take(MAX_NAMED + 1).map(|n| format!("{n}/{of}")).collect();
        if !named.is_empty() {
            let more = if named.len() > MAX_NAMED { ", …" } else { "" };
            return Err(Error::Data(format!(
                "of seed {seed} {} of {of} parts are missing: {}{more}",
                of as usize - parts.len().min(of as usize),
                named[..named.len().min(MAX_NAMED)].join(", ")
            )));
        }
    }
    let mut tiles = Vec::new();
    let mut stats = RenderStats::default();
    for part in parts {
        part.verify()?;
        let name = part.path.display();
        let own = part.tiles(settings(part))?.ok_or_else(|| {
            Error::Data(format!("{name}: carries no statistics to merge: render it with --checkpoint"))
        })?;
        let saved = Saved { tiles: own, stats: part.record.stats, goals: part.record.goals.clone() };
        // Merged parts should have the bits of the whole.
        if settings(part).part.is_some() && !saved.has_passes_of(settings(part)) {
            warn!(
                "{name} was begun with another goal and took other passes, or learned another guiding field, than a render \
                 in one go: the picture is as right as ever, but not bit for bit that of the whole"
            );
        }
        let own = saved.tiles;
        let paths = |tiles: &[Tile]| tiles.first().map_or(0, Tile::paths);
        let per_tile_counts = |part: &Earlier| settings(part).noise.is_some() || part.record.stats.is_allocated();
        let [goal, ours] = [part, first].map(|part| {
            let s = settings(part);
            (s.noise, s.min_spp, s.spp.filter(|_| per_tile_counts(part)))
        });
        if goal != ours {
            return Err(Error::Data(format!(
                "{name} and {} ended at different goals (--noise, --min-spp, --spp): go on with one of them (--resume)",
                first.path.display()
            )));
        }
        if !tiles.is_empty() && !per_tile_counts(part) && paths(&own) != paths(&tiles) {
            return Err(Error::Data(format!(
                "{name} has {} paths a pixel and {} has {}: go on with the one that has less (--resume)",
                paths(&own),
                first.path.display(),
                paths(&tiles)
            )));
        }
        stats.join(&part.record.stats);
        tiles.extend(own);
    }
    tiles.sort_by_key(|tile| {
        let [x, y] = tile.grid_position();
        (y, x)
    });
    if !fits(&tiles, &RenderSettings { part: None, ..settings(first).clone() }) {
        return Err(Error::Data(format!("the parts of seed {seed} do not cover the picture")));
    }
    Ok(Whole { tiles, stats })
}

impl Whole {
    /// Adds the sums of another seed.
    fn add(&mut self, other: &Whole) {
        for (tile, more) in self.tiles.iter_mut().zip(&other.tiles) {
            tile.join(more);
        }
        self.stats.join(&other.stats);
    }
}
