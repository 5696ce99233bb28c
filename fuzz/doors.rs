//! The doors by which strangers' bytes come in. The targets of `cargo fuzz` go through them, and so does
//! `tests/mutations.rs`, which needs no nightly compiler.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::batch::file::{self, Flag};
use bismar::farm::{PathMapping, Plan};
use bismar::film::{Picture, exr_file};
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::record::checkpoint::{Earlier, unpack};
use bismar::render::{self, RenderSettings};
use bismar::scene::import::{EnvironmentFile, ImportOptions, Imported, Pose, SceneFiles, Shutter};
use serde_json::json;

/// Takes bytes in as the program does, in a folder for its files; are they what they should be? Whatever comes of them but
/// a panic, an abort, a hang or much memory is right.
pub type Door = fn(&Path, &[u8]) -> bool;

/// All of them, by name.
pub const DOORS: [(&str, Door); 10] = [
    ("scene", scene),
    ("render", render),
    ("decoders", decoders),
    ("picture", picture),
    ("environment", environment),
    ("exr", exr),
    ("checkpoint", checkpoint),
    ("statistics", statistics),
    ("batch", batch),
    ("farm", farm),
];

fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).expect("a folder that can be written");
    path
}

/// A scene's file, named by what it is.
fn put_scene(folder: &Path, bytes: &[u8]) -> PathBuf {
    put(folder, if bytes.starts_with(b"glTF") { "scene.glb" } else { "scene.gltf" }, bytes)
}

/// glTF as JSON or GLB, with all that is inside it: accessors, pictures.
pub fn scene(folder: &Path, bytes: &[u8]) -> bool {
    let Ok(files) = SceneFiles::open(&put_scene(folder, bytes)) else { return false };
    files.survey();
    // A moment of its animations too, and what moves around it.
    let shutter = Some(Shutter { opens: -0.1, closes: 0.2, steps: Some(3) });
    let pose = Some(Pose { seconds: 0.7, animation: None, shutter, frame: Some(0.04) });
    let _ = files.import(&ImportOptions { pose, ..Default::default() });
    files.import(&ImportOptions::default()).is_ok()
}

/// A stream alone, in a document that is made for it, so that no mutation is lost on the document: KTX2, meshopt or Draco. The
/// head: which one, its kind (bits 0 and 1: meshopt's mode, or Draco's attribute; 2 and 3: the filter), a stride, a byte that
/// means nothing, and the numbers of vertices and indices that the document claims, 32 bits each.
pub fn decoders(folder: &Path, bytes: &[u8]) -> bool {
    let Some((&[which, kind, stride, _, v0, v1, v2, v3, i0, i1, i2, i3], stream)) = bytes.split_first_chunk() else {
        return false;
    };
    let [vertices, indices] = [[v0, v1, v2, v3], [i0, i1, i2, i3]].map(u32::from_le_bytes);
    let length = stream.len();
    let triangle = length.next_multiple_of(4);
    let mut binary = stream.to_vec();
    binary.resize(triangle, 0);
    binary.extend([0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()));
    let mut document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_texture_basisu", "EXT_meshopt_compression", "KHR_draco_mesh_compression"],
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "bufferViews": [
            { "buffer": 0, "byteLength": length },
            { "buffer": 0, "byteOffset": triangle, "byteLength": 36 },
        ],
        "buffers": [{ "byteLength": binary.len() }],
    });
    let plain = json!({ "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3" });
    let mut positions = json!({ "componentType": 5126, "count": vertices, "type": "VEC3" });
    let mut corners = json!({ "componentType": 5123, "count": indices, "type": "SCALAR" });
    let (accessors, primitive) = match which % 3 {
        0 => {
            document["images"] = json!([{ "bufferView": 0, "mimeType": "image/ktx2" }]);
            document["textures"] = json!([{ "extensions": { "KHR_texture_basisu": { "source": 0 } } }]);
            document["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
            (json!([plain]), json!({ "attributes": { "POSITION": 0 }, "material": 0 }))
        }
        1 => {
            let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES", "ATTRIBUTES"][usize::from(kind & 3)];
            let filter = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"][usize::from(kind >> 2 & 3)];
            let count = if mode == "ATTRIBUTES" { vertices } else { indices };
            let size = u64::from(count) * u64::from(stride);
            let packed = json!({ "buffer": 0, "byteOffset": 0, "byteLength": length, "byteStride": stride,
                "count": count, "mode": mode, "filter": filter });
            let packed = json!({ "EXT_meshopt_compression": packed });
            document["bufferViews"][0] = json!({ "buffer": 1, "byteLength": size, "extensions": packed });
            // Decoded streams are as if in a buffer that has no bytes.
            let fallback = json!({ "EXT_meshopt_compression": { "fallback": true } });
            let fallback = json!({ "byteLength": size, "extensions": fallback });
            document["buffers"] = json!([{ "byteLength": binary.len() }, fallback]);
            if mode == "ATTRIBUTES" {
                positions["bufferView"] = 0.into();
                (json!([positions]), json!({ "attributes": { "POSITION": 0 } }))
            } else {
                corners["bufferView"] = 0.into();
                (json!([plain, corners]), json!({ "attributes": { "POSITION": 0 }, "indices": 1 }))
            }
        }
        _ => {
            let packed = json!({ "bufferView": 0, "attributes": { "POSITION": kind & 3 } });
            let packed = json!({ "KHR_draco_mesh_compression": packed });
            let primitive = json!({ "attributes": { "POSITION": 0 }, "indices": 1, "extensions": packed });
            (json!([positions, corners]), primitive)
        }
    };
    document["accessors"] = accessors;
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 12 + 8 + text.len() + 8 + binary.len();
    file.extend([2, total as u32].into_iter().flat_map(u32::to_le_bytes));
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    let Ok(files) = SceneFiles::open(&put(folder, "scene.glb", &file)) else { return false };
    files.survey();
    // A picture that cannot be decoded is left out with a note.
    let all = |imported: Imported| which % 3 != 0 || !imported.scene.images.is_empty();
    files.import(&ImportOptions::default()).is_ok_and(all)
}

/// glTF to a picture of 8 x 8 pixels, each a number, by one of the ray libraries.
pub fn render(folder: &Path, bytes: &[u8]) -> bool {
    let imported = SceneFiles::open(&put_scene(folder, bytes)).and_then(|files| files.import(&Default::default()));
    let Ok(imported) = imported else { return false };
    let mut scene = imported.scene;
    scene.light_if_dark();
    let rays = if bytes.len().is_multiple_of(2) { Backend::Embree } else { Backend::Obvhs };
    let Ok(scene) = PreparedScene::build(Arc::new(scene), rays) else { return false };
    let settings = RenderSettings { width: 8, height: 8, spp: Some(2), aovs: true, ..Default::default() };
    let rendered = render::render(&scene, &settings, &AtomicBool::new(false), &|_| ()).expect("valid settings");
    for pixel in &rendered.film().pixels {
        assert!(pixel.mean().iter().all(|x| x.is_finite()), "a pixel is no number");
    }
    true
}

/// PNG, JPEG, HDR and EXR for `compare` and `develop`.
pub fn picture(folder: &Path, bytes: &[u8]) -> bool {
    Picture::open(&put(folder, "picture", bytes), None).is_ok()
}

/// HDR and EXR for `--env`.
pub fn environment(folder: &Path, bytes: &[u8]) -> bool {
    let Ok(file) = EnvironmentFile::open(&put(folder, "sky", bytes)) else { return false };
    file.size().bytes();
    file.decode(0.0, 1.0).is_ok()
}

/// EXR and its header.
pub fn exr(folder: &Path, bytes: &[u8]) -> bool {
    let path = put(folder, "a.exr", bytes);
    let read = exr_file::read(&path).is_ok();
    let _ = (exr_file::read_header(&path), exr_file::read_statistics(&path), exr_file::check(&path));
    read
}

/// A picture of ours that a render goes on from.
pub fn checkpoint(folder: &Path, bytes: &[u8]) -> bool {
    let Ok(Some(earlier)) = Earlier::read(&put(folder, "a.exr", bytes)) else { return false };
    let settings = &earlier.record.identity.settings;
    // What a file says of its size is compared with what the scene and the command say before tiles are made of it.
    let small = settings.width <= 256 && settings.height <= 256;
    earlier.verify().is_ok() & (small && earlier.tiles(settings).is_ok())
}

/// Packed tiles whose hash is right.
pub fn statistics(_: &Path, bytes: &[u8]) -> bool {
    unpack(bytes).is_some()
}

pub fn batch(folder: &Path, bytes: &[u8]) -> bool {
    let flags = [
        ("spp", Flag::Value),
        ("no-env", Flag::Switch),
        ("preview", Flag::File),
        ("seed", Flag::Value),
        ("output", Flag::File),
    ];
    let flags: HashMap<_, _> = flags.into_iter().map(|(name, flag)| (name.to_owned(), flag)).collect();
    file::read(&put(folder, "jobs.toml", bytes), &flags).is_ok()
}

/// The plan of a farm, and rules for its paths.
pub fn farm(folder: &Path, bytes: &[u8]) -> bool {
    let path = put(folder, "farm.json", bytes);
    Plan::read(&path).is_ok() | PathMapping::read(&path).is_ok()
}
