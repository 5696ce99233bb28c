//! What is asked for: one picture. `values` and `wire` have its values as texts and as JSON, `json`
//! has all of it as JSON, as flags and in pictures.

mod json;
mod selection;
mod values;
mod view;
mod wire;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::{Args, Command, FromArgMatches};
use serde::{Deserialize, Serialize};

use super::memory::parse_size;
use crate::Result;
use crate::color::ColorSpace;
use crate::console::args::{positive, seconds, threads};
use crate::console::{Paths, Size, tev};
use crate::film::lock::{Claim, claim};
use crate::film::lut::is_lut;
use crate::film::{Aov, Denoise, Exposure, atomic};
use crate::integrator::data::dimensions::MAX_SEGMENTS;
use crate::rays::Backend;
use crate::render::record::identity::RequestedOutputs;
use crate::render::settings::lens::{Aperture, Focus, LensSettings};
use crate::render::{
    BackFaces, Balance, Choices, GlassShadows, Ground, Integrator, LightGroups, Part, PixelFilter, RenderSettings,
    Technique,
};
use crate::sampling::frame_seed;
use crate::scene::import::ImportOptions;
use crate::scene::{ClearSky, Framing, Orbit, PlacedCamera};
pub use json::argument;
pub use selection::SceneSelection;
pub use values::{LightUnit, OnOff, Preset, TechniqueOptions, value_of};
use values::{aov_list, balance, blades, crop, env_strength, finite, light_radius, preset, share, sun_angle};
pub use view::ViewOptions;

/// A request to render one picture: the flags of `bismar render` that concern it, with their help, and the fields of batch files,
/// Python and headers. The default is the command without a flag. As JSON, names and values are those of flags.
#[derive(Debug, Clone, Args, Serialize, Deserialize)]
#[command(allow_negative_numbers = true)]
#[serde(rename_all = "kebab-case", default)]
pub struct RenderRequest {
    /// The scene's file.
    #[arg(skip)]
    #[serde(with = "wire::path")]
    pub scene: PathBuf,
    /// The picture's file (.exr).
    #[arg(skip = "bismar.exr")]
    #[serde(with = "wire::path")]
    pub output: PathBuf,
    /// What of it is rendered.
    #[command(flatten)]
    #[serde(flatten)]
    pub selection: SceneSelection,
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
    #[serde(with = "wire::optional_text")]
    pub orbit: Option<Orbit>,
    /// Other defaults of some flags, for an occasion; flags that are given win.
    #[arg(long, value_parser = preset(), value_name = "OCCASION", help_heading = "View")]
    pub preset: Option<Preset>,
    /// Resolution in pixels [default: 960 wide, with the height from the camera's aspect ratio].
    #[arg(long, value_name = "WxH", default_value_ifs([("preset", "thumbnail", "512x512"), ("preset", "product", "1024x1024"),
        ("preset", "final", "1920x1080")]), help_heading = "View")]
    #[serde(with = "wire::optional_text")]
    pub size: Option<Size>,
    /// Crop window in pixels from the top left; x1 and y1 are exclusive. Its pixels are bit-identical to those of the full
    /// render.
    #[arg(long, value_parser = crop, value_name = "x0,y0,x1,y1", help_heading = "View")]
    pub crop: Option<[u32; 4]>,
    /// Thin-lens aperture: an f-stop such as f/2.8 (for a sensor 24 mm high) or a radius in metres. glTF cameras have no
    /// aperture [default: pinhole].
    #[arg(long, value_name = "F-STOP|RADIUS", help_heading = "View")]
    #[serde(with = "wire::optional_text")]
    pub aperture: Option<Aperture>,
    /// Focus distance in metres along the camera's axis, or auto: the distance of what the centre of the picture shows.
    #[arg(long, value_name = "DISTANCE|auto", default_value = "auto", requires = "aperture", help_heading = "View")]
    #[serde(with = "wire::text")]
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
    #[serde(with = "wire::optional_path")]
    pub env: Option<PathBuf>,
    /// Rotation of the environment map about +y, in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, requires = "env",
        value_parser = finite, help_heading = "Light")]
    #[serde(with = "wire::text")]
    pub env_rotate: f32,
    /// Factor on the radiance of --env, --sky or --sunsky.
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "infinite", value_parser = env_strength,
        help_heading = "Light")]
    #[serde(with = "wire::text")]
    pub env_strength: f32,
    /// Uniform white environment.
    #[arg(long, group = "infinite", conflicts_with = "env", help_heading = "Light")]
    pub sky: bool,
    /// A clear sky with its sun, by the sun's elevation and azimuth (0 in +z, 90 in +x) in degrees and the haze, from 1 to 10
    /// [default: 3] (docs/lights.md).
    #[arg(long, value_name = "ELEVATION,AZIMUTH[,TURBIDITY]", group = "infinite", conflicts_with_all = ["env", "sky"],
        help_heading = "Light")]
    #[serde(with = "wire::optional_text")]
    pub sunsky: Option<ClearSky>,
    /// Unit of the file's point, spot and directional lights: lumen uses their intensities unchanged, watt divides them by
    /// 683 lm/W, the factor that Blender's exporter multiplies by.
    #[arg(long, value_parser = value_of::<LightUnit>(), default_value = LightUnit::Lumen.name(), value_name = "UNIT",
        help_heading = "Light")]
    pub light_unit: LightUnit,
    /// Radius of all point and spot lights: spheres with the irradiance that the points have, soft shadows, and highlights. The
    /// camera does not see them. Without this, `radius` in the file's extras, or points.
    #[arg(long, value_name = "METRES", value_parser = light_radius, help_heading = "Light")]
    #[serde(with = "wire::optional_text")]
    pub light_radius: Option<f32>,
    /// Angle that all directional lights subtend, at most 180; the sun has 0.53. Without this, `angle` (radians) in the file's
    /// extras, or sharp shadows.
    #[arg(long, value_name = "DEG", value_parser = sun_angle, help_heading = "Light")]
    #[serde(with = "wire::optional_text")]
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
    #[arg(long, value_parser = value_of::<OnOff>(), default_value = OnOff::On.name(), value_name = "WHEN", help_heading = "Sampling")]
    pub energy_compensation: OnOff,
    /// Light transport to simulate.
    #[arg(long, value_parser = value_of::<Integrator>(), default_value = Integrator::Path.name(), help_heading = "Sampling")]
    pub integrator: Integrator,
    /// Largest number of segments of a path: 1 is emission only, 2 adds direct light. Mirror-like bounces at smooth glass are
    /// not counted.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SEGMENTS)),
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
    /// Which techniques are used.
    #[command(flatten)]
    #[serde(flatten)]
    pub techniques: TechniqueOptions,
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
    #[serde(with = "wire::optional_path")]
    pub on_checkpoint: Option<PathBuf>,
    /// Continue from the output file; start from the beginning if it does not exist, do nothing if it is finished. With a
    /// higher --spp a finished render continues; the result is bit-identical to a single render if it had a multiple of 128
    /// paths per pixel and is not guided.
    #[arg(long, help_heading = "Interruption and parts")]
    pub resume: bool,
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
    #[serde(with = "wire::aovs")]
    pub aov: ::std::vec::Vec<Aov>,
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
    #[arg(long, value_parser = value_of::<Denoise>(), help_heading = "Output")]
    pub denoise: Option<Denoise>,
    /// Also write a picture to look at: .png, .jpg, or lossless .webp.
    #[arg(long, value_name = "FILE.png", help_heading = "Output")]
    #[serde(with = "wire::optional_path")]
    pub preview: Option<PathBuf>,
    /// Show the picture in the viewer tev while it renders; without an address at 127.0.0.1:14158.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = tev::DEFAULT, help_heading = "Output")]
    #[serde(with = "wire::optional_text")]
    pub tev: Option<tev::Address>,
    /// How `preview` is made.
    #[command(flatten)]
    #[serde(flatten)]
    pub view: ViewOptions,
    /// Exposure of the PNG in stops, or auto: the log-mean of all parts that are not dark becomes middle grey. The value is
    /// printed and stored in the EXR header (bismar.exposure), so that other pictures of a sequence can use it.
    #[arg(long, value_name = "EV", default_value_t = Exposure::Auto, allow_negative_numbers = true,
        help_heading = "Output")]
    #[serde(with = "wire::text")]
    pub exposure: Exposure,
    /// Write timings and counters as JSON (docs/stats.md).
    #[arg(long, value_name = "FILE.json", help_heading = "Output")]
    #[serde(with = "wire::optional_path")]
    pub stats: Option<PathBuf>,
    /// Refuse a scene with features that can only be approximated or ignored.
    #[arg(long, help_heading = "Output")]
    pub strict: bool,
    /// A camera by its matrix; jobs of --cameras have it.
    #[arg(long, hide = true, conflicts_with_all = ["camera", "orbit"])]
    #[serde(with = "wire::optional_text")]
    pub placed: Option<PlacedCamera>,
    /// Folder that is left out of the paths in the picture's header; `bismar check` has it.
    #[arg(long, hide = true)]
    #[serde(with = "wire::optional_path")]
    pub relative_to: Option<PathBuf>,
    /// Render only this part of the tiles.
    #[arg(skip)]
    #[serde(with = "wire::optional_text")]
    pub part: Option<Part>,
}

/// What clap has where no flag is given.
impl Default for RenderRequest {
    fn default() -> Self {
        static DEFAULT: OnceLock<RenderRequest> = OnceLock::new();
        DEFAULT.get_or_init(|| of_flags(None).expect("each flag is optional")).clone()
    }
}

/// The request of these flags.
fn of_flags(flags: impl IntoIterator<Item = String>) -> std::result::Result<RenderRequest, clap::Error> {
    let command = RenderRequest::augment_args(Command::new("render")).no_binary_name(true);
    command.try_get_matches_from(flags).and_then(|matches| RenderRequest::from_arg_matches(&matches))
}

impl RenderRequest {
    /// Is the camera the view that fits the whole scene?
    pub fn is_framed(&self) -> bool {
        self.camera.as_deref() == Some(Framing::NAME)
    }

    /// AOVs to write, in the order of [`Aov`]: those asked for, and that of groups of lights. `velocity` needs a time.
    pub fn aovs(&self) -> Vec<Aov> {
        let mut aovs = self.aov.clone();
        aovs.extend(self.light_groups.iter().map(|_| Aov::Lights));
        aovs.sort();
        aovs.dedup();
        aovs.retain(|aov| *aov != Aov::Velocity || self.selection.is_posed());
        aovs
    }

    /// Is the velocity AOV written?
    pub fn has_velocities(&self) -> bool {
        self.aovs().contains(&Aov::Velocity)
    }

    /// How to render, but for camera, width and height, which follow from the scene ([`settings`](super::settings)).
    pub fn settings(&self) -> RenderSettings {
        let (aovs, plain) = (self.aovs(), RenderSettings::default());
        let uses_prepasses = self.balance.method().uses_prepasses();
        // Adaptive sampling estimates the variance of the colour, not of alpha.
        // Denoisers take the errors of neighbours for independent.
        let suits = |technique| match technique {
            Technique::Adaptive => self.ground == Ground::None,
            Technique::PathReuse => self.denoise.is_none(),
            _ => true,
        };
        // Other methods are there to compare with: they take what is asked for, and nothing more.
        let usual = |technique: Technique| technique.usual(uses_prepasses && suits(technique));
        let unlimited = self.spp.is_none() && self.time.is_none() && self.noise.is_none();
        let kinds = || aovs.contains(&Aov::Lights).then(LightGroups::kinds);
        RenderSettings {
            crop: self.crop,
            integrator: self.integrator,
            max_depth: self.max_depth,
            spp: if unlimited { plain.spp } else { self.spp },
            time: self.time,
            noise: self.noise,
            min_spp: self.min_spp,
            balance: self.balance,
            pilot: self.pilot,
            techniques: Choices::new(|technique| self.techniques.choices[technique].unwrap_or(usual(technique))),
            guiding_memory: self.guiding_memory,
            seed: match (self.seed_per_frame, self.selection.frame) {
                (Some(true), Some(frame)) => frame_seed(self.seed, frame),
                _ => self.seed,
            },
            filter: self.filter,
            aovs: aovs.iter().any(|aov| aov.needs_sums()),
            extras: self.denoise.is_some() || aovs.iter().any(|aov| aov.needs_extras()),
            clamp_direct: self.clamp_direct,
            clamp_indirect: self.clamp_indirect,
            transparent: self.transparent || self.ground == Ground::Shadow,
            lens: self.aperture.map(|aperture| LensSettings { aperture, focus: self.focus, blades: self.lens_blades }),
            back_faces: self.back_faces,
            clip: !self.no_clip,
            glass_shadows: self.glass_shadows,
            reuse_sizes: self.techniques.reuse_sizes,
            ground: self.ground,
            light_groups: self.light_groups.clone().or_else(kinds),
            part: self.part,
            ..plain
        }
    }

    /// Options of the import.
    pub fn import_options(&self) -> ImportOptions {
        self.selection.options(self.strict, self.has_velocities())
    }

    /// Text that distinguishes scenes imported differently from the same files; empty for the default import.
    pub fn import_choices(&self) -> String {
        let unit = if self.light_unit == LightUnit::Watt { ", lights in watts" } else { "" };
        let radius = self.light_radius.map_or(String::new(), |metres| format!(", lights of radius {metres}"));
        let angle = self.sun_angle.map_or(String::new(), |degrees| format!(", suns of {degrees} degrees"));
        let energy = if self.energy_compensation == OnOff::On { "" } else { ", no energy compensation" };
        let velocities = if self.has_velocities() { ", velocities" } else { "" };
        format!("{}{unit}{radius}{angle}{energy}{velocities}", self.selection.name())
    }

    /// Text that identifies a camera that is not one of the file; empty for those of the file.
    pub fn view_text(&self) -> String {
        let placed = self.placed.as_ref().map(|placed| format!(", camera at {placed}"));
        placed.or(self.orbit.map(|orbit| format!(", orbit {orbit}"))).unwrap_or_default()
    }

    /// The part of the output's identity that is known before the scene is loaded.
    pub fn requested(&self) -> RequestedOutputs {
        let (camera, size) = (self.camera.clone(), self.size.map(|s| [s.0, s.1]));
        let aovs = self.aovs().iter().map(|aov| aov.name()).collect::<Vec<_>>().join(",");
        let Self { half, colorspace, .. } = *self;
        RequestedOutputs { camera, size, aovs, half, colorspace, denoised: self.denoise.is_some() }
    }

    /// Key that is equal for requests whose scenes are made of the same files.
    pub fn files_key(&self) -> String {
        let Self { scene, env, env_rotate, env_strength, no_env, sky, sunsky, .. } = self;
        format!("{scene:?} {env:?} {env_rotate} {env_strength} {no_env} {sky} {sunsky:?}")
    }

    /// Key that is equal for requests that can share a scene in memory.
    pub fn scene_key(&self) -> String {
        let (files, import) = (self.files_key(), self.import_choices());
        format!("{files} {import:?} {} {:?} {}", self.is_framed(), self.rays, self.strict)
    }

    /// Declares the files that are read; `suffix` is appended to their description in errors.
    ///
    /// # Errors
    /// Those of [`Paths::reads`].
    pub fn declare_inputs(&self, suffix: &str, paths: &mut Paths) -> Result<()> {
        paths.reads(&format!("the scene{suffix}"), &self.scene)?;
        self.env.iter().try_for_each(|path| paths.reads(&format!("--env{suffix}"), path))?;
        let lut = is_lut(&self.view.view).then_some(&self.view.view);
        lut.iter().try_for_each(|path| paths.reads(&format!("--view{suffix}"), path))
    }

    /// Declares the files that are read and written; `suffix` as in [`Self::declare_inputs`].
    ///
    /// # Errors
    /// Those of [`Paths::writes`].
    pub fn declare(&self, suffix: &str, paths: &mut Paths) -> Result<()> {
        self.declare_inputs(suffix, paths)?;
        paths.writes(&format!("-o{suffix}"), &self.output)?;
        for (flag, path) in [("--preview", &self.preview), ("--stats", &self.stats)] {
            path.iter().try_for_each(|path| paths.writes(&format!("{flag}{suffix}"), path))?;
        }
        Ok(())
    }

    /// The files that options name.
    pub fn paths_mut(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let lut = is_lut(&self.view.view).then_some(&mut self.view.view);
        [self.env.as_mut(), self.preview.as_mut(), self.stats.as_mut(), lut].into_iter().flatten()
    }

    /// The picture, its preview and its statistics.
    pub fn outputs(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.output), self.preview.as_ref(), self.stats.as_ref()].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Locks the outputs, so that one that cannot be written or that another process writes is an error before the render.
    /// Removes temporary files of killed processes.
    ///
    /// # Errors
    /// Those of [`claim_output`].
    pub fn claim_outputs(&self) -> Result<Vec<Claim>> {
        self.outputs().map(claim_output).collect()
    }
}

/// Locks one output.
///
/// # Errors
/// Those of [`atomic::check`] and [`claim`].
pub fn claim_output(path: &Path) -> Result<Claim> {
    atomic::check(path)?;
    let claim = claim(path)?;
    atomic::sweep(path);
    Ok(claim)
}

#[cfg(test)]
mod tests;
