//! The memory that a render says it needs before it begins, against what it takes; and files of a kilobyte that ask for much.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::gltf_parts::floats;
use crate::helpers::program::{Folder, bits, expect, read_json, says, stdout};
use crate::reliability::said_to_need;

const MIB: u64 = 1 << 20;

/// A document with one buffer.
#[derive(Default)]
struct Document {
    json: serde_json::Map<String, Value>,
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Document {
    /// Index of an accessor of these floats ("VEC3") or indices ("SCALAR").
    fn accessor(&mut self, bytes: &[u8], kind: &str) -> usize {
        let (width, component) = if kind == "VEC3" { (3, 5126) } else { (1, 5125) };
        self.views.push(json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() }));
        self.binary.extend(bytes);
        let count = bytes.len() / (4 * width);
        let mut accessor =
            json!({ "bufferView": self.views.len() - 1, "componentType": component, "count": count, "type": kind });
        if kind == "VEC3" {
            (accessor["min"], accessor["max"]) = (json!([-1e4, -1e4, -1e4]), json!([1e4, 1e4, 1e4]));
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// A rolling field of `n` x `n` quads.
    fn field(&mut self, n: usize) -> Value {
        let at = |i: usize| 2.0 * i as f32 / n as f32 - 1.0;
        let points = (0..=n).flat_map(|y| (0..=n).map(move |x| (x, y)));
        let positions: Vec<f32> =
            points.flat_map(|(x, y)| [at(x), 0.1 * (9.0 * at(x)).sin() * (7.0 * at(y)).cos(), at(y)]).collect();
        let corner = |x: usize, y: usize| (y * (n + 1) + x) as u32;
        let quads = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
        let indices = quads.flat_map(|(x, y)| {
            let [a, b, c, d] = [corner(x, y), corner(x, y + 1), corner(x + 1, y), corner(x + 1, y + 1)];
            [a, b, c, c, b, d]
        });
        let indices: Vec<u8> = indices.flat_map(u32::to_le_bytes).collect();
        json!({ "attributes": { "POSITION": self.accessor(&floats(&positions), "VEC3") },
            "indices": self.accessor(&indices, "SCALAR") })
    }

    fn set(&mut self, key: &str, value: Value) {
        self.json.insert(key.into(), value);
    }

    fn save(mut self, path: &Path) {
        let nodes = self.json["nodes"].as_array().map_or(0, Vec::len);
        self.set("asset", json!({ "version": "2.0" }));
        self.json.entry("scenes").or_insert_with(|| json!([{ "nodes": (0..nodes).collect::<Vec<_>>() }]));
        self.set("accessors", self.accessors.clone().into());
        self.set("bufferViews", self.views.clone().into());
        self.set("buffers", json!([{ "byteLength": self.binary.len() }]));
        fs::write(path, glb::file(&self.json.clone().into(), &self.binary)).unwrap();
    }
}

/// A node that shows mesh 0 in the places of an accessor.
fn placed(document: &mut Document, accessor: usize) {
    let extension = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": accessor } } });
    document.set("nodes", json!([{ "mesh": 0, "extensions": extension }]));
}

/// The same in so many places.
fn instanced(document: &mut Document, count: usize) {
    let places: Vec<f32> = (0..count).flat_map(|i| [(i % 700) as f32, 0.0, (i / 700) as f32]).collect();
    let accessor = document.accessor(&floats(&places), "VEC3");
    placed(document, accessor);
}

/// An accessor without data; its index.
fn bare(document: &mut Document, count: u64) -> usize {
    document.accessors.push(json!({ "componentType": 5126, "count": count, "type": "VEC3" }));
    document.accessors.len() - 1
}

/// A field of `n` x `n` quads of this material.
fn painted(n: usize, material: Value) -> Document {
    let mut document = fields(n);
    document.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    document.set("materials", json!([material]));
    document
}

fn fields(n: usize) -> Document {
    let mut document = Document::default();
    let field = document.field(n);
    document.set("meshes", json!([{ "primitives": [field] }]));
    document.set("nodes", json!([{ "mesh": 0 }]));
    document
}

/// Half to twice: enough to refuse what cannot fit, and not what can.
#[test]
fn what_a_render_says_it_needs_is_about_what_it_takes() {
    let path = &Folder::new().with_scene("cornell.glb", "cornell.glb");
    fields(400).save(&path.join("mesh.glb"));
    let mut many = fields(1);
    instanced(&mut many, 150_000);
    many.save(&path.join("instances.glb"));
    let mut nodes = fields(1);
    nodes.set("nodes", (0..30_000).map(|i| json!({ "mesh": 0, "translation": [i % 170, 0, i / 170] })).collect());
    nodes.save(&path.join("nodes.glb"));
    let mut lamps = painted(7, json!({ "emissiveFactor": [1, 1, 1] }));
    instanced(&mut lamps, 2000);
    lamps.save(&path.join("lamps.glb"));
    let row: Vec<u8> = (0..2048_u32).flat_map(|x| [(x % 256) as u8, 90, 40, 128]).collect();
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1024 +X 2048\n";
    fs::write(path.join("sky.hdr"), [&head[..], &row.repeat(1024)].concat()).unwrap();
    let small = "--size 64x64 --spp 1";
    for line in [
        "cornell.glb --size 2000x1500 --spp 1".to_owned(),
        "cornell.glb --size 1000x800 --spp 1 --aov all".into(),
        format!("mesh.glb --sky {small}"),
        format!("mesh.glb --sky {small} --rays obvhs"),
        format!("instances.glb --sky {small}"),
        format!("nodes.glb --sky {small}"),
        format!("lamps.glb {small}"),
        format!("cornell.glb {small} --env sky.hdr"),
    ] {
        let said = expect(path, &format!("render {line} --threads 2 -o out.exr --stats out.json -v"), 0);
        let said = said_to_need(&said) * MIB;
        let taken = read_json(&path.join("out.json"))["peak_memory_bytes"].as_u64().unwrap();
        let shown = format!("{line}: {} MiB said, {} taken", said / MIB, taken / MIB);
        assert!(2 * said >= taken && said <= 2 * taken, "{shown}");
    }
}

#[test]
fn counts_without_data_are_bounded_in_words_that_name_them() {
    let path = &Folder::new();
    let refused = |document: Document, words: [&str; 2]| {
        document.save(&path.join("scene.glb"));
        assert!(fs::metadata(path.join("scene.glb")).unwrap().len() < 4096);
        for line in ["inspect scene.glb", "render scene.glb --size 64x64 --spp 1 -q -o out.exr"] {
            let said = expect(path, line, 65);
            assert!(words.iter().all(|word| said.contains(word)), "{said}");
        }
    };
    let instances = |count: u64| {
        let mut document = fields(2);
        let places = bare(&mut document, count);
        placed(&mut document, places);
        document
    };
    refused(instances(1_000_000), ["accessors[2]", "1000000 instances without data"]);
    refused(instances(5_000), ["accessors[2]", "at most 4096"]);
    let mut sparse = instances(1_000_000);
    sparse.accessors[2]["sparse"] = json!({ "count": 1, "indices": { "bufferView": 1, "componentType": 5125 },
        "values": { "bufferView": 0 } });
    refused(sparse, ["accessors[2]", "999999 instances without data"]);
    let mut morphed = fields(2);
    let target = bare(&mut morphed, 3_000_000);
    let primitive = json!({ "attributes": { "POSITION": target }, "targets": [{ "POSITION": target }] });
    morphed.set("meshes", json!([{ "primitives": [primitive], "weights": [1] }]));
    refused(morphed, ["accessors[2]", "3000000 elements without data"]);
    instances(4096).save(&path.join("scene.glb"));
    expect(path, "render scene.glb --size 64x64 --spp 1 -q -o out.exr", 0);
}

#[test]
fn inspect_says_what_a_render_needs_and_both_refuse_what_no_memory_holds() {
    let path = &Folder::new().with_scene("cornell.glb", "cornell.glb");
    let inspected: Value = serde_json::from_str(&stdout(path, "inspect cornell.glb --json", 0)).unwrap();
    let bytes = inspected["render_bytes"].as_u64().unwrap();
    assert!(bytes > 60 * MIB && bytes < 400 * MIB, "{bytes}");
    // A camera sixteen times as high as wide has as high a picture where nobody gives its size.
    let mut high = fields(4);
    high.set("nodes", json!([{ "mesh": 0 }, { "camera": 0, "translation": [0, 1, 4] }]));
    let perspective = json!({ "aspectRatio": 0.0625, "yfov": 1, "znear": 0.1 });
    high.set("cameras", json!([{ "type": "perspective", "perspective": perspective }]));
    high.save(&path.join("high.glb"));
    let line = "render high.glb --sky --spp 1 --aov all --memory-limit 3G -o out.exr";
    says(path, line, 76, "high.glb needs about");
    // A hundred million triangles, all the same, of which the file has three corners.
    let mut document = painted(7, json!({ "emissiveFactor": [1, 1, 1] }));
    let places = bare(&mut document, 2_000_000_000);
    placed(&mut document, places);
    document.save(&path.join("many.glb"));
    for line in ["inspect many.glb", "render many.glb --size 8x8"] {
        let said = expect(path, line, 76);
        assert!(said.contains("many.glb") && said.contains("needs about"), "{line}: {said}");
    }
}

/// A scene in geographic coordinates, an emitter of 3e38 and a lens of centimetres in a scene of millimetres are told.
#[test]
fn what_numbers_cannot_hold_is_told() {
    let path = &Folder::new();
    let render = |flags: &str| expect(path, &format!("render scene.glb --size 16x16 --spp 4 -o out.exr {flags}"), 0);
    let at = |translation: [f64; 3], scale: f64| {
        let mut document = fields(4);
        document.set("nodes", json!([
            { "mesh": 0, "translation": translation, "scale": [scale, scale, scale] },
            { "camera": 0, "translation": [translation[0], translation[1] + 0.5 * scale, translation[2] + 4.0 * scale] },
        ]));
        document.set("cameras", json!([{ "type": "perspective", "perspective": { "yfov": 1, "znear": 0.0001 } }]));
        document.save(&path.join("scene.glb"));
    };
    at([0.0, 0.0, 0.0], 1.0);
    let said = render("--sky --aperture f/2.8 --focus 4");
    assert!(!said.contains("away from the origin") && !said.contains("the lens has"), "{said}");
    // What nodes place far away is moved to the eye; what 32-bit numbers do is not.
    at([4e5, 0.0, 0.0], 1.0);
    assert!(!render("--sky").contains("away from the origin"));
    let mut document = fields(4);
    let there = document.accessor(&floats(&[4e5, 0.0, 0.0]), "VEC3");
    placed(&mut document, there);
    document.save(&path.join("scene.glb"));
    let said = render("--sky");
    assert!(said.contains("4.000e5 m away from the origin") && said.contains("wrong by about 21.2 %"), "{said}");
    at([0.0, 0.0, 0.0], 0.001);
    let said = render("--sky --aperture f/2.8 --focus 0.004");
    assert!(said.contains("the lens has a radius of 3.92e-3 m and is focused at 4.00e-3 m"), "{said}");
    at([0.0, 0.0, 0.0], 1.0);
    // Two pixels, one of them a sun of 3.3e6.
    let sun =
        [&b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"[..], &[200, 200, 200, 150, 90, 80, 70, 128]].concat();
    fs::write(path.join("sun.hdr"), sun).unwrap();
    let said = render("--env sun.hdr");
    assert!(said.contains("sun.hdr: 1 pixels were brighter than 65504") && said.contains("3.27"), "{said}");
    let strength = json!({ "KHR_materials_emissive_strength": { "emissiveStrength": 3e38 } });
    let mut document = painted(4, json!({ "emissiveFactor": [1, 1, 1], "extensions": strength }));
    document.set("extensionsUsed", json!(["KHR_materials_emissive_strength"]));
    document.save(&path.join("scene.glb"));
    let said = render("--camera framed --aov all");
    assert!(said.contains("a light of 3e38 is dimmed to 1e15"), "{said}");
    for (name, bits) in bits(&path.join("out.exr")) {
        let finite = bits.iter().all(|bits| !f32::from_bits(*bits).is_infinite());
        assert!(finite || name.starts_with("depth") || name.contains("rypto"), "infinite values in {name}");
    }
}
