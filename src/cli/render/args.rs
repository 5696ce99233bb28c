//! The flags of `bismar render`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::replay::PixelPath;
use super::values::{AovList, Crop, LightUnit, balance, blades, finite, not_negative, share};
use crate::batch::frames::{Frames, numbered};
use crate::cli::shown::Shown;
use crate::console::Size;
use crate::console::args::{positive, seconds, threads};
use crate::console::progress::Style;
use crate::console::tev;
use crate::farm::PathMapping;
use crate::film::{Aov, Denoise, Exposure, View};
use crate::rays::Backend;
use crate::render::identity::RequestedOutputs;
use crate::render::lens::{Aperture, Focus, LensSettings};
use crate::render::{Balance, Guiding, Integrator, Part, PixelFilter, RenderSettings};
use crate::sampling::frame_seed;
use crate::scene::Framing;
use crate::{Error, Result};

/// Render a glTF scene to OpenEXR.
///
/// Stops at whichever of --spp, --time and --noise comes first; without any of them at 64 paths a pixel. SIGINT,
/// SIGTERM, SIGHUP and SIGUSR1 end it early and save what there is (exit code 75; --resume goes on from it); a second
/// one ends it at once.
#[derive(Debug, Clone, Args)]
#[command(allow_negative_numbers = true)]
pub struct RenderArgs {
    /// The scene, .gltf or .glb.
    pub scene: PathBuf,
    #[command(flatten)]
    pub shown: Shown,
    /// Render these frames, each to a file of its own: 1-240, 1-240x2 (every second one), 7,12,40-44. The names of files hold
    /// their number as #### or {frame:04}. The same command again does what is missing (docs/animation.md).
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["pose", "frame", "replay_pixel"], help_heading = "View")]
    pub frames: Option<Frames>,
    /// Where the picture goes [default: the scene's name with .exr, in the current folder].
    #[arg(short, long, value_name = "FILE.exr")]
    pub output: Option<PathBuf>,

    /// Camera by name or, counted from 0, by index, or framed: a view that fits all of the scene [default: the first, or
    /// framed if there is none].
    #[arg(long, value_name = "NAME|INDEX", help_heading = "View")]
    pub camera: Option<String>,
    /// Picture size in pixels [default: 960 wide, as high as the camera's aspect asks].
    #[arg(long, value_name = "WxH", help_heading = "View")]
    pub size: Option<Size>,
    /// Render this window only: pixels from the top left, the last two exclusive. It has the bits of the whole.
    #[arg(long, value_name = "x0,y0,x1,y1", help_heading = "View")]
    pub crop: Option<Crop>,

    /// Give the camera a lens with this opening: an f-stop, as in f/2.8 (of a picture 24 mm high), or a radius in metres. glTF
    /// has none [default: a pinhole: all is sharp].
    #[arg(long, value_name = "F-STOP|RADIUS", help_heading = "View")]
    pub aperture: Option<Aperture>,
    /// What is sharp: a plane so many metres before the camera, or what the middle of the picture shows.
    #[arg(long, value_name = "DISTANCE|auto", default_value = "auto", requires = "aperture", help_heading = "View")]
    pub focus: Focus,
    /// Sides of the lens' opening, 3 to 32, or 0 for a round one.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "aperture", value_parser = blades,
        help_heading = "View")]
    pub lens_blades: u32,

    /// Light from infinity: an equirectangular .hdr or .exr.
    #[arg(long, value_name = "FILE", group = "infinite", help_heading = "Light")]
    pub env: Option<PathBuf>,
    /// Turn it about +y, in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, requires = "env",
        value_parser = finite, help_heading = "Light")]
    pub env_rotate: f32,
    /// Multiply its radiance, or that of --sky.
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "infinite", value_parser = not_negative,
        help_heading = "Light")]
    pub env_strength: f32,
    /// Light from infinity: white from all around.
    #[arg(long, group = "infinite", conflicts_with = "env", help_heading = "Light")]
    pub sky: bool,
    /// What the file's point, spot and directional lights are counted in: as lumens they are taken as they are, as watts
    /// divided by 683 lm/W, as Blender multiplies.
    #[arg(long, value_enum, default_value_t, value_name = "UNIT", help_heading = "Light")]
    pub light_unit: LightUnit,
    /// No light from infinity at all.
    #[arg(long, conflicts_with = "infinite", help_heading = "Light")]
    pub no_env: bool,

    /// Light transport.
    #[arg(long, value_enum, default_value_t = Integrator::Path, help_heading = "Sampling")]
    pub integrator: Integrator,
    /// Most segments of a path: 1 is emission alone, 2 is direct light.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..),
        help_heading = "Sampling")]
    pub max_depth: u32,
    /// Stop at this many paths a pixel.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Sampling")]
    pub spp: Option<u32>,
    /// Stop this long after the start, loading included, in seconds or as in 90s, 10m, 1.5h; of a resumed render, over
    /// all its sessions. The first passes are small, so that all of the picture is there early.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, help_heading = "Sampling")]
    pub time: Option<f64>,
    /// Stop where the estimated relative error is at most this, each tile of 16 x 16 pixels by itself: the root of
    /// mean(variance / (mean^2 + 0.01)).
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub noise: Option<f64>,
    /// Of --noise: fewest paths a pixel before anything stops [default: 32].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..), requires = "noise",
        help_heading = "Sampling")]
    pub min_spp: Option<u32>,
    /// Give tiles of 16 x 16 pixels more paths where a pilot finds them noisy, and fewer elsewhere; --spp is the mean
    /// (docs/adaptive.md).
    #[arg(long, conflicts_with = "noise", help_heading = "Sampling")]
    pub adaptive: bool,
    /// How light and BSDF sampling share the work.
    #[arg(long, value_parser = balance(), default_value = "progressive", help_heading = "Sampling")]
    pub balance: Balance,
    /// Of --balance second-order: the share of its paths that are its pilot, above 0 and below 1 [default: 0.5].
    #[arg(long, value_name = "SHARE", value_parser = share, help_heading = "Sampling")]
    pub pilot: Option<f64>,
    /// Lead paths to where a pilot found light (docs/guiding.md): pays where light comes by few ways to what is seen. auto: if
    /// the pilot finds that it does.
    #[arg(long, value_enum, default_value_t, value_name = "WHEN", help_heading = "Sampling")]
    pub guiding: Guiding,
    /// Memory that guiding may take [default: 256M].
    #[arg(long, value_name = "SIZE", value_parser = crate::cli::memory::parse_size, help_heading = "Sampling")]
    pub guiding_memory: Option<u64>,
    /// Limit each contribution of light at first surfaces to this in its brightest channel: takes fireflies away, and light
    /// with them.
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub clamp_direct: Option<f64>,
    /// As --clamp-direct, at later surfaces.
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub clamp_indirect: Option<f64>,
    /// Pixel filter.
    #[arg(long, value_enum, default_value_t = PixelFilter::Gaussian, help_heading = "Sampling")]
    pub filter: PixelFilter,
    /// Seed of every random choice.
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Sampling")]
    pub seed: u32,
    /// Mix the frame's number into the seed, so that noise does not stick to the screen [default: true with --frames, else
    /// false].
    #[arg(long, value_name = "true|false", num_args = 0..=1, default_missing_value = "true", help_heading = "Sampling")]
    pub seed_per_frame: Option<bool>,

    /// Save the picture, with all that is needed to go on, every so many seconds (or as in 10m) and at the end; the
    /// --preview with it.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, help_heading = "Interruption and parts")]
    pub checkpoint: Option<f64>,
    /// Keep the last N checkpoints beside the picture too, as out.checkpoint-0007.exr.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), requires = "checkpoint",
        help_heading = "Interruption and parts")]
    pub keep: Option<u32>,
    /// Run this program, with the name of the file, whenever a checkpoint is saved. Rendering goes on meanwhile.
    #[arg(long, value_name = "PROGRAM", requires = "checkpoint", help_heading = "Interruption and parts")]
    pub on_checkpoint: Option<PathBuf>,
    /// Go on from what the output file holds. Without such a file begin; with a finished one do nothing. A higher --spp
    /// goes on from any number of paths; from a multiple of 128 to the bits that it would have had at once.
    #[arg(long, help_heading = "Interruption and parts")]
    pub resume: bool,
    /// Render only part K (1 to N) of the picture's tiles; `bismar merge` puts parts together.
    #[arg(long, value_name = "K/N", conflicts_with = "time", help_heading = "Interruption and parts")]
    pub part: Option<Part>,

    /// What traces rays.
    #[arg(long, value_enum, default_value_t = Backend::Embree, help_heading = "Machine")]
    pub rays: Backend,
    /// Threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all].
    #[arg(long, value_name = "N", value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Refuse what needs more memory, as in 900M or 6G [default: what Slurm allows, else what there is].
    #[arg(long, value_name = "SIZE", value_parser = crate::cli::memory::parse_size, help_heading = "Machine")]
    pub memory_limit: Option<u64>,

    /// Outputs beside the beauty: any of albedo, normal, depth, direct, indirect, variance, samples, balance, object,
    /// material, position, uv, emission, guide-albedo, guide-normal (as albedo and normal, but seen in mirrors: for
    /// denoisers), lights (the beauty by what gave the light), velocity (pixels a frame), crypto-object, crypto-material, separated by commas; or
    /// all, or none.
    #[arg(long, value_name = "LIST", default_value = "variance,samples,balance", help_heading = "Output")]
    aov: AovList,
    /// Colours and normals in 16-bit floats: a file of half the size, and what compositors work with.
    #[arg(long, help_heading = "Output")]
    pub half: bool,
    /// Leave the sky out of picture and PNG where the camera sees it: alpha says what is there. It gives light all the
    /// same.
    #[arg(long, help_heading = "Output")]
    pub transparent: bool,
    /// Add a layer `denoised` to the picture, and show that in the PNG. The beauty stays as it is.
    #[arg(long, value_enum, conflicts_with = "part", help_heading = "Output")]
    pub denoise: Option<Denoise>,
    /// Write a PNG too.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    pub preview: Option<PathBuf>,
    /// Show the picture in tev while it is rendered; alone it means 127.0.0.1:14158.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = tev::DEFAULT, help_heading = "Output")]
    pub tev: Option<tev::Address>,
    /// The PNG's view transform.
    #[arg(long, value_enum, default_value_t = View::Agx, help_heading = "Output")]
    pub view: View,
    /// The PNG's exposure in stops, or auto: the log-mean of what is not dark becomes middle grey. It is printed, and
    /// stands in the header (bismar.exposure): give it to the other pictures of a sequence.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true,
        help_heading = "Output")]
    pub exposure: Exposure,
    /// Write times and counts as JSON (docs/stats.md).
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    pub stats: Option<PathBuf>,
    /// Where this command's paths lie on this machine: rules of Open Job Description (pathmapping-1.0).
    #[arg(long, value_name = "FILE.json", help_heading = "Interruption and parts")]
    pub path_mapping: Option<PathBuf>,
    /// Write no picture: print what happens on the paths of one pixel (from the top left), or on its path N alone.
    #[arg(long, value_name = "X,Y[,N]", conflicts_with_all = ["resume", "checkpoint", "part"],
        help_heading = "Output")]
    pub replay_pixel: Option<PixelPath>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t = Style::Auto, help_heading = "Output")]
    pub progress: Style,
    /// Refuse a scene that cannot be shown exactly as its file asks.
    #[arg(long, help_heading = "Output")]
    pub strict: bool,
    /// Leave signals to the parent process, which tells of them by standard input.
    #[arg(long, hide = true)]
    pub led: bool,
}

impl RenderArgs {
    /// Is a moment of the animations shown?
    fn is_posed(&self) -> bool {
        self.frames.is_some() || self.shown.is_posed()
    }

    /// Does it ask for the view that fits all of the scene?
    pub fn is_framed(&self) -> bool {
        self.camera.as_deref() == Some(Framing::NAME)
    }

    /// What tells a scene apart that is made of the same files otherwise than by default; empty for the default.
    pub fn choices(&self) -> String {
        let unit = if self.light_unit == LightUnit::Watt { ", lights in watts" } else { "" };
        let velocities = if self.has_velocities() { ", velocities" } else { "" };
        format!("{}{unit}{velocities}", self.shown.name())
    }

    /// Does it ask how things move in the picture?
    pub fn has_velocities(&self) -> bool {
        self.aovs().contains(&Aov::Velocity)
    }

    /// Where the picture goes.
    pub fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| {
            let mut name = self.scene.file_stem().unwrap_or("bismar".as_ref()).to_owned();
            name.push(if self.frames.is_some() { ".####.exr" } else { ".exr" });
            name.into()
        })
    }

    /// What is written beside the beauty, in its order. A pilot's light is weighed again when its sources are forgotten: all
    /// is then all but `lights`. Without a moment nothing has a velocity.
    pub fn aovs(&self) -> Vec<Aov> {
        let mut aovs = self.aov.0.clone();
        aovs.sort();
        aovs.dedup();
        aovs.retain(|aov| *aov != Aov::Lights || !self.balance.method().needs_goal());
        aovs.retain(|aov| *aov != Aov::Velocity || self.is_posed());
        aovs
    }

    /// Names of what is written beside the beauty, in their order.
    pub fn aov_names(&self) -> String {
        let aovs = self.aovs();
        let names = aovs.iter().filter_map(|a| a.to_possible_value());
        names.map(|v| v.get_name().to_owned()).collect::<Vec<_>>().join(",")
    }

    /// The stop rule by samples: 64 when there is no other rule.
    pub fn spp(&self) -> Option<u32> {
        let unlimited = self.spp.is_none() && self.time.is_none() && self.noise.is_none();
        if unlimited { RenderSettings::default().spp } else { self.spp }
    }

    /// What tells its file from others' before a scene is loaded.
    pub fn asked(&self) -> RequestedOutputs {
        let (camera, size) = (self.camera.clone(), self.size.map(|s| [s.0, s.1]));
        RequestedOutputs { camera, size, aovs: self.aov_names(), half: self.half, denoised: self.denoise.is_some() }
    }

    /// What it asks for, but for camera, width and height: they are the scene's to say.
    pub fn settings(&self) -> RenderSettings {
        RenderSettings {
            crop: self.crop.map(|c| c.0),
            integrator: self.integrator,
            max_depth: self.max_depth,
            spp: self.spp(),
            time: self.time,
            noise: self.noise,
            min_spp: self.min_spp,
            adaptive: self.adaptive,
            balance: self.balance,
            pilot: self.pilot,
            guiding: self.guiding,
            guiding_memory: self.guiding_memory,
            seed: match (self.seed_per_frame, self.shown.frame()) {
                (Some(true), Some(frame)) => frame_seed(self.seed, frame),
                _ => self.seed,
            },
            filter: self.filter,
            aovs: self.aovs().iter().any(|a| a.needs_sums()),
            extras: self.denoise.is_some() || self.aovs().iter().any(|a| a.needs_extras()),
            clamp_direct: self.clamp_direct,
            clamp_indirect: self.clamp_indirect,
            transparent: self.transparent,
            lens: self.aperture.map(|aperture| LensSettings { aperture, focus: self.focus, blades: self.lens_blades }),
            part: self.part,
            ..RenderSettings::default()
        }
    }

    /// With its paths as they are on this machine.
    ///
    /// # Errors
    /// As [`PathMapping::read`].
    pub fn on_this_machine(&self) -> Result<Self> {
        let mut args = self.clone();
        if let Some(file) = &self.path_mapping {
            let mapping = PathMapping::read(file)?;
            mapping.apply(&mut args.scene);
            let others = [&mut args.output, &mut args.env, &mut args.preview, &mut args.stats];
            others.into_iter().flatten().for_each(|path| mapping.apply(path));
        }
        Ok(args)
    }

    /// Of a sequence: as one frame is rendered.
    ///
    /// # Errors
    /// [`Error::Usage`] for an output without a place for its number.
    pub fn of_frame(&self, frame: u32) -> Result<Self> {
        let mut args = Self { frames: None, seed_per_frame: Some(self.seed_per_frame.unwrap_or(true)), ..self.clone() };
        args.shown.set_frame(frame);
        let output = self.output();
        args.output = Some(
            numbered(&output, frame)
                .ok_or_else(|| Error::Usage(format!("{}: has no place for a frame's number", output.display())))?,
        );
        for path in [&mut args.preview, &mut args.stats].into_iter().flatten() {
            *path = numbered(path, frame).unwrap_or_else(|| path.clone());
        }
        Ok(args)
    }

    /// What clap cannot check.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self) -> Result<()> {
        if self.balance.method().needs_goal() && self.spp.is_none() {
            return Err(Error::Usage(
                "--balance second-order needs --spp: the paper's pilot is a share of all samples, so their number must \
                 be known beforehand"
                    .into(),
            ));
        }
        if self.pilot.is_some() && !self.balance.method().needs_goal() {
            return Err(Error::Usage(format!(
                "--pilot belongs to --balance second-order; {} has a pilot of its own or none",
                self.balance.name()
            )));
        }
        if self.seed_per_frame == Some(true) && self.frames.is_none() && self.shown.frame().is_none() {
            return Err(Error::Usage("--seed-per-frame needs a frame: --frames or --frame".into()));
        }
        let all = self.aov.0.len() == Aov::value_variants().len();
        let velocity = !all && self.aov.0.contains(&Aov::Velocity);
        self.shown.check(self.is_posed(), velocity, self.rays)?;
        if !all && self.balance.method().needs_goal() && self.aov.0.contains(&Aov::Lights) {
            return Err(Error::Usage(format!(
                "--aov lights: --balance {} weighs a pilot's light again when where it came from is forgotten; take another \
                 balance",
                self.balance.name()
            )));
        }
        for (flag, path, extension) in [("-o", &self.output, "exr"), ("--preview", &self.preview, "png")] {
            let Some(path) = path else { continue };
            let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
            // A device has no extension, and is welcome for measuring.
            if !named && !path.starts_with("/dev") {
                let instead = match (flag, path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"))) {
                    ("-o", true) => {
                        let exr = path.with_extension("exr");
                        format!(": -o {} --preview {} writes both", exr.display(), path.display())
                    }
                    _ => String::new(),
                };
                let why = format!("{flag} {}: the name must end in .{extension}{instead}", path.display());
                return Err(Error::Usage(why));
            }
        }
        Ok(())
    }
}
