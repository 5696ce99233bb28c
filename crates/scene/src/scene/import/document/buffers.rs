//! Buffers: the data of accessors and pictures.

use bytes::Bytes;

use super::json::Json;
use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;
use crate::scene::import::source::{Blob, Source};

pub struct Buffer {
    /// `None` without `uri` and GLB chunk, which the specification allows.
    data: Option<Blob>,
    /// Declared length in bytes; the data is at least as long.
    pub length: u64,
    at: String,
}

impl Buffer {
    pub fn parse(json: &Json, index: usize, source: &Source) -> Result<Self> {
        let length = json.need("byteLength", json.integer("byteLength")?)?;
        if length == 0 {
            return Err(json.bad("byteLength", "at least 1", 0));
        }
        let data = match json.string("uri")? {
            Some(_) => source.buffer(index)?.map(|data| data.bytes),
            None => source.bin.clone().filter(|_| index == 0),
        };
        if let Some(available) = data.as_ref().map(|data| data.length).filter(|&n| n < length) {
            return Err(json.bad("byteLength", format!("at most the {available} bytes that the data has"), length));
        }
        Ok(Self { data, length, at: json.at.clone() })
    }

    pub(crate) fn has_data(&self) -> bool {
        self.data.is_some()
    }

    /// The `length` bytes from `offset` on.
    /// Errors: When the range is not in the buffer, or the buffer has no data.
    pub fn bytes(&self, offset: u64, length: u64) -> Result<Bytes> {
        let Some(data) = &self.data else {
            return Err(Error::Data(format!(
                "{}: has no `uri`, so there is no data to read; the file is incomplete: export it again",
                self.at
            )));
        };
        let range = offset.checked_add(length).filter(|&end| end <= self.length).map(|end| offset..end);
        range.and_then(|range| data.get(range)).ok_or_else(|| {
            bad(&self.at, format!("{length} bytes from byte {offset}"), format!("{} bytes in all", self.length))
        })
    }
}
