//! Masks and ids of pictures, against the AOV.

use std::fs;
use std::path::Path;

use bismar::film::exr_file::{HeaderValue, read_header};
use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::gltf_parts::Parts;
use crate::helpers::program::{Folder, attribute, bits, expect, names, read_json, says, scene};
use crate::helpers::statistics::Mean;
use crate::import_reach::chunks;
use crate::views::folder;

#[test]
fn annotations_and_ids_are_those_of_the_aov() {
    let path = &folder();
    let line = "render c.glb --turntable 2 --orbit 20,10,0.6 --size 40x30 --spp 2 --aov object,material";
    expect(path, &format!("{line} -o set/#.exr --preview set/#.jpg -q"), 0);
    expect(path, "labels set/0.exr set/1.exr -o set/a.json --images jpg --ids", 0);
    let ids_files = ["0.exr", "0.jpg", "0.object.png", "1.exr", "1.jpg", "1.object.png", "a.json", "transforms.json"];
    assert_eq!(names(&path.join("set")), ids_files);
    let coco = read_json(&path.join("set/a.json"));
    let list = |key: &str| coco[key].as_array().unwrap().clone();
    assert_eq!((list("images").len(), &list("images")[1]["file_name"]), (2, &"1.jpg".into()));
    assert!(list("annotations").len() > 8, "{coco:#}");
    for (image, name) in [(1, "0"), (2, "1")] {
        let picture = path.join("set").join(format!("{name}.exr"));
        let ids = bits(&picture).into_iter().find(|(name, _)| name == "object.V").unwrap().1;
        let grey = image::open(path.join(format!("set/{name}.object.png"))).unwrap().into_luma16();
        assert_eq!(grey.dimensions(), (40, 30));
        assert!(grey.pixels().zip(&ids).all(|(pixel, id)| u32::from(pixel.0[0]) == *id));
        let objects: Vec<String> = serde_json::from_str(&attribute(&picture, "bismar.objects")).unwrap();
        let mut covered = 0;
        for annotation in list("annotations").into_iter().filter(|a| a["image_id"] == image) {
            let id = annotation["instance_id"].as_u64().unwrap() as u32;
            assert_eq!(annotation["name"], objects[id as usize - 1].as_str());
            let category = list("categories")[annotation["category_id"].as_u64().unwrap() as usize - 1].clone();
            assert_eq!(category["name"], objects[id as usize - 1].as_str());
            assert_eq!(annotation["area"], ids.iter().filter(|other| **other == id).count());
            covered += annotation["area"].as_u64().unwrap();
        }
        assert_eq!(covered as usize, ids.iter().filter(|id| **id != 0).count());
    }
    expect(path, "labels set/0.exr -o m.json --by material -q", 0);
    let materials = read_json(&path.join("m.json"));
    assert!(materials["categories"].as_array().unwrap().iter().any(|c| c["name"] == "red"), "{materials:#}");
    assert_eq!(materials["images"][0]["file_name"], "set/0.exr");

    // Its own files are made again, of other pictures too.
    let arrays = "--ids --depth npy,png --normals npy,png -q";
    for size in ["40x30", "40x30", "50x20"] {
        expect(path, &format!("render c.glb --size {size} --spp 1 --aov object,depth,normal -o own.exr -q"), 0);
        expect(path, &format!("labels own.exr -o own.json {arrays}"), 0);
    }
    fs::write(path.join("own.depth.npy"), fs::read(path.join("own.normal.npy")).unwrap().repeat(2)).unwrap();
    says(path, &format!("labels own.exr {arrays}"), 73, "has not written");

    expect(path, "render c.glb --size 8x8 --spp 1 -o plain.exr -q", 0);
    assert!(expect(path, "labels plain.exr -o x.json", 65).contains("--aov object"));
    expect(path, "labels nowhere.exr -o x.json", 66);
    expect(path, "labels set/0.exr -o set/0.exr", 64);
    assert!(!path.join("x.json").exists());
}

#[test]
fn previews_are_of_the_format_that_their_name_says() {
    let path = &folder();
    let line = "render c.glb --camera framed --sky --transparent --size 40x30 --spp 4 -q";
    expect(path, &format!("{line} -o a.exr --preview a.png"), 0);
    let png = image::open(path.join("a.png")).unwrap().into_rgba8();
    for ending in ["webp", "jpg", "JPEG"] {
        let file = path.join(format!("b.{ending}"));
        expect(path, &format!("develop a.exr -o b.{ending} -q"), 0);
        let read = image::open(&file).unwrap();
        if ending == "webp" {
            assert!(read.color().has_alpha() && read.into_rgba8() == png);
            continue;
        }
        // Lossy, and over black.
        let rgb = read.into_rgb8();
        let mut off = Mean::default();
        for (p, q) in rgb.pixels().zip(png.pixels()).filter(|(_, q)| q.0[3] == 255) {
            (0..3).for_each(|c| off.add(p.0[c].abs_diff(q.0[c]).into()));
        }
        assert!(off.n > 900.0 && off.mean < 8.0, "{off:?}");
        assert!(fs::read(&file).unwrap().starts_with(&[0xff, 0xd8]));
    }
    expect(path, &format!("{line} -o c.exr --preview c.webp"), 0);
    assert_eq!(fs::read(path.join("c.webp")).unwrap(), fs::read(path.join("b.webp")).unwrap());
    assert!(expect(path, "develop a.exr -o a.gif", 64).contains(".png, .jpg or .webp"));
    assert!(expect(path, &format!("{line} -o d.exr --preview d.gif"), 64).contains("--preview"));
}

/// Shape and values of an array of 32-bit floats, as NumPy reads them.
fn npy(path: &Path) -> (String, Vec<u32>) {
    let bytes = fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert_eq!((10 + length) % 64, 0);
    let header = std::str::from_utf8(&bytes[10..10 + length]).unwrap();
    let shape = header.strip_prefix("{'descr': '<f4', 'fortran_order': False, 'shape': (").unwrap();
    let shape = shape.strip_suffix('\n').unwrap().trim_end().strip_suffix("), }").unwrap().to_owned();
    (shape, bytes[10 + length..].as_chunks::<4>().0.iter().map(|x| u32::from_le_bytes(*x)).collect())
}

#[test]
fn depth_and_normals_are_those_of_the_picture_in_metres_and_on_the_axes_asked_for() {
    let path = &folder();
    let line = "render c.glb --turntable 2 --orbit 20,10,1.2 --size 40x30 --spp 2 --aov depth,normal,object";
    expect(path, &format!("{line} -o set/#.exr -q"), 0);
    expect(path, "labels set --depth npy,png --depth-scale 0.0005 --normals npy,png -q", 0);
    let cameras = read_json(&path.join("set/transforms.json"));
    for view in 0..2 {
        let beside = |ending: &str| path.join(format!("set/{view}.{ending}"));
        let channels = bits(&beside("exr"));
        let of = |name: &str| channels.iter().find(|(other, _)| other == name).unwrap().1.clone();
        let depth = of("depth.Z");
        assert_eq!(npy(&beside("depth.npy")), ("30,40,".into(), depth.clone()));
        let png = image::open(beside("depth.png")).unwrap().into_luma16();
        let mut missed = 0;
        for (depth, step) in depth.iter().map(|bits| f32::from_bits(*bits)).zip(png.pixels().map(|p| p.0[0])) {
            missed += u32::from(step == 0);
            // Half of a step, and rounding.
            let error = (f64::from(step) * 0.0005 - f64::from(depth)).abs();
            assert!(if depth == 1e10 { step == 0 } else { depth > 0.0 && error <= 0.000_251 }, "{depth}: {step}");
        }
        assert!(missed > 10 && missed < 1150, "{missed}");
        let normals = ["normal.X", "normal.Y", "normal.Z"].map(of);
        let expected: Vec<u32> = (0..40 * 30).flat_map(|i| [0, 1, 2].map(|c| normals[c][i])).collect();
        let (shape, world) = npy(&beside("normal.npy"));
        assert_eq!((shape.as_str(), &world), ("30,40,3,", &expected));
        let png = image::open(beside("normal.png")).unwrap().into_rgb16();
        for (value, bits) in png.as_raw().iter().zip(&world) {
            let decoded = (f32::from(*value) - 32768.0) / 32767.0;
            // Half of a step, and the rounding of 32-bit floats near 65536.
            assert!((decoded - f32::from_bits(*bits)).abs() <= 0.51 / 32767.0);
        }
        // On the camera's axes, which the data set's cameras state.
        let png_before = fs::read(beside("normal.png")).unwrap();
        expect(path, &format!("labels set/{view}.exr --normals npy --normal-space camera -q"), 0);
        assert_eq!(fs::read(beside("normal.png")).unwrap(), png_before);
        let matrix = &cameras["frames"][view]["transform_matrix"];
        let camera = npy(&beside("normal.npy")).1;
        for (world, camera) in world.as_chunks::<3>().0.iter().zip(camera.as_chunks::<3>().0) {
            for (column, value) in camera.iter().enumerate() {
                let turned = |row: usize| matrix[row][column].as_f64().unwrap() * f64::from(f32::from_bits(world[row]));
                let expected: f64 = (0..3).map(turned).sum();
                // Matrices of 32-bit floats, inverted.
                assert!((f64::from(f32::from_bits(*value)) - expected).abs() < 1e-5);
            }
        }
    }
    let said = expect(path, "labels set/0.exr --depth png --depth-scale 1e-6", 65);
    let enough = said.split("--depth-scale ").nth(1).unwrap().split(' ').next().unwrap();
    expect(path, &format!("labels set/0.exr --depth png --depth-scale {enough} -q"), 0);
    for scale in ["0", "-1", "NaN", "x"] {
        expect(path, &format!("labels set/0.exr --depth png --depth-scale={scale}"), 64);
    }
    expect(path, "labels set/0.exr", 64);
    expect(path, "render c.glb --size 8x8 --spp 1 -o plain.exr -q", 0);
    for (flag, aov) in [("--depth npy", "--aov depth"), ("--normals png", "--aov normal")] {
        assert!(expect(path, &format!("labels plain.exr {flag}"), 65).contains(aov));
        expect(path, &format!("labels nowhere.exr {flag}"), 66);
    }
}

#[test]
fn categories_are_those_of_the_nodes_extras_or_of_a_node_above() {
    let path = &Folder::new();
    let (mut document, binary) = chunks(&fs::read(scene("cornell.glb")).unwrap()).unwrap();
    let nodes = document["nodes"].as_array_mut().unwrap();
    let index = |name: &str| nodes.iter().position(|node| node["name"] == name);
    let (tall, short, floor) = (index("tall block").unwrap(), index("short block").unwrap(), index("floor").unwrap());
    nodes[tall]["extras"] = json!({ "category": "furniture" });
    // Anything may be in extras; the short block is below a node with a category.
    nodes[short]["extras"] = json!([1, { "category": 3 }]);
    nodes[floor]["extras"] = json!({ "category": 7 });
    let above = nodes.len();
    nodes.push(json!({ "children": [short], "extras": { "category": "furniture" } }));
    for root in document["scenes"][0]["nodes"].as_array_mut().unwrap() {
        if *root == json!(short) {
            *root = json!(above);
        }
    }
    fs::write(path.join("c.glb"), glb::file(&document, &binary)).unwrap();
    expect(path, "render c.glb --size 40x30 --spp 4 --aov object --checkpoint 1000 -o 1.exr -q", 0);
    expect(path, "render c.glb --size 40x30 --spp 4 --seed 1 --aov object --checkpoint 1000 -o 2.exr -q", 0);
    // A merged picture knows them too.
    expect(path, "merge 1.exr 2.exr -o both.exr -q", 0);
    for picture in ["1.exr", "both.exr"] {
        expect(path, &format!("labels {picture} -o a.json -q"), 0);
        let coco = read_json(&path.join("a.json"));
        for (name, of) in [("tall block", "furniture"), ("short block", "furniture"), ("floor", "floor")] {
            let annotation = coco["annotations"].as_array().unwrap().iter().find(|each| each["name"] == name).unwrap();
            let id = annotation["category_id"].as_u64().unwrap() as usize;
            assert_eq!(coco["categories"][id - 1]["name"], of, "{name}");
        }
    }
}

#[test]
fn names_outside_ascii_are_those_of_the_file() {
    let path = &Folder::new();
    let nodes = r#"[{"children":[1,2,3]},{"mesh":0,"name":"椅子.001"},{"mesh":0,"name":"Stühle","translation":[1,1,0],
        "extras":{"category":"Möbel"}},{"camera":0,"name":"Büro","translation":[0.5,0.5,4]}]"#;
    let more = r#","materials":[{"name":"Grün"}],"cameras":[{"name":"Büro","type":"orthographic",
        "orthographic":{"xmag":2,"ymag":2,"znear":0.1,"zfar":9}}]"#;
    let primitive = r#"{"attributes":{"POSITION":0},"material":0}"#.into();
    let parts = Parts { nodes: nodes.into(), more: more.into(), primitive, ..Default::default() };
    fs::write(path.join("bühne.gltf"), parts.json()).unwrap();
    fs::create_dir(path.join("set")).unwrap();
    let line = "render bühne.gltf --camera Büro --sky --size 160x32 --spp 2 --aov object,material,crypto-object -q";
    expect(path, &format!("{line} -o set/whole.exr --preview p.png"), 0);
    (1..=2).for_each(|k| drop(expect(path, &format!("{line} --part {k}/2 -o {k}.exr"), 0)));
    expect(path, "merge 1.exr 2.exr -o set/merged.exr -q", 0);
    for name in ["set/whole", "set/merged"] {
        let names = |by: &str, key: &str| -> Vec<String> {
            expect(path, &format!("labels {name}.exr -o a.json --by {by} -q"), 0);
            let coco = read_json(&path.join("a.json"));
            coco[key].as_array().unwrap().iter().map(|each| each["name"].as_str().unwrap().into()).collect()
        };
        assert_eq!(names("object", "categories"), ["椅子", "Möbel"]);
        assert_eq!(names("object", "annotations"), ["椅子.001", "Stühle"]);
        assert_eq!(names("material", "categories"), ["Grün"]);
        let header = read_header(&path.join(format!("{name}.exr"))).unwrap();
        let manifest = header.into_iter().find(|(name, _)| name.ends_with("/manifest")).unwrap().1;
        let HeaderValue::Text(manifest) = manifest else { panic!("{manifest:?}") };
        let manifest: Value = serde_json::from_str(&manifest).unwrap();
        assert!(["椅子.001", "Stühle"].iter().all(|name| manifest[name].is_string()), "{manifest}");
    }
    says(path, "check set", 0, "2 golden pictures: 2 identical");
}
