//! An open scene file, or a GLB that was read from standard input.

use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use bytes::Bytes;

use super::container::{HEADER, MAGIC};
use crate::error::{Error, Result};

/// The name of standard input in messages and statistics.
pub const STANDARD_INPUT: &str = "standard input";

/// Where the bytes of a scene come from.
#[derive(Debug)]
pub enum Input {
    /// A file, of which any part can be read.
    File(File),
    /// All bytes.
    Memory(Bytes),
}

impl Input {
    /// The bytes of a range, which lies within the input.
    ///
    /// # Errors
    /// A failed read, no memory.
    pub fn bytes(&self, path: &Path, range: Range<u64>) -> Result<Bytes> {
        let failed = |e| Error::reading(path, &e);
        let size = usize::try_from(range.end - range.start).unwrap_or(usize::MAX);
        match self {
            Self::File(file) => {
                let mut bytes = Vec::new();
                bytes.try_reserve_exact(size).map_err(|e| failed(e.into()))?;
                bytes.resize(size, 0);
                file.read_exact_at(&mut bytes, range.start).map_err(failed)?;
                Ok(bytes.into())
            }
            Self::Memory(bytes) if range.end <= bytes.len() as u64 => {
                Ok(bytes.slice(range.start as usize..range.end as usize))
            }
            Self::Memory(_) => Err(failed(io::ErrorKind::UnexpectedEof.into())),
        }
    }
}

/// Reads a GLB as far as its header says.
///
/// # Errors
/// [`Error::Data`] for anything but a GLB; [`Error::Host`] for one of more than `limit` bytes, before it is read; [`Error::Io`].
pub fn read_glb(reader: &mut dyn Read, limit: u64) -> Result<Bytes> {
    let failed = |e: io::Error| Error::Io(format!("{STANDARD_INPUT}: cannot read: {e}"));
    let mut bytes = Vec::new();
    reader.take(HEADER).read_to_end(&mut bytes).map_err(failed)?;
    if !bytes.starts_with(&MAGIC) {
        return Err(Error::Data(format!(
            "{STANDARD_INPUT}: byte 0: expected the GLB magic `glTF`, found something else; a .gltf is read by its name"
        )));
    }
    let word = bytes.get(8..12).and_then(|word| word.try_into().ok());
    let length = u64::from(word.map_or(0, u32::from_le_bytes));
    if length > limit {
        let (length, limit) = (length.div_ceil(1 << 20), limit >> 20);
        return Err(Error::Host(format!(
            "{STANDARD_INPUT}: a GLB of {length} MiB; the limit of memory is {limit} MiB"
        )));
    }
    reader.take(length.saturating_sub(HEADER)).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes.into())
}
