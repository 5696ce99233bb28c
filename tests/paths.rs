//! No output is an input or another output, however it is spelled: nobody loses a file by naming it twice.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use crate::helpers::program::{Folder, expect, says};

/// A folder with one file of each kind that commands read.
fn folder() -> Folder {
    let rules = r#"{"version":"pathmapping-1.0","path_mapping_rules":[]}"#;
    let folder = Folder::new().with_scene("cornell.glb", "cornell.glb").with("rules.json", rules);
    fs::create_dir(folder.join("sub")).unwrap();
    symlink(".", folder.join("here")).unwrap();
    let line = "render cornell.glb --size 40x24 --spp 2 -q --checkpoint 9";
    for flags in ["-o sky.exr", "-o 1.exr --part 1/2", "-o 2.exr --part 2/2"] {
        expect(&folder, &format!("{line} {flags}"), 0);
    }
    folder
}

/// A job of a batch file.
fn job(name: &str, more: &str) -> String {
    format!("[[job]]\nscene = 'cornell.glb'\nsize = '40x24'\nspp = 1\nname = '{name}'\n{more}\n")
}

/// Other names for a file of the folder, made as they are asked for.
fn spellings(folder: &Path, file: &str, extension: &str) -> Vec<String> {
    let (soft, hard) = (format!("soft.{extension}"), format!("hard.{extension}"));
    for link in [&soft, &hard] {
        let _ = fs::remove_file(folder.join(link));
    }
    symlink(file, folder.join(&soft)).unwrap();
    fs::hard_link(folder.join(file), folder.join(&hard)).unwrap();
    let whole = folder.join(file).to_str().unwrap().to_owned();
    let mut all = vec![file.to_owned(), format!("./{file}"), format!("sub/../here/{file}"), whole];
    // A name with another extension is refused for that.
    all.retain(|name| name.ends_with(extension));
    all.extend([soft, hard]);
    all
}

#[test]
fn no_input_is_overwritten_whatever_it_is_called() {
    let folder = folder();
    let render = "render cornell.glb --size 40x24 --spp 1 -q";
    fs::write(folder.join("jobs.toml"), job("a", "")).unwrap();
    // Line with a place for the output, the input that it names, the output's extension.
    let cases = [
        (format!("{render} -o OUT"), "cornell.glb", "exr"),
        (format!("{render} -o a.exr --preview OUT"), "cornell.glb", "png"),
        (format!("{render} -o a.exr --stats OUT"), "cornell.glb", "glb"),
        (format!("{render} --env sky.exr -o OUT"), "sky.exr", "exr"),
        (format!("{render} --env sky.exr -o a.exr --preview OUT"), "sky.exr", "png"),
        (format!("{render} --env sky.exr -o a.exr --stats OUT"), "sky.exr", "exr"),
        (format!("{render} --path-mapping rules.json -o OUT"), "rules.json", "exr"),
        (format!("{render} --path-mapping rules.json -o a.exr --preview OUT"), "rules.json", "png"),
        (format!("{render} --path-mapping rules.json -o a.exr --stats OUT"), "rules.json", "json"),
        ("merge 1.exr 2.exr -q -o OUT".into(), "1.exr", "exr"),
        ("merge 1.exr 2.exr -q -o OUT".into(), "2.exr", "exr"),
        ("merge 1.exr 2.exr -q -o a.exr --preview OUT".into(), "2.exr", "exr"),
        ("compare sky.exr sky.exr --diff OUT".into(), "sky.exr", "exr"),
        ("compare 1.exr sky.exr --diff OUT".into(), "sky.exr", "png"),
        ("batch jobs.toml -q --report OUT".into(), "jobs.toml", "toml"),
        ("batch jobs.toml -q --report OUT".into(), "cornell.glb", "glb"),
        ("batch jobs.toml -q --events OUT".into(), "jobs.toml", "toml"),
        ("batch jobs.toml -q --events OUT".into(), "cornell.glb", "glb"),
    ];
    for (line, input, extension) in cases {
        let before = fs::read(folder.join(input)).unwrap();
        for name in spellings(&folder, input, extension) {
            says(&folder, &line.replace("OUT", &name), 64, "would overwrite");
            assert_eq!(fs::read(folder.join(input)).unwrap(), before, "{line}, {name}");
        }
        assert!(!folder.join("a.exr").exists(), "{line}: something was rendered");
    }
}

#[test]
fn no_two_outputs_are_one_file() {
    let folder = folder();
    let render = "render cornell.glb --size 40x24 --spp 1 -q";
    symlink("new.exr", folder.join("dangling.png")).unwrap();
    for (line, code) in [
        (format!("{render} -o sky.exr --stats ./sky.exr"), 64),
        (format!("{render} -o new.exr --stats here/new.exr"), 64),
        (format!("{render} -o new.exr --preview dangling.png"), 64),
        (format!("{render} -o new.exr --preview new.png --stats sub/../new.png"), 64),
        ("merge 1.exr 2.exr -q -o new.exr --preview dangling.png".into(), 64),
        (format!("{render} -o /dev/null --stats /dev/null --preview /dev/null"), 0),
    ] {
        let said = expect(&folder, &line, code);
        assert!(code == 0 || said.contains("two outputs"), "{line}: {said}");
    }
}

#[test]
fn jobs_of_a_batch_write_nothing_that_another_reads_or_writes() {
    let folder = folder();
    symlink("new", folder.join("link")).unwrap();
    for (first, second, words) in [
        ("output = 'out.exr'", "output = 'here/out.exr'", "two outputs"),
        // Folders that the batch will make.
        ("output = 'new/out.exr'", "output = 'link/out.exr'", "two outputs"),
        ("output = 'new/out.exr'", "output = 'new/../new/out.exr'", "two outputs"),
        ("preview = 'a.png'", "preview = './a.png'", "two outputs"),
        ("stats = 'a.json'", "stats = 'here/a.json'", "two outputs"),
        ("stats = 'jobs.toml'", "", "would overwrite the batch file"),
        ("stats = 'cornell.glb'", "", "would overwrite the scene"),
        ("env = 'sky.exr'", "output = 'here/sky.exr'", "would overwrite --env of 'a'"),
        ("output = 'here/sky.exr'", "env = 'sky.exr'", "would overwrite --env of 'b'"),
    ] {
        fs::write(folder.join("jobs.toml"), job("a", first) + &job("b", second)).unwrap();
        let said = expect(&folder, "batch jobs.toml -q", 78);
        assert!(said.contains(words) && said.contains("jobs.toml:"), "{first}, {second}: {said}");
    }
    fs::write(folder.join("jobs.toml"), job("a", "output = 'report.json.exr'")).unwrap();
    says(&folder, "batch jobs.toml -q --report sub/../report.json.exr", 64, "two outputs");
}

#[test]
fn the_files_that_a_scene_names_are_inputs_too() {
    let json = r#"{"asset":{"version":"2.0"},"images":[{"uri":"wood.png"}]}"#;
    let jobs = job("a", "preview = 'wood.png'").replace("cornell.glb", "scene.gltf");
    let folder = Folder::new().with("scene.gltf", json).with("jobs.toml", jobs);
    let picture = folder.join("wood.png");
    image::save_buffer(&picture, &[255, 0, 0], 1, 1, image::ColorType::Rgb8).unwrap();
    let before = fs::read(&picture).unwrap();
    let line = "render scene.gltf --size 40x24 --spp 1 --preview ./wood.png";
    says(&folder, line, 64, "--preview ./wood.png would overwrite the scene's");
    expect(&folder, "batch jobs.toml -q", 64);
    assert_eq!(fs::read(&picture).unwrap(), before);
}
