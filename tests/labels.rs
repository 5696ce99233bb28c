//! Masks and ids of pictures, against the AOV.

use std::fs;

use serde_json::Value;

use crate::helpers::program::{attribute, bits, expect, names, scene};

#[test]
fn annotations_and_ids_are_those_of_the_aov() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::copy(scene("cornell.glb"), path.join("c.glb")).unwrap();
    let line = "render c.glb --turntable 2 --orbit 20,10,0.6 --size 40x30 --spp 2 --aov object,material";
    expect(path, &format!("{line} -o set/#.exr --preview set/#.jpg -q"), 0);
    expect(path, "labels set/0.exr set/1.exr -o set/a.json --images jpg --ids", 0);
    let ids_files = ["0.exr", "0.jpg", "0.object.png", "1.exr", "1.jpg", "1.object.png", "a.json", "transforms.json"];
    assert_eq!(names(&path.join("set")), ids_files);
    let coco: Value = serde_json::from_slice(&fs::read(path.join("set/a.json")).unwrap()).unwrap();
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
        let of_image = list("annotations").into_iter().filter(|a| a["image_id"] == image);
        let mut covered = 0;
        for annotation in of_image {
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
    let materials: Value = serde_json::from_slice(&fs::read(path.join("m.json")).unwrap()).unwrap();
    assert!(materials["categories"].as_array().unwrap().iter().any(|c| c["name"] == "red"), "{materials:#}");
    assert_eq!(materials["images"][0]["file_name"], "set/0.exr");

    expect(path, "render c.glb --size 8x8 --spp 1 -o plain.exr -q", 0);
    assert!(expect(path, "labels plain.exr -o x.json", 65).contains("--aov object"));
    expect(path, "labels nowhere.exr -o x.json", 66);
    expect(path, "labels set/0.exr -o set/0.exr", 64);
    assert!(!path.join("x.json").exists());
}

#[test]
fn previews_are_of_the_format_that_their_name_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::copy(scene("cornell.glb"), path.join("c.glb")).unwrap();
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
        let (mut sum, mut opaque) = (0.0, 0);
        for (p, q) in rgb.pixels().zip(png.pixels()).filter(|(_, q)| q.0[3] == 255) {
            sum += (0..3).map(|c| (f64::from(p.0[c]) - f64::from(q.0[c])).abs()).sum::<f64>() / 3.0;
            opaque += 1;
        }
        assert!(opaque > 300 && sum / f64::from(opaque) < 8.0, "{}", sum / f64::from(opaque));
        assert!(fs::read(&file).unwrap().starts_with(&[0xff, 0xd8]));
    }
    expect(path, &format!("{line} -o c.exr --preview c.webp"), 0);
    assert_eq!(fs::read(path.join("c.webp")).unwrap(), fs::read(path.join("b.webp")).unwrap());
    assert!(expect(path, "develop a.exr -o a.gif", 64).contains(".png, .jpg or .webp"));
    assert!(expect(path, &format!("{line} -o d.exr --preview d.gif"), 64).contains("--preview"));
}
