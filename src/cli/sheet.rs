//! `bismar sheet FRAMES.####.png`

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use image::imageops::FilterType;
use image::{ImageFormat, RgbImage, imageops};

use crate::batch::frames::Frames;
use crate::batch::numbering::{numbered, present};
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::film::atomic;
use crate::film::preview::encoded;
use crate::{Error, Result};

/// Make a contact sheet of a sequence of PNGs: thumbnails of all frames, or of 144 at equal steps.
#[derive(Debug, Args)]
pub struct SheetArgs {
    /// The PNGs: a file name with the frame number as #### or {frame:04}.
    pictures: PathBuf,
    /// Frames, such as 1-240, 1-240x2 or 7,12,40-44 [default: all files found].
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Output contact sheet.
    #[arg(short, long, alias = "sheet", value_name = "FILE.png")]
    output: PathBuf,
}

pub fn run(args: &SheetArgs, verbosity: Verbosity) -> Result<Verdict> {
    let pictures = pictures(args)?;
    let mut paths = Paths::default();
    pictures.iter().try_for_each(|picture| paths.reads("the frame", picture))?;
    paths.names("-o", &args.output)?;
    atomic::check(&args.output)?;
    write(&pictures, &args.output)?;
    if !verbosity.quiet {
        say(format_args!("{}: {} frames", args.output.display(), pictures.len()));
    }
    Ok(Verdict::Done)
}

/// The frames' files in order.
/// Errors: [`Error::Missing`] if there are none.
fn pictures(args: &SheetArgs) -> Result<Vec<PathBuf>> {
    let named = |frame: u32| numbered(&args.pictures, frame);
    if named(0).is_none() {
        let why = "names one picture: write the frame number as #### or {frame:04}";
        return Err(Error::Usage(format!("{}: {why}", args.pictures.display())));
    }
    let numbers = match &args.frames {
        Some(frames) => frames.numbers().to_vec(),
        None => present(&args.pictures)?,
    };
    if numbers.is_empty() {
        return Err(Error::Missing(format!("{}: no such pictures", args.pictures.display())));
    }
    Ok(numbers.into_iter().filter_map(named).collect())
}

const MAX_THUMBNAILS: usize = 144;
const THUMBNAIL_WIDTH: u32 = 240;

fn write(pictures: &[PathBuf], path: &Path) -> Result<()> {
    let shown: Vec<&PathBuf> = match pictures.len() {
        all if all <= MAX_THUMBNAILS => pictures.iter().collect(),
        all => (0..MAX_THUMBNAILS).map(|i| &pictures[i * (all - 1) / (MAX_THUMBNAILS - 1)]).collect(),
    };
    let columns = (shown.len() as f64).sqrt().ceil() as u32;
    let mut all = RgbImage::new(0, 0);
    let mut cell = 0;
    for (i, picture) in (0..).zip(shown) {
        let bytes = fs::read(picture).map_err(|e| Error::reading(picture, &e))?;
        let one = image::load_from_memory_with_format(&bytes, ImageFormat::Png)
            .map_err(|e| Error::Data(format!("{}: not a PNG: {e}", picture.display())))?;
        let small = one.resize(THUMBNAIL_WIDTH, THUMBNAIL_WIDTH * 4, FilterType::Triangle).into_rgb8();
        if i == 0 {
            // The first frame sets the height of the rows.
            cell = small.height();
            let rows = (pictures.len().min(MAX_THUMBNAILS) as u32).div_ceil(columns);
            all = RgbImage::new(columns * THUMBNAIL_WIDTH, rows * cell);
        }
        imageops::overlay(&mut all, &small, (i % columns * THUMBNAIL_WIDTH).into(), (i / columns * cell).into());
    }
    let png = encoded(all.width(), all.height(), &all)?;
    atomic::write(path, |file| Ok(Ok(file.write_all(&png)?)))
}
