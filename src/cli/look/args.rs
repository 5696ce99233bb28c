//! The flags of `bismar look`.

use std::path::PathBuf;

use clap::Args;

use super::contents::Bounds;
use super::direction::Direction;
use crate::batch::frames::Frames;
use crate::console::Size;
use crate::console::args::{not_negative, threads};
use crate::job::SceneSelection;
use crate::rays::Backend;
use crate::{Error, Result};

/// Show what is in a scene: a contact sheet of labelled views, and JSON of its contents and of what the views show.
///
/// Of two scenes, old and new, the sheet shows both in one framing with their FLIP error map, and the JSON says what differs; of
/// two folders, which scenes were added, removed and changed (docs/look.md). Three scenes or more are side by side on one sheet.
/// A scene without light gets the studio light of `render`.
#[derive(Debug, Args)]
pub struct LookArgs {
    /// The scene, .gltf or .glb; or two scenes, or two folders of scenes, old and new; or three scenes or more.
    #[arg(required = true, num_args = 1.., value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    #[command(flatten)]
    pub selection: SceneSelection,
    /// Frames of the animation, a row for each: 0-48x12 or 0,12,24. All have the framing of the whole animation.
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["pose", "frame"], help_heading = "View")]
    pub frames: Option<Frames>,
    /// Views, separated by commas [default: front, three-quarters, side, and top of a scene that is less than half as high as it
    /// is wide and deep, else back; of folders, and of three scenes or more, three-quarters].
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', help_heading = "View")]
    pub views: Vec<Direction>,
    /// Size of a view in pixels.
    #[arg(long, value_name = "WxH", default_value = "512x512", help_heading = "View")]
    pub size: Size,
    /// Paths per pixel.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=4096),
        help_heading = "Sampling")]
    pub spp: u32,
    /// The sheet: .png, lossless .webp, or .jpg [default: the scene's name with .look.png, in the current folder].
    #[arg(short, long, value_name = "FILE.png", help_heading = "Output")]
    pub output: Option<PathBuf>,
    /// For two scenes: exit with 1 if the mean FLIP error of a view is larger than this.
    #[arg(long, value_name = "X", value_parser = not_negative, help_heading = "Output")]
    pub max_flip: Option<f64>,
    /// For two scenes: write an HTML page with all views under a slider, their FLIP error map, and what differs.
    #[arg(long, value_name = "FILE.html", help_heading = "Output")]
    pub page: Option<PathBuf>,
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Memory limit, such as 900M or 6G [default: Slurm's limit, else the machine's memory].
    #[arg(long, value_name = "SIZE", value_parser = crate::job::memory::parse_size, help_heading = "Machine")]
    pub memory_limit: Option<u64>,
}

/// Most pixels of all views of a command together.
const MAX_PIXELS: u64 = 1 << 27;

impl LookArgs {
    /// Checks what clap cannot.
    pub fn check(&self) -> Result<()> {
        let selection = &self.selection;
        selection.check(self.frames.is_some() || selection.is_posed(), false, Backend::Embree)?;
        let count = self.scenes.len();
        if count != 2 && (self.max_flip.is_some() || self.page.is_some()) {
            return Err(Error::Usage(format!("--max-flip and --page compare two scenes; the number given is {count}")));
        }
        let frames = self.frames.as_ref().map_or(1, |frames| frames.numbers().len()) as u64;
        let views = match self.views.len() {
            0 if count > 2 => 1,
            0 => 4,
            given => given as u64,
        };
        let pixels = u64::from(self.size.0) * u64::from(self.size.1) * count as u64;
        if pixels.saturating_mul(frames).saturating_mul(views) > MAX_PIXELS {
            let most = MAX_PIXELS >> 20;
            return Err(Error::Usage(format!(
                "more than {most} million pixels in all views: fewer --frames or --views, or a smaller --size"
            )));
        }
        Ok(())
    }

    pub fn output(&self) -> PathBuf {
        let stem = |path: &PathBuf| {
            // `.` and `..` have no name of their own.
            let full = if path.file_name().is_some() { path.clone() } else { path.canonicalize().unwrap_or_default() };
            let name = if full.is_dir() { full.file_name() } else { full.file_stem() };
            name.unwrap_or("scene".as_ref()).to_string_lossy().into_owned()
        };
        let names = match &self.scenes[..] {
            [first, _, _, ..] => vec![stem(first), format!("and-{}-more", self.scenes.len() - 1)],
            all => all.iter().map(stem).collect(),
        };
        self.output.clone().unwrap_or_else(|| format!("{}.look.png", names.join("-")).into())
    }

    /// The views to show of a scene with these bounds.
    pub fn views(&self, bounds: Option<&Bounds>) -> Vec<Direction> {
        if !self.views.is_empty() {
            return self.views.clone();
        }
        let is_low = bounds.is_some_and(|bounds| 2.0 * bounds.size[1] < bounds.size[0].min(bounds.size[2]));
        let last = if is_low { Direction::Top } else { Direction::Back };
        vec![Direction::Front, Direction::ThreeQuarters, Direction::Side, last]
    }
}
