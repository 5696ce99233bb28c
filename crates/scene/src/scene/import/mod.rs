//! glTF 2.0 and environment pictures into [`Scene`].
//!
//! Three rooms, one way: `source` (files, opened once) → `document` (parsed and checked) → `build` (accessors to
//! meshes, textures, nodes, lights, cameras). The file is not trusted: everything that an index, offset or count could
//! break is checked before it is used (`document`), file names stay under the scene's folder (`source`), and memory
//! stays in proportion to the file (`build`). Elements that the shown scene does not need are checked but not kept; the
//! report lists them.

mod build;
mod complaint;
mod document;
mod environment;
mod options;
mod report;
mod source;
mod summary;

use std::io::Read;
use std::path::Path;
use std::time::Instant;

pub use environment::{EnvironmentFile, EnvironmentSize, environment};
pub use options::{ImportOptions, Pose, Shutter};
pub use report::{ImportReport, Note, NoteKind, SceneCounts};
pub use source::{Census, STANDARD_INPUT, Survey, read_own, read_regular, read_text};
pub use summary::{Summary, summary};

use report::Notes;

use super::Scene;
use crate::error::{Error, Result};

/// An imported scene with its report.
#[derive(Debug)]
pub struct Imported {
    /// The scene, ready to be rendered: with at least one camera, without an environment.
    pub scene: Scene,
    /// Report of what was used, approximated, ignored and not loaded.
    pub report: ImportReport,
}

/// A `.gltf` or `.glb` file and the files that it refers to, opened once and held in memory.
#[derive(Debug)]
pub struct SceneFiles {
    source: source::Source,
    /// Results that later imports reuse.
    cache: build::ImportCache,
}

impl SceneFiles {
    /// Reads the files. Faults of files that the document refers to are reported by [`Self::import`].
    ///
    /// # Errors
    /// [`Error::Data`] (exit code 65) for a file that is not glTF; [`Error::Missing`] (66), [`Error::Permission`] and
    /// [`Error::Io`] as the system says.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self { source: source::Source::open(path)?, cache: build::ImportCache::default() })
    }

    /// Reads a GLB of at most `limit` bytes from a pipe. It names no other file. Messages call it [`STANDARD_INPUT`].
    ///
    /// # Errors
    /// [`Error::Data`] for anything but a GLB, also one that ends early; [`Error::Host`] for one beyond the limit;
    /// [`Error::Io`].
    pub fn read_glb(reader: &mut dyn Read, limit: u64) -> Result<Self> {
        Ok(Self { source: source::Source::read_glb(reader, limit)?, cache: build::ImportCache::default() })
    }

    /// Hashes and measures the files without decoding them.
    pub fn survey(&self) -> Survey {
        self.source.survey()
    }

    /// Builds the scene. A later import at another time reuses decoded pictures and meshes that have not changed.
    ///
    /// # Errors
    /// [`Error::Data`] (exit code 65) for a file that breaks the specification, requires an unknown extension, names
    /// files outside of its folder, or asks for memory out of proportion; [`Error::Missing`] (66) when a buffer is not
    /// there (a picture that is not is left out, with a note); [`Error::Permission`] and [`Error::Io`] as the system says.
    /// Texts name the file and the JSON path. [`Error::Usage`] (64) for a scene or variant that is not there, with those
    /// that are.
    pub fn import(&self, options: &ImportOptions) -> Result<Imported> {
        let start = Instant::now();
        let source = &self.source;
        let mut report = ImportReport {
            file: source.path.display().to_string(),
            file_bytes: source.file_bytes,
            ..Default::default()
        };
        let mut build = || -> Result<Scene> {
            let (mut notes, json, bytes) = (Notes::default(), &source.json, source.file_bytes);
            let mut document = document::Document::parse(source, json, options, &mut notes)?;
            document.origin = build::origin(&document);
            let pose = options.pose.as_ref();
            let times = pose.map(|pose| build::play(&mut document, json, bytes, pose, &mut notes)).transpose()?;
            report.generator.clone_from(&document.generator);
            let shown = build::ShownDocument {
                document: &document,
                posed: pose.map(|pose| (json, pose)),
                times: &times.unwrap_or_default(),
            };
            let scene = build::build(&shown, bytes, &self.cache, notes, &mut report)?;
            if options.strict {
                report.refuse_if_inexact()?;
            }
            Ok(scene)
        };
        let scene = build().map_err(|error| in_file(&source.path, error))?;
        report.read_seconds = start.elapsed().as_secs_f64();
        Ok(Imported { scene, report })
    }
}

/// Opens and imports a file.
///
/// # Errors
/// See [`SceneFiles::open`] and [`SceneFiles::import`].
pub fn import(path: &Path, options: &ImportOptions) -> Result<Imported> {
    let start = Instant::now();
    let mut imported = SceneFiles::open(path)?.import(options)?;
    imported.report.read_seconds = start.elapsed().as_secs_f64();
    Ok(imported)
}

/// Prefixes an error with the scene file's path.
fn in_file(path: &Path, error: Error) -> Error {
    let name = |text: String| format!("{}: {text}", path.display());
    match error {
        Error::Data(text) => Error::Data(name(text)),
        Error::Missing(text) => Error::Missing(name(text)),
        Error::Permission(text) => Error::Permission(name(text)),
        Error::Io(text) => Error::Io(name(text)),
        other => other,
    }
}
