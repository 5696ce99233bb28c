//! `scripts/fidelity.py` on a suite of its own: pictures of cameras whose matrices are written by hand.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::helpers::gltf_parts::{Parts, floats};
use crate::helpers::pictures::python;
use crate::helpers::program::{expect, program, scene};

/// A quarter turn's half: sine and cosine of 45 degrees.
const S: f64 = std::f64::consts::FRAC_1_SQRT_2;

fn scenario(name: &str, model: &str, sky: &str, theta: f64, phi: f64) -> Value {
    json!({
        "name": name, "model": format!("../Models/{model}/glTF/{model}.gltf"), "lighting": format!("../{sky}.hdr"),
        "dimensions": {"width": 48, "height": 40}, "target": {"x": 0.25, "y": 0.5, "z": 0.0},
        "orbit": {"theta": theta, "phi": phi, "radius": 3.0}, "verticalFoV": 45, "renderSkybox": false
    })
}

#[test]
fn pictures_of_the_suite_are_compared_and_what_is_missing_is_named() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let positions = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.3, 0.0, 1.0, 0.0]);
    let primitive = r#"{"attributes":{"POSITION":0},"material":0}"#.into();
    let model =
        Parts { positions, primitive, more: r#","materials":[{"doubleSided":true}]"#.into(), ..Default::default() };
    fs::create_dir_all(path.join("models/Thing")).unwrap();
    fs::write(path.join("models/Thing/Thing.gltf"), model.json()).unwrap();
    fs::create_dir(path.join("skies")).unwrap();
    for sky in ["field.hdr", "lightroom_14b.hdr"] {
        fs::copy(scene("field.hdr"), path.join("skies").join(sky)).unwrap();
    }

    // From the right and from above: right, up and backward are the columns of the matrix.
    let turned = [[S, 0.0, S, 0.25 + 3.0 * S], [0.0, 1.0, 0.0, 0.5], [-S, 0.0, S, 3.0 * S], [0.0, 0.0, 0.0, 1.0]];
    let above = [[1.0, 0.0, 0.0, 0.25], [0.0, S, S, 0.5 + 3.0 * S], [0.0, -S, S, 3.0 * S], [0.0, 0.0, 0.0, 1.0]];
    let golden = |name: &str, matrix: [[f64; 4]; 4]| {
        let folder = path.join("suite/public/thumbnails/goldens").join(name);
        fs::create_dir_all(&folder).unwrap();
        let angle = std::f64::consts::FRAC_PI_4;
        let cameras = json!({"camera_angle_y": angle, "w": 48, "h": 40, "frames": [{"file_path": "a", "transform_matrix": matrix}]});
        fs::write(path.join("cameras.json"), cameras.to_string()).unwrap();
        let line = "render models/Thing/Thing.gltf --cameras cameras.json --camera a --env skies/field.hdr --transparent --filter box \
                    --spp 16 --view aces --exposure 0 -q -o a.exr --preview a.webp";
        expect(path, line, 0);
        for peer in ["blender-cycles", "vray"] {
            fs::copy(path.join("a.webp"), folder.join(format!("{peer}-golden.thumb.webp"))).unwrap();
        }
    };
    golden("khronos-Turned", turned);
    golden("khronos-Above", above);
    // The same pictures for a camera elsewhere.
    golden("khronos-Elsewhere", above);
    for name in ["khronos-NoModel", "khronos-NoSky"] {
        golden(name, turned);
    }
    // Two that disagree, and one of them alone.
    golden("khronos-Two", above);
    golden("khronos-One", turned);
    let goldens = path.join("suite/public/thumbnails/goldens");
    let vray = "vray-golden.thumb.webp";
    fs::copy(goldens.join("khronos-Turned").join(vray), goldens.join("khronos-Two").join(vray)).unwrap();
    fs::remove_file(goldens.join("khronos-One/blender-cycles-golden.thumb.webp")).unwrap();
    let scenarios = json!({"scenarios": [
        // The suite's defaults: its light, its field of view, a view from the side.
        {"name": "khronos-Turned", "model": "Thing.gltf", "dimensions": {"width": 48, "height": 40},
         "target": {"x": 0.25, "y": 0.5}, "orbit": {"theta": 45, "radius": 3}},
        scenario("khronos-Above", "Thing", "field", 0.0, 45.0),
        scenario("khronos-Elsewhere", "Thing", "field", -45.0, 90.0),
        scenario("khronos-Two", "Thing", "field", 0.0, 45.0),
        scenario("khronos-One", "Thing", "field", 0.0, 45.0),
        scenario("khronos-NoModel", "Other", "field", 45.0, 90.0),
        scenario("khronos-NoSky", "Thing", "other", 45.0, 90.0),
        scenario("khronos-NoGolden", "Thing", "field", 45.0, 90.0),
    ]});
    fs::write(path.join("config.json"), scenarios.to_string()).unwrap();

    let run = |suite: &str| {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/fidelity.py");
        let mut command = Command::new(&python);
        let flags = format!(
            "--suite {suite} --config config.json --models models --environments skies --out out --spp 16 --bismar"
        );
        command.arg(script).args(flags.split(' ')).arg(program()).current_dir(path);
        command.env("BISMAR_THREADS", "1").output().unwrap()
    };
    let output = run("suite");
    let [said, text] = [&output.stderr, &output.stdout].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{said}");
    let rows: Value = serde_json::from_str(&fs::read_to_string(path.join("out/results.json")).unwrap()).unwrap();
    let of = |name: &str, key: &str, who: &str| {
        let row = rows.as_array().unwrap().iter().find(|row| row["name"] == name);
        row.unwrap_or_else(|| panic!("no {name}"))[key].get(who).and_then(Value::as_f64)
    };
    for name in ["Turned", "Above"] {
        for who in ["bismar", "blender-cycles", "vray"] {
            assert_eq!((of(name, "flip", who), of(name, "overlap", who)), (Some(0.0), Some(1.0)), "{name}, {who}");
        }
    }
    assert!(of("Elsewhere", "flip", "bismar").unwrap() > 0.01 && of("Elsewhere", "overlap", "bismar").unwrap() < 0.9);
    assert_eq!(of("Elsewhere", "overlap", "vray"), Some(1.0));
    // Each of the others is compared with the mean of those that are left.
    let one = of("One", "flip", "bismar");
    assert!(
        one > Some(0.01) && of("Two", "flip", "blender-cycles") == one && of("One", "flip", "vray").is_none(),
        "{rows}"
    );
    assert!(of("Two", "flip", "bismar") < one, "{rows}");
    // Without its light only the silhouette is compared: of another picture, rendered under an even sky.
    assert!(of("NoSky", "flip", "bismar").is_none() && of("NoSky", "overlap", "bismar") == Some(1.0), "{rows}");
    for line in [
        "| Elsewhere | **0.",
        "| Turned | 0.000 | 0.000 | 0.000 |",
        "- its model is in no folder of --models: NoModel.",
        "- FLIP only: other.hdr is in no folder of --environments: NoSky.",
        "- no golden picture in the suite: NoGolden.",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
    assert!(fs::read_to_string(path.join("out/index.html")).unwrap().contains("khronos-Elsewhere/strip.png"));

    let output = run("nowhere");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("--suite is a clone of"), "{said}");
}
