//! The contents that a command names, hashed without loading the scene.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use crate::console::Paths;
use crate::render::identity::{EnvironmentSource, scene_text};
use crate::render::{Identity, RenderSettings};
use crate::scene::import::{EnvironmentFile, SceneFiles, Survey};
use crate::{Error, Result};

use super::RenderArgs;

/// The contents that a command names, opened once.
#[derive(Debug)]
pub struct Inputs {
    /// The scene's files.
    pub scene: Survey,
    /// Of the environment: what tells it from others, and its bytes in memory.
    pub environment: (String, u64),
    /// What opening, hashing and measuring took.
    pub read_seconds: f64,
    /// The files themselves, until the last scene is made of them.
    files: Mutex<Option<Files>>,
}

/// The files of a scene and of its environment.
#[derive(Debug, Clone)]
pub struct Files {
    pub scene: Arc<SceneFiles>,
    pub environment: Option<Arc<EnvironmentFile>>,
}

impl Inputs {
    /// Reads and hashes them.
    ///
    /// # Errors
    /// As [`SceneFiles::open`] and [`EnvironmentFile::open`].
    pub fn read(args: &RenderArgs) -> Result<Self> {
        let start = Instant::now();
        let environment_file = args.env.as_deref().map(EnvironmentFile::open).transpose()?;
        let (degrees, strength) = (args.env_rotate, args.env_strength);
        let source = match &environment_file {
            Some(file) => EnvironmentSource::File { hash: file.hash(), degrees, strength },
            None if args.no_env => EnvironmentSource::Off,
            None if args.sky => EnvironmentSource::White { strength },
            None => EnvironmentSource::Scene,
        };
        let environment = (source.text(), environment_file.as_ref().map_or(0, |file| file.memory_bytes()));
        let scene_files = SceneFiles::open(&args.scene)?;
        let scene = scene_files.survey();
        let (scene_files, environment_file) = (Arc::new(scene_files), environment_file.map(Arc::new));
        let files = Mutex::new(Some(Files { scene: scene_files, environment: environment_file }));
        Ok(Self { scene, environment, read_seconds: start.elapsed().as_secs_f64(), files })
    }

    /// Adds the files that the scene names to a run's.
    ///
    /// # Errors
    /// As [`Paths::reads`].
    pub fn declare(&self, paths: &mut Paths) -> Result<()> {
        self.scene.files.iter().try_for_each(|file| paths.reads("the scene's", file))
    }

    /// The files, for one of several scenes that are made of them.
    ///
    /// # Errors
    /// As [`Inputs::take`].
    pub fn lend(&self, args: &RenderArgs) -> Result<Files> {
        let files = self.take(args)?;
        *self.files.lock().unwrap_or_else(PoisonError::into_inner) = Some(files.clone());
        Ok(files)
    }

    /// Hands the files over. Opens them again when an earlier job of a batch had them and failed.
    ///
    /// # Errors
    /// As [`Inputs::read`]; [`Error::Data`] if they are others by now.
    pub fn take(&self, args: &RenderArgs) -> Result<Files> {
        let take = |inputs: &Self| inputs.files.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(files) = take(self) {
            return Ok(files);
        }
        let again = Self::read(args)?;
        take(&again)
            .filter(|_| (&again.scene.hash, &again.environment.0) == (&self.scene.hash, &self.environment.0))
            .ok_or_else(|| {
                Error::Data(format!(
                    "{}: has changed while it was waited for; run the command again",
                    args.scene.display()
                ))
            })
    }

    /// What a render of these settings is made of.
    pub fn identity(&self, args: &RenderArgs, settings: &RenderSettings) -> Identity {
        Identity::new(&scene_text(&self.scene.hash, &args.choices()), &self.environment.0, args.rays, settings)
    }
}
