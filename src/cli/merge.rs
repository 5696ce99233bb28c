//! `bismar merge PART.exr...`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use tracing::warn;

use super::render::{Earlier, attributes};
use super::stats::counts_header;
use super::{Verbosity, Verdict, say};
use crate::farm::PathMapping;
use crate::film::exr_file::{self, Header, HeaderValue};
use crate::film::{Aov, View, atomic, preview};
use crate::render::part::in_rows;
use crate::render::saved::{self, pack};
use crate::render::tile::Tile;
use crate::render::{
    Fingerprint, Part, RenderSettings, RenderStats, Rendered, StopReason, film_of, fresh_tiles, noise,
};
use crate::{Error, Result};

/// Put the parts of a picture together, and average pictures of different seeds.
///
/// Parts (`render --part K/N`) give the bits of the whole render, in whatever order they are named. Pictures that differ
/// in nothing but their seed are averaged, each path counting the same; they must have been rendered with --checkpoint.
#[derive(Debug, Clone, Args)]
pub struct MergeArgs {
    /// Parts, or pictures of different seeds, or parts of these.
    #[arg(required = true, value_name = "PART.exr")]
    parts: Vec<PathBuf>,
    /// Where the picture goes.
    #[arg(short, long, value_name = "FILE.exr")]
    output: PathBuf,
    /// Write a PNG too.
    #[arg(long, value_name = "FILE.png")]
    preview: Option<PathBuf>,
    /// The PNG's view transform.
    #[arg(long, value_enum, default_value_t = View::Agx)]
    view: View,
    /// The PNG's exposure in stops.
    #[arg(long, value_name = "EV", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,
    /// Leave out the statistics that a render could go on from.
    #[arg(long)]
    no_statistics: bool,
    /// Wait up to so many seconds for files that are not there: shared file systems show them late.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    wait: f64,
    /// Where these paths lie on this machine: rules of Open Job Description (pathmapping-1.0).
    #[arg(long, value_name = "FILE.json")]
    path_mapping: Option<PathBuf>,
}

/// One input.
struct Input {
    path: PathBuf,
    header: Earlier,
    fingerprint: Fingerprint,
    settings: RenderSettings,
    stats: RenderStats,
}

/// One whole picture.
struct Whole {
    tiles: Vec<Tile>,
    settings: RenderSettings,
    stats: RenderStats,
}

pub fn run(args: &MergeArgs, verbosity: Verbosity) -> Result<Verdict> {
    let mut args = args.clone();
    if let Some(file) = &args.path_mapping {
        let mapping = PathMapping::read(file)?;
        let all = args.parts.iter_mut().chain(&mut args.preview).chain([&mut args.output]);
        all.for_each(|path| mapping.apply(path));
    }
    atomic::check(&args.output)?;
    atomic::sweep(&args.output);
    if let Some(path) = &args.preview {
        atomic::check(path)?;
    }
    wait_for(&args.parts, args.wait)?;
    let mut inputs = args.parts.iter().map(|path| Input::read(path)).collect::<Result<Vec<_>>>()?;
    inputs.sort_by_key(|i| (i.settings.seed, i.settings.part.map(|p| p.number), i.path.clone()));
    check_kinship(&inputs)?;

    let mut seeds: BTreeMap<u32, Vec<Input>> = BTreeMap::new();
    for input in inputs {
        seeds.entry(input.settings.seed).or_default().push(input);
    }
    // Metadata are the first picture's, but for what is counted.
    let Some(first) = seeds.values().next().and_then(|group| group.first()) else {
        return Err(Error::Usage("no parts".into()));
    };
    let (header, fingerprint) = (first.header.clone(), first.fingerprint.clone());
    let keeps = !args.no_statistics && seeds.len() == 1 && header.keeps_statistics();
    let by_noise = seeds.values().flatten().any(|input| input.header.stop() == Some(StopReason::Noise));
    let names: Vec<String> = seeds.keys().map(u32::to_string).collect();
    let mut wholes = seeds.into_values().map(|group| assemble(&group)).collect::<Result<Vec<_>>>()?.into_iter();
    let Some(mut whole) = wholes.next() else { return Err(Error::Usage("no parts".into())) };
    for other in wholes {
        whole.average(&other);
    }

    let settings = whole.settings;
    let film = film_of(&whole.tiles, &settings);
    let stats = RenderStats { noise: noise(&whole.tiles, settings.window()), ..whole.stats };
    let rendered = Rendered { film, tiles: whole.tiles, stats, stop: header.stop().unwrap_or(StopReason::Samples) };
    let mut own = merged_header(&header, &settings, &rendered)?;
    let request = header.text("bismar.request").unwrap_or_default();
    own.extend(attributes(request, &fingerprint, &rendered.stats, keeps)?);
    if names.len() > 1 {
        if by_noise {
            warn!(
                "these pictures stopped when they looked clean (--noise), and their paths count alike: a picture that \
                 met nothing bright stopped early, so the mean is a little dark; --spp has no such bias"
            );
        }
        own.push(("bismar.seeds".into(), HeaderValue::Text(names.join(","))));
        // Nothing can go on from several seeds at once.
        own.retain(|(name, _)| name != "bismar.fingerprint" && name != "bismar.format");
    }
    let aovs = Aov::named(header.text("bismar.aov").unwrap_or_default());
    let statistics = keeps.then(|| pack(&rendered.tiles)).transpose()?;
    exr_file::write(&args.output, &rendered.film, &aovs, &own, statistics.as_deref())?;
    if let Some(path) = &args.preview {
        preview::write(path, &rendered.film, args.view, args.exposure)?;
    }
    if !verbosity.quiet {
        say(format_args!(
            "{}: {} merged, noise {:.4}",
            args.output.display(),
            match names.len() {
                1 => format!("{} parts", args.parts.len()),
                n => format!("{n} seeds"),
            },
            rendered.stats.noise
        ));
    }
    Ok(Verdict::Done)
}

fn wait_for(paths: &[PathBuf], seconds: f64) -> Result<()> {
    let start = Instant::now();
    loop {
        let missing: Vec<_> = paths.iter().filter(|p| !p.exists()).map(|p| p.display().to_string()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        if start.elapsed().as_secs_f64() >= seconds {
            return Err(Error::Missing(format!(
                "{} of {} parts are not there: {}",
                missing.len(),
                paths.len(),
                missing.join(", ")
            )));
        }
        thread::sleep(Duration::from_millis(200));
    }
}

impl Input {
    fn read(path: &Path) -> Result<Self> {
        let refused = |why: &str| Error::Data(format!("{}: {why}", path.display()));
        let Some(header) = Earlier::read(path)? else {
            return Err(Error::Missing(format!("{}: is not there", path.display())));
        };
        let known = (header.fingerprint(), header.settings(), header.stats());
        let (Some(fingerprint), Some(settings), Some(stats)) = known else {
            return Err(refused("does not say what it was made of"));
        };
        if header.stop().is_none_or(|stop| stop == StopReason::Interrupted) {
            return Err(refused("is not finished: render it with --resume first"));
        }
        Ok(Self { path: path.into(), header, fingerprint, settings, stats })
    }

    fn tiles(&self) -> Result<Vec<Tile>> {
        let refused = |why: &str| Error::Data(format!("{}: {why}", self.path.display()));
        let bytes = exr_file::read_statistics(&self.path)?
            .ok_or_else(|| refused("carries no statistics to merge: render it with --checkpoint"))?;
        saved::unpack(&bytes)
            .filter(|tiles| saved::fits(tiles, &fresh_tiles(&self.settings)))
            .ok_or_else(|| refused("its statistics are not those of such a render"))
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }
}

/// Are these parts and seeds of one render, each once, and none missing?
fn check_kinship(inputs: &[Input]) -> Result<()> {
    let Some(first) = inputs.first() else { return Ok(()) };
    let ours = first.fingerprint.without_seed();
    for other in inputs {
        let theirs = other.fingerprint.without_seed();
        if theirs != ours {
            return Err(Error::Data(format!(
                "{} is of another render than {}: different {}",
                other.name(),
                first.name(),
                ours.differences(&theirs)
            )));
        }
        if other.header.text("bismar.aov") != first.header.text("bismar.aov") {
            return Err(Error::Data(format!("{} has other AOVs than {}", other.name(), first.name())));
        }
        if other.settings.part.map(|p| p.of) != first.settings.part.map(|p| p.of) {
            let of = |i: &Input| i.settings.part.map_or("the whole".into(), |p| format!("part {p}"));
            return Err(Error::Data(format!(
                "{} is {}, but {} is {}: parts must be of one division",
                other.name(),
                of(other),
                first.name(),
                of(first)
            )));
        }
        let isa = |i: &Input| {
            let backend: serde_json::Value =
                i.header.text("bismar.backend").and_then(|t| serde_json::from_str(t).ok()).unwrap_or_default();
            (backend["version"].to_string(), backend["isa"].to_string())
        };
        if isa(other) != isa(first) {
            warn!(
                "{} was rendered by {:?} and {} by {:?}: the picture is as right as ever, but not to the last bit the one \
                 of a single host",
                other.name(),
                isa(other),
                first.name(),
                isa(first)
            );
        }
    }
    for pair in inputs.windows(2) {
        let [a, b] = pair else { continue };
        if (a.settings.seed, a.settings.part) == (b.settings.seed, b.settings.part) {
            let what = match a.settings.part {
                Some(part) => format!("part {part} of seed {}", a.settings.seed),
                None => format!("seed {}, so that they are no independent pictures", a.settings.seed),
            };
            return Err(Error::Data(format!("{} and {} are both {what}", a.name(), b.name())));
        }
    }
    Ok(())
}

/// Puts the parts of one seed together.
fn assemble(parts: &[Input]) -> Result<Whole> {
    let Some(first) = parts.first() else { return Err(Error::Bug("no parts".into())) };
    let seed = first.settings.seed;
    if let Some(Part { of, .. }) = first.settings.part {
        let there = |number: &u32| parts.iter().any(|p| p.settings.part.is_some_and(|p| p.number == *number));
        let missing: Vec<_> = (1..=of).filter(|n| !there(n)).map(|n| format!("{n}/{of}")).collect();
        if !missing.is_empty() {
            return Err(Error::Data(format!(
                "of seed {seed} {} of {of} parts are missing: {}",
                missing.len(),
                missing.join(", ")
            )));
        }
    }
    let mut tiles = Vec::new();
    let mut stats = RenderStats::default();
    for part in parts {
        let own = part.tiles()?;
        let paths = |tiles: &[Tile]| tiles.first().map_or(0, Tile::paths);
        if !tiles.is_empty() && paths(&own) != paths(&tiles) {
            return Err(Error::Data(format!(
                "{} has {} paths a pixel and {} has {}: go on with the one that has less (--resume)",
                part.name(),
                paths(&own),
                first.name(),
                paths(&tiles)
            )));
        }
        stats.join(&part.stats);
        tiles.extend(own);
    }
    in_rows(&mut tiles);
    let settings = RenderSettings { part: None, ..first.settings.clone() };
    if !saved::fits(&tiles, &fresh_tiles(&settings)) {
        return Err(Error::Data(format!("the parts of seed {seed} do not cover the picture")));
    }
    Ok(Whole { tiles, settings, stats })
}

impl Whole {
    /// Sums add up: every path of either counts the same, and so does the variance of their mean.
    fn average(&mut self, other: &Whole) {
        for (tile, more) in self.tiles.iter_mut().zip(&other.tiles) {
            tile.stats.iter_mut().zip(&more.stats).for_each(|(own, more)| own.join(more));
            tile.aovs.iter_mut().zip(&more.aovs).for_each(|(own, more)| own.join(more));
        }
        self.stats.join(&other.stats);
    }
}

/// The first picture's header with what has changed.
fn merged_header(first: &Earlier, settings: &RenderSettings, rendered: &Rendered) -> Result<Header> {
    let kept =
        ["bismar.version", "bismar.scene", "bismar.camera", "bismar.backend", "bismar.environment", "bismar.aov"];
    let text = |name: &&str| first.text(name).map(|t| ((*name).to_owned().into(), HeaderValue::Text(t.to_owned())));
    let mut header: Header = kept.iter().filter_map(text).collect();
    header.extend(counts_header(settings, rendered)?);
    Ok(header)
}
