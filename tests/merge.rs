//! Parts become the whole to the bit, and seeds the mean that all their paths would have given.

use std::fs;
use std::path::{Path, PathBuf};

use bismar::film::exr_file;
use bismar::render::record::checkpoint::unpack;

use crate::helpers::farm::folder;
use crate::helpers::program::{self, assert_same_bits, bits, expect, names, says};

/// The merge of a render's parts, which are `part1.exr` and so on.
#[track_caller]
pub fn in_parts(folder: &Path, line: &str, parts: u32) -> PathBuf {
    let part = |number: u32| {
        expect(folder, &format!("{line} --part {number}/{parts} -o part{number}.exr"), 0);
        format!("part{number}.exr ")
    };
    let files: String = (1..=parts).map(part).collect();
    expect(folder, &format!("merge {files} -o merged.exr -q"), 0);
    folder.join("merged.exr")
}

#[test]
fn parts_in_any_order_are_the_whole_to_the_bit() {
    let folder = folder();
    for (flags, parts) in [
        ("--size 150x90 --spp 24 --aov all", 5),
        ("--size 150x90 --spp 16 --crop 7,9,140,70 --balance second-order", 3),
        ("--size 20x20 --spp 8 --balance power --rays obvhs", 4),
        ("--size 150x90 --noise 0.2 --spp 300", 3),
        ("--size 150x90 --adaptive --guiding on --spp 48", 3),
    ] {
        let line = format!("render veach.glb {flags} -q");
        expect(&folder, &format!("{line} -o whole.exr"), 0);
        let mut files = String::new();
        for part in (1..=parts).rev() {
            expect(&folder, &format!("{line} --part {part}/{parts} -o part{part}.exr"), 0);
            files = if part % 2 == 0 { format!("{files} part{part}.exr") } else { format!("part{part}.exr {files}") };
        }
        expect(&folder, &format!("merge {files} -o merged.exr -q"), 0);
        assert_same_bits(&folder.join("whole.exr"), &folder.join("merged.exr"));
        for name in ["settings", "samples", "noise", "scene", "camera", "stop", "fingerprint", "aov"] {
            let of = |file: &str| program::attribute(&folder.join(file), &format!("bismar.{name}"));
            assert_eq!(of("whole.exr"), of("merged.exr"), "{name}");
        }
        // It is the whole: the whole's command has nothing to do.
        says(&folder, &format!("render veach.glb {flags} -o merged.exr --resume"), 0, "finished before");
    }
}

#[test]
fn parts_that_can_go_on_make_a_whole_that_can() {
    let folder = folder();
    let line = "render veach.glb --size 64x48 -q";
    let merged = in_parts(&folder, &format!("{line} --spp 128 --checkpoint 9"), 2);
    expect(&folder, &format!("{line} --spp 256 -o merged.exr --resume"), 0);
    expect(&folder, &format!("{line} --spp 256 -o whole.exr"), 0);
    assert_same_bits(&folder.join("whole.exr"), &merged);
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let folder = folder();
    let line = "render veach.glb --size 64x48 -q";
    for (flags, file) in [
        ("--spp 8 --part 1/3", "a1"),
        ("--spp 8 --part 2/3", "a2"),
        ("--spp 8 --part 3/3", "a3"),
        ("--spp 12 --part 3/3", "longer"),
        ("--spp 8 --part 2/2", "b2"),
        ("--spp 8 --part 3/3 --seed 9", "seed9"),
        ("--spp 8 --part 3/3 --max-depth 3", "shallow"),
        ("--spp 8", "plain"),
        ("--spp 8 --seed 1 --checkpoint 9", "one"),
    ] {
        expect(&folder, &format!("{line} {flags} -o {file}.exr"), 0);
    }
    fs::copy(folder.join("one.exr"), folder.join("copy.exr")).unwrap();
    for (files, code, words) in [
        ("a1 a2", 65, "1 of 3 parts are missing: 3/3"),
        ("a1 a2 a3 a3", 65, "a3.exr and a3.exr are both part 3/3"),
        ("a1 a2 b2", 65, "b2.exr is part 2/2, but a1.exr is part 1/3"),
        ("a1 a2 longer", 65, "longer.exr has 12 paths a pixel and a1.exr has 8"),
        ("a1 a2 seed9", 65, "of seed 0 1 of 3 parts are missing: 3/3"),
        ("a1 a2 shallow", 65, "different max-depth (3 there, 8 here)"),
        ("plain", 65, "plain.exr: carries no statistics to merge"),
        ("one copy", 65, "no independent pictures"),
        ("a1 a2 absent", 66, "absent.exr"),
    ] {
        let line = files.split(' ').map(|f| format!("{f}.exr ")).collect::<String>();
        says(&folder, &format!("merge {line} -o out.exr"), code, words);
    }
    let newer = vec![("bismar.format".into(), exr_file::HeaderValue::Number(99.0))];
    let film = bismar::film::Film::new(4, 4, [0, 0, 4, 4], false);
    exr_file::write(&folder.join("newer.exr"), &film, exr_file::Layers::default(), &newer, None).unwrap();
    says(&folder, "merge a1.exr newer.exr a3.exr -o out.exr", 65, "newer.exr: is from a newer bismar");
    assert!(!names(&folder).contains(&"out.exr".into()));
}

/// Sums of all pixels of a picture's tiles: paths, radiance, its square.
fn sums(path: &Path) -> Vec<(u32, [f64; 3], [f64; 3])> {
    let tiles = unpack(&exr_file::read_statistics(path).unwrap().unwrap()).unwrap();
    // One tile, so that pixels are in the picture's order.
    assert_eq!(tiles.len(), 1);
    tiles[0].stats.iter().map(|s| (s.samples, s.sum, s.sum_squared)).collect()
}

#[test]
fn seeds_are_averaged_by_their_paths_and_so_is_their_variance() {
    let folder = folder();
    let file = |name: &str| folder.join(name);
    let line = "render veach.glb --size 16x12 -q --checkpoint 9 --aov all";
    for (seed, spp) in [(1, 16), (2, 48), (3, 16)] {
        expect(&folder, &format!("{line} --seed {seed} --spp {spp} -o {seed}.exr"), 0);
    }
    expect(&folder, "merge 3.exr 1.exr 2.exr -o mean.exr -q", 0);
    expect(&folder, "merge 1.exr 2.exr 3.exr -o again.exr -q", 0);
    assert_same_bits(&file("mean.exr"), &file("again.exr"));
    let all = [1, 2, 3].map(|seed| sums(&file(&format!("{seed}.exr"))));
    let merged = bits(&file("mean.exr"));
    let channel = |name: &str| &merged.iter().find(|(n, _)| n == name).unwrap().1;
    for (pixel, ((a, b), c)) in all[0].iter().zip(&all[1]).zip(&all[2]).enumerate() {
        let n = a.0 + b.0 + c.0;
        assert_eq!((n, channel("samples.V")[pixel]), (80, 80));
        for (channel_number, name) in ["R", "G", "B"].into_iter().enumerate() {
            let sum = a.1[channel_number] + b.1[channel_number] + c.1[channel_number];
            let squared = a.2[channel_number] + b.2[channel_number] + c.2[channel_number];
            let n = f64::from(n);
            let variance = (squared / n - (sum / n).powi(2)).max(0.0) / (n - 1.0);
            assert_eq!(channel(name)[pixel], ((sum / n) as f32).to_bits());
            assert_eq!(channel(&format!("variance.{name}"))[pixel], (variance as f32).to_bits());
        }
    }
    // Seeds in parts are the same mean.
    for (seed, spp) in [(1, 16), (2, 48), (3, 16)] {
        expect(&folder, &format!("{line} --seed {seed} --spp {spp} --part 1/1 -o part{seed}.exr"), 0);
    }
    expect(&folder, "merge part1.exr part2.exr part3.exr -o mean2.exr -q", 0);
    assert_same_bits(&file("mean.exr"), &file("mean2.exr"));
}
