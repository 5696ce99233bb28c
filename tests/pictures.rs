//! What other programs make of our pictures: OpenImageIO and Blender open every kind of file, and see what we mean.

use std::fs;
use std::path::Path;

use bismar::film::exr_file::write_rgb;

use crate::helpers::gltf_parts::Parts;
use crate::helpers::pictures::{python, run};
use crate::helpers::program::{self, Folder, Running, bismar, bits, channel, expect, says, stdout};
use crate::helpers::skipped::skipped;
use crate::merge::in_parts;

/// A folder with `cornell.glb`.
fn folder() -> Folder {
    Folder::new().with_scene("cornell.glb", "cornell.glb").with_scene("field.hdr", "field.hdr")
}

#[test]
fn every_kind_of_file_opens_in_openimageio_and_blender_without_a_word() {
    let Some(python) = python() else { return };
    let folder = folder();
    let line = "render cornell.glb --size 80x60 -q --spp 4 --threads 1";
    let long = "render cornell.glb --size 80x60 --spp 100000 --checkpoint 0.05 --progress plain -o interrupted.exr";
    let mut interrupted = Running::start(&folder, long);
    while !folder.join("interrupted.exr").exists() {
        interrupted.next_line();
    }
    assert_eq!(interrupted.end("-TERM").0, Some(75));
    for (flags, name) in [
        ("", "finished"),
        ("--aov all --checkpoint 9", "all"),
        ("--aov all --half --env field.hdr", "half"),
        ("--env field.hdr --transparent", "transparent"),
        ("--crop 13,9,50,33 --checkpoint 9", "crop"),
    ] {
        expect(&folder, &format!("{line} {flags} -o {name}.exr"), 0);
    }
    in_parts(&folder, line, 2);
    let names = ["finished", "interrupted", "part1", "merged", "crop", "all", "half", "transparent"];
    let files: Vec<_> = names.iter().map(|name| format!("{name}.exr")).collect();
    let seen = run(&python, "look.py", &folder, &files.iter().map(String::as_str).collect::<Vec<_>>());
    for file in &files {
        let of = &seen[file];
        assert_eq!((&of["said"], &of["parts"]), (&"".into(), &1.into()), "{file}: {of}");
        let Some(blender) = of["blender"].as_object() else {
            skipped("no Blender (bpy needs Python 3.11)");
            continue;
        };
        assert_eq!(blender["ended"], 0, "{file}: {of}");
        assert!(blender.get("difference").is_none_or(|d| *d == 0.0), "{file}: {of}");
    }
    assert_eq!(seen["half.exr"]["channels"]["R"], "half");
    assert_eq!(seen["half.exr"]["channels"]["depth.Z"], "float");
    let [all, half] = ["all.exr", "half.exr"].map(|name| fs::metadata(folder.join(name)).unwrap().len());
    assert!(2 * half < all, "{half} for {all} bytes");
}

#[test]
fn alpha_is_1_where_the_sky_is_shown_and_coverage_where_it_is_left_out() {
    let folder = folder();
    let line = "render cornell.glb --size 40x30 --spp 8 -q --env field.hdr";
    expect(&folder, &format!("{line} -o sky.exr"), 0);
    expect(&folder, &format!("{line} -o open.exr --transparent --preview open.png"), 0);
    expect(&folder, "render cornell.glb --size 40x30 --spp 8 -q --no-env -o none.exr", 0);
    let of = |file: &str, name: &str| channel(&folder.join(file), name);
    let (sky, open, none) = (of("sky.exr", "A"), of("open.exr", "A"), of("none.exr", "A"));
    assert!(sky.iter().all(|a| *a == 1.0));
    assert!(open == none && open.contains(&0.0) && open.contains(&1.0), "{open:?}");
    // Where nothing is, nothing is shown; where everything is, it is lit all the same.
    let (shown, left) = (of("sky.exr", "G"), of("open.exr", "G"));
    for ((a, b), alpha) in shown.iter().zip(&left).zip(&open) {
        match alpha {
            0.0 => assert!(*b == 0.0 && *a > 0.0),
            1.0 => assert_eq!(a, b),
            _ => assert!(b <= a, "{b} {a}"),
        }
    }
    let png = image::open(folder.join("open.png")).unwrap();
    assert_eq!(png.color(), image::ColorType::Rgba8);
    let opaque: Vec<_> = png.into_rgba8().pixels().map(|p| f32::from(p.0[3]) / 255.0).collect();
    assert!(opaque.iter().zip(&open).all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6));
}

fn rgb(path: &Path) -> Vec<u8> {
    image::open(path).unwrap().into_rgb8().into_raw()
}

#[test]
fn a_picture_is_developed_from_its_file_as_it_was_when_it_was_rendered() {
    let folder = folder();
    let file = |name: &str| folder.join(name);
    let line = "render cornell.glb --size 40x30 --spp 8 --env field.hdr -o a.exr --preview a.png";
    let said = expect(&folder, line, 0);
    let exposure: f32 = program::attribute(&file("a.exr"), "bismar.exposure").parse().unwrap();
    assert!(exposure != 0.0 && said.contains(&format!("exposure {exposure} EV")), "{said}");
    says(&folder, "develop a.exr -o again.png", 0, &format!("again.png: view agx, exposure {exposure} EV"));
    assert_eq!(rgb(&file("a.png")), rgb(&file("again.png")));
    // The value that was printed gives the same picture; another one does not.
    expect(&folder, &format!("{line} --exposure {exposure} -q"), 0);
    assert_eq!(rgb(&file("a.png")), rgb(&file("again.png")));
    expect(&folder, "develop a.exr -o again.png --exposure 3 -q", 0);
    assert_ne!(rgb(&file("a.png")), rgb(&file("again.png")));
    // Pictures of others, and other layers.
    expect(&folder, "develop field.hdr -q", 0);
    assert!(file("field.png").exists());
    expect(&folder, "develop a.exr --layer samples -o s.png --view srgb -q", 0);
    let pixels = rgb(&file("s.png"));
    // 8 paths everywhere: one grey, but for dithering.
    assert!(pixels.iter().all(|byte| byte.abs_diff(pixels[0]) <= 1));
    let said = expect(&folder, "develop a.exr --layer fog -o f.png", 65);
    assert!(said.contains("no layer 'fog'") && said.contains("variance.R"), "{said}");
    says(&folder, "render cornell.glb -o b.png", 64, "-o b.exr --preview b.png");
    expect(&folder, "develop cornell.glb", 65);
    expect(&folder, "develop absent.exr", 66);
}

#[test]
fn a_png_that_was_changed_or_cut_is_written_again() {
    let folder = folder();
    let file = |name: &str| folder.join(name);
    let line = "render cornell.glb --size 40x30 --spp 8 -o a.exr --preview a.png --resume";
    expect(&folder, line, 0);
    let (picture, png) = (fs::read(file("a.exr")).unwrap(), fs::read(file("a.png")).unwrap());
    says(&folder, line, 0, "nothing to do");
    let mut flipped = png.clone();
    flipped[png.len() / 2] ^= 1;
    for bytes in [&flipped[..], &png[..png.len() - 1], &png[..png.len() / 2], b""] {
        fs::write(file("a.png"), bytes).unwrap();
        says(&folder, line, 0, "the PNG is written again");
        assert!(fs::read(file("a.png")).unwrap() == png && fs::read(file("a.exr")).unwrap() == picture);
    }
}

#[test]
fn a_batch_develops_anew_what_is_to_look_otherwise_and_renders_nothing() {
    let folder = folder();
    let jobs = |more: &str| {
        let text = format!("[[job]]\nscene = 'cornell.glb'\nsize = '40x30'\nspp = 4\npreview = '{{name}}.png'\n{more}");
        fs::write(folder.join("jobs.toml"), text).unwrap();
        expect(&folder, "batch jobs.toml -q", 0);
        let read = |name: &str| fs::read(folder.join(name)).unwrap();
        (read("cornell.exr"), read("cornell.png"))
    };
    let (picture, first) = jobs("");
    assert_eq!(jobs(""), (picture.clone(), first.clone()));
    let (same, brighter) = jobs("exposure = 2");
    assert!(same == picture && brighter != first);
    let (same, neutral) = jobs("exposure = 2\nview = 'neutral'");
    assert!(same == picture && neutral != brighter);
    fs::remove_file(folder.join("cornell.png")).unwrap();
    assert_eq!(jobs(""), (picture, first));
}

#[test]
fn a_scene_without_camera_fills_pictures_of_any_shape_and_is_not_cut_off() {
    let folder = Folder::new().with("thicket.glb", crate::helpers::glb::thicket(3000));
    for (width, height) in [(100_usize, 300_usize), (200, 200), (320, 180)] {
        let line = format!("render thicket.glb --size {width}x{height} --spp 4 --filter box --transparent -q -o a.exr");
        let said = expect(&folder, &line, 0);
        assert!(said.is_empty(), "{said}");
        let alpha = channel(&folder.join("a.exr"), "A");
        let (mut low, mut high) = ([width, height], [0, 0]);
        for i in (0..alpha.len()).filter(|i| alpha[*i] > 0.0) {
            let at = [i % width, i / width];
            low = [low[0].min(at[0]), low[1].min(at[1])];
            high = [high[0].max(at[0] + 1), high[1].max(at[1] + 1)];
        }
        let [across, down] = [0, 1].map(|k| (high[k] - low[k]) as f64 / [width, height][k] as f64);
        assert!(across.max(down) > 0.85, "{width}x{height}: {low:?} to {high:?}");
        for (k, size) in [width, height].into_iter().enumerate() {
            assert!(low[k] > 0 && high[k] < size, "{width}x{height}: {low:?} to {high:?}");
            let off = low[k].abs_diff(size - high[k]);
            assert!(off as f64 <= 1.0 + 0.04 * size as f64, "{width}x{height}: {low:?} to {high:?}");
        }
    }
}

#[test]
fn a_picture_that_is_black_everywhere_is_told() {
    let area_light = |rotation: &str| Parts {
        nodes: format!(r#"[{{"mesh":0,"rotation":{rotation}}}]"#),
        primitive: r#"{"attributes":{"POSITION":0},"material":0}"#.into(),
        more: r#","materials":[{"emissiveFactor":[1,1,1]}]"#.into(),
        ..Default::default()
    };
    let folder = Folder::new();
    let said = |rotation| {
        fs::write(folder.join("lamp.gltf"), area_light(rotation).json()).unwrap();
        expect(&folder, "render lamp.gltf --size 24x18 --spp 2", 0)
    };
    assert!(!said("[0,0,0,1]").contains(" is black "));
    // An area light that shows its back.
    let said = said("[0,1,0,0]");
    assert!(said.contains("lamp.exr is black everywhere") && said.contains("only its front emits"), "{said}");
}

#[test]
fn unlit_labels_take_no_light_from_what_is_beside_them() {
    let scene = |other: &str| {
        let unlit = r#"{"extensions":{"KHR_materials_unlit":{}}}"#;
        let primitive =
            r#"{"attributes":{"POSITION":0},"material":0},{"attributes":{"POSITION":0},"material":1}"#.into();
        Parts { primitive, more: format!(r#","materials":[{unlit},{other}]"#), ..Default::default() }.json()
    };
    let folder = Folder::new();
    let said = |other: &str| {
        fs::write(folder.join("a.gltf"), scene(other)).unwrap();
        expect(&folder, "render a.gltf --size 24x18 --spp 2", 0)
    };
    assert!(said("{}").contains("soft studio light is added"));
    assert!(!said(r#"{"extensions":{"KHR_materials_unlit":{}}}"#).contains("studio"));
    assert!(!said(r#"{"emissiveFactor":[1,1,1]}"#).contains("studio"));
}

#[test]
fn pictures_of_any_kind_are_compared_in_part_by_layer_and_by_folder() {
    let path = &folder();
    let line = "render cornell.glb --size 40x30 --spp 8 -q --aov all";
    for (flags, name) in [("", "a/1"), ("--seed 5", "b/1"), ("--crop 8,4,30,20", "a/crop"), ("", "b/crop")] {
        fs::create_dir_all(path.join(name).parent().unwrap()).unwrap();
        expect(path, &format!("{line} {flags} -o {name}.exr"), 0);
    }
    let compared = |line: &str| -> serde_json::Value {
        serde_json::from_str(&stdout(path, &format!("compare {line} --json"), 0)).unwrap()
    };
    // A crop has the bits of the whole, on either side.
    for line in ["a/crop.exr a/1.exr", "a/1.exr a/crop.exr"] {
        let same = compared(line);
        assert_eq!((&same["rel_mse"], &same["flip"]), (&0.0.into(), &0.0.into()));
        assert_eq!((&same["width"], &same["height"]), (&22.into(), &16.into()));
    }
    let seeds = compared("a/1.exr b/1.exr --page page.html");
    assert!(seeds["flip"].as_f64().unwrap() > 0.01, "{seeds}");
    let page = fs::read_to_string(path.join("page.html")).unwrap();
    assert!(page.contains("FLIP") && page.matches("data:image/png").count() == 3 && !page.contains("{{"));
    assert!(compared("a/1.exr b/1.exr --layer albedo")["rel_mse"].as_f64().unwrap() < 0.05);
    assert_eq!(compared("a/1.exr b/1.exr --layer samples.V")["rel_mse"], 0.0);
    expect(path, "develop a/1.exr -o a.png -q", 0);
    expect(path, "develop b/1.exr -o b.png -q", 0);
    let shown = compared("a.png b.png");
    assert!(shown["flip"].as_f64().unwrap() > 0.01 && shown["statistics"].is_null());
    assert_eq!(compared("field.hdr field.hdr")["flip"], 0.0);
    let both = compared("a b --csv pairs.csv");
    assert_eq!(both.as_array().unwrap().len(), 2);
    let rows = fs::read_to_string(path.join("pairs.csv")).unwrap();
    assert_eq!(rows.lines().count(), 3);
    assert!(rows.starts_with("a,b,width,height,rel_mse,") && rows.contains("\"a/1.exr\",\"b/1.exr\",40,30,"), "{rows}");
    says(path, "compare a b --max-flip 0.001", 1, "a/1.exr: FLIP");
    fs::create_dir(path.join("c")).unwrap();
    expect(path, "compare a c", 65);
}

/// Open Image Denoise, as Blender's wheel brings it along.
pub fn denoiser() -> Option<std::path::PathBuf> {
    let site = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/pictures/lib/python3.11/site-packages/bpy/lib");
    let library = site.join("libOpenImageDenoise.so.2");
    if !library.exists() {
        skipped("no Open Image Denoise (bpy for Python 3.11 has it: scripts/setup.sh --pictures)");
    }
    Some(library).filter(|library| library.exists())
}

/// A library with the functions of Open Image Denoise, which does `what` when it shall denoise.
pub fn false_denoiser(folder: &Path, name: &str, what: &str) -> std::path::PathBuf {
    let (source, library) = (folder.join("oidn.c"), folder.join(name));
    let code = format!(
        r#"#include <stdlib.h>
        #include <unistd.h>
        #include <string.h>
        static float *in, *out; static size_t w, h; static int code; static const char *text = "";
        void *oidnNewDevice(int kind) {{ return &code; }}
        void *oidnNewFilter(void *d, const char *kind) {{ return &code; }}
        void oidnSetSharedFilterImage(void *f, const char *n, void *p, int k, size_t x, size_t y, size_t a, size_t b, size_t c) {{
            if (!strcmp(n, "color")) in = p;
            if (!strcmp(n, "output")) out = p;
            w = x; h = y;
        }}
        void oidnSetFilterBool(void *f, const char *n, _Bool b) {{}}
        int oidnGetDeviceError(void *d, const char **t) {{ *t = text; return code; }}
        void oidnCommitDevice(void *d) {{}}
        void oidnCommitFilter(void *f) {{}}
        void oidnReleaseFilter(void *f) {{}}
        void oidnReleaseDevice(void *d) {{}}
        void oidnExecuteFilter(void *f) {{ {what} }}"#
    );
    fs::write(&source, code).unwrap();
    let mut compiler = std::process::Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-w", "-o"]).arg(&library).arg(&source);
    assert!(compiler.status().unwrap().success());
    library
}

#[test]
fn a_picture_is_there_whatever_its_denoiser_does() {
    let path = &folder();
    expect(path, "render cornell.glb --size 80x60 --spp 8 -q -o plain.exr", 0);
    let line = "render cornell.glb --size 80x60 --spp 8 -q --denoise oidn -o a.exr --preview a.png --resume";
    let command = |name: &str, what: &str| {
        let mut command = bismar(path);
        command.args(line.split(' ')).env("BISMAR_OIDN", false_denoiser(path, name, what));
        command.stderr(std::process::Stdio::piped());
        command
    };
    let plain = bits(&path.join("plain.exr"));
    let holds_it = || {
        let with = bits(&path.join("a.exr"));
        plain.iter().all(|(name, values)| with.iter().any(|(other, same)| other == name && same == values))
    };
    for (name, what, why) in [
        ("abort.so", "abort();", "ended by signal 6"),
        ("fault.so", "*(volatile int *)0 = 1;", "ended by signal 11"),
        ("exit.so", "exit(3);", "exit status: 3"),
        ("error.so", "code = 4; text = \"out of memory\";", "Open Image Denoise: out of memory"),
    ] {
        let _ = fs::remove_file(path.join("a.exr"));
        let output = command(name, what).output().unwrap();
        let said = program::stderr(&output);
        assert_eq!(output.status.code(), Some(76), "{name}: {said}");
        assert!(said.contains(why) && said.contains("a.exr is saved") && said.contains("--resume"), "{name}: {said}");
        assert!(holds_it(), "{name}");
    }
    // A signal is answered while it denoises, and the picture is there.
    fs::remove_file(path.join("a.exr")).unwrap();
    let child = command("slow.so", "sleep(60);").spawn().unwrap();
    while !path.join("a.exr").exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::thread::sleep(std::time::Duration::from_millis(300));
    program::signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    let said = program::stderr(&output);
    assert!(output.status.code() == Some(75) && said.contains("a.exr is saved"), "{said}");
    assert!(holds_it());
    // What is left is done by --resume, in the PNG as well, and once.
    let good = "for (size_t i = 0; i < 3 * w * h; i++) out[i] = 2 * in[i];";
    let output = command("good.so", good).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", program::stderr(&output));
    let red = |name: &str| channel(&path.join("a.exr"), name);
    assert!(holds_it() && red("R").iter().zip(red("denoised.R")).all(|(x, y)| 2.0 * x == y));
    assert!(path.join("a.png").exists());
    let written = fs::metadata(path.join("a.exr")).unwrap().modified().unwrap();
    assert_eq!(command("abort.so", "abort();").output().unwrap().status.code(), Some(0));
    assert_eq!(fs::metadata(path.join("a.exr")).unwrap().modified().unwrap(), written);
}

#[test]
fn noise_is_taken_out_into_a_layer_of_its_own_or_it_is_said_how_to_get_the_library() {
    let folder = folder();
    let line = "render cornell.glb --size 80x60 --spp 8 -q";
    let render = |flags: &str, library: &str| {
        let mut command = bismar(&folder);
        command.args(line.split(' ')).args(flags.split(' ')).env("BISMAR_OIDN", library);
        let output = command.output().unwrap();
        (output.status.code(), program::stderr(&output))
    };
    let (code, said) = render("--denoise oidn -o none.exr", "/not/there.so");
    assert!(code == Some(76) && said.contains("RenderKit/oidn/releases"), "{code:?} {said}");
    assert!(said.contains("pip install pyoidn"), "{said}");
    // The package pyoidn of the user, and of the Python before others in PATH.
    for (variable, of, to) in
        [("HOME", "home", "home/.local"), ("PATH", "venv/bin", "venv"), ("PATH", "pyenv/shims", "pyenv/versions/3")]
    {
        let library = folder.join(to).join("lib/python3.13/site-packages/pyoidn/oidn/lib/libOpenImageDenoise.so.2");
        fs::create_dir_all(library.parent().unwrap()).unwrap();
        let twice = "for (size_t i = 0; i < 3 * w * h; i++) out[i] = 2 * in[i];";
        fs::rename(false_denoiser(&folder, "twice.so", twice), &library).unwrap();
        let mut command = bismar(&folder);
        command.args(line.split(' ')).args(["--denoise", "oidn", "-o", "own.exr"]).env("HOME", "/nowhere");
        ["BISMAR_OIDN", "VIRTUAL_ENV", "CONDA_PREFIX"].iter().for_each(|name| _ = command.env_remove(name));
        let output = command.env("PATH", "/nowhere/bin").env(variable, folder.join(of)).output().unwrap();
        assert!(output.status.success(), "{}", program::stderr(&output));
        let red = |name: &str| channel(&folder.join("own.exr"), name);
        assert!(red("R").iter().zip(red("denoised.R")).all(|(x, y)| 2.0 * x == y));
        fs::remove_dir_all(folder.join(to)).unwrap();
    }
    assert!(!folder.join("none.exr").exists());
    let Some(library) = denoiser() else { return };
    let (code, said) = render("--denoise oidn -o a.exr --preview a.png", library.to_str().unwrap());
    assert_eq!(code, Some(0), "{said}");
    expect(&folder, &format!("{line} -o plain.exr"), 0);
    expect(&folder, "render cornell.glb --size 80x60 --spp 1024 --seed 9 -q -o true.exr", 0);
    let [plain, with] = ["plain.exr", "a.exr"].map(|name| bits(&folder.join(name)));
    for (name, values) in &plain {
        assert!(with.iter().any(|(other, same)| other == name && same == values), "{name} has changed");
    }
    // Nearer to the truth than what it was made of.
    let open = |name: &str, layer| bismar::film::Picture::open(&folder.join(name), layer).unwrap();
    let truth = open("true.exr", None);
    let error = |picture| bismar::film::compare::compare(&picture, &truth).unwrap().rel_mse;
    let (noisy, clean) = (error(open("a.exr", None)), error(open("a.exr", Some("denoised"))));
    assert!(clean < 0.3 * noisy, "{clean} {noisy}");
}

#[test]
fn transparent_pictures_are_cut_out_in_every_file_whatever_lights_them() {
    let path = &Folder::new();
    let emissive = || Parts::of_materials(r#"{"emissiveFactor":[1,1,1]}"#);
    for (name, parts, flags) in [
        ("sun", Parts::of_light(r#"{"type":"directional"}"#), "--transparent"),
        ("point", Parts::of_light(r#"{"type":"point"}"#), "--transparent --no-env --camera framed"),
        ("spot", Parts::of_light(r#"{"type":"spot","spot":{}}"#), "--transparent --sky"),
        ("emissive", emissive(), "--transparent --crop 0,0,20,18"),
        ("ground", emissive(), "--ground shadow --orbit 20,30"),
        ("dark", Parts::default(), "--transparent --no-env"),
        ("studio", Parts::default(), "--transparent"),
    ] {
        fs::write(path.join("a.gltf"), parts.json()).unwrap();
        expect(path, &format!("render a.gltf --size 24x18 --spp 4 -q {flags} -o a.exr --preview a.png"), 0);
        expect(path, "develop a.exr -o b.webp -q", 0);
        let alpha = channel(&path.join("a.exr"), "A");
        assert!(alpha.contains(&0.0) && alpha.iter().any(|a| *a > 0.0), "{name}");
        for file in ["a.png", "b.webp"] {
            let picture = image::open(path.join(file)).unwrap();
            assert_eq!(picture.color(), image::ColorType::Rgba8, "{name} {file}");
            let near = |(pixel, a): (&image::Rgba<u8>, &f32)| (f32::from(pixel.0[3]) - 255.0 * a).abs() < 0.51;
            assert!(picture.into_rgba8().pixels().zip(&alpha).all(near), "{name} {file}");
        }
    }
}

#[test]
fn denoised_colours_end_where_alpha_does() {
    let path = &folder();
    let unlit = r#"{"doubleSided":true,"extensions":{"KHR_materials_unlit":{}}}"#;
    fs::write(path.join("white.gltf"), Parts::of_materials(unlit).json()).unwrap();
    // The mean of 9 x 9 pixels, and the library.
    let blur = "for (long y = 0; y < h; y++) for (long x = 0; x < w; x++) for (int c = 0; c < 3; c++) {
        double s = 0; int n = 0;
        for (long v = y - 4; v <= y + 4; v++) for (long u = x - 4; u <= x + 4; u++)
            if (u >= 0 && v >= 0 && u < w && v < h) { s += in[3 * (v * w + u) + c]; n++; }
        out[3 * (y * w + x) + c] = s / n;
    }";
    let blur = false_denoiser(path, "blur.so", blur);
    let box_of = "cornell.glb --sky --orbit 30,20,1.5";
    expect(path, &format!("render {box_of} --transparent --size 48x36 --spp 2048 --seed 7 -q -o true.exr"), 0);
    for library in [Some(blur.clone()), denoiser()].into_iter().flatten() {
        let render = |line: &str| {
            let line = format!(
                "render {line} --size 48x36 --denoise oidn -q --exposure 0 --view srgb -o a.exr --preview a.png"
            );
            let output = bismar(path).args(line.split(' ')).env("BISMAR_OIDN", &library).output().unwrap();
            assert!(output.status.success(), "{}", program::stderr(&output));
            let of = |name: &str| channel(&path.join("a.exr"), name);
            (of("A"), of("R"), of("denoised.R"), image::open(path.join("a.png")).unwrap().into_rgba8())
        };
        // White wherever it is hit.
        for flags in ["--transparent --sky", "--ground shadow --sky --orbit 20,30"] {
            let (alpha, noisy, denoised, png) = render(&format!("white.gltf --spp 16 {flags}"));
            for ((a, noisy), (own, pixel)) in alpha.iter().zip(&noisy).zip(denoised.iter().zip(png.pixels())) {
                assert!((own - noisy).abs() < 0.01 && (*noisy > 0.0 || *own == 0.0), "{flags}: {own} for {noisy}");
                assert!(*noisy < 0.99 * a || *a < 0.1 || pixel.0[0] >= 250, "{flags}: {pixel:?}");
            }
        }
        if library == blur {
            continue;
        }
        // Rims are nearer to the converged picture than with colours that are blurred against black (0.41).
        let (alpha, noisy, denoised, _) = render(&format!("{box_of} --transparent --spp 16"));
        let truth = channel(&path.join("true.exr"), "R");
        let error = |of: &[f32]| -> f32 {
            let rims = alpha.iter().zip(of.iter().zip(&truth)).filter(|(a, _)| **a > 0.0 && **a < 1.0);
            rims.map(|(_, (own, right))| (own - right).powi(2)).sum()
        };
        assert!(error(&denoised) < 0.35 * error(&noisy), "{} {}", error(&denoised), error(&noisy));
    }
}

#[test]
fn pixels_that_are_not_finite_exceed_every_threshold() {
    let path = &Folder::new();
    let write = |name: &str, bad: f32| {
        let mut rgb = [[0.5; 3]; 64];
        rgb[9][1] = bad;
        write_rgb(&path.join(name), [0, 0, 8, 8], [0, 0, 8, 8], &rgb).unwrap();
    };
    for (name, bad) in [("a.exr", 0.5), ("nan.exr", f32::NAN), ("inf.exr", f32::INFINITY)] {
        write(name, bad);
    }
    for flags in ["--max-relmse 9", "--max-flip 1"] {
        expect(path, &format!("compare a.exr a.exr {flags} -q"), 0);
        for pair in ["nan.exr a.exr", "a.exr nan.exr", "inf.exr a.exr", "a.exr inf.exr", "nan.exr nan.exr"] {
            says(path, &format!("compare {pair} {flags}"), 1, "are not finite");
            expect(path, &format!("compare {pair}"), 0);
        }
    }
}
