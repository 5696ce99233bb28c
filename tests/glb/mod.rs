//! A small binary glTF file, built here.

use serde_json::json;

/// One triangle that fills the middle of the view of two cameras, `a` and `b`; no light.
pub fn triangle() -> Vec<u8> {
    let positions = [[-1.0_f32, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
    let binary = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [
            { "mesh": 0 },
            { "name": "a", "camera": 0, "translation": [0, 0, 3] },
            { "name": "b", "camera": 1, "translation": [0, 0, 4] },
        ],
        "cameras": [
            { "name": "a", "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } },
            { "name": "b", "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } },
        ],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [0.6, 0.5, 0.4, 1], "metallicFactor": 0 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [-1, -1, 0], "max": [1, 1, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": binary.len() }],
        "buffers": [{ "byteLength": binary.len() }],
    });
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
    file
}
