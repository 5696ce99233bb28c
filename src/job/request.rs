//! What is asked for: one picture.

use std::path::{Path, PathBuf};

use crate::Result;
use crate::color::ColorSpace;
use crate::console::{Paths, Size, tev};
use crate::film::lock::{Claim, claim};
use crate::film::{Aov, Denoise, Exposure, View, ViewTransform, atomic};
use crate::rays::Backend;
use crate::render::RenderSettings;
use crate::render::record::identity::RequestedOutputs;
use crate::scene::import::ImportOptions;
use crate::scene::{ClearSky, Framing, Orbit, PlacedCamera};

use super::selection::SceneSelection;

/// A request to render one picture. The default is `bismar render` without a flag.
#[derive(Debug, Clone)]
pub struct RenderRequest {
    /// The scene's file.
    pub scene: PathBuf,
    /// What of it is rendered.
    pub selection: SceneSelection,
    /// The picture's file (.exr).
    pub output: PathBuf,
    /// How to render. Camera, width and height follow from the fields below once the scene is known.
    pub settings: RenderSettings,

    /// Camera by name or index, `framed` or `panorama`; `None`: the first.
    pub camera: Option<String>,
    /// In place of a camera, a view around the scene.
    pub orbit: Option<Orbit>,
    /// In place of both, a camera by its matrix.
    pub placed: Option<PlacedCamera>,
    /// Width and height; `None`: 960 pixels wide, with the camera's aspect ratio.
    pub size: Option<Size>,

    /// Environment map.
    pub env: Option<PathBuf>,
    /// Rotation of the environment map about +y in degrees.
    pub env_rotate: f32,
    /// Factor on the radiance of `env`, `sky` or `sunsky`.
    pub env_strength: f32,
    /// Is the environment uniform and white?
    pub sky: bool,
    /// A clear sky with its sun in place of an environment map.
    pub sunsky: Option<ClearSky>,
    /// Is there no environment at all?
    pub no_env: bool,
    /// Unit of the file's punctual lights.
    pub light_unit: LightUnit,
    /// Radius in metres of all point and spot lights; `None`: the file's.
    pub light_radius: Option<f32>,
    /// Angle in degrees that all directional lights subtend; `None`: the file's.
    pub sun_angle: Option<f32>,
    /// Is the energy compensated that single scattering loses on rough surfaces?
    pub energy_compensation: bool,
    /// Is a scene refused that can only be approximated?
    pub strict: bool,

    /// AOVs to write, sorted.
    pub aovs: Vec<Aov>,
    /// Are colours and normals stored as 16-bit floats?
    pub half: bool,
    /// Primaries of the EXR's colours.
    pub colorspace: ColorSpace,
    /// Add a denoised layer.
    pub denoise: Option<Denoise>,
    /// A picture to look at (.png, .jpg, .webp).
    pub preview: Option<PathBuf>,
    /// View transform of `preview`.
    pub view: ViewTransform,
    /// Exposure of `preview`.
    pub exposure: Exposure,
    /// Statistics (.json).
    pub stats: Option<PathBuf>,
    /// Viewer that shows the picture while it renders.
    pub tev: Option<tev::Address>,

    /// Save a resumable picture at this interval in seconds.
    pub checkpoint: Option<f64>,
    /// Number of checkpoints of which copies are kept.
    pub keep: Option<u32>,
    /// Program to run after each checkpoint.
    pub on_checkpoint: Option<PathBuf>,
    /// Continue from `output`, if it exists.
    pub resume: bool,

    /// Ray tracing library.
    pub rays: Backend,
    /// Maximum bytes of memory; `None`: Slurm's limit, else the machine's memory.
    pub memory_limit: Option<u64>,

    /// Folder that is left out of the paths in the picture's header.
    pub relative_to: Option<PathBuf>,
    /// Names and values by which this was asked for, for the picture's header; `None` if it cannot be asked for again.
    pub given: Option<Vec<(String, Option<String>)>>,
}

impl Default for RenderRequest {
    fn default() -> Self {
        Self {
            scene: PathBuf::new(),
            selection: SceneSelection::default(),
            output: "bismar.exr".into(),
            settings: RenderSettings::default(),
            camera: None,
            orbit: None,
            placed: None,
            size: None,
            env: None,
            env_rotate: 0.0,
            env_strength: 1.0,
            sky: false,
            sunsky: None,
            no_env: false,
            light_unit: LightUnit::Lumen,
            light_radius: None,
            sun_angle: None,
            energy_compensation: true,
            strict: false,
            aovs: Aov::DEFAULT.to_vec(),
            half: false,
            colorspace: ColorSpace::Rec709,
            denoise: None,
            preview: None,
            view: View::Agx.into(),
            exposure: Exposure::Auto,
            stats: None,
            tev: None,
            checkpoint: None,
            keep: None,
            on_checkpoint: None,
            resume: false,
            rays: Backend::Embree,
            memory_limit: None,
            relative_to: None,
            given: None,
        }
    }
}

/// Unit of the file's punctual lights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightUnit {
    /// Candela and lux, as KHR_lights_punctual defines.
    Lumen,
    /// W/sr and W/m^2, multiplied by 683 lm/W as Blender's exporter does.
    Watt,
}

bismar_scene::named_variants! { LightUnit { Lumen = "lumen", Watt = "watt" } }

impl LightUnit {
    /// Factor on intensities.
    pub fn factor(self) -> f32 {
        match self {
            Self::Lumen => 1.0,
            Self::Watt => 1.0 / 683.0,
        }
    }
}

impl RenderRequest {
    /// Is the camera the view that fits the whole scene?
    pub fn is_framed(&self) -> bool {
        self.camera.as_deref() == Some(Framing::NAME)
    }

    /// Is the velocity AOV written?
    pub fn has_velocities(&self) -> bool {
        self.aovs.contains(&Aov::Velocity)
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
        let energy = if self.energy_compensation { "" } else { ", no energy compensation" };
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
        let aovs = self.aovs.iter().map(|aov| aov.name()).collect::<Vec<_>>().join(",");
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
        if let ViewTransform::Lut(_, path, _) = &self.view {
            paths.reads(&format!("--view{suffix}"), path)?;
        }
        Ok(())
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
