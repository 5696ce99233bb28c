//! The scene of a command in memory, with its acceleration structure.

use std::sync::Arc;
use std::time::Instant;

use tracing::{debug, info, warn};

use super::inputs::Inputs;
use super::memory;
use super::request::RenderRequest;
use super::scene::{make_scene, scene_at_rest};
use super::settings::{self, DEFAULT_SIZE};
use super::stats::Seconds;
use crate::integrator::PreparedScene;
use crate::light::AreaLights;
use crate::render::prepass::default_light::{self, OwnLight};
use crate::scene::import::SceneFiles;
use crate::scene::{Deformation, Scene};
use crate::{Result, rays};

/// A scene that is ready to render.
pub struct Loaded {
    /// The scene, with its rays, materials and lights.
    pub prepared: PreparedScene<'static>,
    /// Wall seconds of reading the files.
    pub read_seconds: f64,
    /// Wall seconds of building the acceleration structure.
    pub build_seconds: f64,
    /// Seconds from then on until all is ready.
    pub prepare_seconds: f64,
}

/// Progress of a build: receives the fraction done, in [0, 1], and the wall seconds so far; false stops the build.
pub type Building<'a> = &'a (dyn Fn(f64, f64) -> bool + Sync);

impl Loaded {
    /// The seconds so far.
    pub fn seconds(&self) -> Seconds {
        let Self { read_seconds: read, build_seconds: build, prepare_seconds: prepare, .. } = *self;
        Seconds { read, build, prepare, ..Default::default() }
    }

    /// Imports scene and environment, closes their files, and builds the acceleration structure.
    ///
    /// # Errors
    /// Those of the import and of the build; [`Error::Interrupted`](crate::Error::Interrupted) if `building` returns false.
    pub fn load(request: &RenderRequest, inputs: &Inputs, building: Building) -> Result<Self> {
        Self::load_next(request, inputs, None, false, building)
    }

    /// Loads one of several scenes made of the same files. `more`: others will follow. `previous`: the one before, whose
    /// unchanged parts are reused.
    pub(crate) fn load_next(
        request: &RenderRequest,
        inputs: &Inputs,
        previous: Option<Arc<Self>>,
        more: bool,
        building: Building,
    ) -> Result<Self> {
        let files = if more { inputs.lend(request) } else { inputs.take(request) }?;
        let start = Instant::now();
        let at_rest = request.selection.is_posed().then(|| Arc::clone(&files.scene));
        let scene = Arc::new(make_scene(request, files)?);
        let read_seconds = inputs.read_seconds + start.elapsed().as_secs_f64();
        info!("read {} in {read_seconds:.2} s", request.scene.display());
        check_instances_memory(request, inputs, &scene)?;
        debug!(
            "{} objects, {} instances, {} triangles in memory, {} materials, {} textures, {} punctual lights, {} cameras",
            scene.objects.len(),
            scene.instances.len(),
            scene.meshes.iter().map(|mesh| mesh.indices.len()).sum::<usize>(),
            scene.materials.len(),
            scene.textures.len(),
            scene.lights.len(),
            scene.cameras.len()
        );
        let built = Instant::now();
        let (rays, build_seconds) = match previous.as_ref().and_then(|previous| previous.prepared.rays_of(&scene)) {
            Some(rays) => {
                debug!("no geometry has moved: the acceleration structure is reused");
                (rays, 0.0)
            }
            None => {
                let rays = rays::build_watched(request.rays, Arc::clone(&scene), &|done| {
                    building(done, built.elapsed().as_secs_f64())
                })?;
                let (seconds, backend) = (built.elapsed().as_secs_f64(), rays.info());
                let mebibytes = backend.memory_bytes as f64 / 2_f64.powi(20);
                info!(
                    "built {} {} ({}): {seconds:.2} s, {mebibytes:.1} MiB",
                    backend.name, backend.version, backend.isa
                );
                (rays.into(), seconds)
            }
        };
        let prepared = PreparedScene::after(scene, rays, previous.as_ref().map(|previous| &previous.prepared));
        let prepared = with_light(request, inputs, at_rest.as_deref(), prepared)?;
        let prepare_seconds = built.elapsed().as_secs_f64() - build_seconds;
        debug!("prepared lights and materials: {prepare_seconds:.2} s");
        Ok(Self { prepared, read_seconds, build_seconds, prepare_seconds })
    }

    /// The same scene with the camera of `--orbit`, of a job of `--cameras` or of `--camera panorama` besides the file's;
    /// `None` without those flags.
    ///
    /// # Errors
    /// Those of [`PlacedCamera::camera`](crate::scene::PlacedCamera::camera).
    pub fn placed(&self, request: &RenderRequest) -> Result<Option<Self>> {
        let (width, height) = request.size.map_or(DEFAULT_SIZE, |size| (size.0, size.1));
        let aspect = f64::from(width) / f64::from(height);
        let camera = match (&request.placed, &request.orbit) {
            (Some(placed), _) => placed.camera_in(&self.prepared.scene, aspect)?,
            (None, Some(orbit)) => orbit.camera(&self.prepared.scene, aspect),
            (None, None) if settings::is_panorama(&self.prepared.scene.cameras, request) => {
                settings::panorama(&self.prepared.scene)
            }
            (None, None) => return Ok(None),
        };
        let prepared = self.prepared.with_camera(camera);
        Ok(Some(Self { prepared, ..*self }))
    }
}

/// Adds the default light to a scene whose own light does not light what the camera sees. A first pass decides: of the scene
/// at rest, with its camera at rest, if it is shown at a time (`at_rest` are then its files), so that all frames decide alike.
fn with_light<'a>(
    request: &RenderRequest,
    inputs: &Inputs,
    at_rest: Option<&SceneFiles>,
    prepared: PreparedScene<'a>,
) -> Result<PreparedScene<'a>> {
    if request.no_env || !default_light::is_in_question(&prepared.scene) {
        return Ok(prepared);
    }
    let start = Instant::now();
    let measured = |prepared: &PreparedScene| {
        let camera = settings::camera_of_file(&prepared.scene.cameras, request)?;
        Ok(default_light::own_light(prepared, camera, &request.settings()))
    };
    let found = inputs.own_light(request, || match at_rest {
        None => measured(&prepared),
        Some(files) => measured(&PreparedScene::build(Arc::new(scene_at_rest(request, files)?), request.rays)?),
    })?;
    let OwnLight { surfaces, lit, .. } = found;
    let name = request.scene.display();
    let text = format!("{name}: its own light reaches {lit} of {surfaces} pixels of its surfaces, by a first pass");
    if found.is_enough() {
        info!("{text} ({:.3} s): no light is added", start.elapsed().as_secs_f64());
        return Ok(prepared);
    }
    warn!("{text}: soft studio light is added (--env FILE or --sky replace it, --no-env renders without)");
    Ok(default_light::with_default_light(&prepared))
}

/// Fails if instances, area lights and motion need more memory than allowed, as counted once the scene is read: the number of
/// times at which motion is kept may have been chosen by its curvature.
fn check_instances_memory(request: &RenderRequest, inputs: &Inputs, scene: &Scene) -> Result<()> {
    let (lights, instances) = (AreaLights::count(scene), scene.instances.len() as u64);
    let deforming: usize = scene.meshes.iter().filter_map(|mesh| mesh.motion.as_ref()).map(Deformation::bytes).sum();
    let moving = scene.instances.iter().filter_map(|instance| instance.motion.as_ref());
    let keys: usize = moving.map(|motion| motion.keys().len()).sum();
    let placed = memory::placed_bytes(instances, keys as u64, lights) + deforming as u64;
    let what =
        format!("{} with {instances} instances and {lights} emissive triangles in them", request.scene.display());
    let bytes = memory::at_rest(rayon::current_num_threads()) + inputs.scene.image_bytes + placed;
    memory::check(&what, bytes, memory::limit(request.memory_limit)?)
}
