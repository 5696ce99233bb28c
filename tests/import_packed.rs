//! Packed files: what was packed comes out again, within its quantization; what was damaged is refused, never a panic.

use std::collections::BTreeSet;
use std::fs;

use bismar::scene::import::{ImportOptions, Imported, import};
use bismar::scene::{Mesh, Scene, Texels, TextureSlot};
use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, FaceIndex, GeometryAttributeType, MeshEncoder, PointAttribute,
};
use glam::Vec3;
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, IndexEncoding, VertexEncoding};
use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::gltf_parts::{check_scene, floats, scene_file};
use crate::helpers::random::Random;
use crate::helpers::shared;
use crate::import_content::{accessor, with};

const SIDE: usize = 17;

/// A hilly square of `SIDE` x `SIDE` points.
struct Hills {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

fn hills() -> Hills {
    let point = |i: usize| [(i % SIDE) as f32, (i / SIDE) as f32].map(|x| x / (SIDE - 1) as f32);
    let position = |[x, y]: [f32; 2]| Vec3::new(x, y, 0.25 * (6.0 * x).sin() * (5.0 * y).cos());
    let normal = |[x, y]: [f32; 2]| {
        let (dx, dy) = (1.5 * (6.0 * x).cos() * (5.0 * y).cos(), -1.25 * (6.0 * x).sin() * (5.0 * y).sin());
        Vec3::new(-dx, -dy, 1.0).normalize()
    };
    let quads = (0..(SIDE - 1) * (SIDE - 1)).map(|i| (i / (SIDE - 1) * SIDE + i % (SIDE - 1)) as u32);
    let side = SIDE as u32;
    Hills {
        positions: (0..SIDE * SIDE).map(|i| position(point(i))).collect(),
        normals: (0..SIDE * SIDE).map(|i| normal(point(i))).collect(),
        triangles: quads.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]).collect(),
    }
}

impl Hills {
    /// Holds an imported mesh to these hills: the same triangles, wherever they stand in the list; positions to `far`,
    /// normals to `tilt` radians.
    #[track_caller]
    fn agree(&self, mesh: &Mesh, far: f32, tilt: f32) {
        let nearest = |p: &[f32; 3]| {
            let [column, row] = [p[0], p[1]].map(|x| (x * (SIDE - 1) as f32).round() as usize);
            let i = row * SIDE + column;
            assert!(self.positions[i].distance(Vec3::from(*p)) <= far, "{p:?} for {}", self.positions[i]);
            i as u32
        };
        let whose: Vec<u32> = mesh.positions.iter().map(nearest).collect();
        for (normal, &i) in mesh.normals.as_ref().unwrap().iter().zip(&whose) {
            let angle = Vec3::from(*normal).angle_between(self.normals[i as usize]);
            assert!(angle <= tilt, "{normal:?} is {angle} from {}", self.normals[i as usize]);
        }
        // From the smallest corner on: packers turn triangles, but not over.
        let turned = |t: [u32; 3]| {
            let first = (0..3).min_by_key(|&i| t[i]).unwrap();
            [t[first], t[(first + 1) % 3], t[(first + 2) % 3]]
        };
        let ours: BTreeSet<_> = self.triangles.iter().map(|t| turned(*t)).collect();
        let theirs: BTreeSet<_> = mesh.indices.iter().map(|t| turned(t.map(|i| whose[i as usize]))).collect();
        assert_eq!(mesh.indices.len(), self.triangles.len());
        assert!(ours == theirs, "other triangles");
    }
}

fn document(accessors: Value, views: Value, buffers: Value, primitive: Value, required: &str) -> Value {
    json!({
        "asset": { "version": "2.0" }, "extensionsRequired": [required], "extensionsUsed": [required],
        "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }], "meshes": [{ "primitives": [primitive] }],
        "accessors": accessors, "bufferViews": views, "buffers": buffers,
    })
}

/// Hills under a meshopt extension: normals by the octahedral filter at 8 bits, positions by an exponent of 20 bits or as
/// they are.
pub fn meshopt(extension: &str, version: u8, exponential: bool, sequence: bool) -> Vec<u8> {
    let hills = hills();
    let n = hills.positions.len();
    let mut workspace = Workspace::default();
    let vertices = |bytes: &[u8], stride: usize, workspace: &mut Workspace| {
        let encoding = VertexEncoding::new(version, 2).unwrap();
        codec::encode_vertex_buffer(bytes, n, stride, encoding, workspace).unwrap()
    };
    let flat: Vec<f32> = hills.positions.iter().flat_map(|p| p.to_array()).collect();
    let plain = match exponential {
        true => codec::encode_filter_exp(n, 12, 20, &flat, codec::ExpMode::SharedVector, &mut workspace).unwrap(),
        false => floats(&flat),
    };
    let positions = vertices(&plain, 12, &mut workspace);
    let flat: Vec<f32> = hills.normals.iter().flat_map(|n| [n.x, n.y, n.z, 0.0]).collect();
    let coded = codec::encode_filter_oct(n, 4, 8, &flat, &mut workspace).unwrap();
    let normals = vertices(&coded, 4, &mut workspace);
    let corners: Vec<u32> = hills.triangles.iter().flatten().copied().collect();
    let encoding = IndexEncoding::default();
    let indices = match sequence {
        true => codec::encode_index_sequence(&corners, encoding, &mut workspace).unwrap(),
        false => codec::encode_index_buffer(&corners, encoding, &mut workspace).unwrap(),
    };
    let (mut binary, mut views, mut offset) = (Vec::new(), Vec::new(), 0);
    let mode = if sequence { "INDICES" } else { "TRIANGLES" };
    let filter = if exponential { "EXPONENTIAL" } else { "NONE" };
    for (stream, count, stride, mode, filter) in [
        (positions, n, 12, "ATTRIBUTES", filter),
        (normals, n, 4, "ATTRIBUTES", "OCTAHEDRAL"),
        (indices, corners.len(), 2, mode, "NONE"),
    ] {
        binary.resize(binary.len().next_multiple_of(4), 0);
        let (start, length) = (binary.len(), stream.len());
        binary.extend(stream);
        let mut view = json!({ "buffer": 1, "byteOffset": offset, "byteLength": count * stride, "extensions": {
            extension: { "buffer": 0, "byteOffset": start, "byteLength": length, "byteStride": stride, "count": count,
                "mode": mode, "filter": filter } } });
        if mode == "ATTRIBUTES" {
            view["byteStride"] = stride.into();
        }
        views.push(view);
        offset += (count * stride).next_multiple_of(4);
    }
    let accessors = json!([
        { "bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3", "min": [0, 0, -0.25], "max": [1, 1, 0.25] },
        { "bufferView": 1, "componentType": 5120, "normalized": true, "count": n, "type": "VEC3" },
        { "bufferView": 2, "componentType": 5123, "count": corners.len(), "type": "SCALAR" },
    ]);
    let buffers = json!([
        { "byteLength": binary.len() },
        { "byteLength": offset, "extensions": { extension: { "fallback": true } } },
    ]);
    let primitive = json!({ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2 });
    let mut document = document(accessors, views.into(), buffers, primitive, extension);
    for list in ["extensionsRequired", "extensionsUsed"] {
        document[list] = json!([extension, "KHR_mesh_quantization"]);
    }
    glb::file(&document, &binary)
}

const DRACO: &str = "KHR_draco_mesh_compression";

/// Hills under KHR_draco_mesh_compression: positions by 12 bits, normals by 9. Speed 0 takes the edge breaker, 10 the
/// sequential coder.
pub fn draco(speed: i32) -> Vec<u8> {
    let hills = hills();
    let attribute = |kind, values: &[Vec3]| {
        let mut attribute = PointAttribute::new();
        attribute.init(kind, 3, DataType::Float32, false, values.len());
        let flat: Vec<f32> = values.iter().flat_map(|v| v.to_array()).collect();
        attribute.buffer_mut().write(0, &floats(&flat));
        attribute
    };
    let mut mesh = draco_core::Mesh::new();
    mesh.add_attribute(attribute(GeometryAttributeType::Position, &hills.positions));
    mesh.add_attribute(attribute(GeometryAttributeType::Normal, &hills.normals));
    mesh.set_num_faces(hills.triangles.len());
    for (face, t) in (0..).zip(&hills.triangles) {
        mesh.set_face(FaceIndex(face), t.map(Into::into));
    }
    let mut options = EncoderOptions::new();
    options.set_global_int("encoding_speed", speed);
    options.set_global_int("decoding_speed", speed);
    options.set_attribute_int(0, "quantization_bits", 12);
    options.set_attribute_int(1, "quantization_bits", 9);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut stream = EncoderBuffer::new();
    encoder.encode(&options, &mut stream).unwrap();
    let n = hills.positions.len();
    let accessors = json!([
        { "componentType": 5126, "count": n, "type": "VEC3", "min": [0, 0, -0.25], "max": [1, 1, 0.25] },
        { "componentType": 5126, "count": n, "type": "VEC3" },
        { "componentType": 5123, "count": 3 * hills.triangles.len(), "type": "SCALAR" },
    ]);
    let primitive = json!({ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2,
        "extensions": { DRACO: { "bufferView": 0, "attributes": { "POSITION": 0, "NORMAL": 1 } } } });
    let length = stream.data().len();
    let views = json!([{ "buffer": 0, "byteLength": length }]);
    let document = document(accessors, views, json!([{ "byteLength": length }]), primitive, DRACO);
    glb::file(&document, stream.data())
}

#[track_caller]
fn imported(bytes: &[u8]) -> Imported {
    let (_folder, path) = scene_file("scene.glb", bytes);
    let imported = import(&path, &ImportOptions { strict: true, ..Default::default() }).unwrap();
    check_scene(&imported).unwrap();
    imported
}

#[test]
fn meshopt_streams_hold_what_was_packed() {
    const EXT: &str = "EXT_meshopt_compression";
    // Half a step of 8 bits in either direction of the octahedron, which stretches by at most 2.
    let tilt = 2.0 * std::f32::consts::SQRT_2 / 127.0;
    for (extension, version, exponential, sequence) in
        [(EXT, 0, false, false), (EXT, 0, true, true), ("KHR_meshopt_compression", 1, false, true)]
    {
        let scene = imported(&meshopt(extension, version, exponential, sequence)).scene;
        // A mantissa of 20 bits with its sign, over the largest component.
        let far = if exponential { 2.0_f32.powi(-18) } else { 0.0 };
        hills().agree(&scene.meshes[0], far, tilt);
    }
}

#[test]
fn draco_streams_hold_what_was_packed() {
    for speed in [0, 5, 10] {
        let scene = imported(&draco(speed)).scene;
        // Half a step of 12 bits in each coordinate of a unit square; of 9 bits in the octahedron.
        let far = 0.5 * 3.0_f32.sqrt() / 4095.0 + 1e-6;
        hills().agree(&scene.meshes[0], far, 2.0 * std::f32::consts::SQRT_2 / 255.0);
    }
}

#[test]
fn a_stream_that_is_not_what_the_document_says_is_refused() {
    let refused = |bytes: &[u8], from: &str, to: &str, word: &str| {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let (json, rest) = bytes[20..].split_at(length);
        let changed = text(json).replacen(from, to, 1);
        assert_ne!(changed, text(json), "nothing to change");
        let (_folder, path) = scene_file("scene.glb", glb::file(&serde_json::from_str(&changed).unwrap(), &rest[8..]));
        let error = import(&path, &ImportOptions::default()).map(|_| ()).unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains(word), "no `{word}` in: {error}");
    };
    let packed = meshopt("EXT_meshopt_compression", 0, false, false);
    refused(&packed, r#""mode":"TRIANGLES""#, r#""mode":"QUADS""#, "TRIANGLES or INDICES");
    refused(&packed, r#""mode":"TRIANGLES""#, r#""mode":"INDICES""#, "the meshopt stream is damaged");
    refused(&packed, r#""filter":"OCTAHEDRAL""#, r#""filter":"COLOR""#, "filter");
    refused(&packed, r#""count":289,"filter""#, r#""count":288,"filter""#, "expected elements that fill the view's");
    let packed = draco(0);
    let attributes = |normal: u32| format!(r#""NORMAL":{normal},"POSITION":0}},"bufferView""#);
    refused(&packed, &attributes(1), &attributes(7), "an attribute 7");
    refused(&packed, r#""count":1536"#, r#""count":1539"#, "289 vertices and 513 triangles");
    refused(&packed, r#""count":1536"#, r#""count":1533"#, "the Draco stream is damaged");
    refused(&packed, r#""componentType":5126"#, r#""componentType":5123"#, "VEC3");
}

/// A triangle with a base colour from `textures`, in a folder with pictures.
fn textured(textures: &str, images: &[(&str, &[u8])]) -> Imported {
    let primitive = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}"#;
    let coordinates = floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let mut parts = with(coordinates, &accessor(36, 5126, 3, "VEC2", false), primitive);
    parts.more = format!(
        r#","materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"textures":[{textures}],
        "images":[{}]"#,
        images.iter().map(|(name, _)| format!(r#"{{"uri":"{name}"}}"#)).collect::<Vec<_>>().join(",")
    );
    let (folder, path) = scene_file("scene.gltf", parts.json());
    images.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    import(&path, &ImportOptions::default()).unwrap()
}

fn shown(scene: &Scene) -> Option<&str> {
    let texture = scene.materials[0].textures[TextureSlot::BaseColor].as_ref()?;
    Some(&scene.images[scene.textures[texture.texture as usize].image as usize].name)
}

#[test]
fn webp_is_decoded_and_preferred_and_its_fallback_taken_where_it_is_damaged() {
    let picture = image::RgbImage::from_fn(37, 21, |x, y| image::Rgb([x as u8, y as u8, (7 * x * y) as u8]));
    let encoded = |format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let (png, webp) = (encoded(image::ImageFormat::Png), encoded(image::ImageFormat::WebP));
    let both = r#"{"source":0,"extensions":{"EXT_texture_webp":{"source":1}}}"#;
    let scene = textured(both, &[("a.png", &png), ("a.webp", &webp)]).scene;
    assert_eq!(shown(&scene), Some("a.webp"));
    let Texels::Rgb8(texels) = &scene.images[0].texels else { panic!("opaque pictures have no alpha") };
    assert!(texels.iter().zip(picture.pixels()).all(|(ours, theirs)| *ours == theirs.0), "WebP without loss");
    let damaged = &webp[..16];
    assert_eq!(shown(&textured(both, &[("a.png", &png), ("a.webp", damaged)]).scene), Some("a.png"));
    let alone = r#"{"extensions":{"EXT_texture_webp":{"source":0}}}"#;
    assert_eq!(shown(&textured(alone, &[("a.webp", &webp)]).scene), Some("a.webp"));
    assert_eq!(shown(&textured(alone, &[("a.webp", damaged)]).scene), None);
}

/// A triangle with a KTX2 picture.
fn basis_universal(picture: &[u8]) -> Imported {
    textured(r#"{"extensions":{"KHR_texture_basisu":{"source":0}}}"#, &[("a.ktx2", picture)])
}

/// A KTX2 file of one level of 16 x 16 texels in UASTC blocks. `vk_format` 0 says that they are.
pub fn ktx2(blocks: &[u8], vk_format: u32) -> Vec<u8> {
    let mut out = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    let words = |out: &mut Vec<u8>, words: &[u32]| out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    words(&mut out, &[vk_format, 1, 16, 16, 0, 0, 1, 1, 0]);
    // Where the descriptor is, no keys, no global data; then the level: its place, its length, and that once more.
    words(&mut out, &[104, 44, 0, 0, 0, 0, 0, 0, 160, 0, blocks.len() as u32, 0, blocks.len() as u32, 0]);
    // The descriptor: Khronos' basic block, model UASTC, BT.709, linear, blocks of 4 x 4 in 16 bytes, one sample of RGB.
    words(&mut out, &[44, 0, 2 | 40 << 16, 166 | 1 << 8 | 1 << 16, 3 | 3 << 8, 16, 0, 127 << 16, 0, 0, u32::MAX]);
    out.resize(160, 0);
    out.extend(blocks);
    out
}

#[test]
fn basis_universal_pictures_are_decoded_or_left_out() {
    // 16 blocks by the reference encoder of (16 x, 16 y, 8 (x + y)), and what the reference transcoder makes of them.
    let (blocks, expected) = include_bytes!("data/uastc.bin").split_at(256);
    let good = ktx2(blocks, 0);
    let scene = basis_universal(&good).scene;
    assert_eq!(shown(&scene), Some("a.ktx2"));
    let Texels::Rgb8(texels) = &scene.images[0].texels else { panic!("opaque pictures have no alpha") };
    assert_eq!(texels.as_flattened(), expected);
    let other = basis_universal(&ktx2(blocks, 23));
    assert!(shown(&other.scene).is_none());
    assert!(other.report.notes.iter().any(|n| n.text.contains("not Basis Universal")), "{:?}", other.report.notes);
    for seed in 0..300 {
        let mut random = Random(seed);
        let mut bytes = good.clone();
        for _ in 0..1 + random.below(4) {
            let at = random.below(if seed % 2 == 0 { 160 } else { bytes.len() });
            // Not the size, which is an error where it is too large.
            if !(20..28).contains(&at) {
                bytes[at] = random.below(256) as u8;
            }
        }
        // Shown or left out with a note: neither is an error.
        check_scene(&basis_universal(&bytes)).unwrap();
    }
}

/// The same file with its level in a Zstandard frame, which claims to unpack to `unpacked` bytes. RFC 8878, 3.1.1: a window
/// descriptor, then blocks: `repeats` of 128 KiB of zeros, and the content as it is.
fn ktx2_zstandard(blocks: &[u8], window: u8, repeats: usize, unpacked: u64) -> Vec<u8> {
    let mut frame = b"\x28\xB5\x2F\xFD\x00".to_vec();
    frame.push(window);
    for _ in 0..repeats {
        frame.extend(&((128_u32 << 10) << 3 | 1 << 1).to_le_bytes()[..3]);
        frame.push(0);
    }
    frame.extend(&((blocks.len() as u32) << 3 | 1).to_le_bytes()[..3]);
    frame.extend(blocks);
    let mut file = ktx2(&frame, 0);
    file[44..48].copy_from_slice(&2_u32.to_le_bytes());
    file[96..104].copy_from_slice(&unpacked.to_le_bytes());
    file
}

#[test]
fn what_a_level_says_of_its_size_is_not_believed() {
    let (blocks, expected) = include_bytes!("data/uastc.bin").split_at(256);
    // A window of 1 KiB; then of 8 MiB, which decoders support.
    for window in [0, 13 << 3] {
        let scene = basis_universal(&ktx2_zstandard(blocks, window, 0, 256)).scene;
        let Some(Texels::Rgb8(texels)) = scene.images.first().map(|image| &image.texels) else { panic!("not shown") };
        assert_eq!(texels.as_flattened(), expected);
    }
    let mut unknown = ktx2(blocks, 0);
    unknown[44..48].copy_from_slice(&0x1_0000_u32.to_le_bytes());
    for (bytes, why) in [
        (ktx2_zstandard(blocks, 0, 0, 1536 << 20), "unpacks to 1610612736 bytes, not 256"),
        (ktx2_zstandard(blocks, 0, 0, u64::MAX), "unpacks to 18446744073709551615 bytes"),
        (ktx2_zstandard(blocks, 0, 0, 257), "unpacks to 257 bytes"),
        // A frame of which the decoder would keep everything: 8 GiB in 262 KB.
        (ktx2_zstandard(blocks, 31 << 3, 1 << 16, 256), "window is 2199023255552 bytes"),
        (ktx2_zstandard(blocks, 14 << 3, 0, 256), "window is 16777216 bytes"),
        (unknown, "supercompression scheme 65536"),
    ] {
        let import = basis_universal(&bytes);
        assert!(shown(&import.scene).is_none());
        assert!(import.report.notes.iter().any(|n| n.text.contains(why)), "{why}: {:?}", import.report.notes);
    }
}

#[test]
fn a_fallback_and_its_streams_agree() {
    let Some(folder) = shared::folder() else { return };
    let load = |name: &str| import(&folder.join("compressed").join(name), &ImportOptions::default()).unwrap().scene;
    let plain = load("meshopt_fallback/meshopt-fallback.gltf");
    let packed = load("meshopt_no_fallback/meshopt-no-fallback.gltf");
    assert_eq!(plain.meshes.len(), packed.meshes.len());
    for (plain, packed) in plain.meshes.iter().zip(&packed.meshes) {
        assert_eq!(plain.indices.len(), packed.indices.len());
        assert_eq!(plain.positions[..], packed.positions[..]);
    }
}
