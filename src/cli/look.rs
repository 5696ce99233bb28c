//! `bismar look SCENE`, `bismar look OLD NEW`

mod contents;
mod sheet;
mod shots;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;
use serde_json::{Value, json};

use self::shots::{Direction, Subject, exposure_of, hash_of};
use crate::batch::frames::Frames;
use crate::cli::scene_selection::SceneSelection;
use crate::console::args::{not_negative, threads};
use crate::console::{Paths, Signals, Size, Verbosity, Verdict, host, print_json, say};
use crate::film::{atomic, preview};
use crate::{Error, Result};
pub use sheet::Sheet;
pub use shots::Shot;

/// Show what is in a scene: a contact sheet of labelled views, and JSON of its contents and of what the views show.
///
/// Of two scenes, old and new, the sheet shows both in one framing with their FLIP error map, and the JSON says what differs; of
/// two folders, which scenes were added, removed and changed (docs/look.md). A scene without light gets the studio light of
/// `render`.
#[derive(Debug, Args)]
pub struct LookArgs {
    /// The scene, .gltf or .glb; or two scenes, or two folders of scenes, old and new.
    #[arg(required = true, num_args = 1..=2, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    selection: SceneSelection,
    /// Frames of the animation, a row for each: 0-48x12 or 0,12,24. All have the framing of the whole animation.
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["pose", "frame"], help_heading = "View")]
    frames: Option<Frames>,
    /// Views, separated by commas [default: front, three-quarters and side, and top of a scene that is lower than it is wide and
    /// deep, else back; of folders three-quarters].
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', help_heading = "View")]
    views: Vec<Direction>,
    /// Size of a view in pixels.
    #[arg(long, value_name = "WxH", default_value = "512x512", help_heading = "View")]
    size: Size,
    /// Paths per pixel.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=4096),
        help_heading = "Sampling")]
    spp: u32,
    /// The sheet: .png, lossless .webp, or .jpg [default: the scene's name with .look.png, in the current folder].
    #[arg(short, long, value_name = "FILE.png", help_heading = "Output")]
    output: Option<PathBuf>,
    /// For two scenes: exit with 1 if the mean FLIP error of a view is larger than this.
    #[arg(long, value_name = "X", value_parser = not_negative, help_heading = "Output")]
    max_flip: Option<f64>,
    /// For two scenes: write an HTML page with all views under a slider, their FLIP error map, and what differs.
    #[arg(long, value_name = "FILE.html", help_heading = "Output")]
    page: Option<PathBuf>,
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads, help_heading = "Machine")]
    threads: Option<usize>,
    /// Memory limit, such as 900M or 6G [default: Slurm's limit, else the machine's memory].
    #[arg(long, value_name = "SIZE", value_parser = crate::cli::memory::parse_size, help_heading = "Machine")]
    memory_limit: Option<u64>,
}

/// What `look` has found.
pub struct Looked {
    /// The contact sheet.
    pub sheet: Sheet,
    /// The views, frame by frame; of a pair the old ones, then the new ones; none of folders.
    pub shots: Vec<Shot>,
    /// The JSON document.
    pub report: Value,
    /// What a person should read besides the sheet, line by line.
    pub lines: Vec<String>,
    /// The exit code's meaning.
    pub verdict: Verdict,
    /// The page of a pair, if it was asked for.
    page: Option<String>,
}

/// Version of the JSON document.
const SCHEMA: u32 = 1;
/// Most pixels of all views of a command together.
const MAX_PIXELS: u64 = 1 << 27;

pub fn run(args: &LookArgs, verbosity: Verbosity) -> Result<Verdict> {
    let output = args.output();
    let mut paths = Paths::default();
    for (flag, path, html) in [("-o", Some(&output), false), ("--page", args.page.as_ref(), true)] {
        let Some(path) = path else { continue };
        let fits = if html { path.extension().is_some_and(|end| end == "html") } else { preview::has_ending(path) };
        if !fits && !path.starts_with("/dev") {
            let endings = if html { ".html" } else { ".png, .webp or .jpg" };
            return Err(Error::Usage(format!("{flag} {}: the name must end in {endings}", path.display())));
        }
    }
    [&args.output, &args.page].into_iter().flatten().for_each(|path| atomic::named(path));
    atomic::confine(&[]);
    args.scenes.iter().try_for_each(|scene| paths.reads("the scene", scene))?;
    paths.writes("-o", &output)?;
    args.page.iter().try_for_each(|page| paths.writes("--page", page))?;
    let outputs = [Some(&output), args.page.as_ref()];
    outputs.into_iter().flatten().try_for_each(|path| atomic::check(path))?;
    let (threads, _) = host::threads(args.threads)?;
    let signals = Signals::listen()?;
    let mut looked =
        signals.nothing_to_save(|| host::pool(threads)?.install(|| look(args, &mut paths, &signals.stop)))?;
    atomic::sweep(&output);
    looked.sheet.write(&output)?;
    looked.report["sheet"] = json!(output.display().to_string());
    if let Some((path, page)) = args.page.as_ref().zip(looked.page) {
        atomic::write(path, |file| Ok(Ok(std::io::Write::write_all(file, page.as_bytes())?)))?;
    }
    print_json(&looked.report)?;
    if !verbosity.quiet {
        looked.lines.iter().for_each(say);
        say(format_args!("{}", output.display()));
    }
    Ok(looked.verdict)
}

/// Looks at the scenes of a command, on the current rayon pool, and writes nothing.
///
/// # Errors
/// [`Error::Usage`] for flags that do not fit the scenes; those of the import and of the build; [`Error::Host`] if memory does not
/// suffice; [`Error::Interrupted`] soon after `stop` is raised.
pub fn look(args: &LookArgs, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    args.check()?;
    match &args.scenes[..] {
        [scene] => one(args, scene, paths, stop),
        _ => Err(Error::Usage("give one scene, or two to compare".into())),
    }
}

fn one(args: &LookArgs, scene: &Path, paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    let mut subject = Subject::open(args, scene, paths)?;
    let views = args.views(subject.contents.bounds.as_ref());
    let shots = subject.shots(&views, args.frames.as_ref(), subject.sphere, stop)?;
    let exposure = exposure_of(shots.iter());
    let columns = if args.frames.is_some() { views.len() } else { (views.len() as f64).sqrt().ceil() as usize };
    let cells = shots.iter().map(|shot| (shot.label(), shot.developed(exposure))).collect();
    let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let title = [name, subject.contents.line()];
    let sheet = Sheet::of(&title, cells, columns, [args.size.0, args.size.1]);
    let mut report = json!({ "schema": SCHEMA, "size": [args.size.0, args.size.1], "spp": args.spp });
    report["hash"] = json!(hash_of(&shots));
    report["exposure"] = json!(contents::decimal(exposure));
    report["views"] = shots.iter().map(|shot| shot.report(exposure)).collect();
    report["scene"] = subject.contents.report()?;
    let lines = vec![format!("{}: {}", scene.display(), subject.contents.line())];
    Ok(Looked { sheet, shots, report, lines, verdict: Verdict::Done, page: None })
}

impl LookArgs {
    fn check(&self) -> Result<()> {
        self.selection.check(
            self.frames.is_some() || self.selection.is_posed(),
            false,
            crate::rays::Backend::Embree,
        )?;
        if self.scenes.len() == 1 && (self.max_flip.is_some() || self.page.is_some()) {
            return Err(Error::Usage("--max-flip and --page compare two scenes; there is one".into()));
        }
        let frames = self.frames.as_ref().map_or(1, |frames| frames.numbers().len()) as u64;
        let views = if self.views.is_empty() { 4 } else { self.views.len() } as u64;
        let pixels = u64::from(self.size.0) * u64::from(self.size.1) * self.scenes.len() as u64;
        if pixels.saturating_mul(frames).saturating_mul(views) > MAX_PIXELS {
            let most = MAX_PIXELS >> 20;
            return Err(Error::Usage(format!(
                "more than {most} million pixels in all views: fewer --frames or --views, or a smaller --size"
            )));
        }
        Ok(())
    }

    fn output(&self) -> PathBuf {
        let stem = |path: &PathBuf| {
            // `.` and `..` have no name of their own.
            let full = if path.file_name().is_some() { path.clone() } else { path.canonicalize().unwrap_or_default() };
            let name = if full.is_dir() { full.file_name() } else { full.file_stem() };
            name.unwrap_or("scene".as_ref()).to_string_lossy().into_owned()
        };
        let names: Vec<String> = self.scenes.iter().map(stem).collect();
        self.output.clone().unwrap_or_else(|| format!("{}.look.png", names.join("-")).into())
    }

    /// The views to show of a scene with these bounds.
    fn views(&self, bounds: Option<&contents::Bounds>) -> Vec<Direction> {
        if !self.views.is_empty() {
            return self.views.clone();
        }
        let is_low = bounds.is_some_and(|bounds| bounds.size[1] < bounds.size[0].min(bounds.size[2]));
        let last = if is_low { Direction::Top } else { Direction::Back };
        vec![Direction::Front, Direction::ThreeQuarters, Direction::Side, last]
    }
}
