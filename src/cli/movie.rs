//! `bismar movie FRAMES.####.png`

use std::ffi::OsString;
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;
use image::imageops::FilterType;
use image::{ImageFormat, RgbaImage, imageops};

use crate::batch::frames::{Frames, numbered, present};
use crate::console::args::positive;
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::farm::slurm::quoted;
use crate::film::atomic;
use crate::{Error, Result};

/// Make a movie of a sequence's PNGs with ffmpeg, or a contact sheet.
///
/// The movie is H.264 for .mp4, .mov and .mkv; what else ffmpeg knows by its extension it makes as it does by default. Where
/// there is no ffmpeg, its command is said, and the exit code is 76.
#[derive(Debug, Args)]
pub struct MovieArgs {
    /// The PNGs: a name with the frame's number as #### or {frame:04}.
    pictures: PathBuf,
    /// Which frames, as for render [default: all that are there].
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Where the movie goes.
    #[arg(short, long, value_name = "FILE.mp4", required_unless_present = "sheet")]
    output: Option<PathBuf>,
    /// Frames a second.
    #[arg(long, value_name = "F", value_parser = positive, default_value_t = 24.0)]
    fps: f64,
    /// Where a contact sheet goes: all frames as small pictures, or 144 of them at equal steps.
    #[arg(long, value_name = "FILE.png")]
    sheet: Option<PathBuf>,
}

pub fn run(args: &MovieArgs, verbosity: Verbosity) -> Result<Verdict> {
    let pictures = pictures(args)?;
    let mut paths = Paths::default();
    pictures.iter().try_for_each(|picture| paths.reads("the frame", picture))?;
    for (flag, path) in [("-o", &args.output), ("--sheet", &args.sheet)] {
        let Some(path) = path else { continue };
        paths.writes(flag, path)?;
        atomic::check(path)?;
    }
    if let Some(path) = &args.sheet {
        sheet(&pictures, path)?;
    }
    if let Some(path) = &args.output {
        movie(args.fps, &pictures, path)?;
    }
    if !verbosity.quiet {
        for path in [&args.sheet, &args.output].into_iter().flatten() {
            say(format_args!("{}: {} frames", path.display(), pictures.len()));
        }
    }
    Ok(Verdict::Done)
}

/// The frames' files, in order; all are there.
fn pictures(args: &MovieArgs) -> Result<Vec<PathBuf>> {
    let named = |frame: u32| numbered(&args.pictures, frame);
    let Some(_) = named(0) else {
        let why = "names one picture: write the frames' number as #### or {frame:04}";
        return Err(Error::Usage(format!("{}: {why}", args.pictures.display())));
    };
    let numbers = match &args.frames {
        Some(frames) => frames.numbers().to_vec(),
        None => present(&args.pictures)?,
    };
    let pictures: Vec<PathBuf> = numbers.into_iter().filter_map(named).collect();
    let absent: Vec<_> = pictures.iter().filter(|p| !p.is_file()).map(|p| p.display().to_string()).collect();
    match (pictures.is_empty(), absent.first()) {
        (true, _) => Err(Error::Missing(format!("{}: there are no such pictures", args.pictures.display()))),
        (_, Some(first)) => {
            let all = pictures.len();
            Err(Error::Missing(format!("{first}: is not there ({} of {all} frames are not)", absent.len())))
        }
        _ => Ok(pictures),
    }
}

/// Hands the PNGs to ffmpeg, one after the other: so their names mean nothing to it.
fn movie(fps: f64, pictures: &[PathBuf], path: &Path) -> Result<()> {
    let cannot = |e: std::io::Error| Error::CannotCreate(format!("{}: cannot create: {e}", path.display()));
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let mut words: Vec<OsString> =
        ["-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png", "-framerate"].map(Into::into).into();
    words.extend([fps.to_string(), "-i".into(), "-".into()].map(OsString::from));
    if ["mp4", "mov", "mkv"].iter().any(|known| extension == *known) {
        // Even sides and these colours are what players expect.
        let even = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
        words.extend(["-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p", "-vf", even].map(OsString::from));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let suffix = format!(".{}", extension.to_string_lossy());
    let temporary = tempfile::Builder::new().prefix(".movie-").suffix(&suffix).tempfile_in(folder).map_err(cannot)?;
    let temporary = temporary.into_temp_path();
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(&words).arg(&*temporary).stdin(Stdio::piped()).stdout(Stdio::null());
    let mut child = ffmpeg.spawn().map_err(|e| {
        let command: Vec<String> = ["ffmpeg".into()].into_iter().chain(words).map(|w| shown(&w)).collect();
        let all: Vec<String> = pictures.iter().take(2).map(|p| shown(p.as_os_str())).collect();
        let more = if pictures.len() > 2 { " …" } else { "" };
        let (all, command, to) = (quoted(&all), quoted(&command), quoted(&[shown(path.as_os_str())]));
        Error::Host(format!("cannot run ffmpeg: {e}; where there is one: cat {all}{more} | {command} {to}"))
    })?;
    let mut stdin = child.stdin.take();
    for picture in pictures {
        let bytes = fs::read(picture).map_err(|e| Error::reading(picture, &e));
        // What ffmpeg does not want to read any more is told by its exit code.
        let told = bytes.map(|bytes| stdin.as_mut().is_some_and(|stdin| stdin.write_all(&bytes).is_ok()));
        match told {
            Ok(true) => {}
            Ok(false) => break,
            Err(e) => {
                drop(stdin.take());
                let _ = child.kill().and_then(|()| child.wait().map(drop));
                return Err(e);
            }
        }
    }
    drop(stdin);
    let status = child.wait().map_err(|e| Error::Io(format!("ffmpeg: {e}")))?;
    if !status.success() {
        return Err(Error::Io(format!(
            "{}: ffmpeg could not make it ({status}); what it says is above",
            path.display()
        )));
    }
    // Written by another program: readable as that would have made it.
    fs::set_permissions(&*temporary, std::os::unix::fs::PermissionsExt::from_mode(0o644)).map_err(cannot)?;
    temporary.persist(path).map_err(|e| cannot(e.error))
}

fn shown(word: &std::ffi::OsStr) -> String {
    word.to_string_lossy().into_owned()
}

/// Most pictures of a sheet, and the width of one.
const MOST: usize = 144;
const WIDTH: u32 = 240;

fn sheet(pictures: &[PathBuf], path: &Path) -> Result<()> {
    let shown: Vec<&PathBuf> = match pictures.len() {
        all if all <= MOST => pictures.iter().collect(),
        all => (0..MOST).map(|i| &pictures[i * (all - 1) / (MOST - 1)]).collect(),
    };
    let columns = (shown.len() as f64).sqrt().ceil() as u32;
    let mut all = RgbaImage::new(0, 0);
    let mut cell = 0;
    for (i, picture) in (0..).zip(shown) {
        let bytes = fs::read(picture).map_err(|e| Error::reading(picture, &e))?;
        let one = image::load_from_memory_with_format(&bytes, ImageFormat::Png)
            .map_err(|e| Error::Data(format!("{}: is no PNG: {e}", picture.display())))?;
        let small = one.resize(WIDTH, WIDTH * 4, FilterType::Triangle).into_rgba8();
        if i == 0 {
            // The first says how high a row is.
            cell = small.height();
            let rows = (pictures.len().min(MOST) as u32).div_ceil(columns);
            all = RgbaImage::new(columns * WIDTH, rows * cell);
        }
        imageops::overlay(&mut all, &small, (i % columns * WIDTH).into(), (i / columns * cell).into());
    }
    let mut bytes = Cursor::new(Vec::new());
    all.write_to(&mut bytes, ImageFormat::Png).map_err(|e| Error::Bug(format!("a contact sheet: {e}")))?;
    atomic::write(path, |file| Ok(Ok(file.write_all(bytes.get_ref())?)))
}
