//! Scenes that stay in memory and are rendered many times, for front ends other than the command line (the Python package).

mod heuristic;

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

pub use heuristic::{Heuristic, PixelMoments};

use super::stats::{Seconds, Stats};
use super::{Inputs, Loaded, OutputWriter, RenderRequest, Session, ViewOptions, claim_output, preview_mark, settings};
use crate::color::ColorSpace;
use crate::console::Paths;
use crate::film::aov::{Channel, Value, beauty};
use crate::film::compare::{Comparison, compare as compare_pictures, in_common};
use crate::film::denoise::{DENOISED, Denoiser, denoised_layers};
use crate::film::picture::Picture as FilmPicture;
use crate::film::{Background, Exposure, Look, Pixels, View, colors, preview};
use crate::integrator::PreparedScene;
use crate::render::settings::camera::lens;
use crate::render::{Identity, Progress, RenderSettings, Rendered, RunOptions, StopReason, run};
use crate::scene::import::{self, Summary};
use crate::scene::{Calibration, Camera, Framing, PlacedCamera, Projection, Scene};
use crate::{Error, Result};

/// A camera of a scene.
#[derive(Debug, Clone)]
pub struct CameraInfo {
    /// Its name, for the option `camera`.
    pub name: String,
    /// `perspective`, `orthographic`, `panorama` or `fisheye`.
    pub projection: &'static str,
    /// Vertical field of view in degrees, or half of the height in metres of an orthographic camera.
    pub vertical: f64,
    /// Width over height, if the file states it.
    pub aspect: Option<f64>,
    /// Camera to world, row by row. A framed view is fitted to a square picture.
    pub to_world: [[f64; 4]; 4],
    /// What was measured, if it was calibrated.
    pub calibration: Option<Calibration>,
}

/// A scene in memory. A clone shares all that is large.
#[derive(Clone)]
pub struct LoadedScene {
    request: RenderRequest,
    inputs: Arc<Inputs>,
    /// The files that it was made of.
    paths: Arc<Paths>,
    loaded: Arc<Loaded>,
    /// The placed cameras and their indices in the scene.
    placed: Vec<(usize, PlacedCamera)>,
}

impl LoadedScene {
    /// Loads a scene with its environment and builds the acceleration structure, on the current rayon pool. The AOV `velocity`
    /// in the request prepares it for later ones.
    ///
    /// # Errors
    /// Those of the import and of the build, and [`Error::Host`] if memory does not suffice.
    pub fn load(request: RenderRequest) -> Result<Self> {
        let (inputs, mut paths) = (Inputs::read(&request)?, Paths::default());
        request.declare_inputs("", &mut paths)?;
        inputs.declare(&mut paths)?;
        session(&request, &inputs).check_memory()?;
        let mut loaded = Loaded::load(&request, &inputs, &|_, _| true)?;
        if !loaded.prepared.scene.cameras.iter().any(|camera| camera.name == Framing::NAME) {
            // Every scene has the view that shows all of it.
            let mut scene = Scene::clone(&loaded.prepared.scene);
            scene.frame();
            if let Some(framed) = scene.cameras.pop() {
                loaded.prepared = loaded.prepared.with_camera(framed);
            }
        }
        let (inputs, paths, loaded) = (inputs.into(), paths.into(), loaded.into());
        Ok(Self { request, inputs, paths, loaded, placed: Vec::new() })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.loaded.prepared.scene
    }

    /// Its cameras: the file's, the view that shows the whole scene (`framed`), and those that were added.
    pub fn cameras(&self) -> Vec<CameraInfo> {
        self.scene().cameras.iter().map(|camera| CameraInfo::of(camera, self.scene().origin)).collect()
    }

    /// Adds a camera and returns its index. Nothing else of the scene is copied.
    ///
    /// # Errors
    /// [`Error::Usage`] for a matrix that is no rotation and translation, a field of view out of range, or a name that is
    /// taken.
    pub fn add_camera(&mut self, placed: &PlacedCamera) -> Result<usize> {
        let camera = placed.camera_in(self.scene(), 1.0)?;
        let cameras = &self.scene().cameras;
        if cameras.iter().any(|other| other.name == camera.name) {
            return Err(Error::Usage(format!("camera '{}': there is another camera of this name", camera.name)));
        }
        let index = cameras.len();
        self.placed.push((index, placed.clone()));
        self.loaded = Arc::new(Loaded { prepared: self.loaded.prepared.with_camera(camera), ..*self.loaded });
        Ok(index)
    }

    /// What the file contains, and what is approximated, ignored or not loaded. Reads the file again.
    ///
    /// # Errors
    /// Those of [`import::import`].
    pub fn inspect(&self) -> Result<Summary> {
        let RenderRequest { scene, selection, .. } = &self.request;
        Ok(import::summary(&import::import(scene, &selection.options(false, false))?))
    }

    /// Renders a picture on the current rayon pool, of a request for this scene. It ends within a tile's time after `stop` is
    /// raised, with what there is.
    ///
    /// # Errors
    /// [`Error::Usage`] for a request that is wrong, for another scene, or ends the render before its first path;
    /// [`Error::Interrupted`] if `stop` does; [`Error::Host`] if memory does not suffice or there is no denoiser.
    pub fn render(
        &self,
        request: RenderRequest,
        stop: &AtomicBool,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<RenderedPicture> {
        self.render_with(request, &|scene, settings, began| {
            run(scene, settings, RunOptions { began, ..RunOptions::new(stop, progress) })
        })
    }

    /// Renders with `passes`, which is given the scene, the settings and when the render began.
    fn render_with(
        &self,
        mut request: RenderRequest,
        passes: &dyn Fn(&PreparedScene, &RenderSettings, Instant) -> Result<Rendered>,
    ) -> Result<RenderedPicture> {
        let began = Instant::now();
        // A view and its AOVs may be others.
        let of_scene = |r: &RenderRequest| RenderRequest { camera: None, aov: Vec::new(), ..r.clone() }.scene_key();
        if of_scene(&request) != of_scene(&self.request) {
            return Err(Error::Usage("the request is for another scene than the one in memory".into()));
        }
        if request.has_velocities() && !self.request.has_velocities() {
            return Err(Error::Usage("the AOV velocity: load the scene with velocity".into()));
        }
        let with_view = self.loaded.placed(&request)?.map(Arc::new);
        let loaded = with_view.unwrap_or_else(|| Arc::clone(&self.loaded));
        let settings = settings(&request, &loaded.prepared.scene)?;
        lens(&loaded.prepared, &settings)?;
        request.placed =
            self.placed.iter().find(|(index, _)| *index == settings.camera).map(|(_, placed)| placed.clone());
        session(&request, &self.inputs).check_memory()?;
        if request.denoise.is_some() {
            Denoiser::load()?;
        }
        let identity = self.inputs.identity(&request, &settings);
        let rendered = passes(&loaded.prepared, &settings, began)?;
        let seconds =
            Seconds { render: rendered.stats.render_seconds, total: began.elapsed().as_secs_f64(), ..loaded.seconds() };
        let picture = RenderedPicture {
            request,
            inputs: Arc::clone(&self.inputs),
            paths: Arc::clone(&self.paths),
            loaded,
            identity,
            rendered,
            seconds,
            threads: rayon::current_num_threads(),
            denoised: OnceLock::new(),
            has_own_heuristic: false,
        };
        match (picture.rendered.paths_range(), picture.is_interrupted()) {
            ((_, 0), true) => Err(Error::Interrupted("interrupted before the first path".into())),
            ((_, 0), false) => Err(Error::Usage("time ended before the first path; give it more time".into())),
            _ => Ok(picture),
        }
    }
}

/// Projection of a [`CameraInfo`].
const PERSPECTIVE: &str = "perspective";

impl CameraInfo {
    fn of(camera: &Camera, origin: glam::DVec3) -> Self {
        let (projection, vertical) = match camera.projection {
            Projection::Perspective { yfov } => (PERSPECTIVE, f64::from(yfov).to_degrees()),
            Projection::Orthographic { ymag, .. } => ("orthographic", f64::from(ymag)),
            Projection::Panorama => ("panorama", 180.0),
            Projection::Calibrated(of) => of.described(),
        };
        let calibration = if let Projection::Calibrated(of) = camera.projection { Some(of) } else { None };
        let mut to_world = glam::Mat4::from(camera.to_world).transpose().as_dmat4().to_cols_array_2d();
        to_world.iter_mut().zip(origin.to_array()).for_each(|(row, origin)| row[3] += origin);
        let aspect = camera.aspect.map(f64::from);
        Self { name: camera.name.clone(), projection, vertical, aspect, to_world, calibration }
    }
}

/// Values of some channels of a picture, row by row, all channels of a pixel together.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Floats.
    Floats(Vec<f32>),
    /// Whole numbers: ids and counts.
    Uints(Vec<u32>),
}

/// A rendered picture in memory. It keeps its scene in memory.
pub struct RenderedPicture {
    request: RenderRequest,
    inputs: Arc<Inputs>,
    paths: Arc<Paths>,
    loaded: Arc<Loaded>,
    identity: Identity,
    rendered: Rendered,
    seconds: Seconds,
    threads: usize,
    denoised: OnceLock<Vec<(String, Vec<[f32; 3]>)>>,
    /// Its light shares are by no method of `--balance`, so no file can say how it was made.
    has_own_heuristic: bool,
}

impl RenderedPicture {
    /// Was the render stopped before it was complete?
    pub fn is_interrupted(&self) -> bool {
        self.rendered.stop == StopReason::Interrupted
    }

    /// Width and height of the window in pixels.
    pub fn size(&self) -> [usize; 2] {
        let [x0, y0, x1, y1] = self.rendered.settings.window();
        [(x1 - x0) as usize, (y1 - y0) as usize]
    }

    /// Names for [`Self::layer`]: `beauty` and the AOVs.
    pub fn layers(&self) -> Vec<&'static str> {
        ["beauty"].into_iter().chain(self.request.aovs().iter().map(|aov| aov.name())).collect()
    }

    /// A layer's channels, named as in the file without the layer, and their values.
    ///
    /// # Errors
    /// [`Error::Usage`] for a layer that was not rendered.
    pub fn layer(&self, name: &str) -> Result<(Vec<String>, Values)> {
        let (settings, pixels) = (&self.rendered.settings, self.rendered.pixels());
        let channels = if name == "beauty" {
            beauty(self.rendered.background)
        } else {
            let aovs = self.request.aovs().into_iter();
            let channels = aovs.flat_map(|aov| {
                let whole = aov.name() == name;
                let mut channels = aov.channels(settings.aovs, settings.extras, pixels.light_groups());
                channels.retain(|c| whole || c.name.rsplit_once('.').is_some_and(|(layer, _)| layer == name));
                channels
            });
            channels.collect()
        };
        if channels.is_empty() {
            let have = self.layers().join(", ");
            return Err(Error::Usage(format!("there is no layer '{name}'; there are {have}")));
        }
        let names = channels.iter().map(|c| c.name.rsplit('.').next().unwrap_or(&c.name).to_owned()).collect();
        Ok((names, values(&pixels, &channels)))
    }

    /// Statistics, as `bismar render --stats` writes them.
    pub fn stats(&self) -> Stats {
        let (scene, backend) = (&self.loaded.prepared.scene, self.loaded.prepared.rays.info());
        let mut stats = Stats::new(&self.request.scene, scene, backend, self.threads, &self.rendered, self.seconds);
        stats.exposure = Exposure::Auto.of(colors(&self.rendered.pixels()));
        stats
    }

    /// Camera to world of the view, row by row, and its vertical field of view in radians; `None` for an orthographic one.
    pub fn view(&self) -> ([[f64; 4]; 4], Option<f64>) {
        let settings = &self.rendered.settings;
        let scene = &self.loaded.prepared.scene;
        let view = scene.camera(settings.camera, settings.width, settings.height);
        let info = CameraInfo::of(&view, scene.origin);
        (info.to_world, (info.projection == PERSPECTIVE).then(|| info.vertical.to_radians()))
    }

    /// The denoised beauty, or a denoised layer of lights (`light_NAME`), linear RGB row by row; computed once.
    ///
    /// # Errors
    /// [`Error::Usage`] if the sums that guide the denoiser were not taken, and for other layers; those of the denoiser.
    pub fn denoised(&self, layer: &str) -> Result<&[[f32; 3]]> {
        if !self.rendered.settings.extras {
            return Err(Error::Usage(
                "this picture has no guides for the denoiser: render it with denoise, or with the AOV guide-albedo"
                    .into(),
            ));
        }
        let name = layer.replacen("beauty", DENOISED, 1).replacen("light_", "denoised_", 1);
        let layers = match self.denoised.get() {
            Some(done) => done,
            None => {
                let denoiser = Denoiser::load()?;
                let layers = denoised_layers(&self.rendered.pixels(), |noisy| denoiser.denoise(noisy))?;
                self.denoised.get_or_init(|| layers)
            }
        };
        let found = layers.iter().find(|(own, _)| *own == name).map(|(_, colors)| &colors[..]);
        found.ok_or_else(|| Error::Usage(format!("'{layer}' is not denoised: beauty is, and layers of lights")))
    }

    /// Writes the picture: `.exr` with all its layers; `.png`, `.jpg` or `.webp` through a view transform. `resumable` also
    /// stores the statistics from which it can be continued (`bismar render --resume`) and merged. `half` stores colours as 16-bit
    /// floats, `colorspace` in these primaries.
    ///
    /// # Errors
    /// [`Error::Usage`] for another ending, those of writing files.
    pub fn save(
        &self,
        path: &Path,
        (view, exposure): (ViewOptions, Exposure),
        resumable: bool,
        (half, colorspace): (bool, ColorSpace),
    ) -> Result<()> {
        let mut paths = Paths::clone(&self.paths);
        let mut request = self.request.clone();
        request.output = path.into();
        (request.view, request.exposure) = (view, exposure);
        request.declare_inputs("", &mut paths)?;
        paths.writes("the picture", path)?;
        let ending = path.extension().map(|ending| ending.to_ascii_lowercase()).unwrap_or_default();
        match ending.to_str() {
            Some("exr") if self.has_own_heuristic => Err(Error::Usage(format!(
                "{}: a picture by a heuristic of one's own cannot be saved as EXR, whose header would have to say how it was \
                 made: save its arrays",
                path.display()
            ))),
            Some("exr") => {
                let _claim = claim_output(path)?;
                (request.half, request.colorspace) = (half, colorspace);
                let Self { inputs, loaded, identity, rendered, .. } = self;
                let with_statistics = resumable || self.is_interrupted();
                let writer = OutputWriter::new(&request, inputs, loaded, self.threads, identity, resumable)?;
                writer.write_final(rendered, with_statistics, Instant::now(), &AtomicBool::new(false)).map(drop)
            }
            Some(_) if preview::has_ending(path) => {
                let _claim = claim_output(path)?;
                let exposure = request.exposure.of(colors(&self.rendered.pixels()));
                let view = request.view.transform()?;
                let mark = preview_mark(&request, &view, &self.inputs, self.rendered.stats.paths);
                let look = Look { view, exposure };
                if request.denoise.is_none() {
                    return preview::write(path, &self.rendered.pixels(), &look, &mark);
                }
                let picture = FilmPicture { rgb: self.denoised("beauty")?.to_vec(), ..self.picture() };
                let opaque = self.rendered.background != Background::Transparent;
                preview::write_picture(path, &picture, opaque, &look, &mark)
            }
            _ => Err(Error::Usage(format!("{}: the name must end in .exr, .png, .jpg or .webp", path.display()))),
        }
    }

    /// The beauty as an opaque PNG, denoised if that was asked for, with the view AgX and the automatic exposure.
    ///
    /// # Errors
    /// Those of [`Self::denoised`] and of the encoder.
    pub fn png(&self) -> Result<Vec<u8>> {
        let exposure = Exposure::Auto.of(colors(&self.rendered.pixels()));
        let mut picture = self.picture();
        if self.request.denoise.is_some() {
            picture.rgb = self.denoised("beauty")?.to_vec();
        }
        preview::encoded_picture(&picture, &Look { view: View::Agx.into(), exposure })
    }

    /// The beauty as a picture that can be compared.
    pub fn picture(&self) -> FilmPicture {
        let pixels = self.rendered.pixels();
        let ([width, height], [x0, y0, x1, y1]) = (pixels.size(), pixels.window());
        let each = || (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
        let with_variance = self.layers().contains(&"variance");
        let beauty = beauty(self.rendered.background);
        let alpha = beauty.get(3).map(|channel| each().map(|(x, y)| channel.float(&pixels, x, y)).collect());
        FilmPicture {
            window: [x0, y0, x1, y1].map(i64::from),
            display: [0, 0, width, height].map(i64::from),
            rgb: colors(&pixels).1.collect(),
            variance: with_variance.then(|| each().map(|(x, y)| pixels.at(x, y).0.variance_of_mean()).collect()),
            alpha,
            displayed: false,
            mean_variance: self.rendered.mean_variance().map_or([1.0; 3], |of| of.over_independent),
        }
    }
}

/// The values of channels, row by row. Channels of one layer are all floats or all whole numbers.
fn values(pixels: &dyn Pixels, channels: &[Channel]) -> Values {
    let [x0, y0, x1, y1] = pixels.window();
    let positions = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
    let count = (x1 - x0) as usize * (y1 - y0) as usize * channels.len();
    if channels.iter().all(|c| matches!(c.value, Value::Uint(_))) {
        let mut values = Vec::with_capacity(count);
        for (x, y) in positions {
            let (stats, sums) = pixels.at(x, y);
            values.extend(channels.iter().filter_map(|c| match c.value {
                Value::Uint(of) => Some(of(&stats, &sums)),
                _ => None,
            }));
        }
        return Values::Uints(values);
    }
    let mut values = Vec::with_capacity(count);
    for (x, y) in positions {
        values.extend(channels.iter().map(|channel| channel.float(pixels, x, y)));
    }
    Values::Floats(values)
}

/// Compares a picture A with a reference B, cropped to their common window ([`crate::film::compare`]).
///
/// # Errors
/// [`Error::Data`] if they show different windows.
pub fn compare(a: &FilmPicture, b: &FilmPicture) -> Result<Comparison> {
    in_common(a, b).and_then(|(a, b)| compare_pictures(&a, &b)).map_err(Error::Data)
}

fn session<'a>(request: &'a RenderRequest, inputs: &'a Inputs) -> Session<'a> {
    Session { request, inputs, threads: rayon::current_num_threads(), began: Instant::now(), replaces: false }
}
