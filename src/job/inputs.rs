//! The input files of a command, opened and hashed without loading the scene.

use std::collections::HashMap;
use std::io::Read;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use super::memory;
use super::request::RenderRequest;
use crate::console::Paths;
use crate::render::prepass::default_light::OwnLight;
use crate::render::{Identity, RenderSettings};
use crate::scene::import::{EnvironmentFile, EnvironmentSize, SceneFiles, Survey};
use crate::{Error, Result};

/// The input files of a command, opened once.
#[derive(Debug)]
pub struct Inputs {
    /// The scene's files.
    pub scene: Survey,
    /// Text that identifies the environment, and the size of its picture if it has one.
    pub environment: (String, Option<EnvironmentSize>),
    /// Wall seconds of opening and hashing.
    pub read_seconds: f64,
    /// The open files, until the last scene has been made of them.
    files: Mutex<Option<Files>>,
    /// What the scene's own light does, by camera and import choices.
    own_light: Mutex<HashMap<String, OwnLight>>,
}

/// The files of a scene and of its environment.
#[derive(Debug, Clone)]
pub struct Files {
    /// Those of the scene.
    pub scene: Arc<SceneFiles>,
    /// The environment map, if there is one.
    pub environment: Option<Arc<EnvironmentFile>>,
}

impl Inputs {
    /// Opens and hashes the files.
    ///
    /// # Errors
    /// Those of [`SceneFiles::open`] and [`EnvironmentFile::open`].
    pub fn read(request: &RenderRequest) -> Result<Self> {
        Self::of(request, || SceneFiles::open(&request.scene))
    }

    /// The same with a scene that is read from a pipe.
    pub(crate) fn read_pipe(request: &RenderRequest, pipe: &mut dyn Read) -> Result<Self> {
        Self::of(request, || SceneFiles::read_glb(pipe, memory::limit(request.memory_limit)?.0))
    }

    fn of(request: &RenderRequest, open: impl FnOnce() -> Result<SceneFiles>) -> Result<Self> {
        let start = Instant::now();
        let environment_file = request.env.as_deref().map(EnvironmentFile::open).transpose()?;
        let scene_files = open()?;
        let scene = scene_files.survey();
        let (degrees, strength) = (request.env_rotate, request.env_strength);
        let source = match &environment_file {
            Some(file) => format!("{} turned {degrees} times {strength}", file.hash()),
            None if request.no_env => "none".into(),
            None if request.sky => format!("white times {strength}"),
            None if request.sunsky.is_some() => format!("{:?} times {strength}", request.sunsky),
            // The default light is added where they do not light what the camera sees.
            None if scene.has_lights => "the scene's own, or studio".into(),
            None => "the scene's own".into(),
        };
        let environment = (source, environment_file.as_ref().map(EnvironmentFile::size));
        let (scene_files, environment_file) = (Arc::new(scene_files), environment_file.map(Arc::new));
        let files = Mutex::new(Some(Files { scene: scene_files, environment: environment_file }));
        let read_seconds = start.elapsed().as_secs_f64();
        Ok(Self { scene, environment, read_seconds, files, own_light: Mutex::default() })
    }

    /// Declares the files that the scene names, such as buffers and images.
    pub(crate) fn declare(&self, paths: &mut Paths) -> Result<()> {
        self.scene.files.iter().try_for_each(|file| paths.reads("the scene's", file))
    }

    /// The files, for a scene that is not the last one made of them.
    ///
    /// # Errors
    /// Those of [`Inputs::take`].
    pub fn lend(&self, request: &RenderRequest) -> Result<Files> {
        let files = self.take(request)?;
        *self.files.lock().unwrap_or_else(PoisonError::into_inner) = Some(files.clone());
        Ok(files)
    }

    /// The files, for the last scene made of them. Opens them again if an earlier job of a batch took them and failed.
    ///
    /// # Errors
    /// Those of [`Inputs::read`]; [`Error::Data`] if the files have changed.
    pub fn take(&self, request: &RenderRequest) -> Result<Files> {
        let take = |inputs: &Self| inputs.files.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(files) = take(self) {
            return Ok(files);
        }
        let again = Self::read(request)?;
        take(&again)
            .filter(|_| (&again.scene.hash, &again.environment.0) == (&self.scene.hash, &self.environment.0))
            .ok_or_else(|| {
                Error::Data(format!("{}: has changed since the command began; run it again", request.scene.display()))
            })
    }

    /// What the scene's own light does, measured once for all frames of a view.
    ///
    /// # Errors
    /// Those of `measure`.
    pub fn own_light(&self, request: &RenderRequest, measure: impl FnOnce() -> Result<OwnLight>) -> Result<OwnLight> {
        let selection = request.selection.at_rest();
        let key = format!(
            "{:?} {} {:?} {:?} {:?} {:?} {}",
            request.camera,
            selection.name(),
            request.light_unit,
            request.light_radius,
            request.sun_angle,
            request.back_faces,
            request.no_clip
        );
        let known = || self.own_light.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known().get(&key) {
            return Ok(*found);
        }
        let found = measure()?;
        known().insert(key, found);
        Ok(found)
    }

    /// Identity of a render with these settings: what its pixels depend on.
    pub fn identity(&self, request: &RenderRequest, settings: &RenderSettings) -> Identity {
        let scene = format!("{}{}{}", self.scene.hash, request.import_choices(), request.view_text());
        Identity::new(&scene, &self.environment.0, request.rays, settings)
    }
}
