//! Buffers: found and measured when the document is checked, read when something needs them.

use std::path::{Path, PathBuf};

use super::container::read_regular;
use super::json::{Json, bad};
use super::uri::{self, Contents, Files, Resource};
use crate::error::{Error, Result};

enum Source {
    Memory(Vec<u8>),
    File(PathBuf, Contents),
    /// No `uri`: legal, but there is nothing to read.
    Nothing,
}

/// One glTF buffer.
pub(super) struct Buffer {
    source: Source,
    /// Bytes that the document may use; the source has at least as many.
    pub length: u64,
    at: String,
}

impl Buffer {
    /// Finds a buffer's data; `bin` is the GLB chunk when this is the buffer that may use it.
    pub fn parse(json: &Json, folder: &Path, files: &mut Files, bin: Option<Vec<u8>>) -> Result<Self> {
        let length = json.need("byteLength", json.integer("byteLength")?)?;
        if length == 0 {
            return Err(json.bad("byteLength", "at least 1", 0));
        }
        let (source, available) = match json.string("uri")? {
            Some(text) => match uri::resolve(text, folder, &json.path("uri"))? {
                Resource::File(path, size) => {
                    let contents = files.add(&path, size);
                    (Source::File(path, contents), Some(size))
                }
                Resource::Data { bytes, .. } => {
                    let size = bytes.len() as u64;
                    (Source::Memory(bytes), Some(size))
                }
            },
            None => match bin {
                Some(bytes) => {
                    let size = bytes.len() as u64;
                    (Source::Memory(bytes), Some(size))
                }
                None => (Source::Nothing, None),
            },
        };
        if let Some(available) = available.filter(|&n| n < length) {
            return Err(json.bad("byteLength", format!("at most the {available} bytes that the data has"), length));
        }
        Ok(Self { source, length, at: json.at.clone() })
    }

    /// `length` bytes from `offset`.
    ///
    /// # Errors
    /// When the range is not in the buffer, the buffer has no data, or its file cannot be read.
    pub fn bytes(&self, offset: u64, length: u64) -> Result<&[u8]> {
        let all = match &self.source {
            Source::Memory(bytes) => bytes,
            Source::File(path, cell) => match cell.get() {
                Some(bytes) => bytes,
                None => {
                    let bytes = read_regular(path, u64::MAX)?;
                    cell.get_or_init(|| bytes)
                }
            },
            Source::Nothing => {
                return Err(Error::Data(format!(
                    "{}: has no `uri`, so there is no data to read; the file is incomplete: export it again",
                    self.at
                )));
            }
        };
        let range =
            offset.checked_add(length).filter(|&end| end <= self.length).map(|end| offset as usize..end as usize);
        range.and_then(|r| all.get(r)).ok_or_else(|| {
            bad(&self.at, format!("{length} bytes from byte {offset}"), format!("{} bytes in all", self.length))
        })
    }
}
