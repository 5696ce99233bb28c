//! Opening and reading regular files.

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;

use crate::error::{Error, Result};

/// Opens a regular file and returns its size in bytes. Pipes and devices are refused before they are opened.
/// Errors: The file is missing, not permitted, not regular, or larger than `limit` bytes.
pub(crate) fn open_regular(path: &Path, limit: u64) -> Result<(File, u64)> {
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

/// Refuses a Git LFS pointer, which stands in place of a file that was not downloaded.
/// Errors: [`Error::Data`], which names the cure.
pub(crate) fn refuse_pointer(path: &Path, bytes: &[u8]) -> Result<()> {
    if bytes.len() < 1024 && bytes.starts_with(b"version https://git-lfs.github.com/spec/") {
        let text = "a Git LFS pointer in place of the file: run `git lfs pull` where it comes from, and copy it again";
        return Err(Error::Data(format!("{}: {text}", path.display())));
    }
    Ok(())
}

/// Reads a regular file completely; no Git LFS pointer.
///
/// # Errors
/// See `open_regular`; also a failed read, or insufficient memory.
pub fn read_regular(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let (file, size) = open_regular(path, limit)?;
    let reading = |e| Error::reading(path, &e);
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(size).unwrap_or(usize::MAX)).map_err(|e| reading(e.into()))?;
    file.take(limit).read_to_end(&mut bytes).map_err(reading)?;
    tracing::debug!("{}: {} bytes", path.display(), bytes.len());
    refuse_pointer(path, &bytes)?;
    Ok(bytes)
}

/// Most bytes of a text.
const MOST: u64 = 1 << 30;

/// Reads a text that this program has written under a name that others can guess: never from a pipe, which would wait for a writer.
///
/// # Errors
/// Those of [`read_regular`].
pub fn read_own(path: &Path) -> Result<Vec<u8>> {
    read_regular(path, MOST)
}

/// Reads a text of some program: from a file or a pipe, of at most 1 GiB.
///
/// # Errors
/// [`Error::reading`]; [`Error::Data`] for a device, which may have no end, and for one that is longer.
pub fn read_text(path: &Path) -> Result<Vec<u8>> {
    let reading = |e| Error::reading(path, &e);
    let kind = std::fs::metadata(path).map_err(reading)?.file_type();
    let mut bytes = Vec::new();
    if !kind.is_char_device() && !kind.is_block_device() {
        File::open(path).and_then(|file| file.take(MOST + 1).read_to_end(&mut bytes)).map_err(reading)?;
        if bytes.len() as u64 <= MOST {
            return Ok(bytes);
        }
    }
    Err(Error::Data(format!("{}: a device, or longer than {MOST} bytes", path.display())))
}
