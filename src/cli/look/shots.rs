//! Views of a scene: one load, one acceleration structure, one framing.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use glam::DVec3;
use serde_json::{Value, json};

use super::args::LookArgs;
use super::contents::Contents;
use super::direction::Direction;
use crate::batch::frames::Frames;
use crate::console::Paths;
use crate::film::{Exposure, Pixels, View, preview::to_byte};
use crate::job::{Inputs, Loaded, RenderRequest, Session, TechniqueOptions};
use crate::render::{Choice, PerTechnique, RenderSettings, RunOptions, StopReason, run};
use crate::scene::Orbit;
use crate::{Error, Result};

/// Centre and radius in metres.
pub type Sphere = (DVec3, f64);

/// A scene that is looked at, with its files.
pub struct Subject {
    request: RenderRequest,
    inputs: Inputs,
    pub contents: Contents,
    /// The sphere around it, over the whole animation if one is played.
    pub sphere: Sphere,
}

impl Subject {
    /// Opens and imports a scene, and declares its files.
    pub fn open(look: &LookArgs, scene: &Path, paths: &mut Paths) -> Result<Self> {
        let mut selection = look.selection.clone();
        look.frames.iter().for_each(|frames| selection.frame = Some(frames.numbers()[0].into()));
        // With so few paths, the pre-passes take longer than what they save.
        let choices = PerTechnique::new(|_| Some(Choice::Off));
        let request = RenderRequest {
            scene: scene.into(),
            selection,
            spp: Some(look.spp),
            transparent: true,
            techniques: TechniqueOptions { choices, ..TechniqueOptions::default() },
            size: Some(look.size),
            aov: Vec::new(),
            memory_limit: look.memory_limit,
            ..Default::default()
        };
        let inputs = Inputs::read(&request)?;
        inputs.declare(paths)?;
        let threads = rayon::current_num_threads();
        let session = Session { request: &request, inputs: &inputs, threads, began: Instant::now(), replaces: false };
        session.check_memory()?;
        let imported = inputs.lend(&request)?.scene.import(&request.import_options())?;
        let contents = Contents::of(&imported, &inputs.scene);
        let (centre, radius) = imported.scene.enclosing_sphere();
        Ok(Self { request, inputs, contents, sphere: (centre + imported.scene.origin, radius) })
    }

    /// Renders the views, frame by frame, around `sphere`.
    /// Errors: Those of the import and of the build; [`Error::Interrupted`] soon after `stop` is raised.
    pub fn shots(
        &mut self,
        views: &[Direction],
        frames: Option<&Frames>,
        sphere: Sphere,
        stop: &AtomicBool,
    ) -> Result<Vec<Shot>> {
        let poses: Vec<Option<u32>> =
            frames.map_or(vec![None], |all| all.numbers().iter().copied().map(Some).collect());
        let (mut shots, mut previous) = (Vec::new(), None);
        for (i, frame) in poses.iter().enumerate() {
            frame.iter().for_each(|frame| self.request.selection.frame = Some((*frame).into()));
            let more = i + 1 < poses.len();
            let loaded = Loaded::load_next(&self.request, &self.inputs, previous.take(), more, &|_, _| true)?;
            // The importer makes no environment.
            self.contents.studio_light = loaded.prepared.scene.environment.is_some();
            for view in views {
                shots.push(self.shot(&loaded, *view, *frame, sphere, stop)?);
            }
            previous = Some(Arc::new(loaded));
        }
        Ok(shots)
    }

    fn shot(
        &self,
        loaded: &Loaded,
        view: Direction,
        frame: Option<u32>,
        (centre, radius): Sphere,
        stop: &AtomicBool,
    ) -> Result<Shot> {
        let sphere = (centre - loaded.prepared.scene.origin, radius);
        let settings = self.request.settings();
        let (width, height) = self.request.size.map_or((settings.width, settings.height), |size| (size.0, size.1));
        let camera = view.orbit().around(sphere, f64::from(width) / f64::from(height));
        let scene = loaded.prepared.with_camera(camera);
        let settings = RenderSettings { camera: scene.scene.cameras.len() - 1, width, height, ..settings };
        let rendered = run(&scene, &settings, RunOptions::new(stop, &|_| ()))?;
        if rendered.stop == StopReason::Interrupted {
            return Err(Error::Interrupted("interrupted: nothing is written".into()));
        }
        let pixels = rendered.pixels();
        let pixel = |x, y| {
            let stats = pixels.at(x, y).0;
            let [r, g, b] = stats.mean();
            [r, g, b, stats.coverage()]
        };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
        Ok(Shot { view, frame, size: [width, height], pixels })
    }
}

pub struct Shot {
    view: Direction,
    frame: Option<u32>,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Linear RGB, premultiplied, and the share of the pixel that shows a surface; row by row from the top.
    pub pixels: Vec<[f32; 4]>,
}

/// What lies behind the scene, display-encoded.
const BACKDROP: f32 = 0.25;
/// Display values, of 255, up to which a pixel is black in all channels, and from which it is burnt out.
const BLACK: u8 = 5;
const BURNT_OUT: u8 = 250;

impl Shot {
    /// The view, and the frame if there is one.
    pub fn label(&self) -> String {
        let frame = self.frame.map(|frame| format!(", frame {frame}")).unwrap_or_default();
        self.view.name() + &frame
    }

    /// Display-encoded RGB over the backdrop.
    pub fn developed(&self, exposure: f32) -> Vec<u8> {
        let over = |[r, g, b, alpha]: [f32; 4]| {
            let shown = Self::encoded([r, g, b, alpha], exposure);
            shown.map(|x| to_byte(x * alpha + BACKDROP * (1.0 - alpha)))
        };
        self.pixels.iter().flat_map(|pixel| over(*pixel)).collect()
    }

    /// The display-encoded colour of what a pixel shows.
    fn encoded([r, g, b, alpha]: [f32; 4], exposure: f32) -> [f32; 3] {
        View::Agx.apply([r, g, b].map(|x| x / alpha.max(f32::MIN_POSITIVE)), exposure)
    }

    pub(crate) fn has_bits_of(&self, other: &Self) -> bool {
        let bits = |shot: &Self| shot.pixels.as_flattened().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        bits(self) == bits(other)
    }

    /// Share of the frame that shows a surface, 0 to 1.
    pub fn shown(&self) -> f64 {
        self.pixels.iter().map(|pixel| f64::from(pixel[3])).sum::<f64>() / self.pixels.len().max(1) as f64
    }

    /// What a program can act on, as JSON.
    pub fn report(&self, exposure: f32) -> Value {
        let (mut all, mut black, mut burnt_out) = (0_u64, 0_u64, 0_u64);
        for pixel in self.pixels.iter().filter(|pixel| pixel[3] >= 0.5) {
            let bytes = Self::encoded(*pixel, exposure).map(to_byte);
            all += 1;
            black += u64::from(bytes.iter().all(|x| *x <= BLACK));
            burnt_out += u64::from(bytes.iter().all(|x| *x >= BURNT_OUT));
        }
        let share = |n: u64| n as f64 / all.max(1) as f64;
        let Orbit { azimuth, elevation, .. } = self.view.orbit();
        let mut report = json!({ "name": self.view.name(), "azimuth": azimuth, "elevation": elevation });
        self.frame.iter().for_each(|frame| report["frame"] = json!(frame));
        report["shown"] = json!(self.shown());
        report["black"] = json!(share(black));
        report["burnt_out"] = json!(share(burnt_out));
        report["hash"] = json!(hash_of(std::slice::from_ref(self)));
        report
    }
}

/// BLAKE3 of all views in order: of each the linear premultiplied RGBA, 32-bit floats, little-endian, row by row; hexadecimal.
pub(crate) fn hash_of(shots: &[Shot]) -> String {
    let mut hasher = blake3::Hasher::new();
    for some in shots.iter().flat_map(|shot| shot.pixels.chunks(4096)) {
        hasher.update(&some.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>());
    }
    hasher.finalize().to_hex().to_string()
}

/// The exposure in stops of all views together, by what they show of surfaces.
pub(crate) fn exposure_of<'a>(shots: impl Iterator<Item = &'a Shot>) -> f32 {
    let mut shots = shots.peekable();
    let width = shots.peek().map_or(0, |shot| shot.size[0] as usize);
    // What shows no surface does not count.
    let color = |[r, g, b, alpha]: [f32; 4]| [r, g, b].map(|x| if alpha >= 0.5 { x / alpha } else { f32::NAN });
    Exposure::Auto.of((width, shots.flat_map(|shot| &shot.pixels).copied().map(color)))
}
