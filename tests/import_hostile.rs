//! Files made to break an importer: an error that says where, in time, never a panic.

use std::path::Path;
use std::sync::Arc;

use bismar::Error;
use bismar::rays::{self, Backend};
use bismar::scene::import::Imported;

use crate::helpers::glb::{self, BIN, JSON, container};
use crate::helpers::gltf_parts::{LONGEST, Parts, TRIANGLE, attempt, check_scene, floats, scene_file};
use crate::import_content::{accessor, with};

/// Imports a document; a panic or a long wait fails the test.
fn import_json(document: &str) -> Result<Imported, Error> {
    let (_folder, path) = scene_file("scene.gltf", document);
    in_time(&path)
}

fn in_time(path: &Path) -> Result<Imported, Error> {
    let (outcome, time) = attempt(path);
    assert!(time < LONGEST, "took {time:?}");
    outcome.unwrap_or_else(|panic| panic!("panicked: {panic}"))
}

/// Fails with exit code 65 (66 for missing files), and the text has all of `words`.
fn refused(outcome: Result<Imported, Error>, words: &[&str]) {
    let error = outcome.map(|_| ()).expect_err("a hostile file was accepted");
    assert!(matches!(error.exit_code(), 65 | 66), "{} {error}", error.exit_code());
    for word in words {
        assert!(error.to_string().contains(word), "no `{word}` in: {error}");
    }
}

#[test]
fn one_triangle_loads_and_gets_a_framed_view() {
    let imported = Parts::default().import().unwrap();
    check_scene(&imported).unwrap();
    assert_eq!(imported.report.counts.triangles, 1);
    assert_eq!(imported.scene.cameras[0].name, "framed");
    assert!(imported.scene.instances[0].transform.is_none());
}

#[test]
fn a_document_without_triangles_is_an_empty_scene() {
    let imported = import_json(r#"{"asset":{"version":"2.0"}}"#).unwrap();
    assert!(imported.scene.instances.is_empty() && imported.scene.meshes.is_empty());
    check_scene(&imported).unwrap();
}

#[test]
fn a_chain_of_100000_nodes_is_walked() {
    let n = 100_000;
    let nodes: Vec<_> = (0..n - 1).map(|i| format!(r#"{{"children":[{}]}}"#, i + 1)).collect();
    let nodes = format!(r#"[{},{{"mesh":0}}]"#, nodes.join(","));
    assert_eq!(Parts { nodes, ..Default::default() }.import().unwrap().scene.instances.len(), 1);
}

#[test]
fn cycles_and_shared_children_are_refused() {
    for (nodes, at) in [
        (r#"[{"children":[0]}]"#, "nodes[0]"),
        (r#"[{"children":[1]},{"children":[0]}]"#, "nodes["),
        (r#"[{},{"children":[2]},{"children":[1]}]"#, "nodes[1]"),
        (r#"[{"children":[1,2]},{"children":[3]},{"children":[3]},{}]"#, "nodes[3]"),
        (r#"[{"children":[1,1]},{}]"#, "nodes[0].children[1]"),
    ] {
        refused(Parts { nodes: nodes.into(), ..Default::default() }.import(), &[at]);
    }
    // 2^40 paths, were they walked.
    let levels: Vec<_> = (0..40).map(|i| format!(r#"{{"children":[{0},{0}]}}"#, i + 1)).collect();
    refused(Parts { nodes: format!("[{},{{}}]", levels.join(",")), ..Default::default() }.import(), &["children"]);
}

#[test]
fn deeply_nested_json_is_refused() {
    let n = 100_000;
    let document = format!(r#"{{"asset":{{"version":"2.0"}},"extras":{}{}}}"#, "[".repeat(n), "]".repeat(n));
    refused(import_json(&document), &["not valid JSON"]);
}

#[test]
fn memory_out_of_proportion_is_refused() {
    let huge = r#"{"componentType":5126,"count":4000000000,"type":"VEC3"}"#;
    refused(Parts { accessor: huge.into(), ..Default::default() }.import(), &["accessors[0]", "4000000000"]);
    let largest = r#"{"componentType":5126,"count":9007199254740991,"type":"MAT4"}"#;
    let more = r#","skins":[{"joints":[0],"inverseBindMatrices":1}]"#.into();
    let accessor = format!("{},{largest}", Parts::default().accessor);
    assert!(Parts { accessor, more, ..Default::default() }.import().is_ok(), "an unused skin is not read");
    let sparse = r#"{"componentType":5126,"count":4000000000,"type":"VEC3","sparse":{"count":4000000000,
        "indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0}}}"#;
    refused(Parts { accessor: sparse.into(), ..Default::default() }.import(), &["accessors[0].sparse.indices"]);
    // A thousand meshes that each unfold a million zeros.
    let primitive = vec![r#"{"attributes":{"POSITION":0}}"#; 1000].join(",");
    let accessor = r#"{"componentType":5126,"count":1000000,"type":"VEC3"}"#.into();
    refused(Parts { accessor, primitive, ..Default::default() }.import(), &["unfold", "1000000 elements"]);
    let nodes = r#"[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}}}]"#.into();
    let accessor =
        format!(r#"{},{{"componentType":5126,"count":1000000000,"type":"VEC3"}}"#, Parts::default().accessor);
    refused(Parts { accessor, nodes, ..Default::default() }.import(), &["accessors[1]"]);
}

#[test]
fn one_file_named_many_times_counts_once() {
    let (_folder, path) = scene_file("data.bin", vec![0; 8 << 20]);
    let buffer = r#"{"uri":"data.bin","byteLength":8388608}"#;
    let view = |i: usize| format!(r#"{{"buffer":{i},"byteLength":8388608}}"#);
    let accessor = |i: usize| format!(r#"{{"bufferView":{i},"componentType":5126,"count":699050,"type":"VEC3"}}"#);
    let list = |item: &dyn Fn(usize) -> String| (0..500).map(item).collect::<Vec<_>>().join(",");
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{}],"bufferViews":[{}],"accessors":[{}],"meshes":[{}],"nodes":[{}]}}"#,
        list(&|_| buffer.into()),
        list(&view),
        list(&accessor),
        list(&|i| format!(r#"{{"primitives":[{{"attributes":{{"POSITION":{i}}}}}]}}"#)),
        list(&|i| format!(r#"{{"mesh":{i}}}"#)),
    );
    let scene = path.with_file_name("scene.gltf");
    std::fs::write(&scene, json).unwrap();
    refused(in_time(&scene), &["unfold"]);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"images":[{}],"textures":[{}],"materials":[{}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{}]}}],"accessors":[{{"componentType":5126,"count":3,"type":"VEC3"}}]}}"#,
        list(&|_| r#"{"uri":"data.bin"}"#.into()),
        list(&|i| format!(r#"{{"source":{i}}}"#)),
        list(&|i| format!(r#"{{"emissiveFactor":[1,1,1],"emissiveTexture":{{"index":{i}}}}}"#)),
        list(&|i| format!(r#"{{"attributes":{{"POSITION":0}},"material":{i}}}"#)),
    );
    std::fs::write(&scene, json).unwrap();
    refused(in_time(&scene), &["unfold"]);
}

#[test]
fn lying_accessors_are_refused() {
    let import = |component: u32, fields: &str, shape: &str| {
        let accessor = format!(r#"{{"bufferView":0,"componentType":{component},{fields},"type":"{shape}"}}"#);
        Parts { accessor, ..Default::default() }.import()
    };
    for (component, fields, shape, words) in [
        (5126, r#""count":4"#, "VEC3", ["accessors[0]", "36 bytes"]),
        (5126, r#""count":0"#, "VEC3", ["accessors[0].count", "at least 1"]),
        (5126, r#""count":-1"#, "VEC3", ["accessors[0].count", "-1"]),
        (5126, r#""count":2.5"#, "VEC3", ["accessors[0].count", "2.5"]),
        (5126, r#""count":18446744073709551615"#, "VEC3", ["accessors[0]", "36"]),
        (5126, r#""count":1,"byteOffset":18446744073709551612"#, "VEC3", ["accessors[0].byteOffset", ""]),
        (5122, r#""count":3"#, "VEC3", ["POSITION", "SHORT"]),
        (5126, r#""count":3"#, "VEC2", ["POSITION", "VEC2"]),
        (5124, r#""count":3"#, "VEC3", ["accessors[0].componentType", "5124"]),
    ] {
        refused(import(component, fields, shape), &words);
    }
    let accessor = r#"{"bufferView":7,"componentType":5126,"count":3,"type":"VEC3"}"#.into();
    refused(Parts { accessor, ..Default::default() }.import(), &["accessors[0].bufferView", "7"]);
    assert!(import(5126, r#""count":3.0"#, "VEC3").is_ok());
}

#[test]
fn wrong_values_are_refused_with_their_place() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut positions = TRIANGLE;
        positions[4] = bad;
        // Its only triangle is left out, and told.
        let imported = Parts { positions: floats(&positions), ..Default::default() }.import().unwrap();
        assert!(imported.scene.instances.is_empty());
        assert!(imported.report.notes.iter().any(|note| note.text.contains("not finite")));
    }
    let with_indices = |indices: &[u8]| {
        let accessor = accessor(36, 5121, indices.len(), "SCALAR", false);
        with(indices.to_vec(), &accessor, r#"{"attributes":{"POSITION":0},"indices":1}"#).import()
    };
    assert_eq!(with_indices(&[0, 1, 2, 2, 1, 0]).unwrap().report.counts.triangles, 2);
    refused(with_indices(&[0, 1, 3]), &["accessors[1]", "below 3", "3 as number 2"]);
    refused(with_indices(&[0, 1, 255]), &["accessors[1]", "255"]);
    // Every second byte, or all of them?
    let mut parts = with(
        vec![0, 0, 1, 0, 2],
        &accessor(0, 5121, 3, "SCALAR", false).replace(r#"View":0"#, r#"View":1"#),
        r#"{"attributes":{"POSITION":0},"indices":1}"#,
    );
    parts.more =
        r#","bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":5,"byteStride":2}]"#
            .into();
    refused(parts.import(), &["primitives[0].indices", "without byteStride", "bufferViews[1]"]);
}

#[test]
fn values_of_wrong_types_are_refused_with_their_place_and_what_was_wanted() {
    let camera = |camera: &str| {
        let (nodes, more) = (r#"[{"mesh":0,"camera":0}]"#.into(), format!(r#","cameras":[{camera}]"#));
        (Parts { nodes, more, ..Default::default() }, "cameras[0]")
    };
    let light = |light: &str| (Parts::of_light(light), "extensions.KHR_lights_punctual.lights[0]");
    let material = |material: &str| {
        let mut parts = Parts::of_materials(material);
        parts.more += r#","textures":[{}]"#;
        (parts, "materials[0]")
    };
    for ((parts, at), words) in [
        (material(r#"{"normalTexture":{"index":0,"scale":"big"}}"#), [".normalTexture.scale", "a number", "big"]),
        (material(r#"{"normalTexture":{"index":4294967296}}"#), [".normalTexture.index", "an index", "4294967296"]),
        (material(r#"{"normalTexture":{"index":1}}"#), [".normalTexture.index", "textures", "1"]),
        (material(r#"{"normalTexture":{}}"#), [".normalTexture.index", "a value", "nothing"]),
        (material(r#"{"emissiveFactor":[1,2]}"#), [".emissiveFactor", "array of length 3", "length 2"]),
        (material(r#"{"emissiveFactor":[1,2,1e39]}"#), [".emissiveFactor[2]", "32-bit float", "1e+39"]),
        (material(r#"{"doubleSided":1}"#), [".doubleSided", "a boolean", "1"]),
        (material(r#"{"alphaMode":"GLASS"}"#), [".alphaMode", "MASK", "GLASS"]),
        (material(r#"{"emissiveFactor":[1,2,null]}"#), [".emissiveFactor[2]", "a value", "null"]),
        (material(r#"{"extensions":{"KHR_materials_ior":{"ior":0.5}}}"#), [".ior", "at least 1", "0.5"]),
        (material("[]"), ["", "an object", "an array"]),
        (camera(r#"{"type":"perspective"}"#), [".perspective", "a value", "nothing"]),
        (camera(r#"{"type":"fisheye"}"#), [".type", "orthographic", "fisheye"]),
        (camera(r#"{"type":"perspective","perspective":{"znear":1}}"#), [".perspective.yfov", "a value", "nothing"]),
        (camera(r#"{"type":"perspective","perspective":{"znear":1,"yfov":4}}"#), [".yfov", "below π", "4"]),
        (camera(r#"{"type":"perspective","perspective":{"znear":2,"zfar":1,"yfov":1}}"#), [".zfar", "znear", "1"]),
        (light(r#"{"type":"point","color":[1,1]}"#), [".color", "array of length 3", "length 2"]),
        (light(r#"{"type":"point","range":-1}"#), [".range", "above 0", "-1"]),
    ] {
        let words = [&format!("{at}{}", if words[0].is_empty() { ":" } else { "" }), words[0], words[1], words[2]];
        if at != "cameras[0]" {
            refused(parts.import(), &words);
            continue;
        }
        // An error where it is used, and a note.
        let imported = parts.import().unwrap();
        let fault = imported.scene.cameras[0].fault.as_ref().unwrap();
        assert!(words.iter().all(|word| fault.contains(word)), "{fault}");
        assert!(imported.report.notes.iter().any(|note| note.at == at && note.text.contains(&**fault)));
    }
    // JSON has one kind of number.
    let (parts, _) = material(r#"{"normalTexture":{"index":0.0,"texCoord":1.0,"scale":10000000000}}"#);
    assert_eq!(parts.import().unwrap().scene.materials[0].normal_scale, 1e10);
}

#[test]
fn positions_beyond_what_can_be_traced_are_refused() {
    let one = r#"{"mesh":0,"scale":[1e10,1e10,1e10]}"#;
    for nodes in [format!("[{one}]"), format!(r#"[{{"children":[1,2]}},{one},{one}]"#)] {
        let import = |far: f32| {
            let positions = floats(&TRIANGLE.map(|x| x * far));
            Parts { positions, nodes: nodes.clone(), ..Default::default() }.import()
        };
        // The rule of the ray queries: 1e18 m.
        for far in [1e10, 1.5e8] {
            refused(import(far), &["nodes[", "scale"]);
        }
        let scene = import(0.9e8).unwrap().scene;
        rays::build(Backend::Obvhs, Arc::new(scene)).unwrap();
    }
}

#[test]
fn a_flat_placement_is_dropped_with_a_note() {
    let nodes = r#"[{"mesh":0,"scale":[1,0,1]}]"#.into();
    let imported = Parts { nodes, ..Default::default() }.import().unwrap();
    assert!(imported.scene.instances.is_empty());
    assert!(imported.report.notes.iter().any(|n| n.text.contains("to lines")));
}

#[test]
fn uris_cannot_leave_the_scenes_folder() {
    let outer = tempfile::tempdir().unwrap();
    let inner = outer.path().join("inner");
    std::fs::create_dir_all(inner.join("sub")).unwrap();
    let secret = outer.path().join("secret.bin");
    std::fs::write(&secret, floats(&TRIANGLE)).unwrap();
    std::fs::write(inner.join("sub/in side.bin"), floats(&TRIANGLE)).unwrap();
    std::os::unix::fs::symlink(&secret, inner.join("link.bin")).unwrap();
    std::os::unix::fs::symlink(outer.path(), inner.join("up")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", inner.join("zero.bin")).unwrap();
    let path = inner.join("scene.gltf");
    let import_uri = |uri: &str| {
        std::fs::write(&path, Parts::default().json_with(uri)).unwrap();
        in_time(&path)
    };
    for good in ["sub/in side.bin", "sub/in%20side.bin", "./sub/../sub/in%20side.bin"] {
        assert_eq!(import_uri(good).unwrap().report.counts.triangles, 1, "{good}");
    }
    let file_url = format!("file://{}", secret.display());
    for bad in [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "%2e%2e%2fsecret.bin",
        "sub/../../secret.bin",
        r"..\\secret.bin",
        r"sub\\..\\..\\secret.bin",
        "%5cetc%5cpasswd",
        "link.bin",
        "up/secret.bin",
        "zero.bin",
        "/etc/passwd",
        "%2fetc%2fpasswd",
        "/dev/zero",
        "file:///etc/passwd",
        &file_url,
        "http://localhost/secret.bin",
        "//localhost/secret.bin",
        "FILE:secret.bin",
        "sub",
        ".",
        "",
        "%00",
        "%ff%fe",
        "data:",
        "data:;base64,!!!!",
        "data:application/octet-stream;;base64,AAAA",
        "data:application/octet-stream;base64,AAAA",
    ] {
        refused(import_uri(bad), &["buffers[0]"]);
    }
    assert_eq!(import_uri("not_there.bin").unwrap_err().exit_code(), 66);
    std::fs::write(inner.join("short.bin"), [0; 35]).unwrap();
    refused(import_uri("short.bin"), &["buffers[0].byteLength", "36"]);
}

#[test]
fn what_is_no_scene_file_is_refused() {
    let (folder, path) = scene_file("scene.glb", b"glTF");
    refused(in_time(&path), &["scene.glb", "header"]);
    refused(in_time(folder.path()), &["not a regular file"]);
    refused(in_time(Path::new("/dev/zero")), &["not a regular file"]);
    assert_eq!(in_time(&folder.path().join("nothing.gltf")).unwrap_err().exit_code(), 66);
}

#[test]
fn the_small_glb_uses_all_that_it_has() {
    let (_folder, path) = scene_file("small.glb", glb::quad());
    let imported = in_time(&path).unwrap();
    check_scene(&imported).unwrap();
    let counts = &imported.report.counts;
    assert_eq!((counts.triangles, counts.images, counts.lights, counts.cameras), (2, 1, 1, 1));
    assert!(imported.scene.meshes[0].tangents.is_some());
    assert!(imported.scene.has_alpha(0));
}

#[test]
fn glb_headers_that_lie_are_refused() {
    let json: &[u8] = br#"{"asset":{"version":"2.0"}}"#;
    let good = container(&[(JSON, json)]);
    let patched = |at: usize, word: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        bytes
    };
    let (_folder, path) = scene_file("scene.glb", &good);
    assert!(in_time(&path).is_ok());
    for (bytes, word) in [
        (patched(0, 0), "magic"),
        (patched(4, 1), "version"),
        (patched(8, 0), "header says 0"),
        (patched(8, 11), "header says 11"),
        (patched(8, u32::MAX), "header says 4294967295"),
        (patched(12, u32::MAX), "4294967295 bytes"),
        (patched(12, 0), "empty"),
        (patched(16, BIN), "JSON chunk first"),
        (good[..15].to_vec(), "header says"),
        (container(&[]), "no JSON chunk"),
        (container(&[(JSON, json), (JSON, json)]), "second JSON"),
        (container(&[(JSON, json), (7, b""), (BIN, b"abcd")]), "BIN"),
        (container(&[(JSON, json), (BIN, b"abcd"), (BIN, b"abcd")]), "BIN"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        refused(in_time(&path), &["scene.glb", word]);
    }
}

#[test]
fn a_picture_that_claims_to_be_huge_is_refused_before_it_is_decoded() {
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(u32::MAX, |crc, &b| {
            (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xEDB8_8320 } else { c >> 1 })
        })
    };
    let chunk = |kind: &[u8], data: &[u8]| {
        let body = [kind, data].concat();
        [&(data.len() as u32).to_be_bytes(), body.as_slice(), &crc(&body).to_be_bytes()].concat()
    };
    for side in [100_000_u32, 30_000, u32::MAX >> 1] {
        let header = [&side.to_be_bytes()[..], &side.to_be_bytes(), &[8, 6, 0, 0, 0]].concat();
        let png =
            [b"\x89PNG\r\n\x1a\n".as_slice(), &chunk(b"IHDR", &header), &chunk(b"IDAT", b"x"), &chunk(b"IEND", b"")];
        let (_folder, path) = scene_file("huge.png", png.concat());
        let primitive = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}"#.into();
        let accessor = format!(r#"{},{{"componentType":5126,"count":3,"type":"VEC2"}}"#, Parts::default().accessor);
        let more = r#","materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
            "textures":[{"source":0}],"images":[{"uri":"huge.png"}]"#
            .into();
        let json = Parts { primitive, accessor, more, ..Default::default() }.json();
        let scene = path.with_file_name("scene.gltf");
        std::fs::write(&scene, json).unwrap();
        refused(in_time(&scene), &["images[0]"]);
    }
}
