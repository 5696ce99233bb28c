//! Small faults that have one obvious reading, and faults in what nothing shown needs, are notes and stop nothing.

use bismar::scene::import::{ImportOptions, NoteKind, import};
use bismar::scene::{PunctualKind, Scene, TextureSlot};

use crate::helpers::glb;
use crate::helpers::gltf_parts::{Parts, TRIANGLE, check_scene, floats, scene_file};
use crate::import_content::{accessor, with};

/// Imports; some note of this kind has this word.
fn noted(parts: Parts, kind: NoteKind, word: &str) -> Scene {
    let imported = parts.import().unwrap();
    let notes = &imported.report.notes;
    assert!(notes.iter().any(|n| n.kind == kind && n.text.contains(word)), "no {kind:?} `{word}` in {notes:?}");
    imported.scene
}

#[test]
fn vertex_colours_are_clamped() {
    let colors = floats(&[2.0, 0.5, -1.0, 1.0].repeat(3));
    let parts = with(colors, &accessor(36, 5126, 3, "VEC4", false), r#"{"attributes":{"POSITION":0,"COLOR_0":1}}"#);
    let scene = noted(parts, NoteKind::Repaired, "colours");
    assert_eq!(scene.meshes[0].colors.as_ref().unwrap()[0], [1.0, 0.5, 0.0, 1.0]);
}

#[test]
fn a_specular_factor_above_1_is_clamped() {
    let parts = Parts::of_materials(r#"{"extensions":{"KHR_materials_specular":{"specularFactor":1.5}}}"#);
    let scene = noted(parts, NoteKind::Repaired, "clamped");
    assert_eq!(scene.materials[0].specular, 1.0);
}

#[test]
fn names_and_numbers_that_the_specification_does_not_know_are_notes() {
    let primitive = r#"{"attributes":{"POSITION":0,"POSITIONS":0,"TEXCOORD_A":0}}"#.into();
    noted(Parts { primitive, ..Default::default() }, NoteKind::Repaired, "TEXCOORD_A");
    for filter in ["magFilter", "minFilter"] {
        let more = format!(r#","samplers":[{{"{filter}":1}}]"#);
        noted(Parts { more, ..Default::default() }, NoteKind::Repaired, "filter");
    }
}

#[test]
fn equal_cone_angles_make_a_spot_and_unknown_types_no_light() {
    let spot = |angles: &str| Parts::of_light(&format!(r#"{{"type":"spot","spot":{{{angles}}}}}"#));
    let scene = noted(spot(r#""innerConeAngle":0.5,"outerConeAngle":0.5"#), NoteKind::Repaired, "cone angles");
    assert_eq!(scene.lights[0].kind, PunctualKind::Spot { inner: 0.5, outer: 0.5 });
    for refused in [r#""innerConeAngle":0.6,"outerConeAngle":0.5"#, r#""outerConeAngle":0"#, r#""outerConeAngle":2"#] {
        assert!(spot(refused).import().is_err(), "{refused}");
    }
    assert!(noted(Parts::of_light(r#"{"type":"area"}"#), NoteKind::Ignored, "type").lights.is_empty());
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let (_folder, path) = scene_file("scene.gltf", format!("\u{feff}{}", Parts::default().json()));
    let report = import(&path, &ImportOptions { strict: true, ..Default::default() }).unwrap().report;
    assert!(report.of_kind(NoteKind::Repaired).any(|n| n.text.contains("byte-order")));
}

#[test]
fn a_backslash_separates_folders_unless_a_file_has_it_in_its_name() {
    let (folder, path) = scene_file("scene.gltf", Parts::default().json_with(r"sub\\data.bin"));
    let second = || {
        let imported = import(&path, &ImportOptions::default()).unwrap();
        assert!(imported.report.of_kind(NoteKind::Repaired).any(|n| n.at == "buffers[0].uri"));
        imported.scene.meshes[0].positions[1]
    };
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("sub/data.bin"), floats(&TRIANGLE)).unwrap();
    assert_eq!(second(), [1.0, 0.0, 0.0]);
    std::fs::write(folder.path().join(r"sub\data.bin"), floats(&TRIANGLE.map(|x| 2.0 * x))).unwrap();
    assert_eq!(second(), [2.0, 0.0, 0.0]);
}

#[test]
fn faults_in_what_nothing_shown_needs_are_notes() {
    let view = r#"{"bufferView":9,"componentType":5126,"count":3,"type":"VEC3"}"#;
    for (accessor, nodes, more) in [
        // The second accessor is faulty: unused, in a mesh that no node places, in a node that the scene does not show.
        (view, "", ""),
        (view, "", r#","skins":[{"joints":[0],"inverseBindMatrices":1}]"#),
        (view, r#",{"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}}}"#, ""),
        ("", r#",{"mesh":9}"#, ""),
        ("", r#",{"camera":0}"#, r#","cameras":[{"type":"perspective","perspective":{"yfov":-1}}]"#),
        ("", "", r#","materials":[{"alphaMode":"GLASS"}]"#),
        ("", "", r#","textures":[{"source":7}]"#),
        ("", "", r#","samplers":[{"wrapS":1}]"#),
        ("", "", r#","images":[{"uri":"not_there.png"}]"#),
        ("", "", r#","images":[{"bufferView":3}]"#),
        ("", "", r#","animations":[{"channels":[{"sampler":1,"target":{"path":"scale"}}],"samplers":[]}]"#),
        ("", "", r#","extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":-1}]}}"#),
    ] {
        let default = Parts::default();
        let accessor = format!("{}{}{accessor}", default.accessor, if accessor.is_empty() { "" } else { "," });
        let nodes = format!(r#"[{{"mesh":0}}{nodes}]"#);
        let parts = Parts { accessor, nodes: nodes.clone(), more: more.into(), ..default };
        assert_eq!(noted(parts, NoteKind::NotLoaded, "faulty").instances.len(), 1, "{nodes} {more}");
    }
}

#[test]
fn a_buffer_that_nothing_shown_needs_may_be_missing() {
    let json =
        Parts::default().json().replace(r#""buffers":["#, r#""buffers":[{"uri":"not_there.bin","byteLength":9},"#);
    let json = json.replace(r#""buffer":0"#, r#""buffer":1"#);
    let (_folder, path) = scene_file("scene.gltf", &json);
    let report = import(&path, &ImportOptions { strict: true, ..Default::default() }).unwrap().report;
    assert!(report.of_kind(NoteKind::NotLoaded).any(|n| n.at == "buffers[0]" && n.text.contains("not_there.bin")));
    let (_folder, path) = scene_file("scene.gltf", json.replace(r#""buffer":1"#, r#""buffer":0"#));
    assert_eq!(import(&path, &ImportOptions::default()).unwrap_err().exit_code(), 66);
}

#[test]
fn damaged_data_of_a_mesh_that_is_not_placed_is_not_read() {
    let wild = floats(&[f32::NAN; 9]);
    let mut parts = with(wild, &accessor(36, 5125, 9, "SCALAR", false), r#"{"attributes":{"POSITION":0}}"#);
    parts.primitive += r#"]},{"primitives":[{"attributes":{"POSITION":0},"indices":1}"#;
    assert_eq!(parts.import().unwrap().scene.meshes.len(), 1);
    parts.nodes = r#"[{"mesh":1}]"#.into();
    assert!(parts.import().is_err());
}

#[test]
fn a_fault_in_a_file_that_shows_nothing_is_an_error() {
    let document = r#"{"asset":{"version":"2.0"},"accessors":[{}]}"#;
    let (_folder, path) = scene_file("scene.gltf", document);
    let error = import(&path, &ImportOptions::default()).unwrap_err();
    assert!(error.to_string().contains("accessors[0]"), "{error}");
}

#[test]
fn a_picture_that_cannot_be_used_leaves_the_factor() {
    let good = glb::png(image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([x as u8, y as u8, (x * y) as u8])));
    let damaged = &good[..good.len() / 2];
    let primitive = r#"{"attributes":{"POSITION":0,"NORMAL":0,"TEXCOORD_0":1},"material":0}"#;
    let more = r#","materials":[{"normalTexture":{"index":0},"pbrMetallicRoughness":{"baseColorTexture":{"index":1}}}],
        "textures":[{"source":0},{"source":1}],"images":[{"uri":"bad.png","mimeType":"image/avif"},{"uri":"good.png"}]"#;
    let mut parts = with(floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), &accessor(36, 5126, 3, "VEC2", false), primitive);
    parts.more = more.into();
    for bad in [None, Some(damaged), Some(b"\x89PNG damaged"), Some(b"GIF89a"), Some(b"")] {
        let (folder, path) = scene_file("scene.gltf", parts.json());
        std::fs::write(folder.path().join("good.png"), &good).unwrap();
        if let Some(bad) = bad {
            std::fs::write(folder.path().join("bad.png"), bad).unwrap();
        }
        let imported = import(&path, &ImportOptions::default()).unwrap();
        check_scene(&imported).unwrap();
        let ignored: Vec<_> = imported.report.of_kind(NoteKind::Ignored).collect();
        assert!(ignored.len() == 1 && ignored[0].text.contains("factor alone"), "{ignored:?}");
        assert_eq!(ignored[0].at, "images[0]");
        let material = &imported.scene.materials[0];
        assert!(material.textures[TextureSlot::Normal].is_none());
        assert_eq!(material.textures[TextureSlot::BaseColor].as_ref().unwrap().texture, 0);
        assert_eq!(imported.scene.images[0].name, "good.png");
        let error = import(&path, &ImportOptions { strict: true, ..Default::default() }).unwrap_err();
        assert!(error.to_string().contains("images[0]"), "{error}");
        // A picture of this kind next to a core one is not even looked at.
        let json = parts
            .json()
            .replace(r#"[{"source":0},"#, r#"[{"source":1,"extensions":{"EXT_texture_avif":{"source":0}}},"#);
        std::fs::write(&path, json).unwrap();
        let imported = import(&path, &ImportOptions { strict: true, ..Default::default() }).unwrap();
        assert!(imported.scene.meshes[0].tangents.is_some());
    }
}
