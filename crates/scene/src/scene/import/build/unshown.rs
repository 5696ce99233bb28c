//! Notes about contents of the document that are not shown.

use std::collections::HashSet;

use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::extensions::{SPLATS, Support, support};
use crate::scene::import::report::Notes;

/// Notes that concern the file as a whole.
pub(crate) fn note_document(document: &Document, variant: bool, posed: bool, notes: &mut Notes) {
    for (name, at) in &document.extensions {
        // Extensions on elements are noted where the elements are used.
        let whole = !at.contains('.') || at.starts_with("scenes");
        if let Support::Ignored(why) = support(name)
            && whole
            && at != "extensionsUsed"
        {
            notes.ignored(&format!("{at}.{name}"), format!("{name}: {why}"));
        }
    }
    if document.animations.len() > 0 && !posed {
        let text = "animations are not played: the scene is shown at rest (a pose or a frame shows another time)";
        notes.approximated("animations", text);
    }
    if !document.variants.is_empty() && !variant {
        let text = "material variants: the default materials are shown (name a variant for others)";
        notes.convention("extensions.KHR_materials_variants", text);
    }
    match document.scenes.len() {
        0 => notes.convention("scenes", "no scene in the file: all of its nodes are shown"),
        1 => {}
        n => notes.not_loaded("scenes", format!("{} of {n} scenes: only {} is shown", n - 1, document.scene_at)),
    }
}

/// Notes the extensions of a shown element that are ignored.
pub(crate) fn note_extensions(at: &str, extensions: &[String], notes: &mut Notes) {
    // Splats are noted with their number.
    for name in extensions.iter().filter(|name| *name != SPLATS) {
        if let Support::Ignored(why) = support(name) {
            notes.ignored(&format!("{at}.extensions.{name}"), format!("{name}: {why}"));
        }
    }
}

/// Notes meshes that no shown node refers to.
pub(crate) fn note_unplaced(document: &Document, placed: &HashSet<usize>, notes: &mut Notes) {
    for (_, mesh) in document.meshes.sound().filter(|(index, _)| !placed.contains(index)) {
        notes.not_loaded(&mesh.at, "a mesh that no shown node places");
    }
}

/// Notes faulty elements that nothing shown needs. If nothing is shown at all, the first fault may be the cause and is
/// returned as an error.
pub(crate) fn note_faults(document: &Document, nothing_shown: bool, notes: &mut Notes) -> Result<()> {
    for (at, error) in document.faults() {
        if nothing_shown {
            return Err(error);
        }
        notes.not_loaded(&at, format!("faulty, but nothing shown needs it: {error}"));
    }
    Ok(())
}
