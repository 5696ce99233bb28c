//! The first picture of a file that nobody has prepared: its default light, texture coordinates, and what is said.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use bismar::film::Pixels;
use bismar::rays::Backend;
use bismar::render::prepass::default_light::own_light;
use bismar::render::{Choice, RenderSettings, RunOptions, Technique, run};
use bismar::scene::build::{area_light, glass, lambert, look};
use bismar::scene::import::{ImportOptions, NoteKind, import};
use bismar::scene::{AlphaMode, Material, Scene, TextureSlot};
use glam::{Vec3, vec4};

use crate::helpers::gltf_parts::{Parts, floats, scene_file};
use crate::helpers::program::{Folder, assert_same_bits, bits, expect, says, stdout};
use crate::helpers::stage::{Stage, add, add_sphere, closed_box, rectangle, sphere};
use crate::import_content::{accessor, with};

/// Two triangles side by side, seen by a camera in front: the first of material 0, the second of material 1.
fn two(materials: &str) -> String {
    let primitive = r#"{"attributes":{"POSITION":0},"material":0},{"attributes":{"POSITION":1},"material":1}"#;
    let second = floats(&[1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let mut parts = with(second, &accessor(36, 5126, 3, "VEC3", false), primitive);
    parts.more = format!(r#","materials":[{materials}]"#);
    parts.json()
}

fn write(folder: &Path, json: &str) {
    fs::write(folder.join("a.gltf"), json).unwrap();
}

const DISPLAY: &str = r#"{},{"emissiveFactor":[1,1,1]}"#;

#[test]
fn a_display_that_lights_nothing_does_not_switch_the_default_light_off() {
    let folder = Folder::new();
    let said = |flags: &str| expect(&folder, &format!("render a.gltf --size 24x18 --spp 2 {flags}"), 0);
    write(&folder, &two(DISPLAY));
    let text = said("");
    assert!(text.contains("its own light reaches 0 of") && text.contains("studio light is added"), "{text}");
    assert!(!text.contains(" is black "), "{text}");
    // Nothing is added to it, and its dark part is told.
    let text = said("--no-env");
    assert!(!text.contains("studio"), "{text}");
    // A picture that shines all over needs no light.
    write(&folder, &two(r#"{"emissiveFactor":[1,1,1]},{"emissiveFactor":[1,1,1]}"#));
    assert!(!said("").contains("studio"));
    let inspected = |materials: &str| {
        write(&folder, &two(materials));
        serde_json::from_str::<serde_json::Value>(&stdout(&folder, "inspect a.gltf --json", 0)).unwrap()
    };
    let found = inspected(DISPLAY);
    assert_eq!((&found["default_light"], &found["own_light"]["lit"]), (&true.into(), &0.into()));
    let found = inspected("{},{}");
    assert_eq!((&found["default_light"], &found["own_light"]), (&true.into(), &serde_json::Value::Null));
    write(&folder, &two(DISPLAY));
    assert!(expect(&folder, "inspect a.gltf", 0).is_empty());
}

#[test]
fn the_default_light_is_the_same_for_parts_crops_threads_and_seeds() {
    let folder = Folder::new();
    write(&folder, &two(DISPLAY));
    let line = "render a.gltf --size 40x30 --spp 4 -q";
    for (flags, name) in [("--threads 1", "one"), ("--threads 2", "two"), ("--part 1/2", "p1"), ("--part 2/2", "p2")] {
        expect(&folder, &format!("{line} {flags} -o {name}.exr"), 0);
    }
    expect(&folder, "merge p1.exr p2.exr -o merged.exr -q", 0);
    assert_eq!(bits(&folder.join("one.exr")), bits(&folder.join("two.exr")));
    assert_eq!(bits(&folder.join("one.exr")), bits(&folder.join("merged.exr")));
    says(&folder, "render a.gltf --size 7x90 --spp 1 --seed 9 --crop 2,3,4,5", 0, "studio light is added");
}

/// A floor under a lamp, in a room or not.
fn lamp_over_floor(lamp: f32) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    rectangle(&mut scene, 2.0, [-0.4, 0.4], [-0.9, -0.3], false, area_light(lamp));
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.5, 0.0), 0.6);
    scene
}

#[test]
fn a_lamp_over_a_floor_is_enough_light() {
    for backend in [Backend::Embree, Backend::Obvhs] {
        let of =
            |lamp| own_light(&Stage::new(lamp_over_floor(lamp).into(), backend).scene, 0, &RenderSettings::default());
        let found = of(9.0);
        assert!(found.is_enough() && found.lit * 2 > found.surfaces && found.covered >= found.surfaces, "{found:?}");
        let found = of(1e-6);
        assert!(!found.is_enough() && found.lit == 0 && found.surfaces > 100, "{found:?}");
    }
}

/// A floor under a small lamp, with these spheres around it: radius, whether it shows its inside, material.
fn lamp_in(spheres: &[(f32, bool, Material)]) -> Scene {
    let (mut scene, center) = (Scene::default(), Vec3::new(0.0, 1.2, -0.6));
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    add_sphere(&mut scene, 8, 0.05, center, area_light(300.0));
    for (radius, inward, material) in spheres {
        let (points, mut triangles) = sphere(16, *radius, center);
        triangles.iter_mut().filter(|_| *inward).for_each(|corners| corners.reverse());
        add(&mut scene, points, triangles, material.clone());
    }
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.5, 0.0), 0.6);
    scene
}

#[test]
fn a_lamp_behind_glass_is_enough_light_and_one_in_a_box_is_none() {
    let of = |scene: Scene, backend| own_light(&Stage::new(scene.into(), backend).scene, 0, &RenderSettings::default());
    let thin = |roughness| Material { bounds_medium: false, ..glass(1.5, roughness) };
    let shell = |radius: f32, material: Material| [(radius, false, material.clone()), (0.9 * radius, true, material)];
    let amber =
        Material { base_color: vec4(0.9, 0.5, 0.1, 1.0), absorption: Vec3::new(1.0, 2.0, 5.0), ..glass(1.5, 0.0) };
    let blended = Material { alpha_mode: AlphaMode::Blend, base_color: vec4(0.5, 0.5, 0.5, 0.5), ..lambert(0.5) };
    let paper = Material { diffuse_transmission: 0.5, ..lambert(0.5) };
    let lanterns = [
        vec![(0.3, false, glass(1.5, 0.0))],
        shell(0.2, glass(1.5, 0.0)).to_vec(),
        [0.2, 0.3, 0.4, 0.5].into_iter().flat_map(|radius| shell(radius, glass(1.5, 0.0))).collect(),
        shell(0.2, glass(1.5, 0.5)).to_vec(),
        shell(0.2, amber.clone()).to_vec(),
        vec![(0.2, false, amber), (0.3, false, thin(0.0)), (0.4, false, thin(0.7))],
        vec![(0.2, false, blended)],
        vec![(0.2, false, paper)],
        // Around the camera too.
        vec![(9.0, false, Material { absorption: Vec3::splat(0.1), ..glass(1.33, 0.0) })],
    ];
    for (case, spheres) in lanterns.iter().enumerate() {
        for backend in [Backend::Embree, Backend::Obvhs] {
            let found = of(lamp_in(spheres), backend);
            assert!(found.is_enough() && found.lit * 2 > found.surfaces, "{case} {backend:?}: {found:?}");
        }
    }
    let opaque = [(0.4, false, lambert(0.5)), (0.2, false, glass(1.5, 0.0))];
    let found = of(lamp_in(&opaque), Backend::Embree);
    assert!(!found.is_enough() && found.lit == 0, "{found:?}");
    // A display lights neither its device nor, by its cover glass, itself.
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-3.0, 0.0], [-3.0, 3.0], true, lambert(0.5));
    rectangle(&mut scene, 0.0, [0.0, 3.0], [-3.0, 3.0], true, Material { emissive: Vec3::ONE, ..lambert(0.5) });
    closed_box(&mut scene, Vec3::new(0.001, 0.001, -3.0), Vec3::new(3.0, 0.01, 3.0), glass(1.5, 0.0));
    look(&mut scene, Vec3::new(0.0, 5.0, 0.0), Vec3::ZERO, 0.9);
    let found = of(scene, Backend::Embree);
    assert!(!found.is_enough() && found.surfaces * 3 > found.covered, "{found:?}");
}

#[test]
fn without_clipping_a_camera_with_planes_is_one_without() {
    // The planes hide all: no surface is lit in what they leave.
    let with = |clip: Option<[f32; 2]>| {
        let mut scene = lamp_over_floor(9.0);
        scene.cameras[0].clip = clip;
        Stage::new(scene.into(), Backend::Embree)
    };
    let [planes, none] = [Some([0.1, 0.2]), None].map(with);
    let settings = RenderSettings { clip: false, width: 24, height: 16, spp: Some(16), ..Default::default() };
    let settings = settings.with(Technique::Guiding, Choice::On);
    let light = |stage: &Stage| own_light(&stage.scene, 0, &settings);
    assert_eq!(light(&planes), light(&none));
    assert_eq!(own_light(&planes.scene, 0, &RenderSettings::default()).covered, 0);
    let picture = |stage: &Stage| {
        let rendered = run(&stage.scene, &settings, RunOptions::new(&AtomicBool::new(false), &|_| ())).unwrap();
        let pixels = rendered.pixels();
        (0..24 * 16).map(|i| pixels.at(i % 24, i / 24).0.mean()).collect::<Vec<_>>()
    };
    assert_eq!(picture(&planes), picture(&none));
}

#[test]
fn any_set_of_texture_coordinates_that_a_texture_names_is_loaded() {
    let uv = |x: f32| floats(&[x, 0.0, x, 0.5, x, 1.0]);
    let accessors = [36, 60, 84].map(|at| accessor(at, 5126, 3, "VEC2", false)).concat();
    let primitive = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_2":2,"TEXCOORD_5":3},"material":0}"#;
    let mut parts = with([uv(0.25), uv(0.5), uv(0.75)].concat(), &accessors, primitive);
    parts.more = r#","materials":[{"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0,"texCoord":5},
        "pbrMetallicRoughness":{"baseColorTexture":{"index":0,"texCoord":2}}}],
        "textures":[{"source":0}],"images":[{"uri":"a.png"}]"#
        .into();
    let (folder, path) = scene_file("scene.gltf", parts.json());
    image::RgbImage::from_fn(4, 1, |x, _| image::Rgb([60 * x as u8; 3])).save(folder.path().join("a.png")).unwrap();
    let imported = import(&path, &ImportOptions::default()).unwrap();
    assert_eq!(imported.report.of_kind(NoteKind::Ignored).count(), 0);
    let scene = &imported.scene;
    let (mesh, material) = (&scene.meshes[0], &scene.materials[0]);
    // Only the sets that textures name, and the first for the AOV `uv`.
    assert!(mesh.texcoords[0].is_some() && mesh.texcoords[1].is_none(), "{:?}", mesh.texcoords);
    assert_eq!(mesh.more_texcoords.iter().map(|(set, _)| *set).collect::<Vec<_>>(), [2, 5]);
    for (slot, x) in [(TextureSlot::BaseColor, 0.5), (TextureSlot::Emissive, 0.75)] {
        let texture = material.textures[slot].as_ref().unwrap();
        assert_eq!(mesh.texcoord(texture, 0, (0.25, 0.25)).x, x);
    }
    // What the camera sees of it: the base colour at 0.5, the emission at 0.75.
    let line = "render scene.gltf --size 8x8 --spp 4 --no-env --aov albedo,emission -q";
    expect(folder.path(), line, 0);
}

#[test]
fn a_git_lfs_pointer_is_named_as_such() {
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    let folder = Folder::new();
    let told = |file: &str, code| {
        fs::write(folder.join(file), pointer).unwrap();
        let text = expect(&folder, "render a.gltf --size 8x8 --spp 1", code);
        assert!(text.contains("Git LFS pointer") && text.contains("git lfs pull") && text.contains(file), "{text}");
    };
    told("a.gltf", 65);
    write(&folder, &Parts::default().json_with("a.bin"));
    told("a.bin", 65);
}

#[test]
fn a_scene_without_a_triangle_says_so() {
    let folder = Folder::new();
    fs::write(folder.join("a.gltf"), r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{}]}"#)
        .unwrap();
    says(&folder, "render a.gltf --size 8x8 --spp 1", 0, "has no triangle to show");
}

#[test]
fn lights_in_watts_are_told_by_the_picture() {
    let folder = Folder::new();
    let lit = |candela: f64| {
        let light = format!(r#"{{"type":"directional","intensity":{candela}}}"#);
        write(&folder, &Parts::of_light(&light).json());
    };
    let said = |flags: &str| expect(&folder, &format!("render a.gltf --size 16x12 --spp 2 {flags}"), 0);
    lit(683.0);
    assert!(said("").contains("--light-unit watt"));
    assert!(!said("--light-unit watt").contains("luminance"));
    // Neither dim light nor the sun's is in watts.
    for lux in [1.0, 1e5] {
        lit(lux);
        assert!(!said("").contains("luminance"), "{lux}");
    }
}

#[test]
fn a_faulty_camera_is_an_error_only_where_it_is_the_one_that_is_rendered() {
    let folder = Folder::new();
    let mut parts = Parts {
        nodes: r#"[{"mesh":0,"camera":0,"children":[1]},{"name":"good","camera":1}]"#.into(),
        ..Default::default()
    };
    let camera = |znear: u32| format!(r#"{{"type":"perspective","perspective":{{"yfov":1,"znear":{znear}}}}}"#);
    parts.more = format!(r#","cameras":[{},{}]"#, camera(0), camera(1));
    write(&folder, &parts.json());
    for (flags, code) in [
        ("", 65),
        ("--camera 0", 65),
        ("--camera good", 0),
        ("--camera 1", 0),
        ("--camera framed", 0),
        ("--orbit 0,0", 0),
    ] {
        let said = expect(&folder, &format!("render a.gltf --size 8x8 --spp 1 {flags}"), code);
        assert_eq!(
            said.contains("a.gltf: cameras[0].perspective.znear: expected a number above 0"),
            code == 65,
            "{said}"
        );
    }
    assert!(stdout(&folder, "inspect a.gltf", 0).contains("faulty"));
}

#[test]
fn a_preset_is_the_flags_that_its_help_says_and_given_flags_win() {
    let path = &Folder::new().with_scene("c.glb", "cornell.glb");
    let help = stdout(path, "render --help", 0);
    for (preset, flags, own, rest) in [
        (
            "thumbnail",
            "--size 512x512 --spp 16 --aov none --adaptive off --guiding off --path-reuse off",
            "--size 24x18",
            "--spp 16 --aov none --adaptive off --guiding off --path-reuse off",
        ),
        (
            "product",
            "--size 1024x1024 --spp 256 --ground shadow",
            "--size 24x18 --orbit 20,30",
            "--spp 256 --ground shadow",
        ),
        ("final", "--size 1920x1080 --spp 1024 --checkpoint 60", "--size 24x18 --spp 3 --aov none", "--checkpoint 60"),
    ] {
        assert!(help.contains(&format!("{preset}:")) && help.contains(flags), "{help}");
        let said = expect(path, &format!("render c.glb --preset {preset} {own} -v -o preset.exr"), 0);
        let denoise = if said.contains(&format!("{flags} --denoise oidn;")) { "--denoise oidn" } else { "" };
        assert!(said.contains(&format!("--preset {preset} stands for {flags}")), "{said}");
        expect(path, &format!("render c.glb {rest} {own} {denoise} -o flags.exr -q"), 0);
        assert_same_bits(&path.join("preset.exr"), &path.join("flags.exr"));
        // The command with the flags is the same render.
        let again = expect(path, &format!("render c.glb {rest} {own} {denoise} -o preset.exr --resume"), 0);
        assert!(again.contains("nothing to do"), "{again}");
    }
    expect(path, "render c.glb --preset poster", 64);
}
