//! `bismar movie FRAMES.####.png`

use std::ffi::OsString;
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use clap::Args;
use image::imageops::FilterType;
use image::{ImageFormat, RgbaImage, imageops};

use crate::batch::frames::Frames;
use crate::batch::numbering::{numbered, present};
use crate::console::args::positive;
use crate::console::{Paths, Verbosity, Verdict, say};
use crate::farm::slurm::quoted;
use crate::film::atomic;
use crate::{Error, Result};

/// Make a movie of a sequence of PNGs with ffmpeg, or a contact sheet.
///
/// .mp4, .mov and .mkv are encoded as H.264; other extensions use ffmpeg's defaults. Without ffmpeg the command to run is
/// printed, and the exit code is 76.
#[derive(Debug, Args)]
pub struct MovieArgs {
    /// The PNGs: a file name with the frame number as #### or {frame:04}.
    pictures: PathBuf,
    /// Frames, such as 1-240, 1-240x2 or 7,12,40-44 [default: all files found].
    #[arg(long, value_name = "FRAMES")]
    frames: Option<Frames>,
    /// Output movie.
    #[arg(short, long, value_name = "FILE.mp4", required_unless_present = "sheet")]
    output: Option<PathBuf>,
    /// Frames per second.
    #[arg(long, value_name = "F", value_parser = positive, default_value_t = 24.0)]
    fps: f64,
    /// Output contact sheet: thumbnails of all frames, or of 144 at equal steps.
    #[arg(long, value_name = "FILE.png")]
    sheet: Option<PathBuf>,
}

pub fn run(args: &MovieArgs, verbosity: Verbosity) -> Result<Verdict> {
    let pictures = pictures(args)?;
    let mut paths = Paths::default();
    pictures.iter().try_for_each(|picture| paths.reads("the frame", picture))?;
    for (flag, path) in [("-o", &args.output), ("--sheet", &args.sheet)] {
        let Some(path) = path else { continue };
        paths.names(flag, path)?;
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

/// The frames' files in order.
///
/// # Errors
/// [`Error::Missing`] if one does not exist, or there are none.
fn pictures(args: &MovieArgs) -> Result<Vec<PathBuf>> {
    let named = |frame: u32| numbered(&args.pictures, frame);
    let Some(_) = named(0) else {
        let why = "names one picture: write the frame number as #### or {frame:04}";
        return Err(Error::Usage(format!("{}: {why}", args.pictures.display())));
    };
    let numbers = match &args.frames {
        Some(frames) => frames.numbers().to_vec(),
        None => present(&args.pictures)?,
    };
    let pictures: Vec<PathBuf> = numbers.into_iter().filter_map(named).collect();
    let missing: Vec<_> = pictures.iter().filter(|p| !p.is_file()).map(|p| p.display().to_string()).collect();
    match (pictures.is_empty(), missing.first()) {
        (true, _) => Err(Error::Missing(format!("{}: no such pictures", args.pictures.display()))),
        (_, Some(first)) => {
            let all = pictures.len();
            Err(Error::Missing(format!("{first}: missing (one of {} missing frames of {all})", missing.len())))
        }
        _ => Ok(pictures),
    }
}

/// Encodes the movie. The PNGs are piped to ffmpeg, so that it does not interpret their names.
fn movie(fps: f64, pictures: &[PathBuf], path: &Path) -> Result<()> {
    let cannot = |e: std::io::Error| Error::CannotCreate(format!("{}: cannot create: {e}", path.display()));
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let mut words: Vec<OsString> =
        ["-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png", "-framerate"].map(Into::into).into();
    words.extend([fps.to_string(), "-i".into(), "-".into()].map(OsString::from));
    if ["mp4", "mov", "mkv"].iter().any(|known| extension == *known) {
        // Players expect even sides and 4:2:0 chroma.
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
        let command: Vec<String> = ["ffmpeg".into()].into_iter().chain(words).map(|w| lossy(&w)).collect();
        let all: Vec<String> = pictures.iter().take(2).map(|p| lossy(p.as_os_str())).collect();
        let more = if pictures.len() > 2 { " …" } else { "" };
        let (all, command, to) = (quoted(&all), quoted(&command), quoted(&[lossy(path.as_os_str())]));
        Error::Host(format!("cannot run ffmpeg: {e}; on a machine with ffmpeg: cat {all}{more} | {command} {to}"))
    })?;
    let mut stdin = child.stdin.take();
    for picture in pictures {
        let bytes = fs::read(picture).map_err(|e| Error::reading(picture, &e));
        // If ffmpeg stops reading, its exit code tells why.
        let written = bytes.map(|bytes| stdin.as_mut().is_some_and(|stdin| stdin.write_all(&bytes).is_ok()));
        match written {
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
        return Err(Error::Io(format!("{}: ffmpeg failed ({status}); its message is above", path.display())));
    }
    // Temporary files are private; the movie gets default permissions.
    fs::set_permissions(&*temporary, std::os::unix::fs::PermissionsExt::from_mode(0o644)).map_err(cannot)?;
    temporary.persist(path).map_err(|e| cannot(e.error))
}

fn lossy(word: &std::ffi::OsStr) -> String {
    word.to_string_lossy().into_owned()
}

/// Most thumbnails of a contact sheet.
const MAX_THUMBNAILS: usize = 144;
/// Width of a thumbnail in pixels.
const THUMBNAIL_WIDTH: u32 = 240;

/// Writes a contact sheet.
fn sheet(pictures: &[PathBuf], path: &Path) -> Result<()> {
    let shown: Vec<&PathBuf> = match pictures.len() {
        all if all <= MAX_THUMBNAILS => pictures.iter().collect(),
        all => (0..MAX_THUMBNAILS).map(|i| &pictures[i * (all - 1) / (MAX_THUMBNAILS - 1)]).collect(),
    };
    let columns = (shown.len() as f64).sqrt().ceil() as u32;
    let mut all = RgbaImage::new(0, 0);
    let mut cell = 0;
    for (i, picture) in (0..).zip(shown) {
        let bytes = fs::read(picture).map_err(|e| Error::reading(picture, &e))?;
        let one = image::load_from_memory_with_format(&bytes, ImageFormat::Png)
            .map_err(|e| Error::Data(format!("{}: not a PNG: {e}", picture.display())))?;
        let small = one.resize(THUMBNAIL_WIDTH, THUMBNAIL_WIDTH * 4, FilterType::Triangle).into_rgba8();
        if i == 0 {
            // The first frame sets the height of the rows.
            cell = small.height();
            let rows = (pictures.len().min(MAX_THUMBNAILS) as u32).div_ceil(columns);
            all = RgbaImage::new(columns * THUMBNAIL_WIDTH, rows * cell);
        }
        imageops::overlay(&mut all, &small, (i % columns * THUMBNAIL_WIDTH).into(), (i / columns * cell).into());
    }
    let mut bytes = Cursor::new(Vec::new());
    all.write_to(&mut bytes, ImageFormat::Png).map_err(|e| Error::Bug(format!("a contact sheet: {e}")))?;
    atomic::write(path, |file| Ok(Ok(file.write_all(bytes.get_ref())?)))
}
