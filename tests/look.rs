//! `bismar look`: what is in a file, at a glance, for people and for programs; and what differs between two.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::program::{expect, names, says, stdout};
use crate::views::folder;

const SMALL: &str = "--size 48x48 --spp 4 -q";

/// Runs `look` with a line of arguments and returns its JSON.
fn look(folder: &Path, line: &str, code: i32) -> Value {
    serde_json::from_str(&stdout(folder, &format!("look {line}"), code)).unwrap()
}

/// A lamp-less cube-like scene: a square of two triangles with corners at these places.
fn square(corners: [[f32; 3]; 4]) -> Vec<u8> {
    let order = [0, 1, 2, 0, 2, 3];
    let binary: Vec<u8> = order.iter().flat_map(|i| corners[*i]).flat_map(f32::to_le_bytes).collect();
    let fold = |pick: fn(f32, f32) -> f32| {
        let with = |a: [f32; 3], b: &[f32; 3]| std::array::from_fn(|axis| pick(a[axis], b[axis]));
        corners[1..].iter().fold(corners[0], with)
    };
    let document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "materials": [{ "name": "paint", "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3",
            "min": fold(f32::min), "max": fold(f32::max) }],
        "bufferViews": [{ "buffer": 0, "byteLength": binary.len() }],
        "buffers": [{ "byteLength": binary.len() }],
    });
    glb::file(&document, &binary)
}

fn square_of(size: f32, at: f32) -> Vec<u8> {
    square([[at, at, at], [at + size, at, at], [at + size, at + size, at + size], [at, at + size, at + size]])
}

#[test]
fn one_command_says_what_is_in_a_file_and_what_its_views_show() {
    let path = &folder();
    let report = look(path, &format!("c.glb {SMALL}"), 0);
    assert_eq!(names(path), ["c.glb", "c.look.png"]);
    let (scene, views) = (&report["scene"], report["views"].as_array().unwrap());
    let inspected: Value = serde_json::from_str(&stdout(path, "inspect --json c.glb", 0)).unwrap();
    assert_eq!(scene["triangles"], inspected["counts"]["instanced_triangles"]);
    assert_eq!(scene["materials"].as_array().unwrap().len(), inspected["materials"].as_array().unwrap().len());
    assert_eq!((&scene["emits"], &scene["studio_light"], &report["schema"]), (&json!(true), &json!(false), &json!(1)));
    let shown: Vec<&str> = views.iter().map(|view| view["name"].as_str().unwrap()).collect();
    assert_eq!(shown, ["front", "three-quarters", "side", "back"]);
    assert!(views.iter().all(|view| (0.1..=1.0).contains(&view["shown"].as_f64().unwrap())), "{views:?}");
    let sheet = image::open(path.join("c.look.png")).unwrap().into_rgb8();
    assert!(sheet.width() > 96 && sheet.height() > 96 && sheet.width() < 130, "{:?}", sheet.dimensions());
    // Text has ink: the label above the first view.
    assert!(sheet.pixels().take(60 * sheet.width() as usize).any(|p| p.0.iter().all(|x| *x > 150)));

    // The bits do not depend on threads, and other paths have other bits.
    let again = look(path, &format!("c.glb {SMALL} --threads 1 -o again.webp"), 0);
    assert_eq!((&again["hash"], &again["views"]), (&report["hash"], &report["views"]));
    assert_eq!(image::open(path.join("again.webp")).unwrap().into_rgb8(), sheet);
    let other = look(path, "c.glb --size 48x48 --spp 5 -q --views front -o other.png", 0);
    assert_ne!(other["views"][0]["hash"], report["views"][0]["hash"]);
}

#[test]
fn scenes_huge_tiny_flat_far_and_empty_have_sheets() {
    let path = &folder();
    let flat = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 2.0], [0.0, 0.0, 2.0]];
    let empty = glb::file(&json!({ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [] }] }), &[]);
    for (name, bytes, size) in [
        ("huge", square_of(3e8, 0.0), Some(3e8)),
        ("tiny", square_of(2e-6, 0.0), Some(2e-6)),
        ("far", square_of(1.0, 512.0), Some(1.0)),
        ("flat", square(flat), Some(2.0)),
        ("empty", empty, None),
    ] {
        fs::write(path.join(format!("{name}.glb")), bytes).unwrap();
        let report = look(path, &format!("{name}.glb {SMALL}"), 0);
        assert!(path.join(format!("{name}.look.png")).exists());
        let (scene, views) = (&report["scene"], report["views"].as_array().unwrap());
        let Some(size) = size else {
            assert!(scene["bounds"].is_null() && views.iter().all(|view| view["shown"] == 0.0), "{report}");
            continue;
        };
        let found = scene["bounds"]["size"][0].as_f64().unwrap();
        assert!((found / size - 1.0).abs() < 1e-3, "{name}: {found}");
        let most = views.iter().map(|view| view["shown"].as_f64().unwrap()).fold(0.0, f64::max);
        // A square in the sphere around it fills 2/pi of its circle, which is 0.785 of the picture, seen from its side.
        assert!((0.2..0.6).contains(&most), "{name}: {most}");
        assert_eq!(scene["studio_light"], true, "{name}");
        assert!(views.iter().all(|view| view["black"] == 0.0 && view["burnt_out"] == 0.0), "{name}: {views:?}");
    }
    // A flat scene is seen from above.
    assert_eq!(look(path, &format!("flat.glb {SMALL}"), 0)["views"][3]["name"], "top");
}

#[test]
fn a_broken_scene_leaves_nothing_and_no_output_is_an_input() {
    let path = &folder();
    let whole = fs::read(path.join("c.glb")).unwrap();
    fs::write(path.join("cut.glb"), &whole[..whole.len() / 2]).unwrap();
    says(path, &format!("look cut.glb {SMALL}"), 65, "cut.glb");
    says(path, &format!("look none.glb {SMALL}"), 66, "none.glb");
    fs::copy(path.join("c.glb"), path.join("c.png")).unwrap();
    for (line, code, why) in [
        ("look c.png -o c.png", 64, "would overwrite"),
        ("look c.glb -o c.exr", 64, ".png"),
        ("look c.glb --max-flip 0.1", 64, "compare two scenes"),
        ("look c.glb --size 9000x9000", 64, "million pixels"),
        ("look c.glb --views up", 64, "front"),
        ("look c.glb -o no/where.png", 73, "no/where.png"),
        ("look c.glb c.glb c.glb --max-flip 0.1", 64, "the number given is 3"),
    ] {
        says(path, line, code, why);
    }
    assert_eq!(names(path), ["c.glb", "c.png", "cut.glb"]);
    // What another program has written there stays, unless the command line names it.
    fs::write(path.join("c.look.png"), "mine").unwrap();
    expect(path, &format!("look c.glb {SMALL}"), 73);
    assert_eq!(fs::read(path.join("c.look.png")).unwrap(), b"mine");
    expect(path, &format!("look c.glb {SMALL} -o c.look.png"), 0);
}

#[test]
fn frames_of_an_animation_are_rows_of_one_framing() {
    let path = &folder().with("m.glb", glb::moving());
    let report = look(path, &format!("m.glb {SMALL} --frames 0,12,24 --views front"), 0);
    let views = report["views"].as_array().unwrap();
    assert_eq!(views.iter().map(|view| view["frame"].as_u64()).collect::<Vec<_>>(), [Some(0), Some(12), Some(24)]);
    assert!(views[0]["hash"] != views[1]["hash"] && views[1]["hash"] != views[2]["hash"]);
    let single = look(path, &format!("m.glb {SMALL} --frame 12 --views front -o one.png"), 0);
    assert_eq!(single["views"][0]["hash"], views[1]["hash"]);
    assert_eq!(single["scene"]["bounds"], report["scene"]["bounds"]);
    assert!(!report["scene"]["animations"].as_array().unwrap().is_empty());
}

#[test]
fn a_pair_has_one_framing_and_says_what_differs() {
    let path = &folder().with("old.glb", glb::moving());
    fs::copy(path.join("old.glb"), path.join("same.glb")).unwrap();
    let same = look(path, &format!("old.glb same.glb {SMALL} --max-flip 0"), 0);
    assert_eq!((&same["equal"], &same["same_files"], &same["flip"]), (&json!(true), &json!(true), &json!(0.0)));
    assert!(same["differences"].to_string().contains("equal bits in all views"), "{same}");
    assert!(path.join("old-same.look.png").exists());

    fs::write(path.join("new.glb"), square_of(5.0, -1.0)).unwrap();
    let line = format!("old.glb new.glb {SMALL} --max-flip 0.001 --page p.html -o s.png");
    let other = look(path, &line, 1);
    let words = other["differences"].to_string();
    for word in [
        "bounds: ",
        "triangles: 3 -> 2",
        "material 'paint': added",
        "texture '",
        "': removed",
        "animation '",
        "FLIP at most",
    ] {
        assert!(words.contains(word), "{word}: {words}");
    }
    assert_eq!((&other["within"], &other["equal"]), (&json!(false), &json!(false)));
    // Alone, the old scene fills more of its own framing than beside the large new one.
    let share = |report: &Value| report["shown"].as_f64().unwrap();
    let alone = look(path, &format!("old.glb {SMALL} --views front -o a.png"), 0);
    assert!(share(&other["views"][0]["old"]) < 0.5 * share(&alone["views"][0]));
    let page = fs::read_to_string(path.join("p.html")).unwrap();
    assert!(page.contains("triangles: 3 -&gt; 2") || page.contains("triangles: 3 -> 2"));
    look(path, "old.glb new.glb --size 16x16 --spp 2 -q --max-flip 1", 0);
}

#[test]
fn three_scenes_or_more_are_on_one_sheet_and_a_broken_one_does_not_stop_the_others() {
    let path = &folder().with("s/c.glb", square_of(1.0, 0.0)).with("big.glb", square_of(9.0, 0.0)).with("bad.glb", "x");
    let report = look(path, &format!("c.glb s/c.glb big.glb {SMALL}"), 0);
    let scenes = report["scenes"].as_array().unwrap();
    let files: Vec<&str> = scenes.iter().map(|one| one["scene"]["file"].as_str().unwrap()).collect();
    assert_eq!(files, ["c.glb", "s/c.glb", "big.glb"]);
    let sheet = image::open(path.join("c-and-2-more.look.png")).unwrap();
    // Two columns and two rows, below one line.
    assert_eq!((sheet.width(), sheet.height()), (6 + 2 * 54, 28 + 2 * 76));
    for (one, file) in scenes.iter().zip(files) {
        let alone = look(path, &format!("{file} {SMALL} --views three-quarters -o a.png"), 0);
        assert!(["hash", "exposure", "views", "scene"].iter().all(|key| one[key] == alone[key]), "{one} {alone}");
    }
    let line = format!("bad.glb none.glb c.glb big.glb {SMALL} --views front,top -o all.png");
    let report = look(path, &line, 66);
    let codes = [0_usize, 1].map(|i| (&report["failed"][i]["name"], report["failed"][i]["exit_code"].as_u64()));
    assert_eq!(codes, [(&json!("bad.glb"), Some(65)), (&json!("none.glb"), Some(66))]);
    // A row for each scene.
    assert_eq!(report["scenes"].as_array().unwrap().len(), 2);
    assert_eq!(image::open(path.join("all.png")).unwrap().height(), 28 + 2 * 76);
}

#[test]
fn a_look_stays_in_its_folders_and_says_what_it_left_out() {
    let one = square_of(1.0, 0.0);
    let files = ["a/same", "b/same", "a/out/x", "elsewhere/secret", "b/linked", "b/deep"];
    let path = &files.iter().fold(folder(), |folder, name| folder.with(&format!("{name}.glb"), &one));
    fs::write(path.join("elsewhere/t.png"), glb::png(image::RgbImage::new(1, 1))).unwrap();
    for side in ["a", "b"] {
        fs::write(path.join(side).join("t.glb"), glb::pictured()).unwrap();
        std::os::unix::fs::symlink("../elsewhere/t.png", path.join(side).join("t.png")).unwrap();
    }
    let deep = path.join("a").join("d/".repeat(17));
    fs::create_dir_all(&deep).unwrap();
    fs::write(deep.join("x.glb"), &one).unwrap();
    for (to, name) in [
        ("../elsewhere/secret.glb", "a/linked.glb"),
        ("../elsewhere", "b/out"),
        ("nowhere", "a/deep.glb"),
        ("same.glb", "a/inside.glb"),
        ("same.glb", "b/inside.glb"),
        (".", "a/again"),
    ] {
        std::os::unix::fs::symlink(to, path.join(name)).unwrap();
    }
    let report = look(path, &format!("a b {SMALL} --max-flip 0"), 65);
    let left_out = report["left_out"].as_array().unwrap();
    let names: Vec<&str> = left_out.iter().map(|left| left["name"].as_str().unwrap()).collect();
    let deep = "d/".repeat(17);
    assert_eq!(names, [&deep[..33], "deep.glb", "linked.glb", "out", "t.glb"]);
    assert_eq!((&report["within"], &report["unchanged"]), (&json!(false), &json!(["inside.glb", "same.glb"])));
    assert!(["added", "removed", "failed"].iter().all(|key| report[key] == json!([])), "{report}");
    // Scenes of the same bytes, but who knows what their pictures show.
    assert_eq!(report["changed"].as_array().unwrap().len(), 1, "{report}");
    assert_eq!(report["changed"][0]["same_files"], false);
    assert!(
        expect(path, &format!("look a b {SMALL}").replace("-q", ""), 65)
            .contains("linked.glb: left out: a link to a file")
    );
}

#[test]
fn folders_say_what_was_added_removed_and_changed() {
    let one = square_of(1.0, 0.0);
    let files = ["a/gone", "a/sub/same", "b/sub/same", "a/changed", "b/fresh"];
    let folder = files.iter().fold(folder(), |folder, name| folder.with(&format!("{name}.glb"), &one));
    let path = &folder.with("b/changed.glb", square_of(2.0, 0.0));
    let report = look(path, &format!("a b {SMALL}"), 0);
    for (key, name) in [("added", "fresh.glb"), ("removed", "gone.glb"), ("unchanged", "sub/same.glb")] {
        assert_eq!(report[key], json!([name]));
    }
    assert_eq!(report["changed"][0]["name"], "changed.glb");
    assert!(report["changed"][0]["differences"].to_string().contains("1.00 x 1.00 x 1.00 m -> 2.00 x 2.00 x 2.00 m"));
    assert!(path.join("a-b.look.png").exists());
    assert_eq!(look(path, &format!("a b {SMALL} --max-flip 0.001"), 1)["within"], false);
    // A broken scene does not stop the others; its exit code is the command's.
    fs::write(path.join("a/broken.glb"), "x").unwrap();
    fs::write(path.join("b/broken.glb"), "y").unwrap();
    let report = look(path, &format!("a b {SMALL}"), 65);
    assert_eq!([&report["failed"][0]["name"], &report["changed"][0]["name"]], ["broken.glb", "changed.glb"]);
    assert!(expect(path, "look a b --page p.html", 64).contains("two folders"));
    assert!(expect(path, "look a c.glb", 65).contains('a'));
}
