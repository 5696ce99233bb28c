//! The shared glTF files and what their manifest says of them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The folder, or `None` with a word about it. On CI it must be there.
pub fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/gltf");
    if folder.join("manifest.csv").exists() {
        return Some(folder);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing", folder.display());
    super::skipped::skipped(&format!("{} is missing", folder.display()));
    None
}

/// The manifest's rows that are scenes, by column name.
pub fn scenes(folder: &Path) -> Vec<HashMap<String, String>> {
    let mut rows = rows(&std::fs::read_to_string(folder.join("manifest.csv")).unwrap());
    rows.retain(|row| row["path"].ends_with(".gltf") || row["path"].ends_with(".glb"));
    assert!(rows.len() > 400, "the manifest has lost its rows");
    rows
}

/// May the file load, by the manifest's verdict, and nothing else?
pub fn must_accept(verdict: &str) -> bool {
    verdict.contains("(or decode)")
        || verdict.starts_with("accept") && !verdict.contains("or error") && !verdict.contains("or clear error")
}

/// Rows of a CSV text with quoted fields.
fn rows(text: &str) -> Vec<HashMap<String, String>> {
    let mut lines = text.lines().map(|line| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        fields
    });
    let names = lines.next().unwrap();
    lines.map(|fields| names.iter().cloned().zip(fields).collect()).collect()
}

/// Rows that the manifest rejects for a fault with one obvious reading, in a picture, or in a mesh that nothing places:
/// they load, and a note says so.
const NOTED: [&str; 8] = [
    "malformed/validator/image/invalid_data_uri_mime_type.gltf",
    "malformed/validator/image/invalid_image_data.gltf",
    "malformed/validator/image/png_eos.gltf",
    "malformed/validator/json/bom.gltf",
    "malformed/validator/mesh/invalid_attribute.gltf",
    "malformed/validator/mesh/invalid_attribute_escaped_name.gltf",
    "malformed/validator/mesh_data/colors_non_clamped.gltf",
    "malformed/validator/mesh_data/index_buffer_primitive_restart.gltf",
];

/// Must this row load with a note, though the manifest rejects it?
pub fn must_be_noted(path: &str) -> bool {
    NOTED.contains(&path)
}
