//! Reading a file whole.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Opens a regular file; with its size in bytes. Pipes and devices are refused before they are opened.
///
/// # Errors
/// Missing, forbidden, not a regular file, or larger than `limit`.
pub fn open_regular(path: &Path, limit: u64) -> Result<(File, u64)> {
    let reading = |e| Error::reading(path, &e);
    let refused = |text: String| Err(Error::Data(format!("{}: {text}", path.display())));
    if !std::fs::metadata(path).map_err(reading)?.is_file() {
        return refused("not a regular file".into());
    }
    let file = File::open(path).map_err(reading)?;
    match file.metadata().map_err(reading)?.len() {
        size if size > limit => refused(format!("{size} bytes are more than the {limit} that such a file may have")),
        size => Ok((file, size)),
    }
}

/// Reads a regular file whole.
///
/// # Errors
/// As [`open_regular`]; a failed read, no memory.
pub fn read_regular(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let (file, size) = open_regular(path, limit)?;
    let reading = |e| Error::reading(path, &e);
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(size).unwrap_or(usize::MAX)).map_err(|e| reading(e.into()))?;
    file.take(limit).read_to_end(&mut bytes).map_err(reading)?;
    tracing::debug!("{}: {} bytes", path.display(), bytes.len());
    Ok(bytes)
}
