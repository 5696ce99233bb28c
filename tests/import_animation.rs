//! Animations at one time, compared with their formulas; and invalid keys.

use std::path::PathBuf;

use bismar::scene::import::{ImportOptions, Imported, NoteKind, Pose, Shutter, import};
use bismar::scene::{Projection, TextureSlot};
use glam::{Affine3A, Quat, Vec3, vec3};
use serde_json::{Value, json};

use crate::helpers::glb::{self, Data};
use crate::helpers::gltf_parts::{LONGEST, TRIANGLE, attempt, check_scene, data_uri, scene_file};

/// A triangle in a node, with room for animations.
struct Moving {
    document: Value,
    data: Data,
}

impl Moving {
    fn new() -> Self {
        let document = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
            "materials": [{}], "animations": [],
        });
        let mut data = Data::default();
        data.floats(&TRIANGLE, "VEC3");
        Self { document, data }
    }

    /// Adds an animation of one channel.
    fn animate(&mut self, name: &str, target: Value, interpolation: &str, times: &[f32], values: &[f32], shape: &str) {
        let (input, output) = (self.data.floats(times, "SCALAR"), self.data.floats(values, shape));
        self.document["animations"].as_array_mut().unwrap().push(json!({
            "name": name,
            "samplers": [{ "input": input, "output": output, "interpolation": interpolation }],
            "channels": [{ "sampler": 0, "target": target }],
        }));
    }

    fn pointer(&mut self, pointer: &str, times: &[f32], values: &[f32], shape: &str) {
        let target = json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": pointer } } });
        self.animate("", target, "LINEAR", times, values, shape);
    }

    fn file(&self) -> (tempfile::TempDir, PathBuf) {
        scene_file("scene.glb", self.data.file(self.document.clone()))
    }

    fn at(&self, seconds: f64, animation: Option<&str>) -> Result<Imported, bismar::Error> {
        self.pose(Pose { seconds, animation: animation.map(Into::into), shutter: None, frame: None })
    }

    /// While the shutter is open, with the frames before and after.
    fn blurred(&self, seconds: f64, steps: Option<u32>) -> Result<Imported, bismar::Error> {
        let shutter = Some(Shutter { opens: -0.25, closes: 0.25, steps });
        self.pose(Pose { seconds, animation: None, shutter, frame: Some(0.04) })
    }

    fn pose(&self, pose: Pose) -> Result<Imported, bismar::Error> {
        let (_folder, path) = self.file();
        import(&path, &ImportOptions { pose: Some(pose), ..Default::default() })
    }

    /// Where the triangle's node stands: its origin and what its x and y axis became.
    #[track_caller]
    fn placed(&self, seconds: f64) -> [Vec3; 3] {
        let imported = self.at(seconds, None).unwrap();
        check_scene(&imported).unwrap();
        axes(&imported)
    }
}

/// Meshes that are placed once are stored in world space.
fn axes(imported: &Imported) -> [Vec3; 3] {
    let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(imported.scene.meshes[0].positions[i]));
    [a, b - a, c - a]
}

fn node(path: &str) -> Value {
    json!({ "node": 0, "path": path })
}

const TIMES: [f32; 3] = [0.5, 1.0, 3.0];

#[test]
fn keys_are_held_joined_by_lines_or_by_splines() {
    let keys = [vec3(1.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0), vec3(0.0, 0.0, 4.0)];
    let tangents = [vec3(0.0, 1.0, -1.0), vec3(3.0, 0.0, 0.5), vec3(-2.0, 1.0, 0.0)];
    let flat = |keys: &[Vec3]| keys.iter().flat_map(|k| k.to_array()).collect::<Vec<_>>();
    // Tangent in, value, tangent out.
    let spline: Vec<Vec3> = (0..3).flat_map(|i| [tangents[i] * 2.0, keys[i], tangents[i]]).collect();
    for (interpolation, values) in [("STEP", flat(&keys)), ("LINEAR", flat(&keys)), ("CUBICSPLINE", flat(&spline))] {
        let mut moving = Moving::new();
        moving.animate("walk", node("translation"), interpolation, &TIMES, &values, "VEC3");
        for t in [0.0, 0.5, 0.75, 0.999, 1.0, 1.5, 2.9, 3.0, 100.0] {
            let i = TIMES.iter().rposition(|k| f64::from(*k) <= t);
            let expected = match i {
                None => keys[0],
                Some(2) => keys[2],
                Some(i) => {
                    let step = TIMES[i + 1] - TIMES[i];
                    let u = (t as f32 - TIMES[i]) / step;
                    match interpolation {
                        "STEP" => keys[i],
                        "LINEAR" => keys[i].lerp(keys[i + 1], u),
                        // Bernstein's form of the same cubic.
                        _ => {
                            let b = [
                                keys[i],
                                keys[i] + tangents[i] * step / 3.0,
                                keys[i + 1] - tangents[i + 1] * 2.0 * step / 3.0,
                                keys[i + 1],
                            ];
                            let v = 1.0 - u;
                            b[0] * v * v * v + b[1] * 3.0 * v * v * u + b[2] * 3.0 * v * u * u + b[3] * u * u * u
                        }
                    }
                }
            };
            let [found, ..] = moving.placed(t);
            assert!(found.distance(expected) < 1e-5, "{interpolation} at {t}: {found} for {expected}");
        }
    }
}

#[test]
fn rotations_take_the_shortest_way_on_the_sphere() {
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    // The same rotation by the other sign, which is the long way.
    let values = [Quat::IDENTITY.to_array(), (-quarter).to_array()].concat();
    let mut moving = Moving::new();
    moving.document["nodes"][0]["matrix"] = json!([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]);
    moving.animate("", node("rotation"), "LINEAR", &[0.0, 1.0], &values, "VEC4");
    for t in [0.0_f32, 0.25, 1.0 / 3.0, 0.5, 1.0] {
        // The matrix of the file has a scale and a place, which stay.
        let expected = Affine3A::from_scale_rotation_translation(
            Vec3::splat(2.0),
            Quat::from_rotation_z(std::f32::consts::FRAC_PI_2 * t),
            vec3(5.0, 6.0, 7.0),
        );
        let expected = [expected.translation, expected.matrix3.x_axis, expected.matrix3.y_axis].map(Vec3::from);
        let found = moving.placed(t.into());
        assert!((0..3).all(|i| found[i].distance(expected[i]) < 1e-5), "{t}: {found:?} for {expected:?}");
    }
}

#[test]
fn weights_move_positions_and_colours() {
    let mut moving = Moving::new();
    let lifted = moving.data.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3");
    let color = moving.data.floats(&[1.0, 1.0, 1.0].repeat(3), "VEC3");
    let darker = moving.data.floats(&[-0.5, -0.25, 0.0].repeat(3), "VEC3");
    let primitive = &mut moving.document["meshes"][0]["primitives"][0];
    primitive["attributes"]["COLOR_0"] = color.into();
    primitive["targets"] = json!([{ "POSITION": lifted }, { "COLOR_0": darker }]);
    moving.animate("", node("weights"), "LINEAR", &[0.0, 2.0], &[0.0, 0.0, 3.0, 1.0], "SCALAR");
    for (t, height, color) in
        [(0.0, 0.0, [1.0, 1.0, 1.0]), (1.0, 1.5, [0.75, 0.875, 1.0]), (9.0, 3.0, [0.5, 0.75, 1.0])]
    {
        let scene = moving.at(t, None).unwrap().scene;
        assert!(scene.meshes[0].positions.iter().all(|p| p[2] == height), "at {t}");
        let colors = scene.meshes[0].colors.as_ref();
        let found = colors.map_or([1.0; 3], |c| [c[0][0], c[0][1], c[0][2]]);
        assert_eq!(found, color, "at {t}");
    }
}

#[test]
fn pointers_move_weights_that_nodes_take_from_their_mesh() {
    for (pointer, shape, keys, of_mesh, [x, z]) in [
        ("/nodes/0/weights/0", "SCALAR", vec![0.0, 2.0], Some([5.0, 3.0]), [3.0, 1.0]),
        ("/nodes/0/weights/1", "SCALAR", vec![0.0, 2.0], Some([5.0, 3.0]), [1.0, 5.0]),
        ("/nodes/0/weights/0", "SCALAR", vec![0.0, 2.0], None, [0.0, 1.0]),
        ("/nodes/0/weights", "VEC2", vec![0.0, 0.0, 2.0, 4.0], Some([5.0, 3.0]), [2.0, 1.0]),
        ("/nodes/0/weights", "VEC2", vec![0.0, 0.0, 2.0, 4.0], None, [2.0, 1.0]),
        ("/meshes/0/weights/1", "SCALAR", vec![0.0, 2.0], None, [1.0, 0.0]),
        ("/meshes/0/weights/1", "SCALAR", vec![0.0, 2.0], Some([5.0, 3.0]), [1.0, 5.0]),
    ] {
        let mut moving = Moving::new();
        let lifted = moving.data.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3");
        let shifted = moving.data.floats(&[1.0, 0.0, 0.0].repeat(3), "VEC3");
        moving.document["meshes"][0]["primitives"][0]["targets"] =
            json!([{ "POSITION": lifted }, { "POSITION": shifted }]);
        if let Some(weights) = of_mesh {
            moving.document["meshes"][0]["weights"] = json!(weights);
        }
        moving.pointer(pointer, &[0.0, 1.0], &keys, shape);
        let imported = moving.at(0.5, None).unwrap();
        assert!(!imported.report.notes.iter().any(|note| note.text.contains("not played")), "{pointer}");
        let scene = imported.scene;
        assert_eq!(scene.meshes[0].positions[0], [x, 0.0, z], "{pointer} {of_mesh:?}");
        // The view shows all of the motion, to twice the weights that move.
        let more = match pointer.rsplit('/').next().unwrap() {
            "0" => vec3(0.0, 0.0, z),
            "1" => vec3(x, 0.0, 0.0),
            _ => vec3(x, 0.0, z),
        };
        assert_eq!(scene.reach.as_ref().unwrap().bounds[1], vec3(1.0 + x, 1.0, z) + more, "{pointer} {of_mesh:?}");
    }
}

#[test]
fn pointers_move_materials_lights_cameras_textures_and_visibility() {
    let mut moving = Moving::new();
    moving.document["nodes"] = json!([{ "mesh": 0, "children": [1, 2] }, { "camera": 0 },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } } }]);
    moving.document["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }]);
    moving.document["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    moving.document["textures"] = json!([{ "source": 0 }]);
    let png = glb::png(image::RgbImage::new(2, 2));
    moving.document["images"] = json!([{ "uri": data_uri("image/png", &png) }]);
    let texcoords = moving.data.floats(&[0.0; 6], "VEC2");
    moving.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = texcoords.into();
    moving.document["materials"][0] = json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } });
    let times = [0.0, 1.0];
    moving.pointer("/materials/0/pbrMetallicRoughness/roughnessFactor", &times, &[0.0, 1.0], "SCALAR");
    moving.pointer("/materials/0/emissiveFactor", &times, &[0.0, 0.0, 0.0, 1.0, 0.5, 0.25], "VEC3");
    moving.pointer("/extensions/KHR_lights_punctual/lights/0/intensity", &times, &[1.0, 3.0], "SCALAR");
    moving.pointer("/cameras/0/perspective/yfov", &times, &[0.5, 1.5], "SCALAR");
    let transform = "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/offset";
    moving.pointer(transform, &times, &[0.0, 0.0, 1.0, -1.0], "VEC2");
    let scene = moving.at(0.5, None).unwrap().scene;
    let material = &scene.materials[0];
    assert_eq!((material.roughness, material.emissive), (0.5, vec3(0.5, 0.25, 0.125)));
    let texture = material.textures[TextureSlot::BaseColor].as_ref().unwrap();
    assert_eq!(texture.transform.unwrap().translation.to_array(), [0.5, -0.5]);
    assert_eq!(scene.lights[0].intensity, Vec3::splat(2.0));
    assert!(matches!(scene.cameras[0].projection, Projection::Perspective { yfov } if yfov == 1.0));
    moving.pointer("/nodes/0/extensions/KHR_node_visibility/visible", &times, &[1.0, 0.0], "SCALAR");
    assert_eq!(moving.at(0.0, None).unwrap().scene.instances.len(), 1);
    assert_eq!(moving.at(1.0, None).unwrap().scene.instances.len(), 0);
}

#[test]
fn one_animation_or_all_are_played_and_the_report_says_which() {
    let mut moving = Moving::new();
    moving.animate("left", node("translation"), "LINEAR", &[0.0, 1.0], &[0.0, 0.0, 0.0, -2.0, 0.0, 0.0], "VEC3");
    moving.animate("grow", node("scale"), "LINEAR", &[0.0, 1.0], &[1.0, 1.0, 1.0, 3.0, 3.0, 3.0], "VEC3");
    let place = |animation: Option<&str>| {
        let imported = moving.at(0.5, animation).unwrap();
        let [origin, x, _] = axes(&imported);
        let note = imported.report.of_kind(NoteKind::Convention).find(|n| n.at == "animations").unwrap().text.clone();
        (origin.x, x.x, note)
    };
    assert_eq!(place(None), (-1.0, 2.0, "at 0.5 s, played: left, grow".into()));
    assert_eq!(place(Some("all")), place(None));
    assert_eq!(place(Some("left")), (-1.0, 1.0, "at 0.5 s, played: left".into()));
    assert_eq!(place(Some("1")), (0.0, 2.0, "at 0.5 s, played: grow".into()));
    let error = moving.at(0.5, Some("jump")).unwrap_err();
    assert!(error.exit_code() == 64 && error.to_string().contains("0  left"), "{error}");
    // At rest without a pose, and said so.
    let (_folder, path) = moving.file();
    let rest = import(&path, &ImportOptions::default()).unwrap();
    assert_eq!(axes(&rest), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert!(rest.report.of_kind(NoteKind::Approximated).any(|n| n.text.contains("at rest")));
}

#[test]
fn keys_that_make_no_sense_are_refused_with_their_place() {
    type Case = (&'static str, &'static str, Vec<f32>, Vec<f32>, &'static str, &'static str);
    let line = || vec![0.0; 6];
    let cases: [Case; 6] = [
        ("translation", "LINEAR", vec![1.0, 0.5], line(), "VEC3", "increase"),
        ("translation", "LINEAR", vec![1.0, 1.0], line(), "VEC3", "increase"),
        ("translation", "LINEAR", vec![0.0, 1.0], vec![0.0; 9], "VEC3", "2 keys"),
        ("translation", "LINEAR", vec![0.0, 1.0], vec![0.0; 8], "VEC4", "2 keys"),
        ("translation", "CUBICSPLINE", vec![0.0, 1.0], line(), "VEC3", "2 keys"),
        ("rotation", "LINEAR", vec![0.0, 1.0], line(), "VEC3", "2 keys"),
    ];
    for (path, interpolation, times, values, shape, word) in cases {
        let mut moving = Moving::new();
        moving.animate("", node(path), interpolation, &times, &values, shape);
        for attempt in [moving.at(0.7, None), moving.blurred(0.7, None), moving.blurred(0.7, Some(128))] {
            let error = attempt.map(|_| ()).unwrap_err();
            assert!(error.exit_code() == 65 && error.to_string().contains(word), "{path} {word}: {error}");
        }
        // At rest nothing needs them.
        let (_folder, path) = moving.file();
        import(&path, &ImportOptions::default()).unwrap();
    }
}

#[test]
fn pointers_to_anything_else_are_not_played() {
    for pointer in [
        "",
        "/",
        "x",
        "/nodes",
        "/nodes/0",
        "/nodes/0/mesh",
        "/nodes/0/children/0",
        "/nodes/-1/color",
        "/nodes/x/color",
        "/accessors/0/count",
        "/scene",
        "/asset/version",
        "/weights",
        "/nodes/0/translation/9",
        "/~0~1/offset",
        "/bufferViews/0/byteOffset",
        "/meshes/0/primitives/0/indices",
    ] {
        let mut moving = Moving::new();
        moving.pointer(pointer, &[0.0, 1.0], &[1.0, 2.0], "SCALAR");
        let imported = moving.at(0.5, None).unwrap_or_else(|error| panic!("{pointer}: {error}"));
        check_scene(&imported).unwrap();
        check_scene(&moving.blurred(0.5, None).unwrap()).unwrap();
        let said = imported.report.of_kind(NoteKind::Approximated).any(|n| n.text.contains("is not played"));
        assert!(said, "{pointer}: {:?}", imported.report.notes);
    }
}

#[test]
fn a_million_keys_are_read_in_time() {
    let mut moving = Moving::new();
    let times: Vec<f32> = (0..1_000_000).map(|i| i as f32).collect();
    let values: Vec<f32> = times.iter().flat_map(|t| [*t, 0.0, 0.0]).collect();
    moving.animate("", node("translation"), "LINEAR", &times, &values, "VEC3");
    assert_eq!(moving.placed(777_777.5)[0].x, 777_777.5);
    let (_folder, path) = moving.file();
    let (_, time) = attempt(&path);
    assert!(time < LONGEST, "{time:?}");
    moving.blurred(777_777.5, None).unwrap();
}

/// Whatever it was, it is finite, or refused with 65.
fn is_told_or_finite(what: &str, attempt: Result<Imported, bismar::Error>) -> Option<Imported> {
    match attempt {
        Err(error) => {
            assert_eq!(error.exit_code(), 65, "{what}: {error}");
            None
        }
        Ok(imported) => {
            check_scene(&imported).unwrap();
            let keys = imported.scene.instances.iter().flat_map(|i| i.motion.iter().flat_map(|m| m.keys()));
            assert!(keys.into_iter().all(|key| key.transform().is_finite()), "{what}");
            let steps = imported.scene.meshes.iter().flat_map(|m| m.motion.iter().flat_map(|d| &d.positions));
            assert!(steps.into_iter().all(|p| p.iter().flatten().all(|x| x.is_finite())), "{what}");
            Some(imported)
        }
    }
}

#[test]
fn motion_that_makes_no_sense_is_told_or_stands_still() {
    let ends = [0.0, 1.0];
    let cases: [(&str, Vec<f32>, &str); 6] = [
        // Through nothing, to the other side of a mirror, out of the world, a thousand turns, nowhere.
        ("scale", vec![1.0, 1.0, 1.0, -1.0, -1.0, -1.0], "VEC3"),
        ("scale", vec![0.0; 6], "VEC3"),
        ("scale", vec![1e-30, 1.0, 1.0, 1e30, 1.0, 1.0], "VEC3"),
        ("translation", vec![0.0, 0.0, 0.0, 3e38, 3e38, -3e38], "VEC3"),
        ("rotation", vec![0.0, 0.0, 0.0, 1.0, 0.0, 1e-30, 0.0, 1e-30], "VEC4"),
        ("rotation", vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0], "VEC4"),
    ];
    for (path, values, shape) in cases {
        for interpolation in ["LINEAR", "STEP"] {
            let mut moving = Moving::new();
            moving.animate("", node(path), interpolation, &ends, &values, shape);
            for (seconds, steps) in [(0.5, None), (0.5, Some(1)), (0.5, Some(2)), (0.9, None)] {
                is_told_or_finite(&format!("{path} {values:?}"), moving.blurred(seconds, steps));
            }
        }
    }
    // Exactly nothing in the middle: it stands still then, and says so.
    let mut moving = Moving::new();
    moving.animate("", node("scale"), "LINEAR", &[0.25, 0.75], &[1.0, 1.0, 1.0, -1.0, -1.0, -1.0], "VEC3");
    let imported = moving.blurred(0.45, Some(2)).unwrap();
    let _ = check_scene(&imported);
    let wild: Vec<f32> = (0..200).flat_map(|i| Quat::from_rotation_z(i as f32 * 2.9).to_array()).collect();
    let times: Vec<f32> = (0..200).map(|i| i as f32 * 0.005).collect();
    let mut moving = Moving::new();
    moving.animate("", node("rotation"), "LINEAR", &times, &wild, "VEC4");
    let spun = is_told_or_finite("a thousand turns", moving.blurred(0.5, None)).unwrap();
    let motion = spun.scene.instances[0].motion.as_ref().unwrap();
    assert!(!motion.has_rotation() && motion.keys().len() == 65);
}

#[test]
fn invalid_skins_are_reported_at_any_time_sample() {
    let skinned = |joint: u8, change: &dyn Fn(&mut Value)| {
        let mut moving = Moving::new();
        let weights = moving.data.floats(&[1.0, 0.0, 0.0, 0.0].repeat(3), "VEC4");
        let joints = moving.data.accessor(&[joint, 0, 0, 0].repeat(3), 5121, 3, "VEC4");
        let attributes = &mut moving.document["meshes"][0]["primitives"][0]["attributes"];
        (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (joints.into(), weights.into());
        moving.document["nodes"] = json!([{ "mesh": 0, "skin": 0 }, { "children": [2] }, {}]);
        moving.document["scenes"][0]["nodes"] = json!([0, 1]);
        moving.document["skins"] = json!([{ "joints": [1, 2] }]);
        let turn = json!({ "node": 2, "path": "rotation" });
        let quarter = Quat::from_rotation_z(1.5).to_array();
        moving.animate("", turn, "LINEAR", &[0.0, 1.0], &[[0.0, 0.0, 0.0, 1.0], quarter].concat(), "VEC4");
        change(&mut moving.document);
        moving
    };
    let sound = skinned(1, &|_| ()).blurred(0.5, None).unwrap();
    assert!(sound.scene.meshes[0].motion.is_some() && sound.scene.instances[0].motion.is_none());
    type Change = fn(&mut Value);
    let cases: [(&str, u8, Change); 6] = [
        ("a joint that is not there", 2, |_| ()),
        ("a joint beyond all nodes", 1, |d| d["skins"][0]["joints"] = json!([1, 99])),
        ("nodes in a circle", 1, |d| d["nodes"][2]["children"] = json!([1])),
        ("a node under itself", 1, |d| d["nodes"][1]["children"] = json!([1])),
        ("no skin of that number", 1, |d| d["nodes"][0]["skin"] = json!(7)),
        ("no joints", 1, |d| d["skins"][0]["joints"] = json!([])),
    ];
    for (what, joint, change) in cases {
        let moving = skinned(joint, &change);
        for attempt in [moving.at(0.5, None), moving.blurred(0.5, None)] {
            let error = attempt.map(|_| ()).unwrap_err();
            assert_eq!(error.exit_code(), 65, "{what}: {error}");
        }
    }
    // A skin whose joint carries the mesh that it moves is no circle: joints alone place it.
    let own = skinned(1, &|d| d["skins"][0]["joints"] = json!([1, 0]));
    is_told_or_finite("its own joint", own.blurred(0.5, None)).unwrap();
}
