//! Reading a file whole.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Reads a regular file whole. Pipes and devices are refused before they are opened.
///
/// # Errors
/// Missing, forbidden, not a regular file, larger than `limit`, or a failed read.
pub fn read_regular(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let meta = std::fs::metadata(path).map_err(|e| Error::reading(path, &e))?;
    if !meta.is_file() {
        return Err(Error::Data(format!("{}: not a regular file", path.display())));
    }
    if meta.len() > limit {
        return Err(Error::Data(format!(
            "{}: {} bytes are more than the {limit} that such a file may have",
            path.display(),
            meta.len()
        )));
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|e| Error::reading(path, &e))?;
    file.take(limit).read_to_end(&mut bytes).map_err(|e| Error::reading(path, &e))?;
    tracing::debug!("{}: {} bytes", path.display(), bytes.len());
    Ok(bytes)
}
