//! The file around the scene: GLB container or plain JSON.

use std::ops::Range;
use std::path::Path;

use bytes::Bytes;
use serde_json::Value;

use super::read_regular;
use crate::error::{Error, Result};

const MAGIC: &[u8] = b"glTF";
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// A scene file's parts.
pub struct Container {
    pub json: Value,
    /// Does the JSON start with a byte-order mark?
    pub byte_order_mark: bool,
    /// The GLB's binary chunk.
    pub bin: Option<Bytes>,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// Reads `.gltf` or `.glb`, told apart by their first bytes.
pub fn read(path: &Path) -> Result<Container> {
    const LARGEST: u64 = 64 << 30;
    let bytes = Bytes::from(read_regular(path, LARGEST)?);
    let in_file = |text: String| Error::Data(format!("{}: {text}", path.display()));
    let file_bytes = bytes.len() as u64;
    let is_glb = bytes.starts_with(MAGIC);
    if !is_glb && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
        return Err(in_file("byte 0: wanted the GLB magic `glTF`, found something else; is this a GLB file?".into()));
    }
    let (json, bin) = if is_glb {
        let chunks = split(&bytes).map_err(|text| in_file(format!("GLB container: {text}")))?;
        (bytes.slice(chunks.json), chunks.bin.map(|range| bytes.slice(range)))
    } else {
        (bytes, None)
    };
    // RFC 8259, 8.1: writers must not add one, readers may skip it.
    let (json, byte_order_mark) = match json.strip_prefix(b"\xEF\xBB\xBF") {
        Some(rest) => (rest, true),
        None => (&json[..], false),
    };
    // The parser's own recursion limit keeps deep nesting from overflowing the stack.
    let json = serde_json::from_slice(json).map_err(|error| in_file(format!("not valid JSON: {error}")))?;
    Ok(Container { json, byte_order_mark, bin, file_bytes })
}

struct Chunks {
    json: Range<usize>,
    bin: Option<Range<usize>>,
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

fn split(bytes: &[u8]) -> std::result::Result<Chunks, String> {
    let truncated = || format!("byte {}: the file ends inside the {HEADER}-byte header", bytes.len());
    let version = word(bytes, 4).ok_or_else(truncated)?;
    let length = word(bytes, 8).ok_or_else(truncated)? as usize;
    if version != 2 {
        return Err(format!("byte 4: wanted version 2, found {version}; convert the file to glTF 2.0"));
    }
    if length > bytes.len() || length < HEADER {
        return Err(format!("byte 8: the header says {length} bytes, the file has {}; is it truncated?", bytes.len()));
    }
    let bytes = &bytes[..length];
    let (mut json, mut bin) = (None, None);
    let (mut at, mut index) = (HEADER, 0);
    while at < length {
        let cut = || format!("byte {at}: the file ends inside a chunk header");
        let size = word(bytes, at).ok_or_else(cut)? as usize;
        let kind = word(bytes, at + 4).ok_or_else(cut)?;
        let start = at + CHUNK_HEADER;
        let end = start.checked_add(size).filter(|&end| end <= length).ok_or_else(|| {
            format!("byte {at}: a chunk of {size} bytes, but only {} are left", length - start.min(length))
        })?;
        match (index, kind) {
            (0, JSON_CHUNK) if size > 0 => json = Some(start..end),
            (0, JSON_CHUNK) => return Err(format!("byte {at}: the JSON chunk is empty")),
            (0, _) => return Err(format!("byte {at}: wanted the JSON chunk first, found type {kind:#010x}")),
            (1, BIN_CHUNK) => bin = Some(start..end),
            (_, JSON_CHUNK) => return Err(format!("byte {at}: a second JSON chunk")),
            (_, BIN_CHUNK) => return Err(format!("byte {at}: a BIN chunk that is not the second chunk")),
            // Later chunks of other kinds are for extensions and are skipped, as the specification asks.
            _ => {}
        }
        at = end;
        index += 1;
    }
    let json = json.ok_or_else(|| format!("byte {HEADER}: no JSON chunk"))?;
    Ok(Chunks { json, bin })
}
