//! A file's own length and hash, in its header: what was cut or changed since is never taken for whole.

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::head;
use crate::{Error, Result};

/// The attribute's name.
pub const CHECKSUM: &str = "bismar.seal";

/// What it holds until the file is written: 16 digits of the length, 64 of BLAKE3 over the file with this in its place.
pub(super) const OPEN: &str =
    concat!("0000000000000000-", "0000000000000000000000000000000000000000000000000000000000000000");

/// What a file's checksum says of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Checksum {
    /// It has none: it is older than seals are, or not ours.
    Missing,
    /// It is not what was written.
    Broken,
    /// It is what was written; the checksum itself, by which one file is told from another.
    Whole(String),
}

/// Puts the checksum into a file that was written with [`OPEN`]; nothing if there is no place for it.
///
/// # Errors
/// As the system has them.
pub(super) fn close(file: &File) -> io::Result<()> {
    let Some((at, _)) = find(file)? else { return Ok(()) };
    file.write_all_at(of(file, at)?.as_bytes(), at)
}

/// Reads a file whole and tells whether it is what was written.
///
/// # Errors
/// Missing, forbidden or failing files as [`Error::reading`].
pub fn check(path: &Path) -> Result<Checksum> {
    let failed = |e: io::Error| Error::reading(path, &e);
    let file = File::open(path).map_err(failed)?;
    let found = match find(&file) {
        Ok(found) => found,
        Err(e) if matches!(e.kind(), ErrorKind::InvalidData | ErrorKind::UnexpectedEof) => return Ok(Checksum::Broken),
        Err(e) => return Err(failed(e)),
    };
    let Some((at, checksum)) = found else { return Ok(Checksum::Missing) };
    // The length first: it costs nothing.
    let length = file.metadata().map_err(failed)?.len();
    if !checksum.starts_with(&digits(length)) || checksum != of(&file, at).map_err(failed)? {
        return Ok(Checksum::Broken);
    }
    Ok(Checksum::Whole(checksum))
}

/// A file's checksum as it stands there, without reading the rest; empty for files without.
///
/// # Errors
/// As [`check`].
pub fn checksum(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|e| Error::reading(path, &e))?;
    // Devices have none.
    Ok(find(&file).ok().flatten().map(|(_, checksum)| checksum).unwrap_or_default())
}

/// Where the first part's checksum is, and what it says.
fn find(mut file: &File) -> io::Result<Option<(u64, String)>> {
    let mut found = None;
    file.seek(SeekFrom::Start(0))?;
    head::walk(BufReader::new(file), &mut |attribute| {
        if attribute.part == 0 && attribute.name == CHECKSUM.as_bytes() && attribute.value.len() == OPEN.len() {
            found = Some((attribute.at, String::from_utf8_lossy(attribute.value).into_owned()));
        }
    })?;
    Ok(found)
}

/// The checksum of a file that has its place for it at byte `at`.
fn of(mut file: &File, at: u64) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    file.seek(SeekFrom::Start(0))?;
    hasher.update_reader(file.take(at))?;
    hasher.update(OPEN.as_bytes());
    file.seek(SeekFrom::Start(at + OPEN.len() as u64))?;
    let length = hasher.update_reader(file)?.count();
    Ok(format!("{}-{}", digits(length), hasher.finalize().to_hex()))
}

fn digits(length: u64) -> String {
    format!("{length:016}")
}
