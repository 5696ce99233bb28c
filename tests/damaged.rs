//! Files cut short and with bits turned over, as disks and networks leave them: the program says what is wrong with
//! them, or takes them for what they now are. It never panics, crashes or ends without a reason.

use std::fs;
use std::path::{Path, PathBuf};

use crate::helpers::program::{self, Folder, expect, run, scene, stderr, try_all};
use crate::helpers::random::Random;
use crate::helpers::shared;

/// Where headers and most of the text are.
const FRONT: usize = 4096;

/// A file's bytes after an accident; the seed chooses its kind first, so that consecutive seeds try them all.
fn damage(bytes: &[u8], seed: usize) -> Vec<u8> {
    let mut random = Random(seed as u64);
    let mut bytes = bytes.to_vec();
    let front = bytes.len().min(FRONT);
    match seed % 5 {
        0 => bytes.truncate(random.below(bytes.len())),
        1 => bytes.truncate(random.below(front)),
        kind @ (2 | 3) => {
            for _ in 0..1 + random.below(8) {
                let at = random.below(if kind == 2 { bytes.len() } else { front });
                bytes[at] ^= 1 << random.below(8);
            }
        }
        _ => {
            // Other numbers in what stays well-formed text.
            let digits: Vec<_> = (0..bytes.len().min(16 * FRONT)).filter(|&i| bytes[i].is_ascii_digit()).collect();
            for _ in 0..(1 + random.below(4)).min(digits.len()) {
                bytes[digits[random.below(digits.len())]] = b'0' + random.below(10) as u8;
            }
        }
    }
    bytes
}

/// Runs `bismar LINE`: `Err` unless it did its work, or refused a file by name with exit code 65 (66 and 76 when the
/// damage changed what the file asks for).
fn survives(folder: &Path, line: &str) -> Result<i32, String> {
    let output = run(folder, line);
    let said = stderr(&output);
    match output.status.code() {
        Some(0) => Ok(0),
        Some(code @ (65 | 66 | 73 | 76)) if said.starts_with("error: ") => Ok(code),
        code => Err(format!("bismar {line}: {code:?}\n{said}")),
    }
}

/// Refused and rendered must both occur: else the damage is too coarse, or none.
#[track_caller]
fn assert_mixed(codes: &[i32]) {
    let refused = codes.iter().filter(|&&code| code != 0).count();
    println!("{refused} of {} refused", codes.len());
    assert!(refused > codes.len() / 10 && refused < codes.len(), "{refused} of {}", codes.len());
}

/// Renders a few pixels of a damaged scene: the scene's own file, or one that is next to it.
fn render_damaged(scene: &Path, seed: usize) -> Result<i32, String> {
    let folder = Folder::new();
    let entries = fs::read_dir(scene.parent().unwrap()).unwrap().map(|e| e.unwrap().path());
    let mut neighbours = Vec::new();
    for path in entries.filter(|p| p.is_file()) {
        let used = ["bin", "png", "jpg", "jpeg", "hdr"].iter().any(|&e| path.extension().is_some_and(|x| x == e));
        if used || path == scene {
            fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
        }
        if used && path.extension().is_some_and(|e| e != "hdr") {
            neighbours.push(path);
        }
    }
    let own_sky = scene.with_extension("hdr");
    let mut env = String::new();
    if own_sky.exists() {
        env = format!(" --env {}", own_sky.file_name().unwrap().to_str().unwrap());
        neighbours.push(own_sky);
    }
    neighbours.sort();
    let victim = if seed % 3 == 2 && !neighbours.is_empty() { &neighbours[seed % neighbours.len()] } else { scene };
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    fs::write(folder.join(name(victim)), damage(&fs::read(victim).unwrap(), seed)).unwrap();
    let line = format!("render {}{env} --size 8x8 --spp 2 -q -o out.exr", name(scene));
    survives(&folder, &line).map_err(|e| format!("{} damaged: {e}", victim.display()))
}

#[test]
fn damaged_scenes_of_ours_are_rendered_or_refused() {
    let scenes = ["cornell.glb", "veach.glb", "glossy-sun.glb", "many-lights.glb", "field.glb"].map(scene);
    assert_mixed(&try_all(60, |i| render_damaged(&scenes[i % scenes.len()], 7 * i + i / 5)));
}

#[test]
fn damaged_scenes_of_others_are_rendered_or_refused() {
    let Some(folder) = shared::folder() else { return };
    let small = |row: &str| row.parse::<u64>().is_ok_and(|bytes| bytes < 300_000);
    let rows = shared::scenes(&folder);
    let sound: Vec<PathBuf> = rows
        .iter()
        .filter(|row| shared::must_accept(&row["expected_verdict"]) && small(&row["bytes_total"]))
        .map(|row| folder.join(&row["path"]))
        .collect();
    // Thirty from all over the list.
    let chosen: Vec<_> = sound.iter().step_by(sound.len() / 30).take(30).collect();
    assert_eq!(chosen.len(), 30);
    assert_mixed(&try_all(150, |i| render_damaged(chosen[i % 30], i + i / 30)));
}

const RENDER: &str = "render cornell.glb --size 40x24 --spp 8 --aov all --checkpoint 9 -q";

/// A folder with a picture of ours, its two parts, and the scene.
fn pictures() -> Folder {
    let folder = Folder::new().with_scene("cornell.glb", "cornell.glb");
    for flags in ["-o whole.exr", "--part 1/2 -o 1.exr", "--part 2/2 -o 2.exr"] {
        expect(&folder, &format!("{RENDER} {flags}"), 0);
    }
    folder
}

/// Goes on with a picture of this scene to twice as many paths.
fn goes_on(scene: &[u8], picture: &[u8]) -> Result<i32, String> {
    let folder = Folder::new().with("cornell.glb", scene).with("out.exr", picture);
    survives(&folder, &format!("{} --resume -o out.exr", RENDER.replace("--spp 8", "--spp 16")))
}

#[test]
fn damaged_pictures_are_compared_merged_and_gone_on_with_or_refused() {
    let pictures = pictures();
    let bytes = |name: &str| fs::read(pictures.join(name)).unwrap();
    let [whole, first, second, scene] = ["whole.exr", "1.exr", "2.exr", "cornell.glb"].map(bytes);
    let codes = try_all(180, |i| {
        let seed = i / 3;
        match i % 3 {
            0 => {
                let folder = Folder::new().with("a.exr", damage(&whole, seed)).with("b.exr", &whole);
                survives(&folder, "compare a.exr b.exr --diff diff.png")
            }
            1 => {
                let folder = Folder::new().with("1.exr", damage(&first, seed)).with("2.exr", &second);
                survives(&folder, "merge 1.exr 2.exr -o out.exr -q")
            }
            _ => goes_on(&scene, &damage(&whole, seed)),
        }
    });
    assert_mixed(&codes);
}

/// Statistics changed by someone who also made their hash right again.
#[test]
fn forged_statistics_are_gone_on_with_or_refused() {
    let pictures = pictures();
    let path = pictures.join("whole.exr");
    let file = fs::read(&path).unwrap();
    let statistics = bismar::film::exr_file::read_statistics(&path).unwrap().unwrap();
    let find = |wanted: &[u8]| file.windows(wanted.len()).position(|w| w == wanted).unwrap();
    let hash_at = find(blake3::hash(&statistics).to_hex().as_bytes());
    let scene = fs::read(pictures.join("cornell.glb")).unwrap();
    // They stand at the end of the file; a run of 16 KiB is found where it is.
    let rows: Vec<_> = statistics.chunks(4 * 4096).map(|row| (find(row), row.len())).collect();
    let codes = try_all(100, |i| {
        let mut random = Random(i as u64);
        let (mut file, mut statistics) = (file.clone(), statistics.clone());
        for _ in 0..1 + random.below(3) {
            let (row, flip) = (random.below(rows.len()), 1 << random.below(8));
            let column = random.below(rows[row].1);
            file[rows[row].0 + column] ^= flip;
            statistics[row * 4 * 4096 + column] ^= flip;
        }
        file[hash_at..hash_at + 64].copy_from_slice(blake3::hash(&statistics).to_hex().as_bytes());
        program::seal(&mut file);
        goes_on(&scene, &file)
    });
    assert_mixed(&codes);
}

#[test]
fn a_finished_picture_that_was_changed_is_never_called_done() {
    let pictures = pictures();
    let whole = fs::read(pictures.join("whole.exr")).unwrap();
    let scene = fs::read(pictures.join("cornell.glb")).unwrap();
    let jobs = "[defaults]\nsize = '40x24'\nspp = 8\naov = 'all'\ncheckpoint = 9\noutput = 'out.exr'\n";
    let jobs = format!("{jobs}[[job]]\nscene = 'cornell.glb'\n");
    let codes = try_all(150, |i| {
        let mut random = Random(i as u64);
        let mut bytes = whole.clone();
        match i % 5 {
            0 => bytes.truncate(random.below(whole.len())),
            // Where the header is, and anywhere.
            1 | 2 => bytes[random.below(FRONT)] ^= 1 << random.below(8),
            _ => bytes[random.below(whole.len())] ^= 1 << random.below(8),
        }
        let folder = Folder::new().with("cornell.glb", &scene).with("out.exr", &bytes).with("jobs.toml", &jobs);
        let code = survives(&folder, &format!("{RENDER} --resume -o out.exr"))?;
        if code == 0 && fs::read(folder.join("out.exr")).unwrap() == bytes {
            return Err(format!("cut or flipped, and called done: {i}"));
        }
        // Nobody can tell that it is ours.
        let code = run(&folder, "batch jobs.toml -q --threads 1").status.code();
        let same = fs::read(folder.join("out.exr")).unwrap() == bytes;
        let is_right = matches!((code, same), (Some(0), false) | (Some(73), true));
        if is_right { Ok(code == Some(73)) } else { Err(format!("a batch: {i}: {code:?}, {same}")) }
    });
    assert!(codes.iter().filter(|refused| **refused).count() > codes.len() / 2, "{codes:?}");
}
