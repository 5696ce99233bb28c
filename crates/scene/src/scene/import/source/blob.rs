//! Bytes of a file, of which only the needed ranges are read.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;

use super::input::Input;
use crate::error::Result;

/// Smallest number of unneeded bytes that are worth skipping.
const MIN_SKIPPED_BYTES: u64 = 1 << 20;

/// Bytes of a file or a data URI, whole or in parts.
#[derive(Debug, Clone, Default)]
pub struct Blob {
    pub length: u64,
    /// Parts that were read, each with its offset, in order.
    parts: Arc<[(u64, Bytes)]>,
}

impl Blob {
    /// A blob of which all bytes are present.
    pub fn whole(bytes: Bytes) -> Self {
        Self { length: bytes.len() as u64, parts: Arc::new([(0, bytes)]) }
    }

    /// Reads the `wanted` ranges, relative to the start of `within`; all of `within` if little can be skipped.
    ///
    /// # Errors
    /// A failed read, no memory.
    pub fn read(path: &Path, input: &Input, within: Range<u64>, mut wanted: Option<Vec<Range<u64>>>) -> Result<Self> {
        let length = within.end - within.start;
        wanted.iter_mut().for_each(|wanted| wanted.sort_unstable_by_key(|range| range.start));
        let mut merged: Vec<Range<u64>> = Vec::new();
        for range in wanted.iter().flatten() {
            let range = range.start.min(length)..range.end.min(length);
            match merged.last_mut() {
                Some(last) if range.start <= last.end.saturating_add(MIN_SKIPPED_BYTES) => {
                    last.end = last.end.max(range.end)
                }
                _ => merged.push(range),
            }
        }
        let left_out = length - merged.iter().map(|range| range.end - range.start).sum::<u64>();
        if wanted.is_none() || left_out <= MIN_SKIPPED_BYTES {
            merged.clear();
            merged.push(0..length);
        }
        let part = |range: Range<u64>| {
            let start = within.start + range.start;
            let bytes = input.bytes(path, start..within.start + range.end)?;
            tracing::debug!("{}: {} bytes from {start}", path.display(), bytes.len());
            Ok((range.start, bytes))
        };
        Ok(Self { length, parts: merged.into_iter().map(part).collect::<Result<_>>()? })
    }

    /// The bytes of a blob that was read completely.
    pub fn all(&self) -> Bytes {
        self.parts.first().map(|(_, bytes)| bytes.clone()).unwrap_or_default()
    }

    /// The bytes of a range; `None` if some were not read or lie beyond the end.
    pub fn get(&self, range: Range<u64>) -> Option<Bytes> {
        let (start, part) =
            &self.parts[self.parts.partition_point(|(start, _)| *start <= range.start).checked_sub(1)?];
        let within = (range.start - start) as usize..range.end.checked_sub(*start)? as usize;
        (within.start <= within.end && within.end <= part.len()).then(|| part.slice(within))
    }

    pub fn read_bytes(&self) -> u64 {
        self.parts.iter().map(|(_, part)| part.len() as u64).sum()
    }

    /// Hashes the parts that were read, with their offsets unless at the start.
    pub fn hash(&self, hasher: &mut blake3::Hasher) {
        for (start, part) in &*self.parts {
            if *start > 0 {
                hasher.update(&start.to_le_bytes());
            }
            hasher.update_rayon(part);
        }
    }
}
