//! Many views of one scene: each is the picture of a command of its own, of one load of the scene, with its camera beside it.

use std::f32::consts::{PI, TAU};
use std::fs;

use bismar::film::Picture;
use bismar::film::exr_file::{HeaderValue, write_rgb};
use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, attribute, channel, expect, names, read_json, says};

const FLAGS: &str = "--size 32x20 --spp 4";

pub fn folder() -> Folder {
    Folder::new().with_scene("c.glb", "cornell.glb")
}

#[test]
fn a_turntable_is_orbits_of_one_load_and_its_cameras_make_it_again() {
    let path = &folder();
    let line =
        format!("render c.glb --turntable 3 --orbit 40,-10,0.7 {FLAGS} -o set/v.##.exr --preview set/{{frame}}.png");
    let said = expect(path, &format!("{line} -v"), 0);
    assert_eq!(said.matches("built embree").count(), 1, "{said}");
    let files = ["0.png", "1.png", "2.png", "transforms.json", "v.00.exr", "v.01.exr", "v.02.exr"];
    assert_eq!(names(&path.join("set")), files);
    for (view, azimuth) in [(0, 40), (1, 160), (2, 280)] {
        expect(path, &format!("render c.glb --orbit {azimuth},-10,0.7 {FLAGS} -o single.exr -q"), 0);
        assert_same_bits(&path.join("single.exr"), &path.join(format!("set/v.0{view}.exr")));
    }
    assert!(expect(path, &line, 0).contains("3 done before"));
    // Another view is another picture.
    expect(path, &format!("render c.glb --orbit 41,-10,0.7 {FLAGS} -o single.exr --resume -q"), 65);

    // The cameras that were written give the same views: to what 32-bit matrices can tell.
    let cameras = read_json(&path.join("set/transforms.json"));
    assert_eq!(cameras["frames"].as_array().map(Vec::len), Some(3));
    assert_eq!((&cameras["frames"][1]["w"], &cameras["frames"][1]["file_path"]), (&json!(32.0), &json!("v.01.exr")));
    expect(path, "render c.glb --cameras set/transforms.json --spp 4 -o again/v.##.exr --aov depth -q", 0);
    for view in 0..3 {
        let line = format!("compare again/v.0{view}.exr set/v.0{view}.exr --max-relmse 0.01");
        expect(path, &line, 0);
    }
    expect(path, "compare again/v.00.exr set/v.01.exr --max-relmse 0.01", 1);
    let again = read_json(&path.join("again/transforms.json"));
    for view in 0..3 {
        for (row, column) in (0..4).flat_map(|row| (0..4).map(move |column| (row, column))) {
            let of = |all: &Value| all["frames"][view]["transform_matrix"][row][column].as_f64().unwrap();
            // A rotation, and an eye within 10 m, in 32-bit floats through two inversions.
            assert!((of(&cameras) - of(&again)).abs() < 1e-4);
        }
    }
    let angle = |all: &Value| all["camera_angle_x"].as_f64().unwrap();
    assert!((angle(&cameras) - angle(&again)).abs() < 1e-5);
    // One of them, by name, without a number in its name.
    expect(path, "render c.glb --cameras set/transforms.json --camera v.01 --spp 4 -o one.exr --aov depth -q", 0);
    assert_same_bits(&path.join("one.exr"), &path.join("again/v.01.exr"));
}

#[test]
fn a_batch_has_views_too() {
    let path = &folder();
    let text = "[defaults]\nscene = \"c.glb\"\nsize = [32, 20]\nspp = 4\noutput = \"{name}/####.exr\"\n\
                [[job]]\nname = \"table\"\nturntable = 2\norbit = [40, -10, 0.7]\n[[job]]\nname = \"one\"\norbit = [40, -10, 0.7]\n\
                output = \"one.exr\"\n";
    fs::write(path.join("jobs.toml"), text).unwrap();
    let said = expect(path, "batch jobs.toml -v", 0);
    assert_eq!(said.matches("built embree").count(), 1, "{said}");
    let set = fs::read_dir(path).unwrap().flatten().find(|e| e.path().is_dir()).unwrap().path();
    assert_eq!(names(&set), ["0000.exr", "0001.exr", "transforms.json"]);
    assert_same_bits(&path.join("one.exr"), &set.join("0000.exr"));
}

#[test]
fn what_is_no_view_is_refused_before_anything_is_written() {
    let path = &folder();
    let cameras = json!({"camera_angle_x": 1.0, "frames": [{"transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]}]});
    fs::write(path.join("bad.json"), cameras.to_string()).unwrap();
    for (flags, code, why) in [
        ("--orbit 0,91", 64, "elevation"),
        ("--orbit 0,0,0", 64, "distance"),
        ("--orbit 0,0 --camera 0", 64, "cannot be used with"),
        ("--turntable 3 -o a.exr", 64, "one file for all views"),
        ("--turntable 0", 64, "--turntable"),
        ("--turntable 3 --frames 1-2", 64, "cannot be used with"),
        ("--cameras nowhere.json", 66, "cannot read"),
        ("--cameras bad.json", 65, "last row"),
    ] {
        says(path, &format!("render c.glb {FLAGS} {flags}"), code, why);
    }
    assert_eq!(names(path), ["bad.json", "c.glb"]);
}

/// An environment of 8 x 4 blocks of 8 x 8 texels with different radiances.
fn blocks() -> Vec<[f32; 3]> {
    let block = |x: usize, y: usize| [0.5 + x as f32, 1.0 + y as f32, 0.25 * (x + 3 * y) as f32];
    (0..32).flat_map(|y| (0..64).map(move |x| block(x / 8, y / 8))).collect()
}

#[test]
fn a_panorama_is_the_environment_map_that_it_sees() {
    let path = &Folder::new().with("t.glb", glb::triangle());
    write_rgb(&path.join("sky.exr"), [0, 0, 64, 32], [0, 0, 64, 32], &blocks()).unwrap();
    let line = "render t.glb --camera panorama --size 64x32 --filter box --spp 4 --aov depth -q";
    expect(path, &format!("{line} --env sky.exr -o a.exr"), 0);
    expect(path, &format!("{line} --env a.exr -o b.exr"), 0);
    let hidden = Picture::open(&path.join("a.exr"), Some("depth.Z")).unwrap().rgb;
    let mut compared = 0;
    for name in ["a.exr", "b.exr"] {
        let seen = Picture::open(&path.join(name), None).unwrap().rgb;
        for (i, (seen, sky)) in seen.iter().zip(blocks()).enumerate() {
            // The inner texels of a block: interpolation reaches half a texel beyond a pixel, twice.
            let inner = [i % 64 % 8, i / 64 % 8].iter().all(|k| (2..6).contains(k));
            // Nothing in front of the sky, here and in the pixels around.
            let at = |dx: usize, dy: usize| hidden[(i / 64 + dy) % 32 * 64 + (i % 64 + dx) % 64][0];
            let is_clear = [0, 1, 63].iter().all(|&dx| [0, 1, 31].iter().all(|&dy| at(dx, dy) == 1e10));
            if inner && is_clear {
                compared += 1;
                let same = seen.iter().zip(sky).all(|(a, b)| (a - b).abs() <= 1e-5 * b);
                assert!(same, "{name}, pixel {i}: {seen:?} for {sky:?}");
            }
        }
    }
    assert!(compared > 600, "{compared}");
}

#[test]
fn a_panorama_sees_the_room_around_its_camera_and_its_depth_is_the_distance() {
    let path = &folder();
    let line = "render c.glb --size 64x32 --spp 1 --aov depth,position -q";
    expect(path, &format!("{line} --camera panorama -o a.exr"), 0);
    expect(path, &format!("{line} --camera 0 -o straight.exr"), 0);
    let matrix = |name: &str| attribute(&path.join("straight.exr"), name) == attribute(&path.join("a.exr"), name);
    assert!(!matrix("worldToCamera"));
    let header = bismar::film::exr_file::read_header(&path.join("a.exr")).unwrap();
    assert!(header.iter().all(|(name, _)| name != "worldToNDC"));
    // The camera of the file, from its own header: columns of the row-major matrix for row vectors.
    let Some((_, HeaderValue::Matrix(to_camera))) = header.into_iter().find(|(name, _)| name == "worldToCamera") else {
        panic!("no camera")
    };
    let eye = glam::Mat4::from_cols_array(&to_camera).inverse().transform_point3(glam::Vec3::ZERO);
    let of = |layer: &str| Picture::open(&path.join("a.exr"), Some(layer)).unwrap().rgb;
    let (depth, position) = (of("depth.Z"), of("position"));
    let mut hits = 0;
    for (i, (depth, position)) in depth.iter().zip(&position).enumerate().filter(|(_, (depth, _))| depth[0] < 1e9) {
        hits += 1;
        // One path per pixel: both are of the same hit.
        let toward = glam::Vec3::from(*position) - eye;
        assert!((toward.length() - depth[0]).abs() < 1e-4 * depth[0], "{depth:?} {toward}");
        // As in an environment map; the filter reaches two pixels.
        let [u, v] = [(i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5].map(|x| x / 64.0);
        let (longitude, latitude) = ((u - 0.5) * TAU, (0.5 - 2.0 * v) * PI);
        let (s, c) = longitude.sin_cos();
        let direction = glam::Vec3::new(c * latitude.cos(), latitude.sin(), s * latitude.cos());
        assert!(direction.dot(toward.normalize()) > (3.0 * PI / 32.0).cos(), "pixel {i}: {direction} {toward}");
    }
    assert!(hits > 30, "{hits}");
    assert!(expect(path, "render c.glb --camera panorama --aperture 0.1", 64).contains("panorama"));
}

#[test]
fn panoramas_are_in_camera_files_too() {
    let path = &folder();
    let frame = json!({"transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 4], [0, 0, 1, 0], [0, 0, 0, 1]]});
    let rig = json!({"camera_model": "EQUIRECTANGULAR", "w": 32, "h": 16, "frames": [frame]});
    fs::write(path.join("rig.json"), rig.to_string()).unwrap();
    expect(path, "render c.glb --cameras rig.json --spp 2 --aov depth -o a/##.exr -q", 0);
    // From above the boxes in the room, which is open in front only: +z, at both sides of the picture.
    let depth = Picture::open(&path.join("a/00.exr"), Some("depth.Z")).unwrap().rgb;
    assert!(depth.iter().filter(|d| d[0] < 1e9).count() > 300);
    assert!(depth[8 * 32][0] > 1e9 && depth[8 * 32 + 16][0] < 1e9);
    let written = read_json(&path.join("a/transforms.json"));
    assert_eq!(written["frames"][0]["camera_model"], "EQUIRECTANGULAR");
    expect(path, "render c.glb --cameras a/transforms.json --spp 2 --aov depth -o b/##.exr -q", 0);
    assert_same_bits(&path.join("a/00.exr"), &path.join("b/00.exr"));
}

#[test]
fn cameras_of_crops_are_those_of_the_cropped_pictures() {
    let path = &folder();
    let line = "render c.glb --turntable 2 --orbit 40,-10,0.7 --size 64x48 --spp 32 --aov position,depth -q";
    for (name, crop) in [("all", ""), ("cut", "--crop 10,20,50,44"), ("middle", "--crop 16,12,48,36")] {
        expect(path, &format!("{line} {crop} -o {name}/#.exr"), 0);
    }
    let [all, cut] = ["all", "cut"].map(|name| read_json(&path.join(format!("{name}/transforms.json"))));
    for view in 0..2 {
        let (all, cut) = (&all["frames"][view], &cut["frames"][view]);
        let number = |key: &str| cut[key].as_f64().unwrap();
        assert_eq!(["w", "h", "cx", "cy"].map(number), [40.0, 24.0, 22.0, 4.0]);
        assert!(["fl_x", "fl_y", "transform_matrix"].iter().all(|key| cut[key] == all[key]), "{cut} {all}");
        assert!((number("camera_angle_x") - 2.0 * (20.0 / number("fl_x")).atan()).abs() < 1e-12);
    }
    // A crop is a camera of its own, with a principal point off the middle.
    for name in ["middle", "cut"] {
        let line = format!("render c.glb --cameras {name}/transforms.json --spp 32 --aov depth -o {name}2/#.exr -q");
        expect(path, &line, 0);
    }
    let [middle, again] = ["middle", "middle2"].map(|name| read_json(&path.join(format!("{name}/transforms.json"))));
    for key in ["w", "h", "cx", "cy", "fl_x", "fl_y"] {
        let of = |all: &Value| all["frames"][1][key].as_f64().unwrap();
        // Through 32-bit matrices.
        assert!((of(&middle) / of(&again) - 1.0).abs() < 1e-5, "{key}: {middle} {again}");
    }
    let [first, second] = ["cut", "cut2"].map(|name| read_json(&path.join(format!("{name}/transforms.json"))));
    assert_eq!(first["frames"][1]["cx"], second["frames"][1]["cx"]);
    // The same views, but for their noise and the places of their windows.
    let [again, cut] = ["cut2", "cut"].map(|name| channel(&path.join(format!("{name}/1.exr")), "depth.Z"));
    let errors: Vec<_> = again.iter().zip(&cut).map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() / b }).collect();
    // Edges of objects apart.
    let near = errors.iter().filter(|error| **error < 0.02).count();
    assert!(near > 19 * errors.len() / 20, "{near} of {}", errors.len());
}

#[test]
fn calibrated_cameras_are_written_as_they_were_read_and_depths_along_the_axis_are_of_them() {
    let path = &folder();
    let rows = [[1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 1, 3]];
    let lens = json!({"w": 64, "h": 48, "fl_x": 41.5, "fl_y": 40.25, "cx": 30.125, "cy": 25.5});
    for (name, model, more) in [
        ("linear", "PINHOLE", json!({})),
        ("opencv", "OPENCV", json!({"k1": -0.11, "k2": 0.02, "p1": 0.003, "p2": -0.002})),
        ("full", "FULL_OPENCV", json!({"k1": 0.2, "k4": 0.3, "k6": 0.01})),
        ("fisheye", "OPENCV_FISHEYE", json!({"k1": -0.03, "k4": 0.001})),
    ] {
        let mut rig = json!({"camera_model": model, "frames": [{"file_path": "a", "transform_matrix": rows}]});
        for (key, value) in lens.as_object().unwrap().iter().chain(more.as_object().unwrap()) {
            rig[key] = value.clone();
        }
        fs::write(path.join("rig.json"), rig.to_string()).unwrap();
        let line = "--spp 4 --aov depth,position,object -q";
        expect(path, &format!("render c.glb --cameras rig.json {line} -o {name}/#.exr"), 0);
        let written = read_json(&path.join(format!("{name}/transforms.json")));
        let frame = &written["frames"][0];
        let same = |key: &str, value: &Value| frame[key] == *value || frame[key].as_f64() == value.as_f64();
        let all = rig.as_object().unwrap();
        assert!(all.iter().all(|(key, value)| key == "frames" || same(key, value)), "{frame}");
        assert_eq!(written["camera_model"], model);
        // The same camera, so the same bits; and of a crop the same pixels.
        expect(path, &format!("render c.glb --cameras {name}/transforms.json {line} -o {name}-again/#.exr"), 0);
        assert_same_bits(&path.join(format!("{name}/0.exr")), &path.join(format!("{name}-again/0.exr")));
        let line = format!("render c.glb --cameras rig.json {line}");
        expect(path, &format!("{line} --crop 8,8,40,40 -o {name}-cut/#.exr"), 0);
        let cut = read_json(&path.join(format!("{name}-cut/transforms.json")));
        assert_eq!((&cut["frames"][0]["cx"], &cut["frames"][0]["k1"]), (&json!(22.125), &frame["k1"]));

        expect(path, &format!("labels {name} --depth npy --depth-along axis -q"), 0);
        let bytes = fs::read(path.join(format!("{name}/0.depth.npy"))).unwrap();
        let depth = bytes[bytes.len() - 4 * 64 * 48..].as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x));
        let [position, along_ray] = ["position", "depth.Z"]
            .map(|layer| Picture::open(&path.join(format!("{name}/0.exr")), Some(layer)).unwrap().rgb);
        let hits = depth.zip(&position).zip(along_ray).filter(|(_, ray)| ray[0] < 1e9);
        let off = |((depth, position), _): ((f32, &[f32; 3]), [f32; 3])| (depth / (3.0 - position[2]) - 1.0).abs();
        let mut errors: Vec<f32> = hits.map(off).collect();
        errors.sort_by(f32::total_cmp);
        // By the middle of the pixel in place of its paths: few pixels lie on edges.
        let most = errors[errors.len() * 8 / 10];
        assert!(errors.len() > 1000 && most < 0.02, "{name}: {most}");
        // Merged parts keep the camera.
        for part in [1, 2] {
            expect(path, &format!("{line} --part {part}/2 -o {name}-{part}/#.exr"), 0);
        }
        expect(path, &format!("merge {name}-1/0.exr {name}-2/0.exr -o {name}/merged.exr -q"), 0);
        let calibration = |file: &str| attribute(&path.join(name).join(file), "bismar.calibration");
        assert_eq!(calibration("merged.exr"), calibration("0.exr"));
    }
    let line = "render c.glb --cameras rig.json --aperture f/2 --spp 1 -o x/#.exr";
    assert!(expect(path, line, 64).contains("a fisheye has no focal plane"));
    expect(path, "render c.glb --cameras opencv/transforms.json --aperture f/2 --spp 1 -o x/#.exr -q", 0);
    expect(path, "render c.glb --cameras opencv/transforms.json --size 128x96 --spp 1 -o y/#.exr -q", 0);
    let scaled = read_json(&path.join("y/transforms.json"));
    assert_eq!((&scaled["frames"][0]["fl_x"], &scaled["frames"][0]["cy"]), (&json!(83.0), &json!(51.0)));
}
