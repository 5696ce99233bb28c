//! `bismar merge PART.exr...`

use std::path::PathBuf;
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;

use crate::batch::frames::Frames;
use crate::batch::numbering::numbered;
use crate::console::args::wait;
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::farm::PathMapping;
use crate::film::exr_file::HeaderValue;
use crate::film::{Exposure, Look, ViewTransform, atomic, colors, preview};
use crate::job::ViewOptions;
use crate::job::claim_output;
use crate::job::memory;
use crate::render::record::merge::{memory_bytes, merge};
use crate::{Error, Result};

/// Merge the parts of a picture, or average pictures of different seeds.
///
/// Merged parts (`render --part K/N`) are bit-identical to a whole render, in any order. Pictures that differ only in their
/// seed are averaged with the same weight for every path; they must have been rendered with --checkpoint.
#[derive(Debug, Clone, Args)]
pub struct MergeArgs {
    /// Frames to merge, each to its own file; names of parts and outputs hold the frame number as #### or {frame:04}.
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Parts, pictures of different seeds, or parts of such pictures.
    #[arg(required = true, value_name = "PART.exr")]
    parts: Vec<PathBuf>,
    /// Output picture.
    #[arg(short, long, value_name = "FILE.exr")]
    output: PathBuf,
    /// Also write a PNG.
    #[arg(long, value_name = "FILE.png")]
    preview: Option<PathBuf>,
    #[command(flatten)]
    view: ViewOptions,
    /// Exposure of the PNG in stops, or auto: the log-mean of all parts that are not dark becomes middle grey.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true)]
    exposure: Exposure,
    /// Omit the statistics from which a render could be resumed.
    #[arg(long)]
    no_statistics: bool,
    /// Wait up to this many seconds for missing files, which shared file systems may show late.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = wait)]
    wait: f64,
    /// Path mapping rules of Open Job Description (pathmapping-1.0), applied to all paths of this command.
    #[arg(long, value_name = "FILE.json")]
    path_mapping: Option<PathBuf>,
}

pub fn run(args: &MergeArgs, verbosity: Verbosity) -> Result<Verdict> {
    let mut args = args.clone();
    if let Some(file) = &args.path_mapping {
        let mapping = PathMapping::read(file)?;
        let all = args.parts.iter_mut().chain(&mut args.preview).chain([&mut args.output, &mut args.view.view]);
        all.for_each(|path| mapping.apply(path));
    }
    let Some(frames) = args.frames.take() else { return one(&args, verbosity) };
    // Names that a number completes are not those of the command line.
    atomic::confine(&[]);
    let mut worst = 0;
    for &frame in frames.numbers() {
        // A failed frame does not stop the others.
        if let Err(error) = args.of_frame(frame).and_then(|args| one(&args, verbosity)) {
            say(format_args!("error: frame {frame}: {error}"));
            worst = worst.max(error.exit_code());
        }
    }
    Ok(if worst == 0 { Verdict::Done } else { Verdict::Worst(worst) })
}

impl MergeArgs {
    /// The command of one frame.
    fn of_frame(&self, frame: u32) -> Result<Self> {
        let mut args = self.clone();
        for path in args.parts.iter_mut().chain(&mut args.preview).chain([&mut args.output]) {
            *path = numbered(path, frame).ok_or_else(|| {
                let why = "names one file for all frames; write their number as #### or {frame:04}";
                Error::Usage(format!("{}: {why}", path.display()))
            })?;
        }
        Ok(args)
    }
}

fn one(args: &MergeArgs, verbosity: Verbosity) -> Result<Verdict> {
    let (mut paths, mut claims) = (Paths::default(), Vec::new());
    args.parts.iter().try_for_each(|part| paths.reads("the part", part))?;
    args.path_mapping.iter().try_for_each(|file| paths.reads("--path-mapping", file))?;
    let view = args.view.transform()?;
    if let ViewTransform::Lut(_, path, _) = &view {
        paths.reads("--view", path)?;
    }
    for (flag, path) in [("-o", Some(&args.output)), ("--preview", args.preview.as_ref())] {
        let Some(path) = path else { continue };
        paths.writes(flag, path)?;
        claims.push(claim_output(path)?);
    }
    wait_for(&args.parts, args.wait)?;
    let limit = memory::limit(None)?;
    let bytes = memory::at_rest(rayon::current_num_threads()).saturating_add(memory_bytes(&args.parts)?);
    memory::check(&format!("merging to {}", args.output.display()), bytes, limit)?;
    memory::hold(limit);
    let mut merged = merge(&args.parts)?;
    merged.record.resumable &= !args.no_statistics;
    let exposure = args.exposure.of(colors(&merged.rendered.pixels()));
    merged.more.push(("bismar.exposure".into(), HeaderValue::Number(exposure.into())));
    merged.write(&args.output)?;
    if let Some(path) = &args.preview {
        preview::write(path, &merged.rendered.pixels(), &Look { view, exposure }, "")?;
    }
    if !verbosity.quiet {
        let what = match merged.record.seeds.len() {
            0 => format!("{} parts", args.parts.len()),
            n => format!("{n} seeds"),
        };
        let noise = merged.rendered.stats.noise;
        let shown = if args.preview.is_some() { format!(", exposure {exposure} EV") } else { String::new() };
        say(format_args!("{}: {what} merged, noise {noise:.4}{shown}", args.output.display()));
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
                "{} of {} parts are missing: {}",
                missing.len(),
                paths.len(),
                missing.join(", ")
            )));
        }
        thread::sleep(Duration::from_millis(200));
    }
}
