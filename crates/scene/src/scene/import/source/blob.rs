//! A file's bytes, as far as they are needed.

use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;

use crate::error::{Error, Result};

/// Bytes that nothing shown needs are not worth a second thought below this; nor are gaps.
const SMALL: u64 = 1 << 20;

/// Bytes of a file or a URI, whole or in parts.
#[derive(Debug, Clone, Default)]
pub struct Blob {
    /// Bytes in all.
    pub length: u64,
    /// Where each part starts, in order.
    parts: Arc<[(u64, Bytes)]>,
}

impl Blob {
    /// All of it.
    pub fn whole(bytes: Bytes) -> Self {
        Self { length: bytes.len() as u64, parts: Arc::new([(0, bytes)]) }
    }

    /// Reads the wanted ranges of `within`, which are relative to its start; all of it where little can be left out.
    ///
    /// # Errors
    /// A failed read, no memory.
    pub fn read(path: &Path, file: &File, within: Range<u64>, mut wanted: Option<Vec<Range<u64>>>) -> Result<Self> {
        let length = within.end - within.start;
        wanted.iter_mut().for_each(|wanted| wanted.sort_unstable_by_key(|range| range.start));
        let mut merged: Vec<Range<u64>> = Vec::new();
        for range in wanted.iter().flatten() {
            let range = range.start.min(length)..range.end.min(length);
            match merged.last_mut() {
                Some(last) if range.start <= last.end.saturating_add(SMALL) => last.end = last.end.max(range.end),
                _ => merged.push(range),
            }
        }
        let left_out = length - merged.iter().map(|range| range.end - range.start).sum::<u64>();
        if wanted.is_none() || left_out <= SMALL {
            merged.clear();
            merged.push(0..length);
        }
        let part = |range: Range<u64>| {
            let mut bytes = Vec::new();
            let size = usize::try_from(range.end - range.start).unwrap_or(usize::MAX);
            bytes.try_reserve_exact(size).map_err(|e| Error::reading(path, &e.into()))?;
            bytes.resize(size, 0);
            let start = within.start + range.start;
            file.read_exact_at(&mut bytes, start).map_err(|e| Error::reading(path, &e))?;
            tracing::debug!("{}: {size} bytes from {start}", path.display());
            Ok((range.start, Bytes::from(bytes)))
        };
        Ok(Self { length, parts: merged.into_iter().map(part).collect::<Result<_>>()? })
    }

    /// Of a whole blob.
    pub fn all(&self) -> Bytes {
        self.parts.first().map(|(_, bytes)| bytes.clone()).unwrap_or_default()
    }

    /// Some of it; `None` for what was not read or is beyond its end.
    pub fn get(&self, range: Range<u64>) -> Option<Bytes> {
        let (start, part) =
            &self.parts[self.parts.partition_point(|(start, _)| *start <= range.start).checked_sub(1)?];
        let within = (range.start - start) as usize..range.end.checked_sub(*start)? as usize;
        (within.start <= within.end && within.end <= part.len()).then(|| part.slice(within))
    }

    /// Bytes in memory.
    pub fn read_bytes(&self) -> u64 {
        self.parts.iter().map(|(_, part)| part.len() as u64).sum()
    }

    /// Feeds what was read, and where it is unless it is all there is.
    pub fn hash(&self, hasher: &mut blake3::Hasher) {
        for (start, part) in &*self.parts {
            if *start > 0 {
                hasher.update(&start.to_le_bytes());
            }
            hasher.update_rayon(part);
        }
    }
}
