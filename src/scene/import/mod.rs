//! glTF 2.0 and environment pictures into [`Scene`].
//!
//! The file is not trusted: everything that an index, offset or count could break is checked before it is used
//! (`document`, `accessors`), file names stay under the scene's folder (`uri`), and memory stays in proportion to the
//! file (`accessors::Budget`). What the shown scene does not need is checked, but not kept; the report says so.

mod accessors;
mod assemble;
mod buffers;
mod cameras;
mod container;
mod document;
mod environment;
mod extensions;
mod geometry;
mod images;
mod json;
mod lights;
mod materials;
mod nodes;
mod primitives;
mod report;
mod skins;
mod summary;
mod survey;
mod tangents;
mod uri;

use std::path::Path;
use std::time::Instant;

pub use environment::environment;
pub use report::{Counts, ImportReport, Note, NoteKind};
pub use summary::{Summary, summary};
pub use survey::{Survey, survey, survey_environment};

use super::Scene;
use crate::error::{Error, Result};

/// How strictly to import.
#[derive(Debug, Clone, Copy, Default)]
pub struct ImportOptions {
    /// Whatever would be approximated or ignored (also a missing texture) is an error that names it.
    pub strict: bool,
}

/// A scene, and what was done to get it.
#[derive(Debug)]
pub struct Imported {
    /// Ready to be rendered; has at least one camera. Without an environment.
    pub scene: Scene,
    /// What was used, approximated, ignored and not loaded.
    pub report: ImportReport,
}

/// Reads a `.gltf` or `.glb` file.
///
/// # Errors
/// [`Error::Data`] (exit code 65) for a file that breaks the specification, requires an unknown extension, names
/// files outside of its folder, or asks for memory out of proportion; [`Error::Missing`] (66) when it, a buffer or a
/// picture is not there; [`Error::Permission`] and [`Error::Io`] as the system says. Texts name the file and the
/// JSON path.
pub fn import(path: &Path, options: &ImportOptions) -> Result<Imported> {
    let start = Instant::now();
    let container = container::read(path)?;
    let mut report = ImportReport { file: path.display().to_string(), ..Default::default() };
    let build = || -> Result<Scene> {
        let folder = uri::folder_of(path)?;
        let document = document::Document::parse(&container.json, &folder, container.bin)?;
        report.generator.clone_from(&document.generator);
        report.file_bytes = container.file_bytes + document.external_bytes;
        let file_bytes = report.file_bytes;
        let scene = assemble::assemble(&document, file_bytes, &mut report)?;
        if options.strict {
            report.refuse_if_inexact()?;
        }
        Ok(scene)
    };
    let scene = build().map_err(|error| in_file(path, error))?;
    report.read_seconds = start.elapsed().as_secs_f64();
    Ok(Imported { scene, report })
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
