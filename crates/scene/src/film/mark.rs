//! The mark of a file that this program has written: BLAKE3 of the rest of the file, in a place that its format leaves free. EXR files
//! have their checksum instead.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::exr_file::{self, Checksum};

/// How a format can be marked.
#[derive(Debug, Clone, Copy)]
enum Form {
    /// A text chunk after the header.
    Png,
    /// A comment after the first segment.
    Jpeg,
    /// A chunk of our own at the end.
    WebP,
    /// Blanks and tabs at the end of the header, which all readers skip.
    Npy,
    /// A text at the end with this before and after the hash.
    End(&'static str, &'static str),
    /// The same after the opening brace.
    Json(&'static str, &'static str),
}

/// JSON of ours, and a job template, which has no fields but its own.
const JSON: [Form; 2] =
    [Form::Json("\n  \"bismar.mark\": \"", "\","), Form::Json("\n  \"description\": \"bismar.mark ", "\",")];

impl Form {
    /// What a file that begins so may be; nothing for tables, which have no place for a mark.
    fn of(head: &[u8]) -> &'static [Self] {
        match head {
            [0x89, b'P', b'N', b'G', ..] => &[Self::Png],
            [0xFF, 0xD8, 0xFF, _, _, _, ..] => &[Self::Jpeg],
            [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => &[Self::WebP],
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1, 0, _, _, ..] => &[Self::Npy],
            [b'{', ..] => &JSON,
            [b'#', b'!', ..] => &[Self::End("# bismar.mark ", "\n")],
            [b'<' | b'#', ..] => &[Self::End("<!-- bismar.mark ", " -->\n")],
            [b'.', ..] => &[Self::End(".\\\" bismar.mark ", "\n")],
            _ => &[],
        }
    }

    /// The mark with a hash; it has the same length for every hash.
    fn mark(self, hash: blake3::Hash) -> Vec<u8> {
        let hex = hash.to_hex();
        match self {
            Self::Png => {
                let chunk = format!("tEXtbismar.mark\0{hex}").into_bytes();
                let length = (chunk.len() - 4) as u32;
                [&length.to_be_bytes()[..], &chunk, &crc32fast::hash(&chunk).to_be_bytes()].concat()
            }
            Self::Jpeg => {
                let text = format!("bismar.mark {hex}").into_bytes();
                [&[0xFF, 0xFE][..], &(text.len() as u16 + 2).to_be_bytes(), &text].concat()
            }
            Self::WebP => [b"BSMR\x40\0\0\0", hex.as_bytes()].concat(),
            Self::Npy => {
                (0..128).map(|i| if hash.as_bytes()[i / 8] >> (i % 8) & 1 == 1 { b'\t' } else { b' ' }).collect()
            }
            Self::End(before, after) | Self::Json(before, after) => format!("{before}{hex}{after}").into_bytes(),
        }
    }

    fn length(self) -> u64 {
        self.mark(blake3::hash(&[])).len() as u64
    }

    /// Where the mark begins in a file that begins with `head`, whose fields of lengths count the mark, and has `rest` bytes besides.
    fn place(self, head: &[u8], rest: u64) -> Option<u64> {
        let place = match self {
            Self::Png => 33,
            Self::Jpeg if head[2..6] == [0xFF, 0xE0, 0, 16] => 20,
            Self::Jpeg => 2,
            Self::WebP | Self::End(..) => rest,
            Self::Npy => (9 + u64::from(u16::from_le_bytes([head[8], head[9]]))).checked_sub(self.length())?,
            Self::Json(..) => 1,
        };
        Some(place).filter(|place| *place <= rest)
    }
}

/// Hash of a file without the bytes from `place` to `after`.
fn hash_without(mut file: &File, place: u64, after: u64) -> io::Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    file.seek(SeekFrom::Start(0))?;
    hasher.update_reader(file.take(place))?;
    file.seek(SeekFrom::Start(after))?;
    Ok(hasher.update_reader(file)?.finalize())
}

/// The first bytes of a file, or all.
fn head(mut file: &File) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    file.seek(SeekFrom::Start(0))?;
    file.take(16).read_to_end(&mut head)?;
    Ok(head)
}

/// Marks a file that has been written, if its format has a place for a mark.
pub(super) fn add(mut file: &File) -> io::Result<()> {
    let mut bytes = head(file)?;
    let [form, others @ ..] = Form::of(&bytes) else { return Ok(()) };
    file.read_to_end(&mut bytes)?;
    let is_template = bytes.windows(22).any(|word| word == b"\"specificationVersion\"");
    let form = others.first().filter(|_| is_template).unwrap_or(form);
    match form {
        Form::Json(..) if !bytes[1..].trim_ascii_start().starts_with(b"\"") => return Ok(()),
        Form::WebP => {
            let size = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) + form.length() as u32;
            bytes[4..8].copy_from_slice(&size.to_le_bytes());
        }
        Form::Npy => {
            let size = u16::from_le_bytes([bytes[8], bytes[9]]) + form.length() as u16;
            bytes[8..10].copy_from_slice(&size.to_le_bytes());
        }
        _ => {}
    }
    let Some(place) = form.place(&bytes, bytes.len() as u64) else { return Ok(()) };
    file.write_all_at(&bytes[..16.min(bytes.len())], 0)?;
    let mark = form.mark(hash_without(file, place, place)?);
    file.write_all_at(&mark, place)?;
    file.write_all_at(&bytes[place as usize..], place + mark.len() as u64)
}

/// Has this program written a file, and nobody changed it since?
pub(super) fn is_ours(path: &Path) -> bool {
    try_is_ours(path).unwrap_or(false)
}

fn try_is_ours(path: &Path) -> io::Result<bool> {
    let file = File::open(path)?;
    let (head, all) = (head(&file)?, file.metadata()?.len());
    if head.starts_with(&[0x76, 0x2F, 0x31, 0x01]) {
        return Ok(matches!(exr_file::check(path), Ok(Checksum::Whole(_))));
    }
    // A record of a study has its hash after the first line.
    if head.starts_with(b"bismar study ") {
        let mut hash = [0; 32];
        file.read_exact_at(&mut hash, 15)?;
        return Ok(hash_without(&file, 0, 47)? == hash);
    }
    for form in Form::of(&head) {
        let mut found = vec![0; form.length() as usize];
        let Some(place) = all.checked_sub(form.length()).and_then(|rest| form.place(&head, rest)) else { continue };
        file.read_exact_at(&mut found, place)?;
        if found == form.mark(hash_without(&file, place, place + form.length())?) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::film::{atomic, npy, preview};

    #[test]
    fn what_is_written_is_ours_until_a_byte_of_it_changes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let pixels: Vec<u8> = (0..60).collect();
        for name in ["a.png", "a.jpg", "a.webp"] {
            preview::write_rgb8(&at(name), 5, 4, &pixels).unwrap();
            let read = image::ImageReader::open(at(name)).unwrap().decode().unwrap().into_rgb8();
            assert!(name == "a.jpg" || read.into_raw() == pixels, "{name}");
        }
        npy::write(&at("a.npy"), &[2, 3], &[0.5; 6]).unwrap();
        for (name, text) in [
            ("a.json", "{\"schema\":1}"),
            ("t.json", "{\"name\":1,\"specificationVersion\":2}"),
            ("a.html", "<!DOCTYPE html>\n"),
            ("a.sh", "#!/bin/sh\n"),
            ("a.1", ".TH a 1\n"),
        ] {
            atomic::write(&at(name), |w| Ok(Ok(io::Write::write_all(w, text.as_bytes())?))).unwrap();
        }
        let json: serde_json::Value = serde_json::from_slice(&fs::read(at("t.json")).unwrap()).unwrap();
        assert_eq!((&json["specificationVersion"], json.as_object().unwrap().len()), (&2.into(), 3));
        for file in fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().path()) {
            assert!(is_ours(&file), "{}", file.display());
            let whole = fs::read(&file).unwrap();
            for at in 0..whole.len() {
                let mut changed = whole.clone();
                changed[at] ^= 1;
                fs::write(&file, changed).unwrap();
                assert!(!is_ours(&file), "byte {at} of {}", file.display());
            }
            for other in [&whole[..whole.len() - 1], &[&whole[..], b"\n"].concat(), b"", b"{", b"RIFF"] {
                fs::write(&file, other).unwrap();
                assert!(!is_ours(&file), "{} bytes of {}", other.len(), file.display());
            }
        }
    }
}
