//! Binary glTF files, built here.

use serde_json::{Value, json};

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

pub fn png(picture: impl Into<image::DynamicImage>) -> Vec<u8> {
    let picture: image::DynamicImage = picture.into();
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

/// A file's binary part, which grows as views and accessors are asked for.
#[derive(Clone, Default)]
pub struct Data {
    bytes: Vec<u8>,
    views: Vec<Value>,
    pub accessors: Vec<Value>,
}

impl Data {
    /// The index of a view of these bytes.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() }));
        self.bytes.extend(bytes);
        self.views.len() - 1
    }

    /// The index of an accessor of these bytes.
    pub fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, shape: &str) -> usize {
        let view = self.view(bytes);
        self.accessors.push(json!({ "bufferView": view, "componentType": component, "count": count, "type": shape }));
        self.accessors.len() - 1
    }

    pub fn floats(&mut self, values: &[f32], shape: &str) -> usize {
        let width = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|name| *name == shape).unwrap() + 1;
        self.accessor(&floats(values), 5126, values.len() / width, shape)
    }

    /// The file with this document, to which accessors, views and the buffer are added.
    pub fn file(&self, mut document: Value) -> Vec<u8> {
        document["accessors"] = json!(self.accessors);
        document["bufferViews"] = json!(self.views);
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        file(&document, &self.bytes)
    }
}

/// One triangle that fills the middle of the view of two cameras, `a` and `b`; no light.
pub fn triangle() -> Vec<u8> {
    let mut data = Data::default();
    data.floats(&[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
    data.file(json!({
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
    }))
}

/// A triangle with the picture `t.png`, a file beside it.
pub fn pictured() -> Vec<u8> {
    let mut data = Data::default();
    data.floats(&[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
    data.floats(&[0.0; 6], "VEC2");
    data.file(json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "images": [{ "uri": "t.png" }], "textures": [{ "source": 0 }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
    }))
}

/// A textured triangle that stands still, one that moves, one that changes its form and colour; camera `a` moves, `b` does
/// not. Each for a second, on lines.
pub fn moving() -> Vec<u8> {
    let mut data = Data::default();
    data.floats(&[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
    data.floats(&[0.0, 0.0, 3.0, 0.0, 0.0, 3.0], "VEC2");
    data.floats(&[0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 0.5], "VEC3");
    data.floats(&[0.0, 1.0], "SCALAR");
    data.floats(&[-0.5, 0.0, 0.5, 0.5, 0.5, 0.5], "VEC3");
    data.floats(&[0.0, 1.0], "SCALAR");
    data.floats(&[1.0, 0.2, 0.2, 1.0, 0.2, 0.2, 1.0, 1.0], "VEC4");
    data.floats(&[0.0, 0.0, 3.0, 0.3, 0.2, 4.0], "VEC3");
    let picture = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([(x * 30) as u8, (y * 30) as u8, 90]));
    let picture = data.view(&png(picture));
    let pointer = "/materials/1/pbrMetallicRoughness/baseColorFactor";
    let channel = |sampler: u32, target: Value| json!({ "sampler": sampler, "target": target });
    let sampler = |output: u32| json!({ "input": 3, "output": output });
    let camera = || json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } });
    data.file(json!({
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
        "images": [{ "bufferView": picture, "mimeType": "image/png" }],
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
    }))
}

/// A quad with normals, indices, a texture, a camera and a light: a bit of everything.
pub fn quad() -> Vec<u8> {
    let mut data = Data::default();
    data.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
    data.floats(&[0.0, 0.0, 1.0].repeat(4), "VEC3");
    data.floats(&[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0], "VEC2");
    data.accessor(&[0, 1, 2, 0, 2, 3].map(u16::to_le_bytes).concat(), 5123, 6, "SCALAR");
    let pixels = vec![200, 100, 50, 255, 0, 0, 0, 0];
    let picture = data.view(&png(image::RgbaImage::from_raw(2, 1, pixels).unwrap()));
    let camera = json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 0.1 } });
    let light = json!({ "type": "spot", "spot": {}, "intensity": 5 });
    let transform = json!({ "KHR_texture_transform": { "scale": [2, 2], "rotation": 1 } });
    data.file(json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2] }],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform"],
        "extensions": { "KHR_lights_punctual": { "lights": [light] } },
        "nodes": [
            { "mesh": 0, "rotation": [0, 0, 0, 1] },
            { "camera": 0, "translation": [0, 0, 3] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        ],
        "cameras": [camera],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3, "material": 0 },
        ] }],
        "materials": [{
            "alphaMode": "MASK",
            "normalTexture": { "index": 0 },
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0, "extensions": transform } },
        }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33648 }],
        "images": [{ "bufferView": picture, "mimeType": "image/png" }],
    }))
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
    let mut data = Data::default();
    let points: Vec<_> = (0..3 * POINTS).map(|_| f32::from(random()) / 32767.5 - 1.0).collect();
    data.floats(&points, "VEC3");
    let indices: Vec<u8> = (0..3 * triangles).flat_map(|_| (random() % POINTS).to_le_bytes()).collect();
    data.accessor(&indices, 5123, indices.len() / 2, "SCALAR");
    data.file(json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
    }))
}

pub const JSON: u32 = 0x4E4F_534A;
pub const BIN: u32 = 0x004E_4942;

pub fn file(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    container(&[(JSON, &text[..]), (BIN, &binary[..])])
}

/// A file of chunks (type, bytes), whatever they are.
pub fn container(chunks: &[(u32, &[u8])]) -> Vec<u8> {
    let length = 12 + chunks.iter().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
    let mut out = b"glTF".to_vec();
    out.extend([2, length as u32].iter().flat_map(|x| x.to_le_bytes()));
    for (kind, bytes) in chunks {
        out.extend([bytes.len() as u32, *kind].iter().flat_map(|x| x.to_le_bytes()));
        out.extend(*bytes);
    }
    out
}
