//! Small faults that have one obvious reading, and faults in what nothing shown needs, are notes and stop nothing.

use bismar::scene::import::{ImportOptions, NoteKind, import};
use bismar::scene::{PunctualKind, Scene};

use crate::helpers::gltf_parts::{Parts, TRIANGLE, floats, scene_file};
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
    let more = r#","materials":[{"extensions":{"KHR_materials_specular":{"specularFactor":1.5}}}]"#.into();
    let primitive = r#"{"attributes":{"POSITION":0},"material":0}"#.into();
    let scene = noted(Parts { primitive, more, ..Default::default() }, NoteKind::Repaired, "clamped");
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
    let lit = |light: &str| Parts {
        nodes: r#"[{"mesh":0,"extensions":{"KHR_lights_punctual":{"light":0}}}]"#.into(),
        more: format!(r#","extensions":{{"KHR_lights_punctual":{{"lights":[{light}]}}}}"#),
        ..Default::default()
    };
    let spot = |angles: &str| lit(&format!(r#"{{"type":"spot","spot":{{{angles}}}}}"#));
    let scene = noted(spot(r#""innerConeAngle":0.5,"outerConeAngle":0.5"#), NoteKind::Repaired, "cone angles");
    assert_eq!(scene.lights[0].kind, PunctualKind::Spot { inner: 0.5, outer: 0.5 });
    for refused in [r#""innerConeAngle":0.6,"outerConeAngle":0.5"#, r#""outerConeAngle":0"#, r#""outerConeAngle":2"#] {
        assert!(spot(refused).import().is_err(), "{refused}");
    }
    assert!(noted(lit(r#"{"type":"area"}"#), NoteKind::Ignored, "type").lights.is_empty());
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let (_folder, path) = scene_file("scene.gltf", format!("\u{feff}{}", Parts::default().json()));
    let report = import(&path, &ImportOptions { strict: true }).unwrap().report;
    assert!(report.of_kind(NoteKind::Repaired).any(|n| n.text.contains("byte-order")));
}

#[test]
fn a_backslash_separates_folders_unless_a_file_has_it_in_its_name() {
    let json = Parts::default().json();
    let (start, end) = (json.find("data:").unwrap(), json.find("\"}]}").unwrap());
    let json = format!(r"{}sub\\data.bin{}", &json[..start], &json[end..]);
    let (folder, path) = scene_file("scene.gltf", json);
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
