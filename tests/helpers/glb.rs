//! Binary glTF files, built here.
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
    file(&document, &binary)
}

/// So many triangles through the same 1000 points of [-1, 1]³, hard to put in order; no camera, no light.
pub fn thicket(triangles: u32) -> Vec<u8> {
    const POINTS: u16 = 1000;
    // A multiplicative congruential generator is wild enough.
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 16) as u16
    };
    let mut binary = Vec::new();
    binary.extend((0..3 * POINTS).flat_map(|_| (f32::from(random()) / 32767.5 - 1.0).to_le_bytes()));
    let points = binary.len();
    binary.extend((0..3 * triangles).flat_map(|_| (random() % POINTS).to_le_bytes()));
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": POINTS, "type": "VEC3",
                "min": [-1, -1, -1], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5123, "count": 3 * triangles, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": points },
            { "buffer": 0, "byteOffset": points, "byteLength": binary.len() - points },
        ],
        "buffers": [{ "byteLength": binary.len() }],
    });
    file(&document, &binary)
}

pub fn file(document: &serde_json::Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let mut file = b"glTF".to_vec();
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let total = 12 + 8 + text.len() + 8 + binary.len();
    file.extend([2, total as u32].into_iter().flat_map(u32::to_le_bytes));
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}
