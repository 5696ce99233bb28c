//! Mutated files of every kind that the program reads: never a panic, an abort or a hang.
//!
//! `BISMAR_MUTATIONS=N` tries N of them instead of a few thousand, and holds the process to its memory. `BISMAR_MUTATION=N`
//! tries one alone, and `BISMAR_MUTATIONS_FROM=N` begins with it. `BISMAR_SEEDS=FOLDER` is given the sound files, for
//! `scripts/fuzz.sh`.

use std::env;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use bismar::console::host::peak_memory_bytes;
use bismar::film::{Aov, Film, exr_file};
use bismar::guard;
use exr::prelude::*;
use image::codecs::{hdr::HdrEncoder, jpeg::JpegEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Value, json};

use crate::helpers::glb;
use crate::helpers::gltf_parts::{self, LONGEST, Parts, check_scene, data_uri};
use crate::helpers::program::{Folder, expect, scene, seal};
use crate::helpers::random::Random;
use crate::helpers::shared;
use crate::import_packed;
use crate::import_reach::chunks;

#[path = "../fuzz/doors.rs"]
mod doors;
use doors::DOORS;

/// A file as somebody meant it, and the doors that it comes in by.
struct ValidFile {
    doors: &'static [&'static str],
    bytes: Vec<u8>,
}

const SCENE: &[&str] = &["scene", "render"];

/// A scene in one file: what it names is put into its text.
fn embedded(path: &Path) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let Ok(mut json) = serde_json::from_slice::<Value>(&bytes) else { return bytes };
    for list in ["buffers", "images"] {
        for object in json.get_mut(list).and_then(Value::as_array_mut).into_iter().flatten() {
            let file = object["uri"].as_str().map(|uri| path.with_file_name(uri));
            if let Some(Ok(content)) = file.map(fs::read) {
                object["uri"] = data_uri("application/octet-stream", &content).into();
            }
        }
    }
    json.to_string().into_bytes()
}

/// The shared files that are small, sound and malformed ones.
fn shared_scenes() -> Vec<ValidFile> {
    let Some(folder) = shared::folder() else { return Vec::new() };
    let mut rows = shared::scenes(&folder);
    rows.retain(|row| row["bytes_total"].parse::<u64>().is_ok_and(|bytes| bytes < 40_000));
    let (malformed, others): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row["path"].starts_with("malformed"));
    let some = malformed.into_iter().step_by(4).chain(others);
    some.map(|row| ValidFile { doors: SCENE, bytes: embedded(&folder.join(&row["path"])) }).collect()
}

/// Packed streams behind the head that `doors::decoders` takes.
fn streams() -> Vec<Vec<u8>> {
    let head = |which: u8, kind: u8, stride: u8, counts: [u64; 2]| -> Vec<u8> {
        let counts = counts.into_iter().flat_map(|count| (count as u32).to_le_bytes());
        [which, kind, stride, 0].into_iter().chain(counts).collect()
    };
    let blocks = &include_bytes!("data/uastc.bin")[..256];
    let mut all = vec![[head(0, 0, 0, [0; 2]), import_packed::ktx2(blocks, 0)].concat()];
    let number = |value: &Value| value.as_u64().unwrap();
    for sequence in [false, true] {
        let file = import_packed::meshopt("EXT_meshopt_compression", 1, sequence, sequence);
        let (json, binary) = chunks(&file).unwrap();
        let packed = &json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"];
        let [start, length, count, stride] =
            ["byteOffset", "byteLength", "count", "byteStride"].map(|key| number(&packed[key]));
        let stream = &binary[start as usize..(start + length) as usize];
        let filter = if packed["filter"] == "EXPONENTIAL" { 3 << 2 } else { 0 };
        all.push([head(1, filter, stride as u8, [count, 0]), stream.to_vec()].concat());
    }
    for speed in [0, 10] {
        let (json, binary) = chunks(&import_packed::draco(speed)).unwrap();
        let primitive = &json["meshes"][0]["primitives"][0];
        let packed = &primitive["extensions"]["KHR_draco_mesh_compression"];
        let view = &json["bufferViews"][number(&packed["bufferView"]) as usize];
        let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let stream = &binary[start..start + number(&view["byteLength"]) as usize];
        let count = |index: &Value| number(&json["accessors"][number(index) as usize]["count"]);
        let counts = [count(&primitive["attributes"]["POSITION"]), count(&primitive["indices"])];
        all.push([head(2, number(&packed["attributes"]["POSITION"]) as u8, 0, counts), stream.to_vec()].concat());
    }
    all
}

/// Valid files of this program, each with the doors (entry points for foreign bytes) that accept it.
fn valid_files() -> Vec<ValidFile> {
    let folder = Folder::new();
    let mut all = Vec::new();
    let mut add = |doors: &'static [&'static str], bytes: Vec<u8>| all.push(ValidFile { doors, bytes });

    for file in [
        glb::triangle(),
        glb::quad(),
        glb::moving(),
        import_packed::meshopt("EXT_meshopt_compression", 0, true, false),
        import_packed::meshopt("KHR_meshopt_compression", 1, false, true),
        import_packed::draco(0),
        import_packed::draco(10),
        Parts::default().json().into_bytes(),
        fs::read(scene("cornell.glb")).unwrap(),
        fs::read(scene("veach.glb")).unwrap(),
    ] {
        add(SCENE, file);
    }
    streams().into_iter().for_each(|stream| add(&["decoders"], stream));

    let pixels: Vec<u8> = (0..16 * 9 * 3).map(|i: u32| (i * i / 7) as u8).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png).write_image(&pixels, 16, 9, ExtendedColorType::Rgb8).unwrap();
    let mut jpeg = Vec::new();
    JpegEncoder::new(&mut jpeg).write_image(&pixels, 16, 9, ExtendedColorType::Rgb8).unwrap();
    let mut hdr = Vec::new();
    let radiance: Vec<_> =
        pixels.chunks(3).map(|p| image::Rgb([p[0], p[1], p[2]].map(|x| f32::from(x) / 9.0))).collect();
    HdrEncoder::new(&mut hdr).encode(&radiance, 16, 9).unwrap();
    add(&["picture"], png);
    add(&["picture"], jpeg);
    add(&["picture", "environment"], hdr);

    let at = |name: &str| folder.join(name);
    let compressions = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
        Compression::DWAA(None),
        Compression::DWAB(None),
    ];
    let halves = |c: usize| FlatSamples::F16((0..24 * 20).map(|i| f16::from_f32((i * c % 31) as f32)).collect());
    for (i, compression) in compressions.into_iter().enumerate() {
        let channels = ["R", "G", "B"].iter().enumerate().map(|(c, name)| AnyChannel::new(*name, halves(c + 1)));
        let blocks = if i % 2 == 0 { Blocks::ScanLines } else { Blocks::Tiles(Vec2(8, 8)) };
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = AnyChannels::sort(channels.collect());
        let layer = Layer::new((24, 20), LayerAttributes::named("a"), encoding, channels);
        Image::from_layer(layer).write().to_file(at("c.exr")).unwrap();
        add(&["exr", "picture", "environment"], fs::read(at("c.exr")).unwrap());
    }
    let film = Film::new(20, 12, [0, 0, 20, 12], false);
    exr_file::write(&at("film.exr"), &film, &Aov::DEFAULT, &Vec::new(), Some(&[1; 900])).unwrap();
    add(&["exr"], fs::read(at("film.exr")).unwrap());

    fs::copy(scene("cornell.glb"), at("cornell.glb")).unwrap();
    expect(&folder, "render cornell.glb --size 34x20 --spp 8 --checkpoint 9 -q -o out.exr", 0);
    add(&["exr", "checkpoint"], fs::read(at("out.exr")).unwrap());
    add(&["statistics"], exr_file::read_statistics(&at("out.exr")).unwrap().unwrap());

    let jobs = "[defaults]\nspp = 4\noutput = '{name}-{seed}.exr'\n[[job]]\nscene = 'a.glb'\nno-env = true\nseed = 1\n\
                [[matrix]]\nscene = ['b.glb', 'c.glb']\nseed = [1, 2, 3]\npreview = '{name}.png'\n";
    add(&["batch"], jobs.into());
    fs::write(at("jobs.toml"), jobs.replace("[[job]]", "[[job]]\nname = 'x'")).unwrap();
    for name in ["a", "b", "c"] {
        fs::copy(scene("cornell.glb"), at(&format!("{name}.glb"))).unwrap();
    }
    expect(&folder, "farm submit jobs.toml --format openjd --parts 2", 0);
    add(&["farm"], fs::read(at("jobs.farm/farm.json")).unwrap());
    let rules = r#"{"version":"pathmapping-1.0","path_mapping_rules":[{"source_path_format":"POSIX",
        "source_path":"/a","destination_path":"/b"}]}"#;
    add(&["farm"], rules.into());
    all
}

/// Values at which sizes and counts overflow or underflow.
const NUMBERS: [u64; 12] =
    [0, 1, 2, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 1 << 49, u64::MAX];

/// The file with a few random or malicious changes.
fn mutated(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len());
        // Headers are small and hold most of the structure.
        let at = if random.below(2) == 0 { at % 1024.min(bytes.len()).max(1) } else { at };
        let end = (at + 1 + random.below(64)).min(bytes.len());
        let number = NUMBERS[random.below(NUMBERS.len())];
        match random.below(9) {
            0 | 1 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            2 if at < bytes.len() => bytes[at] = number as u8,
            3 => {
                let wide = [2, 4, 8][random.below(3)];
                let there = wide.min(bytes.len() - at);
                let value = if random.below(4) == 0 { number.to_be_bytes() } else { number.to_le_bytes() };
                bytes[at..at + there].copy_from_slice(&value[..there]);
            }
            4 => drop(bytes.drain(at..end)),
            5 => {
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            6 => bytes.truncate(at),
            7 => {
                let digits: Vec<_> = (0..bytes.len().min(60_000)).filter(|&i| bytes[i].is_ascii_digit()).collect();
                if let Some(&digit) = digits.get(random.below(digits.len())) {
                    let texts =
                        ["-1", "0", "4294967295", "18446744073709551615", "1e30", "1e-30", "null", "[]", "\"\""];
                    let text = texts[random.below(texts.len())].bytes();
                    bytes.splice(digit..digit + 1, text);
                }
            }
            _ => {
                let from = random.below(other.len());
                let piece = other[from..(from + random.below(200)).min(other.len())].to_vec();
                bytes.splice(at..end, piece);
            }
        }
    }
    bytes
}

/// The same for a document's values: of what is well-formed JSON, most can be read, and much is wrong all the same.
fn mutate_json(json: &mut Value, random: &mut Random) {
    fn places(value: &Value, at: String, found: &mut Vec<String>) {
        match value {
            Value::Array(list) => (0..list.len()).for_each(|i| places(&list[i], format!("{at}/{i}"), found)),
            Value::Object(map) => map.iter().for_each(|(key, value)| places(value, format!("{at}/{key}"), found)),
            _ => (),
        }
        found.push(at);
    }
    for _ in 0..1 + random.below(2) {
        let mut found = Vec::new();
        places(json, String::new(), &mut found);
        let other = json.pointer(&found[random.below(found.len())]).cloned().unwrap_or_default();
        // Mostly numbers, to which others are the least offence.
        if random.below(4) > 0 {
            found.retain(|at| json.pointer(at).is_some_and(Value::is_number));
        }
        let Some(value) = found.get(random.below(found.len())).and_then(|at| json.pointer_mut(at)) else { continue };
        let whole = NUMBERS[random.below(NUMBERS.len())];
        *value = match value.take() {
            Value::Number(number) => {
                let number = number.as_f64().unwrap_or_default();
                match random.below(8) {
                    0 => json!(whole),
                    1 => json!(-(whole as f64)),
                    2 => other,
                    3 | 4 => json!(number + [-1.0, 1.0, 2.0, 0.5][random.below(4)]),
                    5 => json!([0, 1, 2, 3, 4, 5121, 5123, 5125, 5126, 9728][random.below(10)]),
                    _ => json!(number * [0.0, -1.0, 1e30, 1e-30, 1000.0, 0.1, 1e-7][random.below(7)]),
                }
            }
            Value::Array(mut list) if random.below(2) == 0 => {
                list.truncate(random.below(list.len()));
                Value::Array(list)
            }
            _ => [Value::Null, json!([]), json!({}), json!(""), json!(true), other][random.below(6)].clone(),
        };
    }
}

/// A scene or plan by its values, and by the bytes that they speak of; `None` if it is no document.
fn mutated_document(bytes: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    if !bytes.starts_with(b"glTF") {
        let mut json = serde_json::from_slice(bytes).ok()?;
        mutate_json(&mut json, random);
        return Some(json.to_string().into_bytes());
    }
    let (mut json, mut binary) = chunks(bytes)?;
    for _ in 0..random.below(4) {
        let at = random.below(binary.len());
        binary.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << random.below(8));
    }
    if binary.is_empty() || random.below(4) > 0 {
        mutate_json(&mut json, random);
    }
    Some(glb::file(&json, &binary))
}

/// Mutates a file by number and reads it; false if that panics, or if a scene is accepted that breaks a promise.
fn attempt(valid: &[ValidFile], number: u64, folder: &Path) -> bool {
    let mut random = Random(number);
    // Every door is equally frequent.
    let (name, door) = DOORS[number as usize % DOORS.len()];
    let fit: Vec<_> = valid.iter().filter(|s| s.doors.contains(&name)).collect();
    let [file, other] = [0; 2].map(|_| fit[random.below(fit.len())]);
    let document = if random.below(4) > 0 { mutated_document(&file.bytes, &mut random) } else { None };
    let mut bytes = document.unwrap_or_else(|| mutated(&file.bytes, &other.bytes, &mut random));
    if name == "checkpoint" && random.below(2) == 0 {
        // With the checksum renewed, as a forger would, the fields behind it are reached.
        let _ = catch_unwind(AssertUnwindSafe(|| seal(&mut bytes)));
    }
    catch_unwind(AssertUnwindSafe(|| {
        if door(folder, &bytes) && ["scene", "decoders"].contains(&name) {
            let glb = name == "decoders" || bytes.starts_with(b"glTF");
            let (outcome, time) = gltf_parts::attempt(&folder.join(if glb { "scene.glb" } else { "scene.gltf" }));
            assert!(time < LONGEST, "{time:?}");
            check_scene(&outcome.unwrap().unwrap()).unwrap();
        }
    }))
    .is_ok()
}

/// Mutations of files that no door accepts would test nothing.
#[test]
fn valid_files_pass_their_doors() {
    let folder = Folder::new();
    let ours = valid_files();
    for (i, file) in ours.iter().enumerate() {
        for (name, door) in DOORS.iter().filter(|(name, _)| file.doors.contains(name)) {
            assert!(door(&folder, &file.bytes), "valid file {i} at {name}");
        }
    }
    let shared = shared_scenes();
    let taken = shared.iter().filter(|file| doors::scene(&folder, &file.bytes)).count();
    assert!(taken * 10 >= shared.len() * 6, "{taken} of {} shared scenes", shared.len());
    assert!(DOORS.iter().all(|(name, _)| ours.iter().any(|file| file.doors.contains(name))));
    if let Some(seeds) = env::var_os("BISMAR_SEEDS") {
        for (i, file) in ours.iter().chain(&shared).enumerate() {
            for folder in file.doors.iter().map(|name| Path::new(&seeds).join(name)) {
                fs::create_dir_all(&folder).unwrap();
                fs::write(folder.join(format!("sound-{i}")), &file.bytes).unwrap();
            }
        }
    }
}

#[test]
fn no_mutated_file_panics_aborts_or_hangs() {
    let number = |name: &str| env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (many, from) = (number("BISMAR_MUTATIONS"), number("BISMAR_MUTATIONS_FROM").unwrap_or(0));
    let numbers = match number("BISMAR_MUTATION") {
        Some(one) => one..one + 1,
        None => from..from + many.unwrap_or(6000),
    };
    // The decoder's own panics are its way to say no, and forgers meet none of ours.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let sealing = info.location().is_some_and(|l| l.file().ends_with("helpers/program.rs"));
        if !guard::is_decoding() && !sealing {
            hook(info);
        }
    }));
    let mut valid = valid_files();
    valid.extend(shared_scenes());
    let folder = Folder::new();
    let failures: Vec<_> = numbers.filter(|number| !attempt(&valid, *number, &folder)).collect();
    let largest = valid.iter().map(|s| s.bytes.len() as u64).max().unwrap();
    let peak = peak_memory_bytes();
    assert!(failures.is_empty(), "BISMAR_MUTATION={}", failures[0]);
    // With other tests in the same process memory says nothing.
    assert!(many.is_none() || peak <= (256 << 20) + 4 * largest, "peak {} MiB", peak >> 20);
}
