//! Report of an import: what was used, approximated and omitted, and why.

use std::collections::HashMap;

use serde::Serialize;

use crate::error::{Error, Result};

/// Effect of a [`Note`] on the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoteKind {
    /// Rendered, but not exactly as specified. An error with `--strict`.
    Approximated,
    /// Omitted although it affects the picture. An error with `--strict`.
    Ignored,
    /// Omitted because the picture does not need it.
    NotLoaded,
    /// A small fault of the file that has one sensible interpretation.
    Repaired,
    /// An interpretation on which renderers differ.
    Convention,
}

/// A note. Notes of equal kind and text are counted, not repeated.
#[derive(Debug, Clone, Serialize)]
pub struct Note {
    pub kind: NoteKind,
    /// JSON path of the first occurrence.
    pub at: String,
    pub count: u32,
    /// One line that says what and why.
    pub text: String,
}

#[derive(Debug, Clone, Default, Serialize)]
pub struct SceneCounts {
    pub triangles: u64,
    /// Triangles in world space: each instance counts.
    pub instanced_triangles: u64,
    /// Meshes: one per placed glTF primitive.
    pub meshes: u64,
    /// Objects: one per placed glTF mesh.
    pub objects: u64,
    pub instances: u64,
    pub materials: u64,
    pub images: u64,
    pub lights: u64,
    pub cameras: u64,
    pub geometry_bytes: u64,
    pub image_bytes: u64,
}

#[derive(Debug, Clone, Default, Serialize)]
pub struct ImportReport {
    /// Path of the file as given.
    pub file: String,
    /// Software that wrote the file (`asset.generator`), if stated.
    pub generator: Option<String>,
    /// Names of the document's scenes; empty for those without.
    pub scenes: Vec<String>,
    pub variants: Vec<String>,
    /// Names of its animations; `animations[3]` for one without.
    pub animations: Vec<String>,
    pub extensions_used: Vec<String>,
    pub extensions_ignored: Vec<String>,
    pub notes: Vec<Note>,
    pub counts: SceneCounts,
    /// Size in bytes of the file and of the buffers and pictures that it refers to.
    pub file_bytes: u64,
    /// Wall-clock seconds of the import.
    pub read_seconds: f64,
}

impl ImportReport {
    pub fn of_kind(&self, kind: NoteKind) -> impl Iterator<Item = &Note> {
        self.notes.iter().filter(move |note| note.kind == kind)
    }

    /// For `--strict`: an error that lists everything approximated or ignored.
    pub(super) fn refuse_if_inexact(&self) -> Result<()> {
        let inexact: Vec<_> =
            self.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored)).collect();
        if inexact.is_empty() {
            return Ok(());
        }
        const MAX_LISTED: usize = 20;
        let mut lines: Vec<_> = inexact.iter().take(MAX_LISTED).map(|n| format!("\n  {}: {}", n.at, n.text)).collect();
        if inexact.len() > MAX_LISTED {
            lines.push(format!("\n  and {} more", inexact.len() - MAX_LISTED));
        }
        Err(Error::Data(format!(
            "strict: this scene cannot be shown exactly:{}\n  without strict it is rendered with these differences",
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

    /// Adds those of other notes that are new.
    pub fn join(&mut self, other: Self) {
        let is_new = |note: &Note| !self.seen.contains_key(&(note.kind, note.text.clone()));
        let new: Vec<_> = other.list.into_iter().filter(is_new).collect();
        new.into_iter().for_each(|note| self.add(note.kind, &note.at, note.text));
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

    pub(crate) fn convention(&mut self, at: &str, text: impl Into<String>) {
        self.add(NoteKind::Convention, at, text);
    }

    pub(crate) fn into_list(self) -> Vec<Note> {
        self.list
    }
}
