//! Mutated files of every kind that the program reads: never a panic, an abort or a hang.
//!
//! `BISMAR_MUTATIONS=N` tries N of them instead of a few thousand, from `BISMAR_MUTATIONS_FROM` on, and holds the process
//! to its memory: `scripts/reliability.py mutations` does so a million times. `BISMAR_MUTATION=N` tries one alone.

use std::env;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use bismar::console::host::peak_memory_bytes;
use bismar::film::{Aov, Film, exr_file};
use exr::prelude::*;
use image::codecs::{hdr::HdrEncoder, jpeg::JpegEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::helpers::glb;
use crate::helpers::gltf_parts::Parts;
use crate::helpers::program::{expect, scene, seal};
use crate::helpers::random::Random;
use crate::helpers::shared;

#[path = "../fuzz/doors.rs"]
mod doors;
use doors::DOORS;

/// A file as somebody meant it, and the doors that it comes in by.
struct Sound {
    doors: &'static [&'static str],
    bytes: Vec<u8>,
}

fn sound() -> Vec<Sound> {
    let folder = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    let mut add = |doors: &'static [&'static str], bytes: Vec<u8>| all.push(Sound { doors, bytes });

    add(&["scene"], glb::triangle());
    add(&["scene"], Parts::default().json().into_bytes());
    add(&["scene"], fs::read(scene("cornell.glb")).unwrap());
    if let Some(folder) = shared::folder() {
        let rows = shared::scenes(&folder);
        let small = |row: &str| row.parse::<u64>().is_ok_and(|bytes| bytes < 40_000);
        for row in rows.iter().filter(|row| small(&row["bytes_total"])).step_by(7) {
            add(&["scene"], fs::read(folder.join(&row["path"])).unwrap());
        }
    }

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

    let at = |name: &str| folder.path().join(name);
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
        let tiles = Blocks::Tiles(Vec2(8, 8));
        let blocks = if i % 2 == 0 { Blocks::ScanLines } else { tiles };
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = AnyChannels::sort(channels.collect());
        let layer = Layer::new((24, 20), LayerAttributes::named("a"), encoding, channels);
        Image::from_layer(layer).write().to_file(at("c.exr")).unwrap();
        add(&["exr", "picture", "environment"], fs::read(at("c.exr")).unwrap());
    }
    let film = Film::new(20, 12, [0, 0, 20, 12], false);
    exr_file::write(&at("film.exr"), &film, &Aov::DEFAULT, &Vec::new(), Some(&[1; 900])).unwrap();
    add(&["exr", "checkpoint"], fs::read(at("film.exr")).unwrap());

    fs::copy(scene("cornell.glb"), at("cornell.glb")).unwrap();
    let line = "render cornell.glb --size 34x20 --spp 8 --checkpoint 9 -q -o out.exr";
    expect(folder.path(), line, 0);
    let out = fs::read(at("out.exr")).unwrap();
    add(&["exr", "checkpoint"], out);
    add(&["statistics"], exr_file::read_statistics(&at("out.exr")).unwrap().unwrap());

    let jobs = "[defaults]\nspp = 4\noutput = '{name}-{seed}.exr'\n[[job]]\nscene = 'a.glb'\nno-env = true\nseed = 1\n\
                [[matrix]]\nscene = ['b.glb', 'c.glb']\nseed = [1, 2, 3]\npreview = '{name}.png'\n";
    add(&["batch"], jobs.into());
    fs::write(at("jobs.toml"), jobs.replace("[[job]]", "[[job]]\nname = 'x'")).unwrap();
    for name in ["a", "b", "c"] {
        fs::copy(scene("cornell.glb"), at(&format!("{name}.glb"))).unwrap();
    }
    expect(folder.path(), "farm submit jobs.toml --format openjd --parts 2", 0);
    for name in ["farm.json", "plan.json", "job.json", "template.json"] {
        if let Ok(bytes) = fs::read(at("jobs.farm").join(name)) {
            add(&["farm"], bytes);
        }
    }
    add(
        &["farm"],
        br#"{"version":"pathmapping-1.0","path_mapping_rules":[{"source_path_format":"POSIX",
        "source_path":"/a","destination_path":"/b"}]}"#
            .to_vec(),
    );
    all
}

/// What an accident or somebody with a mind makes of a file.
fn mutated(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    const NUMBERS: [u64; 12] =
        [0, 1, 2, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 1 << 49, u64::MAX];
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len());
        // Headers are small, and most of what is said is said there.
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

/// Mutates by number, and goes through a door; whether it ended, and how long it took.
fn attempt(sound: &[Sound], number: u64, folder: &Path) -> (bool, Duration) {
    let mut random = Random(number);
    // Each door as often as any other.
    let (name, door) = DOORS[number as usize % DOORS.len()];
    let fit: Vec<_> = sound.iter().filter(|s| s.doors.contains(&name)).collect();
    let [file, other] = [0; 2].map(|_| fit[random.below(fit.len())]);
    let mut bytes = mutated(&file.bytes, &other.bytes, &mut random);
    if name == "checkpoint" && random.below(2) == 0 {
        // As a forger would: what is behind the seal is reached.
        let _ = catch_unwind(AssertUnwindSafe(|| seal(&mut bytes)));
    }
    let start = Instant::now();
    let ended = catch_unwind(AssertUnwindSafe(|| door(folder, &bytes))).is_ok();
    (ended, start.elapsed())
}

#[test]
fn no_mutated_file_panics_aborts_or_hangs() {
    let number = |name: &str| env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (many, from) = (number("BISMAR_MUTATIONS"), number("BISMAR_MUTATIONS_FROM").unwrap_or(0));
    let numbers = match number("BISMAR_MUTATION") {
        Some(one) => one..one + 1,
        None => from..from + many.unwrap_or(4000),
    };
    // The decoder's own panics are its way to say no, and forgers meet none of ours.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let sealing = info.location().is_some_and(|l| l.file().ends_with("helpers/program.rs"));
        if !exr_file::is_decoding() && !sealing {
            hook(info);
        }
    }));
    let sound = sound();
    let folder = tempfile::tempdir().unwrap();
    let (mut failures, mut slowest) = (Vec::new(), (Duration::ZERO, 0));
    for number in numbers.clone() {
        let (ended, took) = attempt(&sound, number, folder.path());
        slowest = slowest.max((took, number));
        if !ended {
            failures.push(number);
        }
    }
    let largest = sound.iter().map(|s| s.bytes.len() as u64).max().unwrap();
    let peak = peak_memory_bytes();
    println!(
        "{} mutated files, {} panics, slowest {:.3} s (number {}), peak {} MiB, largest sound file {largest} bytes",
        numbers.end - numbers.start,
        failures.len(),
        slowest.0.as_secs_f64(),
        slowest.1,
        peak >> 20
    );
    assert!(failures.is_empty(), "BISMAR_MUTATION={}", failures[0]);
    // With other tests in the same process memory says nothing.
    assert!(many.is_none() || peak <= (256 << 20) + 4 * largest, "peak {} MiB", peak >> 20);
}
