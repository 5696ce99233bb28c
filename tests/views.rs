//! Many views of one scene: each is the picture of a command of its own, of one load of the scene, with its camera beside it.

use std::fs;

use serde_json::{Value, json};

use crate::helpers::program::{assert_same_bits, expect, names, scene};

const FLAGS: &str = "--size 32x20 --spp 4";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(scene("cornell.glb"), folder.path().join("c.glb")).unwrap();
    folder
}

fn json_of(path: &std::path::Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_turntable_is_orbits_of_one_load_and_its_cameras_make_it_again() {
    let folder = folder();
    let path = folder.path();
    let line =
        format!("render c.glb --turntable 3 --orbit 40,-10,0.7 {FLAGS} -o set/v.##.exr --preview set/{{frame}}.png");
    let said = expect(path, &format!("{line} -v"), 0);
    assert_eq!(said.matches("built Embree").count(), 1, "{said}");
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
    let cameras = json_of(&path.join("set/transforms.json"));
    assert_eq!(cameras["frames"].as_array().map(Vec::len), Some(3));
    assert_eq!((&cameras["frames"][1]["w"], &cameras["frames"][1]["file_path"]), (&json!(32.0), &json!("v.01.exr")));
    expect(path, "render c.glb --cameras set/transforms.json --spp 4 -o again/v.##.exr --aov depth -q", 0);
    for view in 0..3 {
        let line = format!("compare again/v.0{view}.exr set/v.0{view}.exr --max-relmse 0.01");
        expect(path, &line, 0);
    }
    expect(path, "compare again/v.00.exr set/v.01.exr --max-relmse 0.01", 1);
    let again = json_of(&path.join("again/transforms.json"));
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
    let folder = folder();
    let path = folder.path();
    let text = "[defaults]\nscene = \"c.glb\"\nsize = [32, 20]\nspp = 4\noutput = \"{name}/####.exr\"\n\
                [[job]]\nname = \"table\"\nturntable = 2\norbit = [40, -10, 0.7]\n[[job]]\nname = \"one\"\norbit = [40, -10, 0.7]\n\
                output = \"one.exr\"\n";
    fs::write(path.join("jobs.toml"), text).unwrap();
    let said = expect(path, "batch jobs.toml -v", 0);
    assert_eq!(said.matches("built Embree").count(), 1, "{said}");
    let set = fs::read_dir(path).unwrap().flatten().find(|e| e.path().is_dir()).unwrap().path();
    assert_eq!(names(&set), ["0000.exr", "0001.exr", "transforms.json"]);
    assert_same_bits(&path.join("one.exr"), &set.join("0000.exr"));
}

#[test]
fn what_is_no_view_is_refused_before_anything_is_written() {
    let folder = folder();
    let path = folder.path();
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
        let said = expect(path, &format!("render c.glb {FLAGS} {flags}"), code);
        assert!(said.contains(why), "{flags}: {said}");
    }
    assert_eq!(names(path), ["bad.json", "c.glb"]);
}
