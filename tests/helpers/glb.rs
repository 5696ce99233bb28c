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

/// A textured triangle that stands still, one that moves, one that changes its form and colour; camera `a` moves, `b` does
/// not. Each for a second, on lines.
pub fn moving() -> Vec<u8> {
    let mut binary = Vec::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut add = |bytes: Vec<u8>, shape: Option<(&str, usize)>| {
        views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
        if let Some((shape, width)) = shape {
            accessors.push(json!({ "bufferView": views.len() - 1, "componentType": 5126, "type": shape,
                "count": bytes.len() / 4 / width }));
        }
        binary.extend(bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
    };
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    add(floats(&[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0]), Some(("VEC3", 3)));
    add(floats(&[0.0, 0.0, 3.0, 0.0, 0.0, 3.0]), Some(("VEC2", 2)));
    add(floats(&[0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.5]), Some(("VEC3", 3)));
    add(floats(&[0.0, 1.0]), Some(("SCALAR", 1)));
    add(floats(&[-0.5, 0.0, 0.5, 0.5, 0.5, 0.5]), Some(("VEC3", 3)));
    add(floats(&[0.0, 1.0]), Some(("SCALAR", 1)));
    add(floats(&[1.0, 0.2, 0.2, 1.0, 0.2, 0.2, 1.0, 1.0]), Some(("VEC4", 4)));
    add(floats(&[0.0, 0.0, 3.0, 0.3, 0.2, 4.0]), Some(("VEC3", 3)));
    let picture = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([(x * 30) as u8, (y * 30) as u8, 90]));
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    add(png.into_inner(), None);
    let pointer = "/materials/1/pbrMetallicRoughness/baseColorFactor";
    let channel = |sampler: u32, target: serde_json::Value| json!({ "sampler": sampler, "target": target });
    let sampler = |output: u32| json!({ "input": 3, "output": output });
    let camera = || json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } });
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2, 3, 4] }],
        "extensionsUsed": ["KHR_animation_pointer"],
        "nodes": [
            { "mesh": 0, "translation": [0, 0, -1], "scale": [2, 2, 2] },
            { "mesh": 0, "scale": [0.4, 0.4, 0.4] },
            { "mesh": 1, "translation": [0.2, -0.4, 0.2] },
            { "name": "a", "camera": 0 },
            { "name": "b", "camera": 1, "translation": [0, 0, 4] },
        ],
        "cameras": [camera(), camera()],
        "materials": [
            { "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0 } },
            { "pbrMetallicRoughness": { "metallicFactor": 0 } },
        ],
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": 8, "mimeType": "image/png" }],
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] },
            { "primitives": [{ "attributes": { "POSITION": 0 }, "targets": [{ "POSITION": 2 }], "material": 1 }] },
        ],
        "animations": [{
            "samplers": [sampler(4), sampler(5), sampler(6), sampler(7)],
            "channels": [
                channel(0, json!({ "node": 1, "path": "translation" })),
                channel(1, json!({ "node": 2, "path": "weights" })),
                channel(2, json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": pointer } } })),
                channel(3, json!({ "node": 3, "path": "translation" })),
            ],
        }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    file(&document, &binary)
}

/// A quad with normals, indices, a texture, a camera and a light: a bit of everything.
pub fn quad() -> Vec<u8> {
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    bin.extend(floats(&[0.0, 0.0, 1.0].repeat(4)));
    bin.extend(floats(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]));
    bin.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|x| x.to_le_bytes()));
    let mut png = Vec::new();
    let pixels = [200, 100, 50, 255, 0, 0, 0, 0];
    image::ImageEncoder::write_image(
        image::codecs::png::PngEncoder::new(&mut png),
        &pixels,
        2,
        1,
        image::ExtendedColorType::Rgba8,
    )
    .unwrap();
    let picture = (bin.len(), png.len());
    bin.extend(png);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,1,2]}}],
        "extensionsUsed":["KHR_lights_punctual","KHR_texture_transform"],
        "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"spot","spot":{{}},"intensity":5}}]}}}},
        "nodes":[{{"mesh":0,"rotation":[0,0,0,1]}},{{"camera":0,"translation":[0,0,3]}},
          {{"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
        "cameras":[{{"type":"perspective","perspective":{{"yfov":0.7,"znear":0.1}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"indices":3,"material":0}}]}}],
        "materials":[{{"alphaMode":"MASK","normalTexture":{{"index":0}},"pbrMetallicRoughness":{{"baseColorTexture":
          {{"index":0,"extensions":{{"KHR_texture_transform":{{"scale":[2,2],"rotation":1}}}}}}}}}}],
        "textures":[{{"source":0,"sampler":0}}],"samplers":[{{"wrapS":33648}}],
        "images":[{{"bufferView":4,"mimeType":"image/png"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
          {{"bufferView":1,"componentType":5126,"count":4,"type":"VEC3"}},
          {{"bufferView":2,"componentType":5126,"count":4,"type":"VEC2"}},
          {{"bufferView":3,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":48}},
          {{"buffer":0,"byteOffset":96,"byteLength":32}},{{"buffer":0,"byteOffset":128,"byteLength":12}},
          {{"buffer":0,"byteOffset":{},"byteLength":{}}}],
        "buffers":[{{"byteLength":{}}}]}}"#,
        picture.0,
        picture.1,
        bin.len()
    );
    file(&serde_json::from_str(&json).unwrap(), &bin)
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
