//! What exporters leave wrong or extreme, and what becomes of it: numbers that are not finite, scales of zero, turned texture
//! coordinates, small faults of the file, what nothing can see, and one view for all frames of an animation.

use std::f32::consts::FRAC_PI_2;

use bismar::scene::import::{ImportOptions, NoteKind, Pose, SceneFiles, Shutter};
use bismar::scene::{Framing, Primitive, Scene};
use glam::Vec3;
use serde_json::{Value, json};

use crate::helpers::gltf_parts::{Parts, TRIANGLE, data_uri, floats, scene_file};
use crate::import_content::{accessor, with};
use crate::one_mean::add_texture;

const NAN: f32 = f32::NAN;

fn notes(parts: &Parts, kind: NoteKind) -> (Scene, Vec<String>) {
    let imported = parts.import().unwrap();
    let texts = imported.report.notes.iter().filter(|note| note.kind == kind).map(|note| note.text.clone());
    (imported.scene, texts.collect())
}

#[test]
fn attributes_that_are_not_finite_are_mended_and_noted() {
    let normals = [NAN, 0.0, 1.0, 0.0, 0.0, 1.0, f32::INFINITY, 0.0, 0.0];
    let tangents = [1.0, NAN, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, f32::INFINITY, 0.0, -1.0];
    let colors = [NAN, 0.5, f32::INFINITY, f32::NEG_INFINITY, 0.5, 0.5, 0.5, 0.5, 0.5];
    let coordinates = [0.0, 0.0, NAN, 1.0, 1.0, 0.0];
    let extra = [&normals[..], &tangents, &colors, &coordinates].concat();
    let accessors = [(36, 3, "VEC3"), (72, 3, "VEC4"), (120, 3, "VEC3"), (156, 3, "VEC2")]
        .map(|(offset, count, shape)| accessor(offset, 5126, count, shape, false))
        .concat();
    let primitive = r#"{"material":0,"attributes":{"POSITION":0,"NORMAL":1,"TANGENT":2,"COLOR_0":3,"TEXCOORD_0":4}}"#;
    let mut parts = with(floats(&extra), &accessors, primitive);
    parts.more = r#","extensionsUsed":["KHR_materials_anisotropy"],
        "materials":[{"extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":1}}}]"#
        .into();
    let (scene, repaired) = notes(&parts, NoteKind::Repaired);
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.normals.as_ref().unwrap()[..], [[0.0, 0.0, 1.0]; 3]);
    assert_eq!(mesh.colors.as_ref().unwrap()[0], [1.0, 0.5, 1.0, 1.0]);
    assert_eq!(mesh.colors.as_ref().unwrap()[1][0], 0.0);
    let tangents = mesh.tangents.as_ref().unwrap();
    assert!(tangents.iter().flatten().all(|x| x.is_finite()) && tangents[2][3] == -1.0, "{tangents:?}");
    assert!(["normals", "not finite"].iter().all(|words| repaired.iter().any(|text| text.contains(words))));
}

#[test]
fn triangles_with_a_position_that_is_not_finite_are_left_out_and_unused_vertices_do_not_matter() {
    let square = [&TRIANGLE[..], &[1.0, 1.0, NAN], &[NAN; 3]].concat();
    let indices: Vec<u8> = [0u16, 1, 2, 1, 3, 2].iter().flat_map(|i| i.to_le_bytes()).collect();
    let parts = Parts {
        positions: [floats(&square), indices].concat(),
        accessor: format!(
            r#"{{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3"}}{}"#,
            accessor(60, 5123, 6, "SCALAR", false)
        ),
        primitive: r#"{"attributes":{"POSITION":0},"indices":1}"#.into(),
        ..Default::default()
    };
    let (scene, dropped) = notes(&parts, NoteKind::NotLoaded);
    assert_eq!((scene.meshes[0].indices.len(), scene.meshes[0].positions.len()), (1, 3));
    assert!(dropped.iter().any(|text| text.starts_with("1 triangles with a position")), "{dropped:?}");
}

#[test]
fn numbers_that_json_does_not_have_are_named_with_their_path() {
    for (json, path, word) in [
        (r#""extras":{"weight":NaN}"#, "nodes[0].extras.weight", "NaN"),
        (r#""extras":{"far":[1,-Infinity]}"#, "nodes[0].extras.far[1]", "Infinity"),
        (r#""translation":[0,inf,0]"#, "nodes[0].translation[1]", "inf"),
        (r#""translation":[nan,0,0]"#, "nodes[0].translation[0]", "nan"),
    ] {
        let parts = Parts { nodes: format!(r#"[{{"mesh":0,{json}}}]"#), ..Default::default() };
        let error = parts.import().unwrap_err();
        let said = error.to_string();
        assert!(error.exit_code() == 65 && said.contains(path) && said.contains(word), "{said}");
    }
    let trailing = Parts::default().json() + "x";
    assert!(bismar::scene::import::import(&scene_file("s.gltf", trailing).1, &ImportOptions::default()).is_err());
}

#[test]
fn a_scale_of_zero_on_one_axis_leaves_a_sheet_and_on_two_axes_nothing() {
    // The sheet of a triangle that stands at 45 degrees, seen along z, with normals that its sheet has not.
    let slanted = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
    let mut count = 0;
    for nodes in [
        r#"[{"mesh":0,"scale":[1,1,0]}]"#,
        r#"[{"children":[1],"scale":[1,1,0]},{"mesh":0}]"#,
        r#"[{"mesh":0,"matrix":[1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]}]"#,
        r#"[{"children":[1,2]},{"mesh":0,"scale":[1,1,0]},{"mesh":0,"translation":[3,0,0]}]"#,
        r#"[{"children":[1,2]},{"mesh":0,"scale":[1,1,0]},{"mesh":0,"scale":[2,2,0]}]"#,
        r#"[{"children":[1,2]},{"mesh":0,"scale":[1,1,1e-30]},{"mesh":0,"scale":[2,-2,1e-25]}]"#,
    ] {
        let parts = Parts { positions: slanted.clone(), nodes: nodes.into(), ..Default::default() };
        let scene = parts.import().unwrap().scene;
        for instance in &scene.instances {
            let mesh = &scene.meshes[scene.objects[instance.object as usize].meshes.start as usize];
            let place = |i: u32| {
                let p = Vec3::from(mesh.positions[i as usize]);
                instance.transform.map_or(p, |transform| transform.transform_point3(p))
            };
            let [a, b, c] = mesh.indices[0].map(place);
            if a.x >= 3.0 {
                continue;
            }
            count += 1;
            // 64 roundings of the largest coordinate, and the rounding of the placement.
            let thickness = 2.0 * 66.0 * f32::EPSILON;
            assert!([a, b, c].iter().all(|p| p.z.abs() <= thickness) && mesh.indices.len() == 1, "{nodes}");
            assert!(mesh.normals.is_none() && (b - a).cross(c - a).normalize().z.abs() > 0.999_999, "{nodes}");
            assert!(instance.transform.is_none_or(|transform| transform.inverse().is_finite()), "{nodes}");
        }
    }
    assert_eq!(count, 8);
    let line = Parts { nodes: r#"[{"mesh":0,"scale":[1,0,0]}]"#.into(), ..Default::default() };
    assert!(notes(&line, NoteKind::NotLoaded).1.iter().any(|text| text.contains("nothing to see")));
    // Seen from the side, a sheet is a line.
    let edge = floats(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
    let parts = Parts { positions: edge, nodes: r#"[{"mesh":0,"scale":[1,1,0]}]"#.into(), ..Default::default() };
    assert!(notes(&parts, NoteKind::NotLoaded).1.iter().any(|text| text.contains("to lines")));
}

/// A triangle whose node moves by `output` at the times 0, 1, 2.
fn animated(path: &str, output: &[f32], shape: &str, interpolation: &str) -> Parts {
    let extra = [floats(&[0.0, 1.0, 2.0]), floats(output)].concat();
    let width = ["SCALAR", "", "VEC3", "VEC4"].iter().position(|name| *name == shape).unwrap() + 1;
    let accessors = accessor(36, 5126, 3, "SCALAR", false) + &accessor(48, 5126, output.len() / width, shape, false);
    let mut parts = with(extra, &accessors, r#"{"attributes":{"POSITION":0}}"#);
    parts.more = format!(
        r#","animations":[{{"samplers":[{{"input":1,"output":2,"interpolation":"{interpolation}"}}],
           "channels":[{{"sampler":0,"target":{{"node":0,"path":"{path}"}}}}]}}]"#
    );
    parts
}

#[test]
fn all_frames_have_one_view_and_one_ground() {
    let up = [0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0];
    // Tangents that lead below the keys: -3 * (0.5 - 0.75 + 0.125) at the middle of both intervals, and its minimum.
    let mut splines = [0.0; 27];
    splines[7] = -3.0;
    let half_turn = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0];
    // A node far below that no time shows, one that appears beside a still one of the same mesh, and one weight of a morph target.
    let mut hidden = animated("translation", &up, "VEC3", "LINEAR");
    hidden.nodes = r#"[{"children":[1,2]},{"mesh":0},{"mesh":0,"translation":[0,-50,0],"scale":[0,0,0]}]"#.into();
    let mut appears = animated("scale", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 2.0], "VEC3", "STEP");
    appears.nodes = r#"[{"mesh":0,"children":[1],"rotation":[0,0.28,0,0.96]},{"mesh":0}]"#.into();
    appears.more = appears.more.replace(r#""node":0"#, r#""node":1"#);
    let mut morph = animated("pointer", &[0.0, 3.0, 0.0], "SCALAR", "LINEAR");
    morph.primitive = r#"{"attributes":{"POSITION":0},"targets":[{"POSITION":0}]}"#.into();
    morph.nodes = r#"[{"mesh":0,"weights":[0]}]"#.into();
    let pointer = r#""extensions":{"KHR_animation_pointer":{"pointer":"/nodes/0/weights/0"}},"path":"pointer""#;
    morph.more = morph.more.replace(r#""node":0,"path":"pointer""#, pointer);
    for (parts, low, high) in [
        (hidden, 0.0, 4.0),
        (appears, 0.0, 2.0),
        (morph, 0.0, 4.0),
        (animated("translation", &up, "VEC3", "LINEAR"), 0.0, 4.0),
        (animated("translation", &up, "VEC3", "STEP"), 0.0, 4.0),
        (animated("translation", &splines, "VEC3", "CUBICSPLINE"), -3.0 * 4.0 / 27.0, 1.0),
        (animated("rotation", &half_turn, "VEC4", "LINEAR"), -1.0, 1.0),
        (animated("scale", &[0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0], "VEC3", "LINEAR"), 0.0, 2.0),
    ] {
        let (_folder, path) = scene_file("s.gltf", parts.json());
        let files = SceneFiles::open(&path).unwrap();
        let at = |seconds: f64, files: &SceneFiles| {
            let shutter = Some(Shutter { opens: -0.01, closes: 0.01, steps: None }).filter(|_| seconds > 0.4);
            let pose = Pose { seconds, animation: None, shutter, frame: None };
            files.import(&ImportOptions { pose: Some(pose), ..Default::default() }).unwrap().scene
        };
        let views: Vec<_> = [0.01, 0.5, 1.0, 1.7, 2.0]
            .into_iter()
            .flat_map(|seconds| [at(seconds, &files), at(seconds, &SceneFiles::open(&path).unwrap())])
            .map(|scene| {
                let view = scene.cameras.iter().position(|camera| camera.name == Framing::NAME).unwrap();
                (scene.camera(view, 40, 30).to_world, scene.lowest(), scene.enclosing_sphere())
            })
            .collect();
        assert!(views.iter().all(|view| *view == views[0]), "{views:?}");
        let bounds = at(0.5, &files).reach.as_ref().unwrap().bounds;
        assert!((bounds[0].y - low).abs() < 0.01 && (bounds[1].y - high).abs() < 0.01, "{bounds:?}");
    }
    // Without a played animation the view is that of what is shown.
    let still = Parts::default().import().unwrap().scene;
    assert!(still.reach.is_none() && still.bounds() == Some([Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)]));
}

#[test]
fn morph_targets_that_are_not_finite_leave_their_vertices() {
    let deltas = floats(&[NAN, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, f32::INFINITY, 0.0]);
    let primitive = r#"{"attributes":{"POSITION":0},"targets":[{"POSITION":1}]}],"weights":[1],"extras":[{}"#;
    let (scene, repaired) = notes(&with(deltas, &accessor(36, 5126, 3, "VEC3", false), primitive), NoteKind::Repaired);
    assert_eq!(scene.meshes[0].positions[..], [[0.0; 3], [1.0, 0.0, 5.0], [0.0, 1.0, 0.0]]);
    assert!(repaired.iter().any(|text| text.starts_with("2 numbers")), "{repaired:?}");
}

#[test]
fn front_and_back_of_what_is_flattened_stay_apart() {
    let corners: Vec<f32> = (0..8).flat_map(|i| [0, 1, 2].map(|axis| (i >> axis & 1) as f32 + 20.0)).collect();
    let faces = [[0u8, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5], [0, 2, 3, 1], [4, 5, 7, 6]];
    let indices: Vec<u8> = faces.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
    let parts = Parts {
        positions: [floats(&corners), indices].concat(),
        accessor: r#"{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3"}"#.to_owned()
            + &accessor(96, 5121, 36, "SCALAR", false),
        primitive: r#"{"attributes":{"POSITION":0},"indices":1}"#.into(),
        nodes: r#"[{"children":[1],"rotation":[0.2,0.4,0.4,0.8],"scale":[1,0,1]},{"mesh":0,"rotation":[0,0.6,0,0.8]}]"#
            .into(),
        ..Default::default()
    };
    let mesh = &parts.import().unwrap().scene.meshes[0];
    let corners = |t: &[u32; 3]| t.map(|i| Vec3::from(mesh.positions[i as usize]));
    let normal = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).normalize();
    let plane = normal(corners(&mesh.indices[0]));
    for t in mesh.indices.iter().map(corners) {
        for other in mesh.indices.iter().map(corners) {
            let (n, above) = (normal(t), (t[0] - other[0]).dot(plane) * normal(t).dot(plane).signum());
            assert!(n.dot(plane).abs() > 0.999);
            // Rays begin 16 roundings away from a surface.
            let apart = 32.0 * f32::EPSILON * t[0].abs().max_element();
            assert!(if n.dot(normal(other)) < 0.0 { above > apart } else { above.abs() < apart }, "{above}");
        }
    }
    assert_eq!(mesh.indices.len(), 4);
}

#[test]
fn keys_that_are_not_finite_are_left_out() {
    let up = [0.0, 0.0, 0.0, 0.0, NAN, 0.0, 0.0, 4.0, 0.0];
    let none = [0.0, NAN, 0.0, 0.0, f32::INFINITY, 0.0, 0.0, NAN, 0.0];
    for (keys, height) in [(up, 1.0), (none, 0.0)] {
        let (_folder, path) = scene_file("s.gltf", animated("translation", &keys, "VEC3", "LINEAR").json());
        let pose = Pose { seconds: 0.5, animation: None, shutter: None, frame: None };
        let options = ImportOptions { pose: Some(pose), ..Default::default() };
        let imported = SceneFiles::open(&path).unwrap().import(&options).unwrap();
        assert_eq!(imported.scene.bounds().unwrap()[0].y, height);
        assert!(imported.report.notes.iter().any(|note| note.text.contains("finite")));
    }
}

#[test]
fn coordinates_of_the_first_set_are_kept_for_the_uv_aov_wherever_textures_read() {
    let coordinates = [floats(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), floats(&[0.0; 6])].concat();
    let accessors = accessor(36, 5126, 3, "VEC2", false) + &accessor(60, 5126, 3, "VEC2", false);
    let mut parts =
        with(coordinates, &accessors, r#"{"material":0,"attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":2}}"#);
    let png = data_uri("image/png", &bismar::film::preview::encoded(1, 1, &[9; 3]).unwrap());
    parts.more = format!(
        r#","images":[{{"uri":"{png}"}}],"textures":[{{"source":0}}],
           "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0,"texCoord":1}}}}}}]"#
    );
    let scene = parts.import().unwrap().scene;
    assert_eq!(scene.meshes[0].texcoords[0].as_ref().unwrap()[1], [0.3, 0.4]);
    assert!(scene.meshes[0].texcoords[1].is_some());
}

#[test]
fn a_normal_map_turns_with_its_coordinates() {
    use bismar::integrator::Geometry;
    use bismar::scene::{Filter, Material, Mesh, Texels, TextureRef, TextureSlot, Wrap};
    use glam::{Affine2, Vec2};

    // A slope toward +u, on a square whose u runs along x and v along -y.
    let tilted = [204u8, 128, 230];
    let of = |width: f32, transform: Option<Affine2>| {
        let points = vec![[0.0, 0.0, 0.0], [width, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = Mesh {
            normals: Some(vec![[0.0, 0.0, 1.0]; 3]),
            tangents: Some(vec![[1.0, 0.0, 0.0, 1.0]; 3]),
            texcoords: [Some(vec![[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]), None],
            ..Mesh::new(points, vec![[0, 1, 2]])
        };
        let mut scene = Scene::default();
        let map = add_texture(&mut scene, 1, Texels::Rgb8(vec![tilted]), Wrap::Repeat, Filter::Nearest);
        let mut material = Material::default();
        material.textures[TextureSlot::Normal] = Some(TextureRef { transform, ..map });
        scene.add(mesh, material);
        Geometry::new(&scene).point(&scene, Primitive { instance: 0, mesh: 0, prim: 0 }, (0.3, 0.3), 0.0).ns.normalize()
    };
    let [x, y, z] = tilted.map(|byte| f32::from(byte) / 127.5 - 1.0);
    let turn =
        |r: f32| Affine2::from_cols(Vec2::new(r.cos(), -r.sin()), Vec2::new(r.sin(), r.cos()), Vec2::new(0.2, 0.7));
    let scale = |x: f32, y: f32| Affine2::from_scale(Vec2::new(x, y));
    let straight = of(1.0, None);
    assert!(straight.abs_diff_eq(Vec3::new(x, y, z).normalize(), 1e-6));
    assert_eq!(of(1.0, Some(scale(3.0, 2.0))), straight);
    let is_right = |width: f32, transform: Affine2, tangent: Vec3| {
        let bitangent = Vec3::Z.cross(tangent) * transform.matrix2.determinant().signum();
        let right = (tangent * x + bitangent * y + Vec3::Z * z).normalize();
        let got = of(width, Some(transform));
        assert!(got.abs_diff_eq(right, 1e-5), "{transform:?}: {got} for {right}");
    };
    for (transform, [du, dv]) in [
        (turn(FRAC_PI_2), [0.0, -1.0]),
        (turn(0.5), [0.5f32.cos(), -0.5f32.sin()]),
        (turn(0.5) * scale(2.0, 2.0), [0.5f32.cos(), -0.5f32.sin()]),
        (scale(-1.0, 1.0), [-1.0, 0.0]),
        (scale(-1.0, -1.0), [-1.0, 0.0]),
        (scale(1.0, -1.0), [1.0, 0.0]),
    ] {
        is_right(1.0, transform, Vec3::new(du, dv, 0.0));
    }
    // Where u and v are not of one length, the new u is the surface's derivative by it.
    for transform in [turn(0.5), turn(2.0) * scale(3.0, -1.0), turn(-1.0) * scale(0.5, 2.0)] {
        let inverse = transform.matrix2.inverse();
        is_right(4.0, transform, (Vec3::X * 4.0 * inverse.x_axis.x + Vec3::NEG_Y * inverse.x_axis.y).normalize());
    }
}

/// Sets a member or an element, or adds it.
fn set(document: &mut Value, pointer: &str, value: Value) {
    let (parent, name) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Array(items) if items.len() <= name.parse::<usize>().unwrap() => items.push(value),
        Value::Array(items) => items[name.parse::<usize>().unwrap()] = value,
        other => other[name] = value,
    }
}

#[test]
fn small_faults_that_leave_no_doubt_are_shown_and_noted() {
    let up = floats(&[0.0, 0.0, 1.0].repeat(3));
    let indices: Vec<u8> = [0u16, 1, 2].iter().flat_map(|i| i.to_le_bytes()).collect();
    // The last normals begin at byte 78.
    let parts = with([&up[..], &indices, &up].concat(), "", "{}");
    let mut whole: Value = serde_json::from_str(&parts.json()).unwrap();
    let view = |start: usize, length: usize| json!({ "buffer": 0, "byteOffset": start, "byteLength": length });
    let views = json!([view(0, 36), view(36, 36), view(72, 6), view(78, 36)]);
    let vectors = |view: u32| json!({ "bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3" });
    let of_none = json!({ "componentType": 5126, "count": 0, "type": "VEC3" });
    let list = json!({ "bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR" });
    for (pointer, value) in [
        ("/bufferViews", views),
        ("/accessors", json!([vectors(0), vectors(1), list, of_none])),
        (
            "/meshes/0/primitives/0",
            json!({ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2, "material": 0 }),
        ),
        ("/nodes", json!([{ "mesh": 0, "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } }, {}])),
        (
            "/cameras",
            json!([{ "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "znear": 0, "zfar": 9 } }]),
        ),
        ("/materials", json!([{ "extensions": { "KHR_materials_volume": { "attenuationColor": [0.5, 0.5, 0.5] } } }])),
        ("/extensions", json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }] } })),
    ] {
        set(&mut whole, pointer, value);
    }
    let light = "/extensions/KHR_lights_punctual/lights/0";
    let (range, spot) = (format!("{light}/range"), format!("{light}/spot"));
    let none =
        json!({ "count": 0, "indices": { "bufferView": 2, "componentType": 5123 }, "values": { "bufferView": 0 } });
    let rounded = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.9999999]);
    for (pointer, value, said) in [
        ("/bufferViews/0/byteStride", json!(0), "0 as none"),
        ("/bufferViews/1/byteStride", json!(12), ""),
        ("/bufferViews/2/byteStride", json!(2), "own size"),
        ("/accessors/1/normalized", json!(true), "means nothing"),
        ("/accessors/2/normalized", json!(true), "means nothing"),
        ("/accessors/1/bufferView", json!(3), "not aligned"),
        ("/accessors/1/sparse", none, "sparse"),
        ("/accessors/0/min", json!([null, null, null]), ""),
        ("/nodes/0/name", Value::Null, "null"),
        ("/meshes/0/name", Value::Null, "null"),
        ("/meshes/0/extensions", Value::Null, "null"),
        ("/meshes/0/weights", json!([1]), "without morph targets"),
        ("/meshes/0/weights", json!([]), ""),
        ("/meshes/0/primitives/1", json!({ "attributes": {} }), "without vertices"),
        ("/meshes/0/primitives/1", json!({ "attributes": { "POSITION": 3 }, "material": 0 }), "without vertices"),
        ("/meshes/0/primitives/1", json!({ "attributes": { "POSITION": 0 }, "indices": 3 }), "without vertices"),
        ("/meshes/1", json!({ "primitives": [] }), "without primitives"),
        ("/asset/version", json!("2"), "\"2.0\""),
        ("/nodes/0/matrix", rounded, "rounding"),
        (&range, json!(1e39), "no limit"),
        ("/cameras/0/orthographic/zfar", json!(1e300), "no limit"),
        ("/materials/0/extensions/KHR_materials_volume/attenuationDistance", json!(3.5e38), "no limit"),
        (&spot, Value::Null, "default cone"),
        ("/extras", json!({ "name": null, "range": 1e39 }), ""),
    ] {
        let mut document = whole.clone();
        set(&mut document, pointer, value);
        if pointer == "/meshes/1" {
            set(&mut document, "/nodes/0/children", json!([1]));
            set(&mut document, "/nodes/1/mesh", json!(1));
        }
        let (_folder, path) = scene_file("s.gltf", document.to_string());
        let options = ImportOptions { strict: true, ..Default::default() };
        let imported =
            SceneFiles::open(&path).unwrap().import(&options).unwrap_or_else(|error| panic!("{pointer}: {error}"));
        let scene = &imported.scene;
        assert_eq!(imported.report.counts.instanced_triangles, 1, "{pointer}");
        assert_eq!(scene.meshes[0].normals.as_ref().unwrap()[..], [[0.0, 0.0, 1.0]; 3], "{pointer}");
        assert_eq!(scene.meshes[0].positions.as_flattened(), TRIANGLE, "{pointer}");
        let far = if pointer.ends_with("zfar") { f32::INFINITY } else { 9.0 };
        assert_eq!((scene.cameras[0].clip, scene.lights[0].range), (Some([0.0, far]), f32::INFINITY), "{pointer}");
        assert_eq!(scene.materials[0].absorption, Vec3::ZERO, "{pointer}");
        let repaired: Vec<_> = imported.report.of_kind(NoteKind::Repaired).map(|note| note.text.as_str()).collect();
        assert_eq!(said.is_empty(), repaired.is_empty(), "{pointer}: {repaired:?}");
        assert!(said.is_empty() || repaired.iter().any(|text| text.contains(said)), "{pointer}: {repaired:?}");
    }
}

/// A triangle, and one of this material that is 90 m away, with texture coordinates and vertex colours of alpha 0.
fn beside(material: &str, attributes: &str) -> Parts {
    let extra = [[0.0; 6].to_vec(), [1.0, 1.0, 1.0, 0.0].repeat(3)].concat();
    let accessors = accessor(36, 5126, 3, "VEC2", false) + &accessor(60, 5126, 3, "VEC4", false);
    let mut parts = with(floats(&extra), &accessors, r#"{"attributes":{"POSITION":0}}]},{"primitives":["#);
    parts.primitive += &format!(r#"{{"material":0,"attributes":{{"POSITION":0{attributes}}}}}"#);
    parts.nodes = r#"[{"mesh":0,"children":[1]},{"mesh":1,"translation":[0,-90,0]}]"#.into();
    let clear = crate::helpers::glb::png(image::RgbaImage::from_pixel(2, 2, image::Rgba([9, 9, 9, 0])));
    let uri = data_uri("image/png", &clear);
    parts.more = format!(r#","images":[{{"uri":"{uri}"}}],"textures":[{{"source":0}}],"materials":[{material}]"#);
    parts
}

#[test]
fn what_nothing_can_see_does_not_widen_the_view() {
    let of = |scene: &Scene| (scene.camera(0, 40, 30).to_world, scene.bounds(), scene.enclosing_sphere());
    let plain = Parts::default().import().unwrap().scene;
    let texture = r#""pbrMetallicRoughness":{"baseColorTexture":{"index":0}}"#;
    let factor = |alpha: f32| format!(r#""pbrMetallicRoughness":{{"baseColorFactor":[1,1,1,{alpha}]}}"#);
    let (set, colors) = (r#","TEXCOORD_0":1"#, r#","COLOR_0":2"#);
    for (mode, values, attributes, seen) in [
        ("BLEND", factor(0.0), "", false),
        ("BLEND", factor(0.01), "", true),
        ("MASK", factor(0.49), "", false),
        ("MASK", factor(0.5), "", true),
        ("OPAQUE", factor(0.0), "", true),
        ("BLEND", factor(1.0), colors, false),
        ("MASK", factor(1.0), colors, false),
        ("OPAQUE", factor(1.0), colors, true),
        ("BLEND", texture.into(), set, false),
        ("MASK", texture.into(), set, false),
        ("OPAQUE", texture.into(), set, true),
    ] {
        let parts = beside(&format!(r#"{{"alphaMode":"{mode}",{values}}}"#), attributes);
        let scene = parts.import().unwrap().scene;
        assert_eq!(of(&scene) == of(&plain), !seen, "{mode} {values} {attributes}: {:?}", scene.bounds());
        assert!(seen || scene.lowest() == Some(0.0));
    }
    // Moved by an animation it does not widen the view either, and what fades does, in all frames.
    for (target, shape, low) in [("\"path\":\"translation\",\"node\":1", "VEC3", 0.0), ("", "VEC4", -90.0)] {
        // Times, then two keys of four numbers, or of three.
        let keys = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let mut parts = beside(&format!(r#"{{"alphaMode":"BLEND",{}}}"#, factor(0.0)), "");
        let start = parts.positions.len();
        parts.positions.extend(floats(&keys));
        parts.accessor += &accessor(start, 5126, 2, "SCALAR", false);
        parts.accessor += &accessor(start + 8, 5126, 2, shape, false);
        let pointer = "/materials/0/pbrMetallicRoughness/baseColorFactor";
        let pointer = format!(r#""path":"pointer","extensions":{{"KHR_animation_pointer":{{"pointer":"{pointer}"}}}}"#);
        let target = if target.is_empty() { &pointer[..] } else { target };
        parts.more += &format!(
            r#","animations":[{{"samplers":[{{"input":3,"output":4}}],"channels":[{{"sampler":0,"target":{{{target}}}}}]}}]"#
        );
        let (_folder, path) = scene_file("s.gltf", parts.json());
        for seconds in [0.0, 1.0] {
            let pose = Pose { seconds, animation: None, shutter: None, frame: None };
            let options = ImportOptions { pose: Some(pose), ..Default::default() };
            let scene = SceneFiles::open(&path).unwrap().import(&options).unwrap().scene;
            assert_eq!(scene.lowest(), Some(low), "{target} at {seconds}");
        }
    }
}

#[test]
fn what_is_far_from_the_origin_is_moved_to_the_eye() {
    let of = |[x, y, z]: [f64; 3], camera: bool| {
        let camera =
            if camera { format!(r#",{{"camera":0,"translation":[{x},{},{z}]}}"#, y + 2.0) } else { String::new() };
        let more = r#","cameras":[{"type":"perspective","perspective":{"yfov":1,"znear":0.1}}]"#.into();
        let nodes =
            format!(r#"[{{"translation":[{x},{y},{z}],"children":[1]}},{{"mesh":0,"scale":[0.1,0.1,0.1]}}{camera}]"#);
        let json = Parts { nodes, more, ..Default::default() }
            .json()
            .replace(r#""nodes":[0]"#, if camera.is_empty() { r#""nodes":[0]"# } else { r#""nodes":[0,2]"# });
        let (_folder, path) = scene_file("s.gltf", json);
        SceneFiles::open(&path).unwrap().import(&ImportOptions::default()).unwrap()
    };
    for camera in [true, false] {
        let near = of([0.0; 3], camera).scene;
        assert_eq!(near.origin, glam::DVec3::ZERO);
        for place in [[5e5, 100.0, -4.5e6], [1.1e9, -2e9, 3e9], [-4e3, 0.25, 0.0]] {
            let imported = of(place, camera);
            let far = &imported.scene;
            let [near_eye, far_eye] = [&near, far].map(|scene| scene.camera(0, 40, 30).to_world);
            // Each corner as the camera sees it.
            for (a, b) in near.meshes[0].positions.iter().zip(far.meshes[0].positions.iter()) {
                let [a, b] =
                    [(near_eye, a), (far_eye, b)].map(|(eye, p)| eye.inverse().transform_point3(Vec3::from(*p)));
                assert!(a.abs_diff_eq(b, 1e-6), "{place:?}, {camera}: {a} and {b}");
            }
            let said = bismar::scene::import::summary(&imported).cameras[0].position;
            let eye = glam::DVec3::from(place) + Vec3::from(near_eye.translation).as_dvec3();
            assert!(Vec3::from(said).as_dvec3().abs_diff_eq(eye, 1e-6 * eye.length()), "{said:?} for {eye}");
        }
    }
    // What is seen from afar stays: its coordinates are small.
    let more = r#","cameras":[{"type":"orthographic","orthographic":{"xmag":1,"ymag":1,"znear":0,"zfar":1e9}}]"#.into();
    let nodes = r#"[{"children":[1]},{"mesh":0,"children":[2]},{"camera":0,"translation":[0,0,1e6]}]"#.into();
    assert_eq!(Parts { nodes, more, ..Default::default() }.import().unwrap().scene.origin, glam::DVec3::ZERO);
}

#[test]
fn tangents_follow_the_coordinates_of_each_normal_map() {
    use bismar::integrator::Geometry;

    // u of the first set runs along x, of the second along y; v against the other axis.
    let sets = vec![0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0];
    let tangents = [0.6, 0.8, 0.0, 1.0].repeat(3);
    let extra = [[0.0, 0.0, 1.0].repeat(3), sets, tangents].concat();
    let accessors = accessor(36, 5126, 3, "VEC3", false)
        + &accessor(72, 5126, 3, "VEC2", false)
        + &accessor(96, 5126, 3, "VEC2", false)
        + &accessor(120, 5126, 3, "VEC4", false);
    let tilted = data_uri("image/png", &bismar::film::preview::encoded(1, 1, &[204, 128, 230]).unwrap());
    let of = |own: &str, coat: Option<u32>, attributes: &str| {
        let primitive = format!(
            r#"{{"material":0,"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"TEXCOORD_1":3{attributes}}}}}"#
        );
        let mut parts = with(floats(&extra), &accessors, &primitive);
        let coat =
            coat.map(|set| format!(r#","clearcoatNormalTexture":{{"index":0,"texCoord":{set}}}"#)).unwrap_or_default();
        parts.more = format!(
            r#","images":[{{"uri":"{tilted}"}}],"textures":[{{"source":0}}],"materials":[{{{own}"extensions":{{
               "KHR_materials_clearcoat":{{"clearcoatFactor":1{coat}}}}}}}]"#
        );
        let scene = parts.import().unwrap().scene;
        let point = Geometry::new(&scene).point(&scene, Primitive { instance: 0, mesh: 0, prim: 0 }, (0.3, 0.3), 0.0);
        let slope = |n: Vec3| n.truncate().normalize_or_zero().to_array().map(|x| (10.0 * x).round() / 10.0);
        [slope(point.ns), slope(point.surface_from(&scene, Vec3::NEG_Z).clearcoat_normal)]
    };
    let normal = |set: u32| format!(r#""normalTexture":{{"index":0,"texCoord":{set}}},"#);
    let (x, y, file, flat) = ([1.0, 0.0], [0.0, 1.0], [0.6, 0.8], [0.0; 2]);
    assert_eq!(of(&normal(0), Some(1), ""), [x, y]);
    assert_eq!(of(&normal(1), Some(0), ""), [y, x]);
    assert_eq!(of(&normal(0), Some(0), ""), [x, x]);
    assert_eq!(of(&normal(1), None, ""), [y, flat]);
    assert_eq!(of("", Some(1), ""), [flat, y]);
    // The file's tangents are those of the surface's own map.
    assert_eq!(of(&normal(0), Some(1), r#","TANGENT":4"#), [file, y]);
    assert_eq!(of(&normal(0), Some(0), r#","TANGENT":4"#), [file, file]);
    assert_eq!(of("", Some(1), r#","TANGENT":4"#), [flat, file]);
}
