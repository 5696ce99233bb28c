//! The flags of `bismar render`.

use std::path::{Component, Path, PathBuf};

use clap::Args;
use tracing::info;

use super::values::{
    AovList, OnByDefault, PartFlag, PixelPath, Preset, TechniqueFlags, aov_list, balance, blades, crop, env_strength,
    finite, light_radius, part_flag, pixel_path, preset, share, sun_angle,
};
use crate::batch::frames::Frames;
use crate::batch::job::Job;
use crate::batch::numbering::numbered;
use crate::batch::views::{self, MAX_VIEWS};
use crate::cli::flag_values::{check_ending, value_of};
use crate::cli::scene_selection::SelectionArgs;
use crate::cli::view_args::ViewArgs;
use crate::color::ColorSpace;
use crate::console::Size;
use crate::console::args::{positive, seconds, threads};
use crate::console::progress::Style;
use crate::console::tev;
use crate::farm::{PathMapping, utf8};
use crate::film::denoise::Denoiser;
use crate::film::{Aov, Denoise, Exposure, preview};
use crate::job::memory::parse_size;
use crate::job::{LightUnit, RenderRequest};
use crate::rays::Backend;
use crate::render::settings::lens::{Aperture, Focus, LensSettings};
use crate::render::{
    BackFaces, Balance, Choice, Choices, GlassShadows, Ground, Integrator, LightGroups, PixelFilter, RenderSettings,
    Technique,
};
use crate::sampling::frame_seed;
use crate::scene::import::STANDARD_INPUT;
use crate::scene::{ClearSky, Orbit, PlacedCamera};
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
    pub scene: PathBuf,
    #[command(flatten)]
    pub selection: SelectionArgs,
    /// Frames of an animation to render, each to its own file: 1-240, 1-240x2 (every second frame), 7,12,40-44. File names
    /// hold the frame number as #### or {frame:04}. Running the same command again renders the missing frames
    /// (docs/animation.md).
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["pose", "frame", "replay_pixel"], help_heading = "View")]
    pub frames: Option<Frames>,
    /// Output picture [default: the scene's name with .exr, in the current folder].
    #[arg(short, long, value_name = "FILE.exr")]
    pub output: Option<PathBuf>,

    /// Camera by name or by index from 0; framed: a view that fits the whole scene; or panorama: all directions from the first
    /// camera, or from the scene's centre, as an equirectangular picture in the orientation of --env [default: the first
    /// camera, or framed if the scene has none].
    #[arg(long, value_name = "NAME|INDEX", help_heading = "View")]
    pub camera: Option<String>,
    /// View from a point around the scene, in degrees: azimuth 0 sees it from +z (the front of a glTF asset), 90 from +x;
    /// elevation is -90 to 90. The distance to the centre of what the scene shows is a multiple of that at which the sphere
    /// around it just fits [default: 1].
    #[arg(
        long,
        value_name = "AZIMUTH,ELEVATION[,DISTANCE]",
        allow_hyphen_values = true,
        conflicts_with = "camera",
        help_heading = "View"
    )]
    pub orbit: Option<Orbit>,
    /// N views once around the scene, from that of --orbit on [default: 0,20], each to its own file. File names hold the
    /// number from 0 as #### or {frame:04}; transforms.json beside them holds the cameras (docs/cameras.md).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_VIEWS)),
        conflicts_with_all = ["camera", "frames", "cameras", "replay_pixel"], help_heading = "View")]
    pub turntable: Option<u32>,
    /// The cameras of a JSON file in the convention of NeRF's transforms.json, each to its own file as by --turntable; with
    /// --camera only one of them.
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["orbit", "frames", "replay_pixel"], help_heading = "View")]
    pub cameras: Option<PathBuf>,
    /// Other defaults of some flags, for an occasion; flags that are given win.
    #[arg(long, value_parser = preset(), value_name = "OCCASION", help_heading = "View")]
    pub preset: Option<Preset>,
    /// Resolution in pixels [default: 960 wide, with the height from the camera's aspect ratio].
    #[arg(long, value_name = "WxH", default_value_ifs([("preset", "thumbnail", "512x512"), ("preset", "product", "1024x1024"),
        ("preset", "final", "1920x1080")]), help_heading = "View")]
    pub size: Option<Size>,
    /// Crop window in pixels from the top left; x1 and y1 are exclusive. Its pixels are bit-identical to those of the full
    /// render.
    #[arg(long, value_parser = crop, value_name = "x0,y0,x1,y1", help_heading = "View")]
    pub crop: Option<[u32; 4]>,

    /// Thin-lens aperture: an f-stop such as f/2.8 (for a sensor 24 mm high) or a radius in metres. glTF cameras have no
    /// aperture [default: pinhole].
    #[arg(long, value_name = "F-STOP|RADIUS", help_heading = "View")]
    pub aperture: Option<Aperture>,
    /// Focus distance in metres along the camera's axis, or auto: the distance of what the centre of the picture shows.
    #[arg(long, value_name = "DISTANCE|auto", default_value = "auto", requires = "aperture", help_heading = "View")]
    pub focus: Focus,
    /// Number of aperture blades, 3 to 32, or 0 for a circular aperture.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "aperture", value_parser = blades,
        help_heading = "View")]
    pub lens_blades: u32,

    /// Back faces of single-sided materials: cull lets rays from the camera and their mirror images pass them, as glTF asks;
    /// show draws them, for closed rooms seen from outside.
    #[arg(long, value_parser = value_of::<BackFaces>(), default_value = BackFaces::Cull.name(), value_name = "WHAT",
        help_heading = "View")]
    pub back_faces: BackFaces,

    /// Ignore the camera's clipping planes, znear and zfar. Without this the camera sees only what lies between them; shadows
    /// and mirrors see all.
    #[arg(long, help_heading = "View")]
    pub no_clip: bool,

    /// What lies below the scene: none; or shadow, a plane at its lowest point that shows only what the scene takes from its
    /// light, as black with alpha, seen from above. The environment is hidden, as by --transparent. Light that the scene adds to
    /// the ground, and what the ground would reflect, is left out.
    #[arg(long, value_parser = value_of::<Ground>(), default_value = Ground::None.name(), value_name = "WHAT",
        default_value_if("preset", "product", "shadow"), help_heading = "View")]
    pub ground: Ground,
    /// Shadow rays at bodies of smooth glass (a bottle, a globe, a pane with thickness): off ends them there, straight lets
    /// them pass, dimmed by Fresnel and absorption. That is approximate: without refraction and caustics, with little noise.
    /// They always pass thin glass.
    #[arg(long, value_parser = value_of::<GlassShadows>(), default_value = GlassShadows::Off.name(), value_name = "HOW",
        help_heading = "Light")]
    pub glass_shadows: GlassShadows,
    /// Environment map: an equirectangular .hdr or .exr.
    #[arg(long, value_name = "FILE", group = "infinite", help_heading = "Light")]
    pub env: Option<PathBuf>,
    /// Rotation of the environment map about +y, in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, requires = "env",
        value_parser = finite, help_heading = "Light")]
    pub env_rotate: f32,
    /// Factor on the radiance of --env, --sky or --sunsky.
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "infinite", value_parser = env_strength,
        help_heading = "Light")]
    pub env_strength: f32,
    /// Uniform white environment.
    #[arg(long, group = "infinite", conflicts_with = "env", help_heading = "Light")]
    pub sky: bool,
    /// A clear sky with its sun, by the sun's elevation and azimuth (0 in +z, 90 in +x) in degrees and the haze, from 1 to 10
    /// [default: 3] (docs/lights.md).
    #[arg(long, value_name = "ELEVATION,AZIMUTH[,TURBIDITY]", group = "infinite", conflicts_with_all = ["env", "sky"],
        help_heading = "Light")]
    pub sunsky: Option<ClearSky>,
    /// Unit of the file's point, spot and directional lights: lumen uses their intensities unchanged, watt divides them by
    /// 683 lm/W, the factor that Blender's exporter multiplies by.
    #[arg(long, value_parser = value_of::<LightUnit>(), default_value = LightUnit::Lumen.name(), value_name = "UNIT",
        help_heading = "Light")]
    pub light_unit: LightUnit,
    /// Radius of all point and spot lights: spheres with the irradiance that the points have, soft shadows, and highlights. The
    /// camera does not see them. Without this, `radius` in the file's extras, or points.
    #[arg(long, value_name = "METRES", value_parser = light_radius, help_heading = "Light")]
    pub light_radius: Option<f32>,
    /// Angle that all directional lights subtend, at most 180; the sun has 0.53. Without this, `angle` (radians) in the file's
    /// extras, or sharp shadows.
    #[arg(long, value_name = "DEG", value_parser = sun_angle, help_heading = "Light")]
    pub sun_angle: Option<f32>,
    /// Layers light_NAME in place of the kinds of --aov lights: at most 8 groups of lights by the names of lights, nodes, meshes
    /// and materials, with * and ?; env is the environment. `light_group` in the extras of a node, light or material goes before
    /// patterns. Other lights are in the layer light_rest; the sum is the beauty (docs/lights.md).
    #[arg(long, value_name = "NAME=PATTERN,...", help_heading = "Light")]
    pub light_groups: Option<LightGroups>,
    /// Render without any environment light.
    #[arg(long, conflicts_with = "infinite", help_heading = "Light")]
    pub no_env: bool,

    /// Compensate the energy that microfacet models with a single scattering lose on rough surfaces, up to 69 % for rough
    /// metals. Off: the letter of glTF 2.0, appendix B, as Mitsuba's principled BSDF.
    #[arg(long, value_enum, default_value_t, value_name = "WHEN", help_heading = "Sampling")]
    pub energy_compensation: OnByDefault,
    /// Light transport to simulate.
    #[arg(long, value_parser = value_of::<Integrator>(), default_value = Integrator::Path.name(), help_heading = "Sampling")]
    pub integrator: Integrator,
    /// Largest number of segments of a path: 1 is emission only, 2 adds direct light. Mirror-like bounces at smooth glass are
    /// not counted.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..),
        help_heading = "Sampling")]
    pub max_depth: u32,
    /// Stop at this many paths per pixel.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_ifs([("preset",
        "thumbnail", "16"), ("preset", "product", "256"), ("preset", "final", "1024")]), help_heading = "Sampling")]
    pub spp: Option<u32>,
    /// Stop after this wall time, loading included: in seconds, or with a unit as in 90s, 10m, 1.5h. A resumed render counts
    /// the time of all its sessions. The first passes are small, so that every pixel has paths early.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, help_heading = "Sampling")]
    pub time: Option<f64>,
    /// Stop sampling each tile of 16 x 16 pixels when its estimated relative error, sqrt(mean(variance / (mean^2 + 0.01))),
    /// is at most this.
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub noise: Option<f64>,
    /// Paths per pixel before --noise may stop a tile [default: 32].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..), requires = "noise",
        help_heading = "Sampling")]
    pub min_spp: Option<u32>,
    #[command(flatten)]
    techniques: TechniqueFlags,
    /// Method that sets the share of light samples and BSDF samples in multiple importance sampling (docs/balance.md).
    #[arg(long, value_parser = balance(), default_value = "progressive", help_heading = "Sampling")]
    pub balance: Balance,
    /// For --balance second-order: the pilot's share of all paths, between 0 and 1 [default: 0.5].
    #[arg(long, value_name = "SHARE", value_parser = share, help_heading = "Sampling")]
    pub pilot: Option<f64>,
    /// Memory limit of the guiding field, such as 256M or 1G [default: 256M].
    #[arg(long, value_name = "SIZE", value_parser = parse_size, help_heading = "Sampling")]
    pub guiding_memory: Option<u64>,
    /// Clamp direct light: largest radiance, in the brightest channel, of one contribution at the first surface. Removes
    /// fireflies, but the picture becomes darker than the truth, by how much depends on --balance and other techniques
    /// [default: no limit].
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub clamp_direct: Option<f64>,
    /// Clamp indirect light: largest radiance, in the brightest channel, of one contribution found after the first surface.
    /// As --clamp-direct, it makes the picture darker, by how much depends on techniques [default: no limit].
    #[arg(long, value_name = "X", value_parser = positive, help_heading = "Sampling")]
    pub clamp_indirect: Option<f64>,
    /// Pixel reconstruction filter, applied by importance sampling.
    #[arg(long, value_parser = value_of::<PixelFilter>(), default_value = PixelFilter::Gaussian.name(), help_heading = "Sampling")]
    pub filter: PixelFilter,
    /// Seed of the random number generator.
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Sampling")]
    pub seed: u32,
    /// Vary the seed with the frame number, so that the noise pattern changes from frame to frame [default: true with
    /// --frames, else false].
    #[arg(long, value_name = "true|false", num_args = 0..=1, default_missing_value = "true", help_heading = "Sampling")]
    pub seed_per_frame: Option<bool>,

    /// Save a resumable picture at this interval and at the end, together with the --preview: in seconds, or with a unit as
    /// in 10m.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value_if("preset", "final", "60"),
        help_heading = "Interruption and parts")]
    pub checkpoint: Option<f64>,
    /// Keep copies of the last N checkpoints next to the picture, named as in out.checkpoint-0007.exr.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), requires = "checkpoint",
        help_heading = "Interruption and parts")]
    pub keep: Option<u32>,
    /// Program to run after each checkpoint, with the checkpoint's file as its argument. Rendering continues meanwhile.
    #[arg(long, value_name = "PROGRAM", requires = "checkpoint", help_heading = "Interruption and parts")]
    pub on_checkpoint: Option<PathBuf>,
    /// Continue from the output file; start from the beginning if it does not exist, do nothing if it is finished. With a
    /// higher --spp a finished render continues; the result is bit-identical to a single render if it had a multiple of 128
    /// paths per pixel and is not guided.
    #[arg(long, help_heading = "Interruption and parts")]
    pub resume: bool,
    /// Render only part K (1 to N) of the picture's tiles; `bismar merge` combines the parts. auto, or auto/N, takes K from
    /// the array of Slurm (--array=1-N), AWS Batch or Kubernetes (indexed jobs) that this process is a task of; names of
    /// outputs then hold K as #### or {frame:04} (docs/farm.md).
    #[arg(id = "part", long, value_parser = part_flag, value_name = "K/N|auto|auto/N", conflicts_with = "time",
        help_heading = "Interruption and parts")]
    part_flag: Option<PartFlag>,

    /// Ray tracing library.
    #[arg(long, value_parser = value_of::<Backend>(), default_value = Backend::Embree.name(), help_heading = "Machine")]
    pub rays: Backend,
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads, help_heading = "Machine")]
    pub threads: Option<usize>,
    /// Memory limit, such as 900M or 6G: a render that needs more is refused [default: Slurm's limit, else the machine's
    /// memory].
    #[arg(long, value_name = "SIZE", value_parser = parse_size, help_heading = "Machine")]
    pub memory_limit: Option<u64>,

    /// AOVs to write in addition to the beauty, separated by commas, or all, or none: albedo, normal, depth, direct,
    /// indirect, variance, samples, balance, object, material, position, uv, emission, guide-albedo and guide-normal
    /// (followed through mirrors, for denoisers), lights (the beauty by type of light source), velocity (pixels per frame),
    /// crypto-object, crypto-material.
    #[arg(long, alias = "aovs", value_parser = aov_list, value_name = "LIST",
        default_value = "variance,samples,balance", default_value_if("preset", "thumbnail", "none"),
        help_heading = "Output")]
    aov: AovList,
    /// Write colours and normals as 16-bit floats, which halves the file size.
    #[arg(long, help_heading = "Output")]
    pub half: bool,
    /// Primaries of the EXR's colours, which its attribute `chromaticities` says. The variance stays that of Rec. 709.
    #[arg(long, value_parser = value_of::<ColorSpace>(), default_value = ColorSpace::Rec709.name(), help_heading = "Output")]
    pub colorspace: ColorSpace,
    /// Hide the environment from the camera and write alpha. The environment still lights the scene.
    #[arg(long, help_heading = "Output")]
    pub transparent: bool,
    /// Add a denoised layer `denoised`, and show it in the PNG; layers of lights get a `denoised_NAME` each. The beauty stays
    /// unchanged.
    #[arg(long, value_parser = value_of::<Denoise>(), conflicts_with = "part", help_heading = "Output")]
    pub denoise: Option<Denoise>,
    /// Also write a picture to look at: .png, .jpg, or lossless .webp.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    pub preview: Option<PathBuf>,
    /// Show the picture in the viewer tev while it renders; without an address at 127.0.0.1:14158.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = tev::DEFAULT, help_heading = "Output")]
    pub tev: Option<tev::Address>,
    #[command(flatten)]
    pub view: ViewArgs,
    /// Exposure of the PNG in stops, or auto: the log-mean of all parts that are not dark becomes middle grey. The value is
    /// printed and stored in the EXR header (bismar.exposure), so that other pictures of a sequence can use it.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true,
        help_heading = "Output")]
    pub exposure: Exposure,
    /// Write timings and counters as JSON (docs/stats.md).
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    pub stats: Option<PathBuf>,
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
    /// Refuse a scene with features that can only be approximated or ignored.
    #[arg(long, help_heading = "Output")]
    pub strict: bool,
    /// Ignore signals; the parent process announces them on standard input.
    #[arg(long = "led", hide = true)]
    pub signals_from_parent: bool,
    /// A camera by its matrix; jobs of --cameras have it.
    #[arg(long, hide = true, conflicts_with_all = ["camera", "orbit"])]
    pub placed: Option<PlacedCamera>,
    /// Folder that is left out of the paths in the picture's header; `bismar check` has it.
    #[arg(long, hide = true)]
    pub relative_to: Option<PathBuf>,
    /// The flags that were given, without dashes, with their values; `None` if they are not known.
    #[arg(skip)]
    pub given: Option<Vec<(String, Option<String>)>>,
}

/// Flags that a sequence handles itself and does not pass to its jobs.
const NOT_FOR_JOBS: [&str; 6] = ["resume", "progress", "threads", "path-mapping", "led", "output"];

impl RenderArgs {
    /// Whether the command renders many pictures: frames or views.
    pub fn is_sequence(&self) -> bool {
        self.frames.is_some() || self.turntable.is_some() || self.cameras.is_some()
    }

    /// Whether the scene is shown at a time of its animations.
    fn is_posed(&self) -> bool {
        self.frames.is_some() || self.selection.selection().is_posed()
    }

    /// Path of the picture.
    pub fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| {
            let mut name = self.scene.file_stem().unwrap_or("bismar".as_ref()).to_owned();
            let is_numbered = self.is_sequence() || self.part_flag.is_some_and(|flag| flag.is_auto);
            name.push(if is_numbered { ".####.exr" } else { ".exr" });
            name.into()
        })
    }

    /// AOVs to write, in the order of [`Aov`]; `velocity` needs a time.
    fn aovs(&self) -> Vec<Aov> {
        let mut aovs = self.aov.0.clone();
        aovs.extend(self.light_groups.iter().map(|_| Aov::Lights));
        aovs.sort();
        aovs.dedup();
        aovs.retain(|aov| *aov != Aov::Velocity || self.is_posed());
        aovs
    }

    /// What the command asks for; of a sequence, what its pictures have in common.
    pub fn request(&self) -> Result<RenderRequest> {
        self.check()?;
        let (aovs, selection) = (self.aovs(), self.selection.selection());
        let uses_prepasses = self.balance.method().uses_prepasses();
        // Adaptive sampling estimates the variance of the colour, not of alpha.
        // Denoisers take the errors of neighbours for independent.
        let suits = |technique| match technique {
            Technique::Adaptive => self.ground == Ground::None,
            Technique::PathReuse => self.denoise.is_none(),
            _ => true,
        };
        let unlimited = self.spp.is_none() && self.time.is_none() && self.noise.is_none();
        let settings = RenderSettings {
            crop: self.crop,
            integrator: self.integrator,
            max_depth: self.max_depth,
            spp: if unlimited { RenderSettings::default().spp } else { self.spp },
            time: self.time,
            noise: self.noise,
            min_spp: self.min_spp,
            balance: self.balance,
            pilot: self.pilot,
            // Other methods are there to compare with: they take what is asked for, and nothing more.
            techniques: Choices::new(|technique| {
                self.techniques.choices[technique].unwrap_or(technique.usual(uses_prepasses && suits(technique)))
            }),
            guiding_memory: self.guiding_memory,
            seed: match (self.seed_per_frame, selection.frame) {
                (Some(true), Some(frame)) => frame_seed(self.seed, frame),
                _ => self.seed,
            },
            filter: self.filter,
            aovs: aovs.iter().any(|a| a.needs_sums()),
            extras: self.denoise.is_some() || aovs.iter().any(|a| a.needs_extras()),
            clamp_direct: self.clamp_direct,
            clamp_indirect: self.clamp_indirect,
            transparent: self.transparent || self.ground == Ground::Shadow,
            lens: self.aperture.map(|aperture| LensSettings { aperture, focus: self.focus, blades: self.lens_blades }),
            back_faces: self.back_faces,
            clip: !self.no_clip,
            glass_shadows: self.glass_shadows,
            reuse_sizes: self.techniques.reuse_sizes,
            ground: self.ground,
            light_groups: self.light_groups.clone().or_else(|| aovs.contains(&Aov::Lights).then(LightGroups::kinds)),
            part: self.part_flag.map(|flag| flag.part),
            ..RenderSettings::default()
        };
        let output = self.output();
        let args = self.clone();
        Ok(RenderRequest {
            scene: args.scene,
            selection,
            output,
            settings,
            camera: args.camera,
            orbit: args.orbit,
            placed: args.placed,
            size: args.size,
            env: args.env,
            env_rotate: args.env_rotate,
            env_strength: args.env_strength,
            sky: args.sky,
            sunsky: args.sunsky,
            no_env: args.no_env,
            light_unit: args.light_unit,
            light_radius: args.light_radius,
            sun_angle: args.sun_angle,
            energy_compensation: args.energy_compensation == OnByDefault::On,
            strict: args.strict,
            aovs,
            half: args.half,
            colorspace: args.colorspace,
            denoise: args.denoise,
            preview: args.preview,
            view: args.view.transform()?,
            exposure: args.exposure,
            stats: args.stats,
            tev: args.tev,
            checkpoint: args.checkpoint,
            keep: args.keep,
            on_checkpoint: args.on_checkpoint,
            resume: args.resume,
            rays: args.rays,
            memory_limit: args.memory_limit,
            relative_to: args.relative_to,
            given: args.given,
        })
    }

    /// What the command asks for, picture by picture, with the numbers of frames.
    pub fn requests(&self) -> Result<Vec<(Option<u32>, RenderRequest)>> {
        match &self.frames {
            None => Ok(vec![(None, self.request()?)]),
            Some(frames) => {
                let numbers = frames.numbers().iter();
                numbers.map(|frame| Ok((Some(*frame), self.of_frame(*frame)?.request()?))).collect()
            }
        }
    }

    /// The same command with `--path-mapping` applied to its paths, and with the number of the part in the names of its
    /// outputs if the part is chosen by the scheduler.
    ///
    /// # Errors
    /// Those of [`PathMapping::read`]; [`Error::Usage`] if a name has no place for the number of the part.
    pub fn on_this_machine(&self) -> Result<Self> {
        let mut args = self.clone();
        if let Some(preset) = self.preset {
            if preset.denoises() && self.part_flag.is_none() && Denoiser::load().is_ok() {
                args.denoise = Some(Denoise::Oidn);
            }
            let denoised = if args.denoise.is_some() { " --denoise oidn" } else { "" };
            info!("--preset {} stands for {}{denoised}; flags that are given win", preset.name(), preset.flags());
        }
        if let Some(PartFlag { part, is_auto: true }) = self.part_flag {
            args.output = Some(self.output());
            let outputs = [("-o", &mut args.output), ("--preview", &mut args.preview), ("--stats", &mut args.stats)];
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
            mapping.apply(&mut args.scene);
            let others = [&mut args.output, &mut args.env, &mut args.cameras, &mut args.preview, &mut args.stats];
            others.into_iter().flatten().chain([&mut args.view.view]).for_each(|path| mapping.apply(path));
        }
        Ok(args)
    }

    /// The command of one frame of a sequence.
    ///
    /// # Errors
    /// [`Error::Usage`] if the output's name has no placeholder for the frame number.
    fn of_frame(&self, frame: u32) -> Result<Self> {
        let mut args = Self { frames: None, seed_per_frame: Some(self.seed_per_frame.unwrap_or(true)), ..self.clone() };
        args.selection.frame = Some(frame.into());
        let output = self.output();
        args.output = Some(numbered(&output, frame).ok_or_else(|| {
            Error::Usage(format!(
                "{}: no placeholder for the frame number; write #### or {{frame:04}}",
                output.display()
            ))
        })?);
        for path in [&mut args.preview, &mut args.stats].into_iter().flatten() {
            *path = numbered(path, frame).unwrap_or_else(|| path.clone());
        }
        Ok(args)
    }

    /// Whether the scene is `-`, standard input. It is then named so in what people read, and no header says how to render it
    /// again.
    pub fn takes_standard_input(&mut self) -> bool {
        let takes = self.is_dash() && !self.signals_from_parent;
        if takes {
            self.output.get_or_insert("bismar.exr".into());
            self.scene = STANDARD_INPUT.into();
            self.given = None;
        }
        takes
    }

    fn is_dash(&self) -> bool {
        self.scene.as_os_str() == "-"
    }

    /// Checks the rules that clap cannot express.
    pub fn check(&self) -> Result<()> {
        self.check_balance()?;
        if self.is_dash() && (self.is_sequence() || self.replay_pixel.is_some()) {
            return Err(Error::Usage("a scene from standard input is for one picture: give a file".into()));
        }
        let refused = |technique: &Technique| {
            self.techniques.choices[*technique] == Some(Choice::On) && !technique.row().suits_noise_goal
        };
        if let Some(refused) = Technique::ALL.iter().find(|technique| self.noise.is_some() && refused(technique)) {
            return Err(Error::Usage(format!(
                "--{} cannot be used with --noise, which gives each tile the paths that it needs",
                refused.row().flag
            )));
        }
        if self.seed_per_frame == Some(true) && self.frames.is_none() && self.selection.frame.is_none() {
            return Err(Error::Usage("--seed-per-frame needs a frame: --frames or --frame".into()));
        }
        // `--aov all` leaves out what cannot be written.
        let velocity = self.aov.0.len() < Aov::ALL.len() && self.aov.0.contains(&Aov::Velocity);
        self.selection.selection().check(self.is_posed(), velocity, self.rays)?;
        if self.is_sequence() && self.part_flag.is_some_and(|flag| flag.is_auto) {
            return Err(Error::Usage(
                "--part auto divides one picture: for a sequence use `bismar farm submit`, whose tasks are its frames"
                    .into(),
            ));
        }
        self.output.iter().try_for_each(|path| check_ending("-o", path, &["exr"]))?;
        self.preview.iter().try_for_each(|path| check_ending("--preview", path, &preview::ENDINGS))
    }

    fn check_balance(&self) -> Result<()> {
        let name = self.balance.name();
        match (self.balance.method().needs_goal(), self.spp, self.pilot) {
            (true, None, _) => Err(Error::Usage(format!(
                "--balance {name} needs --spp: its pilot is a share of all samples, so their number must be known in advance"
            ))),
            (false, _, Some(_)) => {
                let with_pilot = Balance::all().iter().filter(|b| b.method().needs_goal()).map(|b| b.name());
                let with_pilot = with_pilot.collect::<Vec<_>>().join(" or ");
                Err(Error::Usage(format!(
                    "--pilot needs --balance {with_pilot}; {name} has no pilot whose size can be set"
                )))
            }
            _ => Ok(()),
        }
    }

    /// The flags that were given, without dashes, with their values.
    ///
    /// # Errors
    /// [`Error::Usage`] for a value that is not UTF-8.
    pub fn given(&self) -> Result<Vec<(String, Option<String>)>> {
        self.given.clone().ok_or_else(|| Error::Usage("the value of a flag is not UTF-8".into()))
    }

    /// A command that renders many pictures, as one job, and the folders below which they are written.
    pub fn sequence(&self) -> Result<(Job, Vec<PathBuf>)> {
        self.check()?;
        let mut flags = self.given()?;
        let args = self.on_this_machine()?;
        // For the exit code of a file that is missing or wrong.
        args.cameras.iter().try_for_each(|file| views::read(file).map(drop))?;
        flags.retain(|(name, _)| !NOT_FOR_JOBS.contains(&name.as_str()));
        // Paths after --path-mapping.
        let view = Some(args.view.view.clone());
        for (name, path) in [
            ("env", &args.env),
            ("cameras", &args.cameras),
            ("preview", &args.preview),
            ("stats", &args.stats),
            ("view", &view),
        ] {
            for (_, value) in flags.iter_mut().filter(|(flag, _)| flag == name) {
                *value = path.as_deref().map(|path| utf8(path).map(str::to_owned)).transpose()?;
            }
        }
        let output = args.output();
        let outputs = [Some(&output), args.preview.as_ref(), args.stats.as_ref()];
        let folders = outputs.into_iter().flatten().map(|path| folder(path)).collect();
        let name = output.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((Job { name, scene: args.scene, flags, output, ..Job::default() }, folders))
    }
}

/// The folder of an output, before the first of its folders whose name holds the frame's number.
fn folder(output: &Path) -> PathBuf {
    let has_number = |part: &Component| part.as_os_str().to_string_lossy().contains(['#', '{']);
    let parent = output.parent().unwrap_or(Path::new(""));
    let before: PathBuf = parent.components().take_while(|part| !has_number(part)).collect();
    if before.as_os_str().is_empty() { ".".into() } else { before }
}
