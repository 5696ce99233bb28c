//! glTF 2.0 and environment pictures into [`Scene`].
//!
//! Three rooms, one way: `source` (files, opened once) → `document` (parsed and checked) → `build` (accessors to
//! meshes, textures, nodes, lights, cameras). The file is not trusted: everything that an index, offset or count could
//! break is checked before it is used (`document`), file names stay under the scene's folder (`source`), and memory
//! stays in proportion to the file (`build`). What the shown scene does not need is checked, but not kept; the report
//! says so.

mod build;
mod complaint;
mod document;
mod environment;
mod report;
mod source;
mod summary;

use std::path::Path;
use std::time::Instant;

use serde_json::Value;

pub use environment::{EnvironmentFile, environment};
pub use report::{ImportReport, Note, NoteKind, SceneCounts};
pub use source::Survey;
pub use summary::{Summary, summary};

use report::Notes;

use super::Scene;
use crate::error::{Error, Result};

/// What to import, and how strictly.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Whatever would be approximated or ignored (also a missing texture) is an error that names it.
    pub strict: bool,
    /// A time sample of its animations; else the pose that its nodes and weights have.
    pub pose: Option<Pose>,
    /// The document's scene, by name or index; else the one that it shows by default.
    pub scene: Option<String>,
    /// The material variant (KHR_materials_variants), by name; else the default materials.
    pub variant: Option<String>,
}

/// A time sample of a document's animations.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Since their beginning; before the first key of a channel and after its last one it stands still.
    pub seconds: f64,
    /// By name or index; `None` or `all` for all of them at once, as viewers play them.
    pub animation: Option<String>,
    /// How long light is let in around it; else it is a time sample.
    pub shutter: Option<Shutter>,
    /// Seconds to the frames before and after, for velocities; `None` if nobody asks for them.
    pub frame: Option<f64>,
}

/// For how long a camera's shutter is open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Seconds from the pose's to its opening, of either sign.
    pub opens: f64,
    /// To its closing, > `opens`.
    pub closes: f64,
    /// Into how many steps motion is cut, at most [`MOST_STEPS`](super::motion::MOST_STEPS); `None`: as many as it bends.
    pub steps: Option<u32>,
}

/// A scene, and what was done to get it.
#[derive(Debug)]
pub struct Imported {
    /// Ready to be rendered; has at least one camera. Without an environment.
    pub scene: Scene,
    /// What was used, approximated, ignored and not loaded.
    pub report: ImportReport,
}

/// A `.gltf` or `.glb` file and the files that it names, opened once and in memory.
#[derive(Debug)]
pub struct SceneFiles {
    source: source::Source,
    /// What imports of them share.
    kept: build::Kept,
}

impl SceneFiles {
    /// Reads the files; what is wrong with those that the document names is left for [`Self::import`] to say.
    ///
    /// # Errors
    /// [`Error::Data`] (exit code 65) for a file that is no glTF; [`Error::Missing`] (66), [`Error::Permission`] and
    /// [`Error::Io`] as the system says.
    pub fn open(path: &Path) -> Result<Self> {
        Ok(Self { source: source::Source::open(path)?, kept: build::Kept::default() })
    }

    /// Hashes and measures the files without decoding them.
    pub fn survey(&self) -> Survey {
        self.source.survey()
    }

    /// Makes the scene. Again, at another time sample, it takes what has not moved and the decoded pictures from the last time.
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
            let mut notes = Notes::default();
            let parse = |json: &Value| document::Document::parse(source, json, options, &mut Notes::default());
            let (json, bytes) = (&source.json, source.file_bytes);
            let (mut posed, mut time_samples, mut adjacent_frames) = (None, Vec::new(), Vec::new());
            if let Some(pose) = &options.pose {
                let at_rest = parse(json)?;
                // What stands still stands as while the shutter is open.
                let aside = pose.shutter.map_or(0.0, |shutter| 0.0_f64.clamp(shutter.opens, shutter.closes));
                let own = Pose { seconds: pose.seconds + aside, ..pose.clone() };
                posed = Some(build::posed(&at_rest, json, bytes, &own, &mut notes)?);
                let time_sample =
                    |seconds: f64| build::time_sample(&at_rest, json, bytes, &Pose { seconds, ..pose.clone() }, &parse);
                time_samples = build::time_samples(pose, &time_sample)?;
                let frames = pose.frame.into_iter().flat_map(|frame| [pose.seconds - frame, pose.seconds + frame]);
                adjacent_frames = frames.map(time_sample).collect::<Result<Vec<_>>>()?;
            }
            let document = document::Document::parse(source, posed.as_ref().unwrap_or(json), options, &mut notes)?;
            report.generator.clone_from(&document.generator);
            let open = time_samples.len();
            time_samples.extend(adjacent_frames);
            let shown = build::Shown { document: &document, posed: posed.is_some(), time_samples: &time_samples, open };
            let scene = build::build(&shown, bytes, &self.kept, notes, &mut report)?;
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
/// As [`SceneFiles::open`] and [`SceneFiles::import`].
pub fn import(path: &Path, options: &ImportOptions) -> Result<Imported> {
    let start = Instant::now();
    let mut imported = SceneFiles::open(path)?.import(options)?;
    imported.report.read_seconds = start.elapsed().as_secs_f64();
    Ok(imported)
}

/// Puts the scene file's name before a complaint.
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
