//! The flags of `bismar render`.

use std::path::{Component, Path, PathBuf};

use clap::Args;
use tracing::info;

use super::values::{PartFlag, PixelPath, part_flag, pixel_path};
use crate::batch::frames::{Frames, Sequence};
use crate::batch::job::Job;
use crate::batch::numbering::numbered;
use crate::batch::views::{self, MAX_VIEWS};
use crate::cli::options::check_ending;
use crate::console::progress::Style;
use crate::farm::PathMapping;
use crate::film::denoise::Denoiser;
use crate::film::{Denoise, preview};
use crate::job::RenderRequest;
use crate::scene::import::STANDARD_INPUT;
use crate::{Error, Result};

/// Render a glTF scene to OpenEXR.
///
/// The render stops when the first of --spp, --time and --noise is reached; without any of them it takes 64 paths per
/// pixel. SIGINT, SIGTERM, SIGHUP, SIGUSR1, SIGXCPU and the like stop it early and save the picture so far (exit code 75;
/// --resume continues from it); one more signal after half a second ends the process at once.
#[derive(Debug, Clone, Args)]
#[command(allow_negative_numbers = true)]
pub struct RenderArgs {
    /// The scene file, .gltf or .glb; or -, a GLB from standard input, which can name no other file.
    scene: PathBuf,
    #[command(flatten)]
    request: RenderRequest,
    /// Frames of an animation to render, each to its own file: 1-240, 1-240x2 (every second frame), 7,12,40-44. File names
    /// hold the frame number as #### or {frame:04}. Running the same command again renders the missing frames
    /// (docs/animation.md).
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["pose", "frame", "replay_pixel"], help_heading = "View")]
    pub frames: Option<Frames>,
    /// Output picture [default: the scene's name with .exr, in the current folder].
    #[arg(short, long, value_name = "FILE.exr")]
    pub output: Option<PathBuf>,
    /// N views once around the scene, from that of --orbit on [default: 0,20], each to its own file. File names hold the
    /// number from 0 as #### or {frame:04}; transforms.json beside them holds the cameras (docs/cameras.md).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_VIEWS)),
        conflicts_with_all = ["camera", "frames", "cameras", "replay_pixel"], help_heading = "View")]
    pub turntable: Option<u32>,
    /// The cameras of a JSON file in the convention of NeRF's transforms.json, each to its own file as by --turntable; with
    /// --camera only one of them.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["orbit", "frames", "replay_pixel"], help_heading = "View")]
    pub cameras: Option<PathBuf>,
    /// Render only part K (1 to N) of the picture's tiles; `bismar merge` combines the parts. auto, or auto/N, takes K from
    /// the array of Slurm (--array=1-N), AWS Batch or Kubernetes (indexed jobs) that this process is a task of; names of
    /// outputs then hold K as #### or {frame:04} (docs/farm.md).
    #[arg(id = "part", long, value_parser = part_flag, value_name = "K/N|auto|auto/N", conflicts_with_all = ["time",
        "denoise"], help_heading = "Interruption and parts")]
    pub part_flag: Option<PartFlag>,
    /// Path mapping rules of Open Job Description (pathmapping-1.0), applied to all paths of this command.
    #[arg(long, value_name = "FILE.json", help_heading = "Interruption and parts")]
    pub path_mapping: Option<PathBuf>,
    /// Print every event on the paths of one pixel (counted from the top left), or on its path N only; no picture is
    /// written.
    #[arg(long, value_parser = pixel_path, value_name = "X,Y[,N]",
        conflicts_with_all = ["resume", "checkpoint", "part"], help_heading = "Output")]
    pub replay_pixel: Option<PixelPath>,
    /// Progress display.
    #[arg(long, value_enum, default_value_t = Style::Auto, help_heading = "Output")]
    pub progress: Style,
    /// Ignore signals; the parent process announces them on standard input.
    #[arg(long, hide = true)]
    pub signals_from_parent: bool,
}

impl RenderArgs {
    /// Whether the command renders many pictures: frames or views.
    pub(crate) fn is_sequence(&self) -> bool {
        self.sequence().is_some()
    }

    pub fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| {
            let mut name = self.scene.file_stem().unwrap_or("bismar".as_ref()).to_owned();
            let is_numbered = self.is_sequence() || self.part_flag.is_some_and(|flag| flag.is_auto);
            name.push(if is_numbered { ".####.exr" } else { ".exr" });
            name.into()
        })
    }

    /// What the command asks for; of a sequence, what its pictures have in common.
    pub fn request(&self) -> Result<RenderRequest> {
        self.check()?;
        let (scene, output, part) = (self.scene.clone(), self.output(), self.part_flag.map(|flag| flag.part));
        Ok(RenderRequest { scene, output, part, ..self.request.clone() })
    }

    /// What makes it many pictures.
    fn sequence(&self) -> Option<Sequence> {
        let frames = self.frames.clone().map(Sequence::Frames);
        frames.or(self.turntable.map(Sequence::Turntable)).or(self.cameras.clone().map(Sequence::Cameras))
    }

    /// The command as a job.
    pub fn job(&self, name: String) -> Result<Job> {
        Ok(Job { name, request: self.request()?, sequence: self.sequence(), ..Job::default() })
    }

    /// The same command with `--path-mapping` applied to its paths, and with the number of the part in the names of its
    /// outputs if the part is chosen by the scheduler.
    /// Errors: Those of [`PathMapping::read`]; [`Error::Usage`] if a name has no place for the number of the part.
    pub(crate) fn on_this_machine(&self) -> Result<Self> {
        let mut args = self.clone();
        if let Some(preset) = self.request.preset {
            if preset.denoises() && self.part_flag.is_none() && Denoiser::load().is_ok() {
                args.request.denoise = Some(Denoise::Oidn);
            }
            let denoised = if args.request.denoise.is_some() { " --denoise oidn" } else { "" };
            info!("--preset {} stands for {}{denoised}; flags that are given win", preset.name(), preset.flags());
        }
        if let Some(PartFlag { part, is_auto: true }) = self.part_flag {
            args.output = Some(self.output());
            let RenderRequest { preview, stats, .. } = &mut args.request;
            let outputs = [("-o", &mut args.output), ("--preview", preview), ("--stats", stats)];
            for (flag, path) in outputs {
                let Some(path) = path else { continue };
                *path = numbered(path, part.number).ok_or_else(|| {
                    let name = path.display();
                    Error::Usage(format!("{flag} {name} names one file for all parts: write their number as ####"))
                })?;
            }
        }
        if let Some(file) = &self.path_mapping {
            let mapping = PathMapping::read(file)?;
            let own = [&mut args.output, &mut args.cameras].into_iter().flatten().chain([&mut args.scene]);
            own.chain(args.request.paths_mut()).for_each(|path| mapping.apply(path));
        }
        Ok(args)
    }

    /// Whether the scene is `-`, standard input. It is then named so in what people read, and no header says how to render it
    /// again.
    pub(crate) fn takes_standard_input(&mut self) -> bool {
        let takes = self.is_dash() && !self.signals_from_parent;
        if takes {
            self.output.get_or_insert("bismar.exr".into());
            self.scene = STANDARD_INPUT.into();
        }
        takes
    }

    fn is_dash(&self) -> bool {
        self.scene.as_os_str() == "-"
    }

    /// Checks the rules that clap cannot express.
    pub fn check(&self) -> Result<()> {
        let wrong = |why: &str| Err(Error::Usage(why.into()));
        if self.is_dash() && (self.is_sequence() || self.replay_pixel.is_some()) {
            return wrong("a scene from standard input is for one picture: give a file");
        }
        if self.is_sequence() && self.part_flag.is_some_and(|flag| flag.is_auto) {
            return wrong(
                "--part auto divides one picture: for a sequence use `bismar farm submit`, whose tasks are its frames",
            );
        }
        self.request.check(self.frames.is_some())?;
        self.output.iter().try_for_each(|path| check_ending("-o", path, &["exr"]))?;
        self.request.preview.iter().try_for_each(|path| check_ending("--preview", path, &preview::ENDINGS))
    }

    /// A flag that is given, but is for the tasks of a farm to set.
    pub(crate) fn of_farm(&self) -> Option<&'static str> {
        let RenderRequest { resume, on_checkpoint, .. } = &self.request;
        let flags = [
            ("--part", self.part_flag.is_some()),
            ("--resume", *resume),
            ("--progress", self.progress != Style::Auto),
            ("--path-mapping", self.path_mapping.is_some()),
            ("--on-checkpoint", on_checkpoint.is_some()),
            ("--signals-from-parent", self.signals_from_parent),
        ];
        flags.into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag)
    }

    /// A command that renders many pictures, as one job, and the folders below which they are written.
    pub(crate) fn job_and_folders(&self) -> Result<(Job, Vec<PathBuf>)> {
        self.check()?;
        let args = self.on_this_machine()?;
        // For the exit code of a file that is missing or wrong.
        args.cameras.iter().try_for_each(|file| views::read(file).map(drop))?;
        let name = args.output().file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let job = args.job(name)?;
        let folders = job.request.outputs().map(folder).collect();
        Ok((job, folders))
    }
}

/// The folder of an output, before the first of its folders whose name holds the frame's number.
fn folder(output: &Path) -> PathBuf {
    let has_number = |part: &Component| part.as_os_str().to_string_lossy().contains(['#', '{']);
    let parent = output.parent().unwrap_or(Path::new(""));
    let before: PathBuf = parent.components().take_while(|part| !has_number(part)).collect();
    if before.as_os_str().is_empty() { ".".into() } else { before }
}
