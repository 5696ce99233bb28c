//! Buffer views under EXT_meshopt_compression and KHR_meshopt_compression.

use meshoptimizer_rs::codec::{self, Mode};
use meshoptimizer_rs::{Error, Limits, Workspace};

use super::{damaged, guarded};
use crate::error::Result;
use crate::scene::import::document::meshopt::Meshopt;

/// Memory that a decoder may use in addition to its result.
const MAX_SCRATCH_BYTES: usize = 1 << 20;

/// The view's decoded bytes: `count` elements of `stride` bytes.
/// Errors: A damaged stream.
pub fn decode(view: &Meshopt, stream: &[u8]) -> Result<Vec<u8>> {
    let (count, stride) = (view.count as usize, view.stride as usize);
    guarded(|| {
        let limits =
            Limits { max_bytes: count.saturating_mul(stride).saturating_add(MAX_SCRATCH_BYTES), ..Limits::default() };
        let mut workspace = Workspace::new(limits);
        if view.mode != Mode::Attributes && view.filter.is_some() {
            return Err(Error::InvalidParameter);
        }
        let mut bytes = match view.mode {
            Mode::Attributes => codec::decode_vertex_buffer(count, stride, stream, &mut workspace),
            Mode::Triangles => codec::decode_index_buffer(count, stride, stream, &mut workspace),
            Mode::Indices => codec::decode_index_sequence(count, stride, stream, &mut workspace),
        }?;
        if let Some(invert_filter) = view.filter {
            invert_filter(&mut bytes, count, stride, &mut workspace)?;
        }
        Ok(bytes)
    })
    .map_err(|why| damaged(&view.at, "meshopt stream", &why))
}
