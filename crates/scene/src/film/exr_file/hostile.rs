//! Tests with hostile files: false sizes are refused before memory is allocated, and changed files are detected.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use exr::prelude::*;

use super::attributes::text;
use super::{CHECKSUM, Checksum, Header, HeaderValue, bounds, check, head, read, read_header, read_statistics, write};
use crate::film::{Aov, Film};

fn written(folder: &Path, name: &str, compression: Compression, side: usize) -> PathBuf {
    let path = folder.join(name);
    let samples = |c: usize| FlatSamples::F16((0..side * side).map(|i| f16::from_f32((i * c % 97) as f32)).collect());
    let channels = ["R", "G", "B"].iter().enumerate().map(|(c, name)| AnyChannel::new(text(name), samples(c + 1)));
    let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let channels = AnyChannels::sort(channels.collect());
    let layer = Layer::new((side, side), LayerAttributes::default(), encoding, channels);
    Image::from_layer(layer).write().to_file(&path).unwrap();
    path
}

#[test]
fn counts_of_a_block_that_lie_are_refused_before_memory_is_taken_for_them() {
    let folder = tempfile::tempdir().unwrap();
    for (name, compression) in [("a.exr", Compression::DWAA(None)), ("b.exr", Compression::DWAB(None))] {
        let path = written(folder.path(), name, compression, 64);
        assert_eq!(read(&path).unwrap().rgb.len(), 64 * 64);
        let good = fs::read(&path).unwrap();
        // The first block: its line (0), its length, and eleven counters, the first of which says version 2.
        let version = good.windows(8).rposition(|w| w == 2_u64.to_le_bytes()).unwrap();
        for counter in 1..10 {
            for value in [1_u64 << 49, u64::MAX, i64::MAX as u64, 1 << 33] {
                let mut bytes = good.clone();
                bytes[version + 8 * counter..version + 8 * counter + 8].copy_from_slice(&value.to_le_bytes());
                fs::write(&path, bytes).unwrap();
                let error = read(&path).unwrap_err();
                assert_eq!(error.exit_code(), 65, "counter {counter}: {error}");
            }
        }
    }
}

#[test]
fn every_compression_is_read_and_its_damage_is_an_error_or_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let all = [
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
    for compression in all {
        let path = written(folder.path(), "c.exr", compression, 40);
        let good = fs::read(&path).unwrap();
        read(&path).unwrap();
        for i in 0..300 {
            let mut bytes = good.clone();
            let at = i * 7919 % bytes.len();
            bytes[at] = [0x00, 0x7F, 0x80, 0xFF][i % 4];
            fs::write(&path, bytes).unwrap();
            if let Err(error) = read(&path) {
                assert_eq!(error.exit_code(), 65, "{compression}, byte {at}: {error}");
            }
        }
    }
}

/// A file that ends with zeros which take no place on the disk.
fn sparse(path: &Path, start: &[u8], length: u64) {
    let mut file = File::create(path).unwrap();
    file.write_all(start).unwrap();
    file.set_len(length).unwrap();
}

#[test]
fn attributes_without_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let head = [0x76, 0x2F, 0x31, 0x01, 2, 0, 0, 0];
    let huge = [&head[..], b"x\0string\0", &(1_i32 << 30).to_le_bytes()].concat();
    let many: Vec<u8> = head.into_iter().chain(b"x\0y\0\0\0\0\0".iter().copied().cycle().take(8 << 20)).collect();
    let negative = [&head[..], b"x\0string\0", &(-1_i32).to_le_bytes()].concat();
    let nameless = [&head[..], &[b'n'; 5000]].concat();
    for (start, words) in [
        (&huge, "more than 16 MiB"),
        (&many, "more than 65536 attributes"),
        (&negative, "negative length"),
        (&nameless, "longer than 255 bytes"),
    ] {
        sparse(&path, start, (1 << 30) + 100);
        let errors = [read(&path).err(), read_header(&path).err(), read_statistics(&path).err()];
        for error in errors {
            let error = error.unwrap();
            assert_eq!(error.exit_code(), 65);
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}

#[test]
fn sizes_out_of_proportion_to_the_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "a.exr", Compression::ZIP16, 16);
    let meta = MetaData::read_from_file(&path, false).unwrap();
    let with = |width: usize, height: usize, chunks: usize| {
        let mut header = meta.headers[0].clone();
        (header.layer_size, header.chunk_count) = (Vec2(width, height), chunks);
        header
    };
    // 44 million pixels in any file, more in larger ones.
    assert_eq!(bounds::check(&with(8192, 4320, 270), 20_000), Ok(()));
    assert_eq!(bounds::check(&with(32768, 16384, 1024), 200 << 20), Ok(()));
    for (header, bytes) in [
        (with(16384, 16384, 1024), 1_600_000),
        (with(1 << 31, 1 << 31, 1), u64::MAX),
        (with(16, 16, 1 << 40), 1 << 30),
        (with(1 << 27, 16, 1), 1 << 20),
        (with(1 << 24, 2, 1), 3388),
    ] {
        assert!(bounds::check(&header, bytes).is_err(), "{:?}", header.layer_size);
    }
}

#[test]
fn blocks_that_cannot_hold_their_pixels_are_refused_before_memory_is_taken_for_them() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [
        Compression::RLE,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44A,
        Compression::DWAA(None),
        Compression::DWAB(None),
    ] {
        let rows = compression.scan_lines_per_block().min(64);
        let path = written(folder.path(), "c.exr", compression, rows);
        read(&path).unwrap();
        let mut bytes = fs::read(&path).unwrap();
        // One block, of so many rows as before, but 24 MB of them.
        let window = b"dataWindow\0box2i\0\x10\0\0\0";
        let at = bytes.windows(window.len()).position(|w| w == window).unwrap() + window.len();
        bytes[at + 8..at + 12].copy_from_slice(&(4_000_000 / rows as i32).to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        let error = read(&path).unwrap_err();
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains("holds too little"), "{compression}: {error}");
    }
}

#[test]
fn devices_are_no_pictures() {
    assert_eq!(read(Path::new("/dev/zero")).unwrap_err().exit_code(), 65);
    assert_eq!(read_header(Path::new("/dev/zero")).unwrap_err().exit_code(), 65);
}

/// A file of ours with statistics, checksummed.
fn checksummed(folder: &Path) -> PathBuf {
    let path = folder.join("checksummed.exr");
    let header: Header = vec![("bismar.scene".into(), HeaderValue::Text("a.glb".into()))];
    write(&path, &Film::new(20, 10, [0, 0, 20, 10], false), &Aov::DEFAULT, &header, Some(&[7; 3000])).unwrap();
    path
}

#[test]
fn a_checksum_finds_every_changed_byte_and_every_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = checksummed(folder.path());
    let Checksum::Whole(checksum) = check(&path).unwrap() else { panic!("no checksum") };
    let good = fs::read(&path).unwrap();
    assert!(checksum.starts_with(&format!("{:016}-", good.len())), "{checksum}");
    // A change before it may hide it: its name, or the length of what it then belongs to.
    let mut at = 0;
    head::walk(&good[..], &mut |a| at = if a.name == CHECKSUM.as_bytes() { a.at as usize } else { at }).unwrap();
    let mut missing = 0;
    for i in (0..at).chain((at..good.len()).step_by(17)) {
        let mut bytes = good.clone();
        bytes[i] ^= 1 << (i % 8);
        fs::write(&path, bytes).unwrap();
        let found = check(&path).unwrap();
        missing += usize::from(found == Checksum::Missing);
        assert!(found == Checksum::Broken || i < at && found == Checksum::Missing, "byte {i}: {found:?}");
    }
    assert!(at > 0 && missing < 200, "{missing} of {at} changes hide the checksum");
    for length in (0..good.len()).step_by(41).chain([good.len() - 1]) {
        fs::write(&path, &good[..length]).unwrap();
        assert_eq!(check(&path).unwrap(), Checksum::Broken, "cut to {length}");
    }
    fs::write(&path, [&good[..], &[0]].concat()).unwrap();
    assert_eq!(check(&path).unwrap(), Checksum::Broken);
    fs::write(&path, &good).unwrap();
    assert_eq!(check(&path).unwrap(), Checksum::Whole(checksum));
}

#[test]
fn files_of_others_have_no_checksum_and_devices_take_none() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(check(&written(folder.path(), "a.exr", Compression::PIZ, 8)).unwrap(), Checksum::Missing);
    write(Path::new("/dev/null"), &Film::new(4, 4, [0, 0, 4, 4], false), &Aov::DEFAULT, &Vec::new(), None).unwrap();
}
