//! The checksum of a file in its own header (length and hash), by which truncated and changed files are detected.

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::head;
use crate::{Error, Result};

/// The name of the attribute.
pub const CHECKSUM: &str = "bismar.seal";

/// The value of the attribute until the file is complete. The checksum has the same form: 16 digits of the length and 64 of the
/// BLAKE3 hash of the file with this placeholder.
pub(super) const PLACEHOLDER: &str =
    concat!("0000000000000000-", "0000000000000000000000000000000000000000000000000000000000000000");

/// The state of a file by its checksum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Checksum {
    /// It has no checksum: another program has written it.
    Missing,
    /// It has been truncated or changed.
    Broken,
    /// It is complete and unchanged. The value is the checksum, which identifies the file.
    Whole(String),
}

/// Replaces [`PLACEHOLDER`] in a file by its checksum, if the file has one.
pub(super) fn finish(file: &File) -> io::Result<()> {
    let Some((at, _)) = find(file)? else { return Ok(()) };
    file.write_all_at(compute(file, at)?.as_bytes(), at)
}

/// Reads a whole file and compares it with its checksum.
///
/// # Errors
/// [`Error::reading`] for a file that cannot be read.
pub fn check(path: &Path) -> Result<Checksum> {
    let failed = |e: io::Error| Error::reading(path, &e);
    let file = File::open(path).map_err(failed)?;
    let found = match find(&file) {
        Ok(found) => found,
        Err(e) if matches!(e.kind(), ErrorKind::InvalidData | ErrorKind::UnexpectedEof) => return Ok(Checksum::Broken),
        Err(e) => return Err(failed(e)),
    };
    let Some((at, checksum)) = found else { return Ok(Checksum::Missing) };
    // The length first, because it is cheap.
    let length = file.metadata().map_err(failed)?.len();
    if !checksum.starts_with(&digits(length)) || checksum != compute(&file, at).map_err(failed)? {
        return Ok(Checksum::Broken);
    }
    Ok(Checksum::Whole(checksum))
}

/// The checksum in the header of a file, which is not verified; empty for files without one.
///
/// # Errors
/// [`Error::reading`] for a file that cannot be opened.
pub fn checksum(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|e| Error::reading(path, &e))?;
    // Devices have no checksum.
    Ok(find(&file).ok().flatten().map(|(_, checksum)| checksum).unwrap_or_default())
}

/// Position and value of the first part's checksum.
fn find(mut file: &File) -> io::Result<Option<(u64, String)>> {
    let mut found = None;
    file.seek(SeekFrom::Start(0))?;
    head::walk(BufReader::new(file), &mut |attribute| {
        if attribute.part == 0 && attribute.name == CHECKSUM.as_bytes() && attribute.value.len() == PLACEHOLDER.len() {
            found = Some((attribute.at, String::from_utf8_lossy(attribute.value).into_owned()));
        }
    })?;
    Ok(found)
}

/// Computes the checksum of a file whose attribute has its value at byte `at`.
fn compute(mut file: &File, at: u64) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    file.seek(SeekFrom::Start(0))?;
    hasher.update_reader(file.take(at))?;
    hasher.update(PLACEHOLDER.as_bytes());
    file.seek(SeekFrom::Start(at + PLACEHOLDER.len() as u64))?;
    let length = hasher.update_reader(file)?.count();
    Ok(format!("{}-{}", digits(length), hasher.finalize().to_hex()))
}

fn digits(length: u64) -> String {
    format!("{length:016}")
}
