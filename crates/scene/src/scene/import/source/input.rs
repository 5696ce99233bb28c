//! An open scene file, or a GLB that was read from standard input.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

use bytes::Bytes;

use crate::error::{Error, Result};

/// The name of standard input in messages and statistics.
pub const STANDARD_INPUT: &str = "standard input";

/// Where the bytes of a scene come from.
#[derive(Debug)]
pub enum Input {
    /// A file, of which any part can be read.
    File(File),
    Memory(Bytes),
}

impl Input {
    /// The bytes of a range, which lies within the input.
    /// Errors: A failed read, no memory.
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
