//! Golden pictures: rendered again from their headers, compared, reported, updated.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::helpers::glb;
use crate::helpers::program::{
    Folder, assert_same_bits, attribute, bismar, expect, names, read_json, says, scene, stderr,
};

fn folder() -> Folder {
    Folder::new().with_scene("models/c.glb", "cornell.glb").with("models/m.glb", glb::moving())
}

fn report(folder: &Path) -> Value {
    read_json(&folder.join("bismar-check/report.json"))
}

fn outcomes(folder: &Path) -> Vec<String> {
    report(folder)["goldens"].as_array().unwrap().iter().map(|g| g["outcome"].as_str().unwrap().into()).collect()
}

/// The lamp of cornell.glb: as it is, a thousandth less green, much less green.
const LAMP: (&str, &str, &str) = ("[1.0,0.705882,0.235294]", "[1.0,0.705000,0.235294]", "[1.0,0.205000,0.235294]");

/// Replaces text in a GLB's JSON by text of the same length.
fn edit(path: &Path, from: &str, to: &str) {
    assert_eq!(from.len(), to.len());
    let mut bytes = fs::read(path).unwrap();
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    fs::write(path, bytes).unwrap();
}

#[test]
fn goldens_of_every_kind_of_command_are_identical() {
    let toml = "[[job]]\nscene = 'models/c.glb'\nsize = [24, 16]\nspp = 4\nguiding = 'on'\noutput = 'g/h.exr'\n";
    let path = &folder().with("jobs.toml", toml);
    fs::create_dir(path.join("g")).unwrap();
    let size = "--size 24x16 --spp 4 -q";
    for line in [
        "render models/c.glb --camera framed --aov all --seed 7 --balance half -o g/a.exr --preview a.png --threads 1",
        "render models/c.glb --orbit 30,-20,0.8 --half --sky --env-strength 0.5 -o g/b.exr --checkpoint 100",
        "render models/c.glb --camera panorama --transparent --sky --clamp-indirect 2 -o g/c.exr",
        "render models/m.glb --frames 1-2 --fps 10 --shutter -0.25,0.25 -o g/d.##.exr",
        "render models/c.glb --turntable 2 -o g/e.#.exr",
        "render models/c.glb --part 1/2 -o 1.exr",
        "render models/c.glb --part 2/2 -o 2.exr",
    ] {
        expect(path, &format!("{line} {size}"), 0);
    }
    expect(path, "merge 1.exr 2.exr -o g/f.exr -q", 0);
    let line = "render models/c.glb --cameras g/transforms.json --camera e.1 --spp 4 --env g/c.exr -o more/g.exr -q";
    expect(path, line, 0);
    expect(path, "batch jobs.toml -q", 0);
    says(path, "check g more", 0, "10 golden pictures: 10 identical, 0 alike, 0 different, 0 failed");
    assert_eq!(outcomes(path), ["identical"; 10]);
    assert_eq!(names(&path.join("bismar-check")), ["index.html", "junit.xml", "new", "report.json"]);
    assert!(names(&path.join("bismar-check/new")).is_empty());
    let junit = fs::read_to_string(path.join("bismar-check/junit.xml")).unwrap();
    assert!(junit.contains("tests=\"10\" failures=\"0\" errors=\"0\""), "{junit}");
    // From elsewhere.
    let elsewhere = Folder::new();
    let line = format!("check {0}/g {0}/more --root {0} --out r", path.display());
    expect(&elsewhere, &format!("{line} -q"), 0);
    assert_eq!(names(&elsewhere), ["r"]);
}

#[test]
fn a_changed_scene_differs_until_the_golden_is_updated() {
    let path = &folder();
    let line = "render models/c.glb --size 48x48 --spp 16 -q";
    expect(path, &format!("{line} --aov depth -o a.exr"), 0);
    // Other bits, and nothing to see.
    edit(&path.join("models/c.glb"), LAMP.0, LAMP.1);
    says(path, "check a.exr", 0, "1 alike");
    expect(path, "check a.exr --max-flip 0", 1);
    // Another lamp.
    edit(&path.join("models/c.glb"), LAMP.1, LAMP.2);
    let said = expect(path, "check a.exr", 1);
    assert!(
        said.contains("a.exr: differs: FLIP 0.") && said.contains("1 different") && !said.contains("depth.Z ("),
        "{said}"
    );
    let golden = &report(path)["goldens"][0];
    assert!(golden["flip"].as_f64().unwrap() > 0.1 && golden["passes"] == false, "{golden}");
    let new = path.join(golden["new"].as_str().unwrap());
    let junit = fs::read_to_string(path.join("bismar-check/junit.xml")).unwrap();
    assert!(junit.contains("failures=\"1\"") && junit.contains("<failure message=\"differs: FLIP"), "{junit}");
    let page = fs::read_to_string(path.join("bismar-check/index.html")).unwrap();
    assert_eq!(page.matches("<img src=\"data:image/png;base64,").count(), 6);
    // The same picture again, as a new golden.
    expect(path, &format!("{line} --aov depth -o b.exr"), 0);
    assert_same_bits(&new, &path.join("b.exr"));
    says(path, "check a.exr --update", 0, "1 updated");
    assert_same_bits(&path.join("a.exr"), &path.join("b.exr"));
    // Its header still says where the scene is, seen from the root.
    assert!(attribute(&path.join("a.exr"), "bismar.command").contains("\"models/c.glb\""));
    assert_eq!((expect(path, "check a.exr -q", 0), outcomes(path)), (String::new(), vec!["identical".into()]));
}

#[test]
fn what_cannot_be_checked_fails_by_itself() {
    let path = &folder();
    let absolute = path.join("models/m.glb");
    let size = "--size 16x16 --spp 2 -q";
    expect(path, &format!("render models/c.glb -o a.exr {size}"), 0);
    expect(path, &format!("render models/c.glb --part 1/1 -o part.exr {size}"), 0);
    expect(path, "render models/c.glb --size 16x16 --spp 2 --time 100 -o time.exr -q", 0);
    expect(path, &format!("render {} -o absolute.exr {size}", absolute.display()), 0);
    let command = attribute(&path.join("absolute.exr"), "bismar.command");
    assert!(command.contains("\"m.glb\"") && !command.contains("models"), "{command}");
    fs::copy(scene("field.hdr"), path.join("other.exr")).unwrap();
    let mut damaged = fs::read(path.join("a.exr")).unwrap();
    damaged.truncate(damaged.len() - 9);
    fs::write(path.join("damaged.exr"), damaged).unwrap();
    let line = "check a.exr part.exr time.exr absolute.exr other.exr damaged.exr nowhere.exr";
    let said = expect(path, line, 66);
    for why in ["1 identical", "6 failed", "a part", "--time", "m.glb", "nowhere.exr: there is no such file"] {
        assert!(said.contains(why), "{why}: {said}");
    }
    let codes: Vec<_> =
        report(path)["goldens"].as_array().unwrap().iter().map(|golden| golden["exit_code"].as_u64()).collect();
    assert_eq!(codes, [None, Some(65), Some(65), Some(66), Some(65), Some(65), Some(66)]);
    // An absolute path's scene is looked up by name.
    expect(path, "check absolute.exr --root models -q", 0);
    // A scene that has vanished, and an update that leaves the golden alone.
    fs::remove_file(path.join("models/c.glb")).unwrap();
    let before = fs::read(path.join("a.exr")).unwrap();
    expect(path, "check a.exr --update", 66);
    assert_eq!(fs::read(path.join("a.exr")).unwrap(), before);
    expect(path, "check models", 66);
    expect(path, "check", 64);
}

#[test]
fn a_mean_of_seeds_and_names_that_are_not_utf8_are_said() {
    let path = &folder();
    for seed in [1, 2] {
        let size = "--size 16x16 --spp 8 --checkpoint 60 --aov none -q";
        expect(path, &format!("render models/c.glb --seed {seed} -o {seed}.exr {size}"), 0);
    }
    expect(path, "merge 1.exr 2.exr -o mean.exr -q", 0);
    assert!(expect(path, "check mean.exr", 65).contains("the mean of pictures with the seeds 1,2"));
    use std::os::unix::ffi::OsStrExt;
    let odd = std::ffi::OsStr::from_bytes(b"\xff.exr");
    fs::rename(path.join("2.exr"), path.join(odd)).unwrap();
    let ran = bismar(path).args(["compare", "--json", "1.exr"]).arg(odd).output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&ran.stdout).unwrap()["b"], "\u{fffd}.exr");
}
