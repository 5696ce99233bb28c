//! What the importer did with a file: used, approximated, left out, and why.

use std::collections::HashMap;

use serde::Serialize;

use crate::error::{Error, Result};

/// What a [`Note`] says about the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoteKind {
    /// Shown, but not exactly as the file asks. An error with `--strict`.
    Approximated,
    /// Has an effect on the picture and is left out. An error with `--strict`.
    Ignored,
    /// Left out because the picture does not need it.
    NotLoaded,
    /// A small fault of the file that has one sensible reading.
    Repaired,
    /// How something is understood where renderers differ.
    Convention,
}

/// One remark. Remarks of equal kind and text are counted, not repeated.
#[derive(Debug, Clone, Serialize)]
pub struct Note {
    /// What it means for the picture.
    pub kind: NoteKind,
    /// JSON path of the first place.
    pub at: String,
    /// How many places.
    pub count: u32,
    /// What and why, in one line.
    pub text: String,
}

/// Sizes of an imported scene.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SceneCounts {
    /// Triangles in memory.
    pub triangles: u64,
    /// Triangles in the picture's world, each instance counted.
    pub instanced_triangles: u64,
    /// Meshes (one a glTF primitive that is placed).
    pub meshes: u64,
    /// Objects (one a glTF mesh that is placed).
    pub objects: u64,
    /// Placements of objects.
    pub instances: u64,
    /// Materials that a mesh uses.
    pub materials: u64,
    /// Decoded pictures.
    pub images: u64,
    /// Punctual lights.
    pub lights: u64,
    /// Cameras.
    pub cameras: u64,
    /// Bytes of vertices and indices.
    pub geometry_bytes: u64,
    /// Bytes of decoded pictures.
    pub image_bytes: u64,
}

/// What the importer did with a file.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ImportReport {
    /// The file, as it was named.
    pub file: String,
    /// What wrote it (`asset.generator`), if it says so.
    pub generator: Option<String>,
    /// Names of the document's scenes, of which one is shown; empty for those without.
    pub scenes: Vec<String>,
    /// Names of its material variants.
    pub variants: Vec<String>,
    /// Extensions in the file that are shown as they ask.
    pub extensions_used: Vec<String>,
    /// Extensions in the file that are left out.
    pub extensions_ignored: Vec<String>,
    /// Remarks, in the order of the file.
    pub notes: Vec<Note>,
    /// Sizes.
    pub counts: SceneCounts,
    /// Bytes of the file and of the buffers and pictures that it names.
    pub file_bytes: u64,
    /// Wall time of the import.
    pub read_seconds: f64,
}

impl ImportReport {
    /// Notes of one kind.
    pub fn of_kind(&self, kind: NoteKind) -> impl Iterator<Item = &Note> {
        self.notes.iter().filter(move |note| note.kind == kind)
    }

    /// With `--strict`, what is approximated or ignored is an error that names it.
    pub(super) fn refuse_if_inexact(&self) -> Result<()> {
        let inexact: Vec<_> =
            self.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored)).collect();
        if inexact.is_empty() {
            return Ok(());
        }
        const SHOWN: usize = 20;
        let mut lines: Vec<_> = inexact.iter().take(SHOWN).map(|n| format!("\n  {}: {}", n.at, n.text)).collect();
        if inexact.len() > SHOWN {
            lines.push(format!("\n  and {} more", inexact.len() - SHOWN));
        }
        Err(Error::Data(format!(
            "--strict: this scene cannot be shown exactly:{}\nwithout --strict it is rendered with these differences",
            lines.concat()
        )))
    }
}

/// Collects notes, equal ones once.
#[derive(Debug, Default)]
pub(super) struct Notes {
    list: Vec<Note>,
    seen: HashMap<(NoteKind, String), usize>,
}

impl Notes {
    pub fn add(&mut self, kind: NoteKind, at: &str, text: impl Into<String>) {
        let text = text.into();
        if let Some(&index) = self.seen.get(&(kind, text.clone())) {
            self.list[index].count = self.list[index].count.saturating_add(1);
            return;
        }
        self.seen.insert((kind, text.clone()), self.list.len());
        self.list.push(Note { kind, at: at.into(), count: 1, text });
    }

    pub fn approximated(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::Approximated, at, text);
    }

    pub fn ignored(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::Ignored, at, text);
    }

    pub fn not_loaded(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::NotLoaded, at, text);
    }

    pub fn repaired(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::Repaired, at, text);
    }

    pub fn convention(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::Convention, at, text);
    }

    pub fn into_list(self) -> Vec<Note> {
        self.list
    }
}
