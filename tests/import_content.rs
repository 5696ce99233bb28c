//! What a scene holds once imported: geometry, placement, cameras, lights, materials, and the report about the rest.

use bismar::scene::import::{EnvironmentFile, ImportOptions, NoteKind, SceneFiles, environment, import};
use bismar::scene::{AlphaMode, Material, Projection, PunctualKind, Scene, TextureSlot};
use glam::{Vec2, Vec3};

use crate::helpers::gltf_parts::{Parts, TRIANGLE, floats, scene_file};
use crate::helpers::shared;

fn scene(parts: Parts) -> Scene {
    parts.import().unwrap().scene
}

const POSITION: &str = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}"#;

pub fn accessor(offset: usize, component: u32, count: usize, shape: &str, normalized: bool) -> String {
    format!(
        r#",{{"bufferView":0,"byteOffset":{offset},"componentType":{component},"count":{count},"type":"{shape}","normalized":{normalized}}}"#
    )
}

/// The triangle's positions and `extra`, which `accessors` (a list that starts with a comma) reads from byte 36 on.
pub fn with(extra: Vec<u8>, accessors: &str, primitive: &str) -> Parts {
    Parts {
        positions: [floats(&TRIANGLE), extra].concat(),
        accessor: format!("{POSITION}{accessors}"),
        primitive: primitive.into(),
        ..Default::default()
    }
}

fn with_normals(normals: &[f32]) -> Parts {
    with(floats(normals), &accessor(36, 5126, 3, "VEC3", false), r#"{"attributes":{"POSITION":0,"NORMAL":1}}"#)
}

#[test]
fn a_mirrored_placement_keeps_normals_outside_and_triangles_counter_clockwise_around_them() {
    let mut parts = with_normals(&[0.0, 0.0, 1.0].repeat(3));
    parts.nodes = r#"[{"mesh":0,"scale":[-2,1,1],"translation":[0,0,7]}]"#.into();
    let scene = scene(parts);
    let mesh = &scene.meshes[0];
    let [a, b, c] = mesh.indices[0].map(|i| Vec3::from(mesh.positions[i as usize]));
    assert_eq!([a, b, c], [Vec3::new(0.0, 0.0, 7.0), Vec3::new(0.0, 1.0, 7.0), Vec3::new(-2.0, 0.0, 7.0)]);
    let normal = Vec3::from(mesh.normals.as_ref().unwrap()[0]);
    assert_eq!(normal, Vec3::Z);
    assert!((b - a).cross(c - a).dot(normal) > 0.0);
}

#[test]
fn normals_follow_the_inverse_transpose() {
    let mut parts = with_normals(&[1.0, 1.0, 0.0].repeat(3));
    parts.nodes = r#"[{"mesh":0,"scale":[2,1,1]}]"#.into();
    let expected = Vec3::new(0.5, 1.0, 0.0).normalize();
    let normal = Vec3::from(scene(parts).meshes[0].normals.as_ref().unwrap()[0]);
    assert!((normal - expected).length() <= 2.0 * f32::EPSILON, "{normal}");
}

#[test]
fn normals_behind_the_front_of_every_triangle_are_turned_around() {
    let normals = |z: [f32; 3]| {
        let normals: Vec<f32> = z.iter().flat_map(|&z| [0.0, 0.0, z]).collect();
        let imported = with_normals(&normals).import().unwrap();
        let told = imported.report.notes.iter().any(|note| note.text.contains("turned around"));
        (imported.scene.meshes[0].normals.as_ref().unwrap().iter().map(|n| n[2]).collect::<Vec<_>>(), told)
    };
    assert_eq!(normals([-1.0; 3]), (vec![1.0; 3], true));
    assert_eq!(normals([1.0; 3]), (vec![1.0; 3], false));
    // The mean normal decides.
    assert_eq!(normals([1.0, 1.0, -1.0]), (vec![1.0, 1.0, -1.0], false));
}

#[test]
fn what_is_placed_twice_is_kept_once() {
    let nodes = r#"[{"children":[1,2]},{"mesh":0,"name":"left"},{"mesh":0,"translation":[5,0,0]}]"#.into();
    let imported = Parts { nodes, ..Default::default() }.import().unwrap();
    let scene = &imported.scene;
    assert_eq!((scene.meshes.len(), scene.objects.len(), scene.instances.len()), (1, 1, 2));
    assert_eq!(scene.instances[0].name, "left");
    assert_eq!(scene.instances[1].transform.unwrap().translation.to_array(), [5.0, 0.0, 0.0]);
    let counts = &imported.report.counts;
    assert_eq!((counts.triangles, counts.instanced_triangles), (1, 2));
}

#[test]
fn gpu_instancing_places_every_element() {
    let mut parts = with(
        floats(&[1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0]),
        &accessor(36, 5126, 3, "VEC3", false),
        r#"{"attributes":{"POSITION":0}}"#,
    );
    parts.nodes = r#"[{"mesh":0,"translation":[0,1,0],"extensions":{"EXT_mesh_gpu_instancing":{"attributes":
        {"TRANSLATION":1}}}}]"#
        .into();
    let at: Vec<_> = scene(parts).instances.iter().map(|i| i.transform.unwrap().translation.to_array()).collect();
    assert_eq!(at, [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [3.0, 1.0, 0.0]]);
}

#[test]
fn strips_and_fans_become_the_triangles_of_the_specification() {
    let square = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0]);
    let of_mode = |mode: u32| {
        let accessor = r#"{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3"}"#.into();
        let primitive = format!(r#"{{"attributes":{{"POSITION":0}},"mode":{mode}}}"#);
        scene(Parts { positions: square.clone(), accessor, primitive, ..Default::default() }).meshes[0].indices.clone()
    };
    assert_eq!(of_mode(5), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert_eq!(of_mode(4), [[0, 1, 2]]);
    // The fan's last triangle (3, 4, 0) and its first (1, 2, 0) have area, so has (2, 3, 0).
    assert_eq!(of_mode(6), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
}

#[test]
fn only_vertices_that_triangles_use_are_kept() {
    let mut positions = vec![9.0; 3 * 100];
    positions[3 * 40..3 * 40 + 9].copy_from_slice(&TRIANGLE);
    let accessor = r#"{"bufferView":0,"componentType":5126,"count":100,"type":"VEC3"},
        {"bufferView":0,"byteOffset":1200,"componentType":5121,"count":3,"type":"SCALAR"}"#
        .into();
    let positions = [floats(&positions), vec![40, 41, 42]].concat();
    let primitive = r#"{"attributes":{"POSITION":0},"indices":1}"#.into();
    let scene = scene(Parts { positions, accessor, primitive, ..Default::default() });
    assert_eq!(scene.meshes[0].positions.as_flattened(), TRIANGLE);
}

#[test]
fn normalized_integers_are_divided_by_their_largest_value() {
    let colors = vec![255, 0, 51, 102, 255, 0, 51, 102, 255, 0, 51, 102];
    let parts = with(colors, &accessor(36, 5121, 3, "VEC4", true), r#"{"attributes":{"POSITION":0,"COLOR_0":1}}"#);
    assert_eq!(scene(parts).meshes[0].colors.as_ref().unwrap()[0], [1.0, 0.0, 51.0 / 255.0, 102.0 / 255.0]);
}

#[test]
fn quantized_positions_are_integers_not_floats() {
    let positions: Vec<u8> =
        [0_i16, 0, 0, 0, 100, 0, 0, 0, 0, -100, 0, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let json = Parts {
        positions,
        accessor: r#"{"bufferView":0,"componentType":5122,"count":3,"type":"VEC3"}"#.into(),
        more: r#","extensionsUsed":["KHR_mesh_quantization"],"extensionsRequired":["KHR_mesh_quantization"]"#.into(),
        ..Default::default()
    }
    .json()
    .replace(r#""byteLength":24}],"#, r#""byteLength":24,"byteStride":8}],"#);
    let (_folder, path) = scene_file("scene.gltf", json);
    let scene = import(&path, &ImportOptions::default()).unwrap().scene;
    assert_eq!(scene.meshes[0].positions[..], [[0.0; 3], [100.0, 0.0, 0.0], [0.0, -100.0, 0.0]]);
}

#[test]
fn sparse_elements_replace_the_base() {
    let extra = [vec![1, 2, 0, 0], floats(&[4.0, 0.0, 0.0, 0.0, 4.0, 0.0])].concat();
    let mut parts = with(extra, "", r#"{"attributes":{"POSITION":0}}"#);
    parts.accessor = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","sparse":{"count":2,
        "indices":{"bufferView":0,"byteOffset":36,"componentType":5121},"values":{"bufferView":0,"byteOffset":40}}}"#
        .into();
    assert_eq!(scene(parts).meshes[0].positions[..], [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
}

#[test]
fn default_morph_weights_are_applied() {
    for (nodes, second) in [(r#"[{"mesh":0,"weights":[0.5]}]"#, [1.0, 0.0, 1.0]), (r#"[{"mesh":0}]"#, [1.0, 0.0, 0.0])]
    {
        let primitive = r#"{"attributes":{"POSITION":0},"targets":[{"POSITION":1}]}"#;
        let parts = with(floats(&[0.0, 0.0, 2.0].repeat(3)), &accessor(36, 5126, 3, "VEC3", false), primitive);
        assert_eq!(scene(Parts { nodes: nodes.into(), ..parts }).meshes[0].positions[1], second);
    }
}

#[test]
fn skins_stand_where_their_joints_are_whatever_the_mesh_node_says() {
    let joints = vec![0; 12];
    let weights = floats(&[1.0, 0.0, 0.0, 0.0].repeat(3));
    let mut bind = [0.0; 16];
    [0, 5, 10, 15].iter().for_each(|&i| bind[i] = 1.0);
    bind[13] = -1.0;
    let extra = [joints, weights, floats(&bind)].concat();
    let accessors = [
        accessor(36, 5121, 3, "VEC4", false),
        accessor(48, 5126, 3, "VEC4", false),
        accessor(96, 5126, 1, "MAT4", false),
    ];
    let mut parts = with(extra, &accessors.concat(), r#"{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}"#);
    parts.nodes = r#"[{"mesh":0,"skin":0,"translation":[100,0,0]},{"translation":[0,5,0]}]"#.into();
    parts.more = r#","skins":[{"joints":[1],"inverseBindMatrices":3}]"#.into();
    assert_eq!(scene(parts).meshes[0].positions[..], [[0.0, 4.0, 0.0], [1.0, 4.0, 0.0], [0.0, 5.0, 0.0]]);
}

#[test]
fn attributes_that_the_material_does_not_sample_are_dropped() {
    let parts = with(
        [floats(&[0.0; 6]), floats(&[1.0, 0.0, 0.0, 1.0].repeat(3)), floats(&[0.0, 0.0, 1.0].repeat(3))].concat(),
        &[
            accessor(36, 5126, 3, "VEC2", false),
            accessor(60, 5126, 3, "VEC4", false),
            accessor(108, 5126, 3, "VEC3", false),
        ]
        .concat(),
        r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1,"TANGENT":2,"NORMAL":3}}"#,
    );
    let scene = scene(parts);
    let mesh = &scene.meshes[0];
    assert!(mesh.texcoords == [None, None] && mesh.tangents.is_none() && mesh.normals.is_some());
}

#[test]
fn cameras_lose_their_scale_and_keep_their_field_of_view() {
    let nodes = r#"[{"children":[1,2],"scale":[3,3,3]},
        {"name":"eye","camera":0,"translation":[1,2,3],"rotation":[0,0.7071067811865476,0,0.7071067811865476]},
        {"camera":1}]"#;
    let more = r#","cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1,"aspectRatio":1.5}},
        {"name":"plan","type":"orthographic","orthographic":{"xmag":4,"ymag":2,"znear":0,"zfar":10}}]"#;
    let scene = scene(Parts { nodes: nodes.into(), more: more.into(), ..Default::default() });
    let [eye, plan] = &scene.cameras[..] else { panic!("two cameras wanted") };
    assert_eq!((eye.name.as_str(), plan.name.as_str()), ("eye", "plan"));
    assert_eq!(eye.projection, Projection::Perspective { yfov: 0.5 });
    assert_eq!(eye.aspect, Some(1.5));
    assert_eq!(plan.projection, Projection::Orthographic { xmag: 4.0, ymag: 2.0 });
    assert_eq!(eye.to_world.translation.to_array(), [3.0, 6.0, 9.0]);
    // Turned by 90° about +y, −z looks along −x.
    let forward = eye.to_world.transform_vector3(Vec3::NEG_Z);
    assert!((forward - Vec3::NEG_X).length() <= 4.0 * f32::EPSILON, "{forward}");
    assert!((eye.to_world.matrix3.determinant() - 1.0).abs() <= 4.0 * f32::EPSILON);
}

#[test]
fn the_framed_view_sees_every_corner() {
    let nodes = r#"[{"mesh":0,"scale":[30,2,5],"translation":[100,-3,8]}]"#.into();
    let scene = scene(Parts { nodes, ..Default::default() });
    let camera = &scene.cameras[0];
    let Projection::Perspective { yfov } = camera.projection else { panic!("perspective wanted") };
    let to_camera = camera.to_world.inverse();
    for &p in scene.meshes[0].positions.iter() {
        let p = to_camera.transform_point3(Vec3::from(p));
        let edge = -p.z * (0.5 * yfov).tan();
        assert!(p.z < 0.0 && p.x.abs() < edge && p.y.abs() < edge, "{p}");
    }
}

#[test]
fn lights_shine_along_their_nodes() {
    let nodes = r#"[{"children":[1,2],"rotation":[-0.7071067811865476,0,0,0.7071067811865476],"scale":[2,2,2]},
        {"translation":[0,0,1],"extensions":{"KHR_lights_punctual":{"light":0}}},
        {"extensions":{"KHR_lights_punctual":{"light":1}}}]"#;
    let more = r#","extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[
        {"type":"spot","color":[1,0.5,0],"intensity":8,"range":5,"spot":{"innerConeAngle":0.1}},{"type":"directional"}]}}"#;
    let scene = scene(Parts { nodes: nodes.into(), more: more.into(), ..Default::default() });
    let [spot, sun] = &scene.lights[..] else { panic!("two lights wanted") };
    assert_eq!(spot.kind, PunctualKind::Spot { inner: 0.1, outer: std::f32::consts::FRAC_PI_4 });
    assert_eq!(spot.intensity, Vec3::new(8.0, 4.0, 0.0));
    // Turned by −90° about +x: −z becomes −y, and the place (0, 0, 2) becomes (0, 2, 0).
    assert!((spot.position - Vec3::new(0.0, 2.0, 0.0)).length() <= 4.0 * f32::EPSILON);
    assert!((sun.direction - Vec3::NEG_Y).length() <= 4.0 * f32::EPSILON);
    assert_eq!(sun.intensity, Vec3::ONE);
    assert_eq!((spot.range, sun.range), (5.0, f32::INFINITY));
    assert_eq!((spot.size, sun.size), (0.0, 0.0));
}

#[test]
fn extras_give_lights_a_size_where_they_are_one() {
    let size = |kind: &str, light: &str, node: &str| {
        let nodes = format!(r#"[{{"extras":{node},"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}]"#);
        let light = format!(r#"{{"type":"{kind}","extras":{light}}}"#);
        let more = format!(r#","extensions":{{"KHR_lights_punctual":{{"lights":[{light}]}}}}"#);
        scene(Parts { nodes, more, ..Default::default() }).lights[0].size
    };
    for (kind, light, node, wanted) in [
        ("point", r#"{"radius":0.25,"angle":1}"#, "{}", 0.25),
        ("point", r#"{"shadow_soft_size":0.5}"#, "{}", 0.5),
        // A node's own goes before that of its light.
        ("point", r#"{"radius":0.25}"#, r#"{"radius":2}"#, 2.0),
        ("directional", r#"{"radius":0.25,"angle":0.5}"#, "{}", 0.25),
        ("directional", "{}", r#"{"angle":3.5}"#, 0.0),
        ("point", r#"{"radius":-1}"#, r#"{"radius":1e30}"#, 0.0),
        ("point", r#"{"radius":"big"}"#, "7", 0.0),
    ] {
        assert_eq!(size(kind, light, node), wanted, "{kind} {light} {node}");
    }
}

/// A material, and what the report says of it that cannot be shown exactly.
fn material(json: &str) -> (Material, Vec<String>) {
    let imported = Parts::of_materials(json).import().unwrap();
    let inexact = |k| matches!(k, NoteKind::Approximated | NoteKind::Ignored);
    let notes = imported.report.notes.iter().filter(|n| inexact(n.kind)).map(|n| n.text.clone()).collect();
    (imported.scene.materials[0].clone(), notes)
}

/// A material that is shown exactly.
#[track_caller]
fn exact(json: &str) -> Material {
    let (material, notes) = material(json);
    assert!(notes.is_empty(), "{notes:?}");
    material
}

#[test]
fn material_factors_and_extensions_arrive() {
    let m = exact(
        r#"{"alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,"emissiveFactor":[1,0.5,0],
        "pbrMetallicRoughness":{"baseColorFactor":[0.1,0.2,0.3,0.4],"metallicFactor":0.5,"roughnessFactor":0.25},
        "extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":10},"KHR_materials_ior":{"ior":1.33},
        "KHR_materials_specular":{"specularFactor":0.5,"specularColorFactor":[1,2,3]}}}"#,
    );
    assert_eq!(m.base_color.to_array(), [0.1, 0.2, 0.3, 0.4]);
    assert_eq!((m.metallic, m.roughness, m.ior, m.specular), (0.5, 0.25, 1.33, 0.5));
    assert_eq!((m.emissive, m.specular_color), (Vec3::new(10.0, 5.0, 0.0), Vec3::new(1.0, 2.0, 3.0)));
    assert_eq!((m.alpha_mode, m.double_sided, m.unlit), (AlphaMode::Mask(0.25), true, false));
}

#[test]
fn transmission_and_volume_arrive() {
    let m = exact(
        r#"{"pbrMetallicRoughness":{"metallicFactor":0},"extensions":{
        "KHR_materials_transmission":{"transmissionFactor":0.5},
        "KHR_materials_volume":{"thicknessFactor":0.1,"attenuationDistance":2,"attenuationColor":[0.25,1,0]}}}"#,
    );
    assert!(m.transmits() && m.bounds_medium && m.transmission == 0.5);
    // After two metres the colour is left.
    assert!(((m.absorption * -2.0).exp() - Vec3::new(0.25, 1.0, 0.0)).abs().max_element() < 1e-6, "{}", m.absorption);
    let (metal, _) = material(r#"{"extensions":{"KHR_materials_transmission":{"transmissionFactor":1}}}"#);
    assert!(!metal.transmits(), "the default is a metal");
    let (m, _) = material(
        r#"{"pbrMetallicRoughness":{"metallicFactor":0},"extensions":{"KHR_materials_transmission":
        {"transmissionFactor":7},"KHR_materials_volume":{"thicknessFactor":-1,"attenuationDistance":0}}}"#,
    );
    assert!(m.transmission == 1.0 && !m.bounds_medium && m.absorption == Vec3::ZERO);
}

#[test]
fn layers_arrive() {
    let m = exact(
        r#"{"extensions":{"KHR_materials_clearcoat":{"clearcoatFactor":0.5,"clearcoatRoughnessFactor":0.25},
        "KHR_materials_sheen":{"sheenColorFactor":[0.1,0.2,3],"sheenRoughnessFactor":0.75},
        "KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.25,
        "diffuseTransmissionColorFactor":[1,0.5,0]}}}"#,
    );
    assert_eq!((m.clearcoat, m.clearcoat_roughness, m.sheen_roughness), (0.5, 0.25, 0.75));
    assert_eq!(m.sheen_color, Vec3::new(0.1, 0.2, 1.0));
    assert_eq!((m.diffuse_transmission, m.diffuse_transmission_color), (0.25, Vec3::new(1.0, 0.5, 0.0)));
    for (json, word) in [
        (r#"{"KHR_materials_sheen":{"sheenColorFactor":1}}"#, "KHR_materials_sheen.sheenColorFactor"),
        (r#"{"KHR_materials_clearcoat":{"clearcoatTexture":{"index":4}}}"#, "clearcoatTexture.index"),
    ] {
        let error = Parts::of_materials(&format!(r#"{{"extensions":{json}}}"#)).import().unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn the_specular_glossiness_model_takes_the_place_of_the_other() {
    let m = exact(
        r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]},"extensions":{"KHR_materials_pbrSpecularGlossiness":
        {"diffuseFactor":[0.1,0.2,0.3,0.4],"specularFactor":[0.5,0.6,0.7],"glossinessFactor":0.75}}}"#,
    );
    assert_eq!(m.base_color.to_array(), [0.1, 0.2, 0.3, 0.4]);
    assert_eq!((m.metallic, m.roughness, m.specular_glossiness), (0.0, 0.25, Some(Vec3::new(0.5, 0.6, 0.7))));
}

#[test]
fn films_brushes_and_prisms_are_as_the_file_says() {
    let (m, notes) = material(
        r#"{"extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":0.6,"anisotropyRotation":1.5},
        "KHR_materials_iridescence":{"iridescenceFactor":0.7,"iridescenceIor":1.8,"iridescenceThicknessMaximum":550},
        "KHR_materials_dispersion":{"dispersion":0.36}}}"#,
    );
    assert_eq!((m.anisotropy, m.anisotropy_rotation), (0.6, 1.5));
    assert_eq!((m.iridescence, m.iridescence_ior, m.iridescence_thickness), (0.7, 1.8, [100.0, 550.0]));
    assert_eq!(m.dispersion, 0.36);
    // The triangle has nothing along which a brush could have gone.
    assert!(notes.len() == 1 && notes[0].contains("highlights are isotropic"), "{notes:?}");
    assert_eq!(m.tangent_sets(), [Some(0), None]);
    // Out of range: clamped.
    let (m, _) = material(
        r#"{"extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":7},
        "KHR_materials_iridescence":{"iridescenceFactor":-1,"iridescenceIor":0.2},
        "KHR_materials_dispersion":{"dispersion":-3}}}"#,
    );
    assert_eq!((m.anisotropy, m.iridescence, m.iridescence_ior, m.dispersion), (1.0, 0.0, 1.0, 0.0));
}

#[test]
fn what_a_material_loses_is_reported_only_when_it_matters() {
    for plain in ["KHR_materials_unlit", "KHR_materials_iridescence", "KHR_materials_anisotropy"] {
        exact(&format!(r#"{{"extensions":{{"{plain}":{{}}}}}}"#));
    }
    let (_, notes) = material(r#"{"extensions":{"EXT_unheard_of":{}}}"#);
    assert!(notes.len() == 1 && notes[0].contains("EXT_unheard_of"), "{notes:?}");
}

#[test]
fn strict_refuses_what_cannot_be_shown_exactly_and_names_it() {
    let strict = |json: &str| {
        let mut parts = Parts::of_materials(json);
        parts.more += r#","textures":[{}]"#;
        let (_folder, path) = scene_file("scene.gltf", parts.json());
        import(&path, &ImportOptions { strict: true, ..Default::default() })
    };
    assert!(strict("{}").is_ok());
    for (json, word) in [
        (r#"{"extensions":{"EXT_materials_unheard_of":{}}}"#, "EXT_materials_unheard_of"),
        (r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#, "baseColorTexture"),
    ] {
        let error = strict(json).unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains(word), "{error}");
    }
}

#[test]
fn what_is_not_read_is_named_and_what_changes_no_picture_is_not() {
    let strict = |json: String| {
        let (_folder, path) = scene_file("scene.gltf", json);
        import(&path, &ImportOptions { strict: true, ..Default::default() })
    };
    let more = |more: &str| Parts { more: more.into(), ..Default::default() }.json();
    let splats =
        r#"{"attributes":{"POSITION":0},"mode":0,"extensions":{"KHR_gaussian_splatting":{"kernel":"ellipse"}}}"#;
    let splats = Parts { primitive: splats.into(), ..Default::default() }.json();
    for (json, said) in [
        (more(r#","files":[{"uri":"b.glb","mimeType":"model/gltf-binary"}]"#), "files: 1 files (glTF 2.1)"),
        (more(r#","externalAssets":[{"file":0},{"file":1}]"#), "externalAssets: 2 scenes in other files (glTF 2.1)"),
        (more(r#","shapes":[{"type":"box"}]"#).replace("2.0", "2.1"), "shapes: 1 shapes without triangles (glTF 2.1)"),
        (splats, "primitives[0]: 3 splats, not shown"),
    ] {
        let error = strict(json).unwrap_err().to_string();
        // Every line but the first is indented, as further lines of messages are.
        assert!(error.contains(said) && error.lines().skip(1).all(|line| line.starts_with("  ")), "{error}");
    }
    for name in ["EXT_mesh_manifold", "EXT_mesh_primitive_edge_visibility", "EXT_structural_metadata", "ACME_metadata"]
    {
        let primitive = format!(r#"{{"attributes":{{"POSITION":0}},"extensions":{{"{name}":{{}}}}}}"#);
        let more = format!(r#","extensionsUsed":["{name}"],"extensions":{{"{name}":{{}}}},"files":[]"#);
        let imported = strict(Parts { primitive, more, ..Default::default() }.json()).unwrap();
        assert_eq!(imported.report.extensions_ignored, [""; 0], "{name}");
    }
}

#[test]
fn strips_and_fans_begin_again_where_the_file_says_so() {
    let square = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    let of = |mode: u32, extension: &str| {
        let indices = [0, 1, 2, 3, 255, 255, 1, 3, 2, 255, 0, 1];
        let accessor = r#"{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}"#.to_owned()
            + &accessor(48, 5121, indices.len(), "SCALAR", false);
        let primitive = format!(r#"{{"attributes":{{"POSITION":0}},"indices":1,"mode":{mode}}}"#);
        let more = format!(r#","extensionsUsed":["{extension}"]"#);
        let positions = [&square[..], &indices].concat();
        Parts { positions, accessor, primitive, more, ..Default::default() }
            .import()
            .map(|i| i.scene.meshes[0].indices.clone())
    };
    let restart = "EXT_mesh_primitive_restart";
    assert_eq!(of(5, restart).unwrap(), [[0, 1, 2], [1, 3, 2], [1, 3, 2]]);
    assert_eq!(of(6, restart).unwrap(), [[1, 2, 0], [2, 3, 0], [3, 2, 1]]);
    for refused in [of(4, restart), of(5, "EXT_mesh_manifold")] {
        assert!(refused.unwrap_err().to_string().contains("255"));
    }
}

#[test]
fn required_extensions_that_are_unknown_are_refused_by_name() {
    let more = r#","extensionsUsed":["EXT_unheard_of"],"extensionsRequired":["EXT_unheard_of"]"#.into();
    let error = Parts { more, ..Default::default() }.import().unwrap_err();
    assert!(error.exit_code() == 65 && error.to_string().contains("EXT_unheard_of"), "{error}");
}

#[test]
fn generated_tangents_agree_with_those_that_exporters_wrote() {
    let Some(folder) = shared::folder() else { return };
    for name in ["ClearCoatTest/ClearCoatTest.glb", "AlphaBlendModeTest/AlphaBlendModeTest.glb"] {
        let bytes = std::fs::read(folder.join("materials").join(name)).unwrap();
        // Renamed, the attribute is an application's own and is not read.
        let mut without = bytes.clone();
        for at in (0..bytes.len()).filter(|&at| bytes[at..].starts_with(b"\"TANGENT\"")) {
            without[at + 1] = b'_';
        }
        assert!(without != bytes, "{name} has no tangents");
        let load = |bytes: &[u8]| {
            let (_folder, path) = scene_file("scene.glb", bytes);
            import(&path, &ImportOptions::default()).unwrap().scene
        };
        let (theirs, ours) = (load(&bytes), load(&without));
        let (mut corners, mut alike) = (0, 0);
        for (a, b) in theirs.meshes.iter().zip(&ours.meshes).filter(|(a, _)| a.tangents.is_some()) {
            let (ta, tb) = (a.tangents.as_ref().unwrap(), b.tangents.as_ref().unwrap());
            for (i, j) in a.indices.iter().flatten().zip(b.indices.iter().flatten()) {
                let (ta, tb) = (ta[*i as usize], tb[*j as usize]);
                let dot = Vec3::new(ta[0], ta[1], ta[2]).dot(Vec3::new(tb[0], tb[1], tb[2]));
                corners += 1;
                alike += usize::from(dot > 0.9 && ta[3] == tb[3]);
            }
        }
        // Within 25°, which rounding and welding stay far below; a wrong sign or axis makes 90° or 180°.
        assert!(corners > 0 && alike == corners, "{name}: {alike} of {corners}");
    }
}

#[test]
fn texture_transforms_turn_as_khronos_test_model_shows() {
    let Some(folder) = shared::folder() else { return };
    let path = folder.join("materials/TextureTransformTest/TextureTransformTest.gltf");
    let scene = import(&path, &ImportOptions::default()).unwrap().scene;
    let rotation = scene.materials.iter().find(|m| m.name == "Rotation").unwrap();
    let transform = rotation.textures[TextureSlot::BaseColor].as_ref().unwrap().transform.unwrap();
    // The model marks where the arrow's tip must show, where it shows when the extension is not there, and where with
    // the wrong sign: at these node translations, on a quad with u = x + 0.5, v = 0.5 − y.
    let uv = |x: f32, y: f32| Vec2::new(x + 0.5, 0.5 - y);
    let tip = uv(0.277_817_46, -0.277_817_46);
    let correct = uv(-0.079_048_224, -0.516_267_5);
    assert!((transform.transform_point2(correct) - tip).length() < 1e-6);
}

#[test]
fn what_was_opened_is_what_is_imported() {
    let json = Parts::default().json_with("data.bin");
    let (folder, path) = scene_file("scene.gltf", &json);
    let data = folder.path().join("data.bin");
    std::fs::write(&data, floats(&TRIANGLE)).unwrap();
    let before = SceneFiles::open(&path).unwrap();
    std::fs::write(&data, floats(&TRIANGLE.map(|x| 2.0 * x))).unwrap();
    let after = SceneFiles::open(&path).unwrap();
    let largest = |files: &SceneFiles| {
        let scene = files.import(&ImportOptions::default()).unwrap().scene;
        scene.meshes[0].positions.iter().flatten().copied().fold(0.0, f32::max)
    };
    assert_ne!(before.survey().hash, after.survey().hash);
    std::fs::remove_file(&path).unwrap();
    assert_eq!((largest(&before), largest(&after)), (1.0, 2.0));
    assert_eq!(before.survey().file_bytes, json.len() as u64 + 36);
}

#[test]
fn a_file_that_is_named_twice_counts_once() {
    let view = r#"{"buffer":0,"byteLength":36}"#;
    let buffer = r#"{"byteLength":36,"uri":"data.bin"}"#;
    let json = format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffer},{buffer}],"bufferViews":[{view}]}}"#);
    let (folder, path) = scene_file("scene.gltf", &json);
    std::fs::write(folder.path().join("data.bin"), floats(&TRIANGLE)).unwrap();
    let files = SceneFiles::open(&path).unwrap();
    let bytes = json.len() as u64 + 36;
    assert_eq!(files.survey().file_bytes, bytes);
    assert_eq!(files.import(&ImportOptions::default()).unwrap().report.file_bytes, bytes);
}

#[test]
fn an_opened_environment_stays_what_it_was() {
    let Some(folder) = shared::folder() else { return };
    let bytes = std::fs::read(folder.join("env/studio_small_03_1k/studio_small_03_1k.hdr")).unwrap();
    let (_folder, path) = scene_file("sky.hdr", &bytes);
    let file = EnvironmentFile::open(&path).unwrap();
    std::fs::write(&path, "no picture").unwrap();
    assert_eq!(file.hash(), blake3::hash(&bytes).to_hex().to_string());
    assert_eq!(file.decode(0.0, 1.0).unwrap().width, 1024);
}

#[test]
fn environments_load_and_others_are_refused() {
    if let Some(folder) = shared::folder() {
        let sky = environment(&folder.join("env/studio_small_03_1k/studio_small_03_1k.hdr"), 90.0, 2.0).unwrap();
        assert_eq!((sky.width, sky.height, sky.pixels.len()), (1024, 512, 1024 * 512));
        assert_eq!((sky.rotation, sky.strength), (std::f32::consts::FRAC_PI_2, 2.0));
        assert!(sky.pixels.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
        let exr = environment(&folder.join("env/exr_uvgrid/uvgrid.exr"), 0.0, 1.0).unwrap();
        assert_eq!((exr.width, exr.height), (2000, 2000));
        assert!(exr.pixels.iter().flatten().any(|x| *x > 0.0));
    }
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000 +X 1000000\n";
    let exr = [&[0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0][..], &[0xFF; 64]].concat();
    let empty = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 0\n";
    for bytes in [&b"no picture"[..], b"", b"#?RADIANCE\n", huge, empty, &exr] {
        let (_folder, path) = scene_file("sky.hdr", bytes);
        let error = environment(&path, 0.0, 1.0).unwrap_err();
        assert!(error.exit_code() == 65 && error.to_string().contains("sky.hdr"), "{error}");
    }
    assert_eq!(environment(std::path::Path::new("not/there.hdr"), 0.0, 1.0).unwrap_err().exit_code(), 66);
    assert_eq!(environment(std::path::Path::new("not/there.hdr"), 0.0, -1.0).unwrap_err().exit_code(), 64);
}

#[test]
fn scenes_and_variants_are_chosen_by_name_or_index() {
    let primitive = r#"{"attributes":{"POSITION":0},"material":0,"extensions":{"KHR_materials_variants":{"mappings":[
        {"material":1,"variants":[0,2]},{"material":2,"variants":[1]}]}}}"#;
    let more = r#","materials":[{"name":"plain"},{"name":"red"},{"name":"blue"}],"extensions":{"KHR_materials_variants":
        {"variants":[{"name":"dawn"},{"name":"noon"},{"name":"1"}]}}"#;
    let parts = Parts { primitive: primitive.into(), more: more.into(), ..Default::default() };
    let scenes = r#""scenes":[{"name":"full","nodes":[0]},{"name":"empty","nodes":[]},{"name":"empty"}]"#;
    let json = parts.json().replace(r#""scenes":[{"nodes":[0]}]"#, scenes);
    let (_folder, path) = scene_file("scene.gltf", json);
    let import = |scene: Option<&str>, variant: Option<&str>| {
        let (scene, variant) = (scene.map(Into::into), variant.map(Into::into));
        let options = ImportOptions { scene, variant, ..Default::default() };
        import(&path, &options)
    };
    let shown = |variant: Option<&str>| import(None, variant).unwrap().scene.materials[0].name.clone();
    assert_eq!(
        [None, Some("dawn"), Some("noon"), Some("1"), Some("2")].map(shown),
        ["plain", "red", "blue", "red", "red"]
    );
    let instances = |scene: &str| import(Some(scene), None).unwrap().scene.instances.len();
    assert_eq!(["full", "0", "1", "2"].map(instances), [1, 1, 0, 0]);
    let report = import(None, None).unwrap().report;
    assert_eq!((report.scenes, report.variants.len()), (["full", "empty", "empty"].map(String::from).to_vec(), 3));
    for (scene, variant, words) in [
        (Some("empty"), None, "2 scenes have this name; choose by index:\n  0  full\n  1  empty\n  2  empty"),
        (Some("3"), None, "there is no such scene"),
        (None, Some("night"), "there is no such variant; there are:\n  0  dawn"),
    ] {
        let error = import(scene, variant).unwrap_err();
        assert!(error.exit_code() == 64 && error.to_string().contains(words), "{error}");
    }
}
