//! Notes of what a document has that is not shown.

use std::collections::HashSet;

use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::extensions::{Support, support};
use crate::scene::import::report::Notes;

/// What concerns the file as a whole.
pub fn note_document(document: &Document, variant: bool, posed: bool, notes: &mut Notes) {
    for (name, at) in &document.extensions {
        // Extensions of objects are noted where those are used.
        let whole = !at.contains('.') || at.starts_with("scenes");
        if let Support::Ignored(why) = support(name)
            && whole
            && at != "extensionsUsed"
        {
            notes.ignored(&format!("{at}.{name}"), format!("{name}: {why}"));
        }
    }
    if document.animations.len() > 0 && !posed {
        let text = "animations are not played: the scene is shown at rest (--pose and --frame show other time_samples)";
        notes.approximated("animations", text);
    }
    if !document.variants.is_empty() && !variant {
        let text = "material variants: the default materials are shown (--variant chooses others)";
        notes.convention("extensions.KHR_materials_variants", text);
    }
    match document.scenes.len() {
        0 => notes.convention("scenes", "no scene in the file: all of its nodes are shown"),
        1 => {}
        n => notes.not_loaded("scenes", format!("{} of {n} scenes: only {} is shown", n - 1, document.scene_at)),
    }
}

pub fn note_unplaced(document: &Document, placed: &HashSet<usize>, notes: &mut Notes) {
    for (_, mesh) in document.meshes.sound().filter(|(index, _)| !placed.contains(index)) {
        notes.not_loaded(&mesh.at, "a mesh that no shown node places");
    }
}

/// What is still faulty here is what nothing shown needed. Where nothing is shown at all, that may be why: then the first
/// fault is an error.
pub fn note_faults(document: &Document, nothing_shown: bool, notes: &mut Notes) -> Result<()> {
    for (at, error) in document.faults() {
        if nothing_shown {
            return Err(error);
        }
        // Pictures that a shown material asks for have their note already.
        notes.not_loaded(&at, format!("faulty, but nothing shown needs it: {error}"));
    }
    Ok(())
}
