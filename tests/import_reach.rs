//! What no scene of a document can show is not read, and changes nothing.

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::path::Path;

use bismar::scene::import::{ImportOptions, Imported, SceneFiles};
use serde_json::{Value, json};

use crate::helpers::{glb, gltf_parts, shared};

#[test]
fn a_buffer_larger_than_any_memory_is_read_where_a_mesh_needs_it() {
    const UNPLACED: u64 = 1 << 40;
    let triangle = gltf_parts::floats(&gltf_parts::TRIANGLE);
    let n = triangle.len() as u64;
    let accessor = |view: u32| json!({ "bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3" });
    let mesh = |accessor: u32| json!({ "primitives": [{ "attributes": { "POSITION": accessor } }] });
    let document = json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 1 }],
        "meshes": [mesh(0), mesh(1)], "accessors": [accessor(0), accessor(1)],
        "bufferViews": [
            { "buffer": 0, "byteLength": UNPLACED }, { "buffer": 0, "byteOffset": UNPLACED, "byteLength": n },
        ],
        "buffers": [{ "uri": "a.bin", "byteLength": UNPLACED + n }],
    });
    let (folder, path) = gltf_parts::scene_file("a.gltf", document.to_string());
    let binary = File::create(folder.path().join("a.bin")).unwrap();
    binary.write_all_at(&triangle, UNPLACED).unwrap();
    let hash = || {
        let files = SceneFiles::open(&path).unwrap();
        let survey = files.survey();
        assert_eq!(survey.file_bytes, UNPLACED + n + document.to_string().len() as u64);
        assert_eq!(survey.read_bytes, survey.file_bytes - UNPLACED);
        assert_eq!(survey.census.triangles, 1, "the other mesh's are not shown");
        assert_eq!(files.import(&ImportOptions::default()).unwrap().scene.meshes[0].positions[1], [1.0, 0.0, 0.0]);
        survey.hash
    };
    let before = hash();
    binary.write_all_at(b"x", UNPLACED / 2).unwrap();
    assert_eq!(hash(), before, "what is not shown does not count");
    binary.write_all_at(&2_f32.to_le_bytes(), UNPLACED + n - 4).unwrap();
    assert_ne!(hash(), before, "what is shown counts");
}

/// A binary glTF file's document, and what is in its binary chunk; `None` if it is no document.
pub fn chunks(file: &[u8]) -> Option<(Value, Vec<u8>)> {
    let json_end = 20 + u32::from_le_bytes(file.get(12..16)?.try_into().ok()?) as usize;
    let document = serde_json::from_slice(file.get(20..json_end)?).ok()?;
    Some((document, file.get(json_end + 8..).unwrap_or_default().to_vec()))
}

/// With so many bytes more before and behind the binary chunk's, which nothing needs.
fn padded(file: &[u8]) -> Option<Vec<u8>> {
    const MORE: u64 = 3 << 20;
    let (mut document, binary) = chunks(file)?;
    let shift = |part: &mut Value| {
        if part["buffer"] == json!(0) {
            part["byteOffset"] = json!(part["byteOffset"].as_u64().unwrap_or(0) + MORE);
        }
    };
    for view in document["bufferViews"].as_array_mut()? {
        shift(view);
        view["extensions"].as_object_mut().into_iter().flatten().for_each(|(_, extension)| shift(extension));
        if view["extensions"].is_null() {
            view.as_object_mut()?.remove("extensions");
        }
    }
    let buffer = &mut document["buffers"][0];
    if buffer["uri"].is_string() {
        return None;
    }
    buffer["byteLength"] = json!(buffer["byteLength"].as_u64()? + 2 * MORE);
    let padding = vec![0xAB; MORE as usize];
    Some(glb::file(&document, &[&padding[..], &binary, &padding].concat()))
}

fn imported(path: &Path) -> Option<(Imported, u64)> {
    let files = SceneFiles::open(path).ok()?;
    Some((files.import(&ImportOptions::default()).ok()?, files.survey().read_bytes))
}

#[test]
fn every_file_looks_the_same_with_bytes_around_it_that_nothing_needs() {
    let Some(folder) = shared::folder() else { return };
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("padded.glb");
    let mut compared = 0;
    for row in shared::scenes(&folder) {
        let file = fs::read(folder.join(&row["path"])).unwrap();
        if !row["path"].ends_with(".glb") || file.len() > 4 << 20 || !shared::must_accept(&row["expected_verdict"]) {
            continue;
        }
        let (Some((alone, _)), Some(padded)) = (imported(&folder.join(&row["path"])), padded(&file)) else { continue };
        fs::write(&path, &padded).unwrap();
        let (around, read) = imported(&path).unwrap_or_else(|| panic!("{}: is refused", row["path"]));
        assert!(read < padded.len() as u64 - (4 << 20), "{}: {read} bytes of {} read", row["path"], padded.len());
        assert!(format!("{:?}", alone.scene) == format!("{:?}", around.scene), "{}: another scene", row["path"]);
        compared += 1;
    }
    assert!(compared > 40, "only {compared} files compared");
}
