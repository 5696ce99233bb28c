//! The container of the scene: GLB, or plain JSON.

use std::io::{self, Read};
use std::ops::Range;
use std::path::Path;

use bytes::Bytes;
use serde_json::Value;

use super::blob::Blob;
use super::input::{Input, STANDARD_INPUT};
use super::read::{open_regular, refuse_pointer};
use crate::error::{Error, Result};

const MAGIC: [u8; 4] = *b"glTF";
/// Bytes of a GLB's header: magic, version, length.
const HEADER: u64 = 12;
const CHUNK_HEADER: u64 = 8;
/// Limit of chunks, as each needs a read.
const MAX_CHUNKS: u32 = 1 << 16;
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// JSON paths, and what was done there.
pub type Repairs = Vec<(String, &'static str)>;

pub struct Container {
    pub json: Value,
    /// Small faults that were mended: JSON paths and what was done.
    pub repairs: Repairs,
    pub input: Input,
    pub file_bytes: u64,
    /// Byte range of the GLB's binary chunk.
    pub bin: Option<Range<u64>>,
}

/// Reads a GLB as far as its header says.
/// Errors: [`Error::Data`] for anything but a GLB; [`Error::Host`] for one of more than `limit` bytes, before it is read;
/// [`Error::Io`].
pub fn read_glb(reader: &mut dyn Read, limit: u64) -> Result<Bytes> {
    let failed = |e: io::Error| Error::Io(format!("{STANDARD_INPUT}: cannot read: {e}"));
    let mut bytes = Vec::new();
    reader.take(HEADER).read_to_end(&mut bytes).map_err(failed)?;
    if !bytes.starts_with(&MAGIC) {
        return Err(Error::Data(format!(
            "{STANDARD_INPUT}: byte 0: expected the GLB magic `glTF`, found something else; a .gltf is read by its name"
        )));
    }
    let length = u64::from(word(&bytes, 8).unwrap_or(0));
    if length > limit {
        let (length, limit) = (length.div_ceil(1 << 20), limit >> 20);
        return Err(Error::Host(format!(
            "{STANDARD_INPUT}: a GLB of {length} MiB; the limit of memory is {limit} MiB"
        )));
    }
    reader.take(length.saturating_sub(HEADER)).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes.into())
}

/// Opens a `.gltf` or `.glb`.
pub fn open(path: &Path) -> Result<Container> {
    const MAX_FILE_BYTES: u64 = 64 << 30;
    let (file, file_bytes) = open_regular(path, MAX_FILE_BYTES)?;
    read(path, Input::File(file), file_bytes)
}

/// Reads the document of a `.gltf` or `.glb`, distinguished by their first bytes.
pub fn read(path: &Path, input: Input, file_bytes: u64) -> Result<Container> {
    let in_file = |text: String| Error::Data(format!("{}: {text}", path.display()));
    let head = input.bytes(path, 0..file_bytes.min(HEADER))?;
    if head.starts_with(b"vers") {
        refuse_pointer(path, &Blob::read(path, &input, 0..file_bytes.min(1023), None)?.all())?;
    }
    let is_glb = head.starts_with(&MAGIC);
    if !is_glb && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
        return Err(in_file("byte 0: expected the GLB magic `glTF`, found something else; is this a GLB file?".into()));
    }
    let (json, bin) = match is_glb {
        true => split(path, &input, &head, file_bytes)?,
        false => (0..file_bytes, None),
    };
    let json = Blob::read(path, &input, json, None)?.all();
    // RFC 8259, 8.1: writers must not add one, readers may skip it.
    let mut repairs = Repairs::new();
    let json = json.strip_prefix(b"\xEF\xBB\xBF").map_or(&json[..], |rest| {
        repairs.push(("the document".into(), "a byte-order mark before the JSON is skipped"));
        rest
    });
    // The parser's own recursion limit keeps deep nesting from overflowing the stack.
    let mut parser = serde_json::Deserializer::from_slice(json);
    let mut document =
        serde_path_to_error::deserialize(&mut parser).map_err(|error| in_file(not_json(json, &error)))?;
    parser.end().map_err(|error| in_file(format!("not valid JSON: {error}")))?;
    repair(&mut document, &mut repairs);
    Ok(Container { json: document, repairs, input, file_bytes, bin })
}

/// Mends members, except in `extras`: those that are null are removed, and limits that no 32-bit float holds become its largest.
/// Adds the first place of each to `found`.
fn repair(value: &mut Value, found: &mut Repairs) {
    let mut visit = |place: &dyn Fn() -> String, member: &mut Value, is_limit: bool| {
        let before = found.len();
        let text = match member {
            Value::Null => "null is read as no such member",
            limit if is_limit && limit.as_f64().is_some_and(|x| x > f64::from(f32::MAX)) => {
                *limit = f32::MAX.into();
                "a number that no 32-bit float holds is read as no limit"
            }
            other => {
                repair(other, found);
                ""
            }
        };
        let is_new = !text.is_empty() && found.iter().all(|(_, known)| *known != text);
        found.extend(is_new.then(|| (String::new(), text)));
        found[before..].iter_mut().for_each(|(at, _)| at.insert_str(0, &place()));
    };
    match value {
        Value::Array(items) => {
            let items = items.iter_mut().enumerate().filter(|(_, item)| !item.is_null());
            items.for_each(|(i, item)| visit(&|| format!("[{i}]"), item, false));
        }
        Value::Object(members) => members.retain(|key, member| {
            let is_limit = ["range", "attenuationDistance", "zfar"].contains(&key.as_str());
            (key != "extras").then(|| visit(&|| format!(".{key}"), member, is_limit));
            !member.is_null()
        }),
        _ => {}
    }
}

/// What is wrong in `json`, and where. Python's and Unreal's exporters write numbers that JSON does not have.
fn not_json(json: &[u8], error: &serde_path_to_error::Error<serde_json::Error>) -> String {
    let (path, error) = (error.path().to_string(), error.inner());
    let line = json.split(|b| *b == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
    let (before, after) = line.split_at(error.column().saturating_sub(1).min(line.len()));
    let is_word = |b: &u8| b.is_ascii_alphabetic();
    let start = before.iter().rposition(|b| !is_word(b)).map_or(0, |i| i + 1);
    let end = after.iter().position(|b| !is_word(b)).unwrap_or(after.len());
    let word = String::from_utf8_lossy(&[&before[start..], &after[..end]].concat()).into_owned();
    match ["nan", "inf", "infinity", "ind"].contains(&&*word.to_lowercase()) {
        true => format!(
            "not valid JSON: {path}: {word}, which JSON has no number for (line {}); write a finite one",
            error.line()
        ),
        false => format!("not valid JSON: {path}: {error}"),
    }
}

/// The 32-bit number at an offset; `None` beyond the end.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes)
}

/// Byte ranges of a GLB's JSON and BIN chunks, by its header and the size of its file.
fn split(path: &Path, input: &Input, head: &[u8], file_bytes: u64) -> Result<(Range<u64>, Option<Range<u64>>)> {
    let bad = |text: String| Error::Data(format!("{}: GLB container: {text}", path.display()));
    let (Some(version), Some(length)) = (word(head, 4), word(head, 8).map(u64::from)) else {
        return Err(bad(format!("byte {file_bytes}: the file ends inside the {HEADER}-byte header")));
    };
    if version != 2 {
        return Err(bad(format!("byte 4: expected version 2, found {version}; convert the file to glTF 2.0")));
    }
    if length > file_bytes || length < HEADER {
        let text = format!("byte 8: the header says {length} bytes, the file has {file_bytes}; is it truncated?");
        return Err(bad(text));
    }
    let (mut json, mut bin) = (None, None);
    let (mut at, mut index) = (HEADER, 0);
    while at < length {
        let head = input.bytes(path, at..length.min(at + CHUNK_HEADER))?;
        let (Some(size), Some(kind)) = (word(&head, 0).map(u64::from), word(&head, 4)) else {
            return Err(bad(format!("byte {at}: the file ends inside a chunk header")));
        };
        let start = at + CHUNK_HEADER;
        let end = start + size;
        if end > length {
            return Err(bad(format!("byte {at}: a chunk of {size} bytes, but only {} are left", length - start)));
        }
        match (index, kind) {
            (0, JSON_CHUNK) if size > 0 => json = Some(start..end),
            (0, JSON_CHUNK) => return Err(bad(format!("byte {at}: the JSON chunk is empty"))),
            (0, _) => return Err(bad(format!("byte {at}: expected the JSON chunk first, found type {kind:#010x}"))),
            (1, BIN_CHUNK) => bin = Some(start..end),
            (_, JSON_CHUNK) => return Err(bad(format!("byte {at}: a second JSON chunk"))),
            (_, BIN_CHUNK) => return Err(bad(format!("byte {at}: a BIN chunk that is not the second chunk"))),
            (MAX_CHUNKS, _) => return Err(bad(format!("byte {at}: more than {MAX_CHUNKS} chunks"))),
            // Later chunks of other kinds are for extensions and are skipped, as the specification asks.
            _ => {}
        }
        at = end;
        index += 1;
    }
    let json = json.ok_or_else(|| bad(format!("byte {HEADER}: no JSON chunk")))?;
    Ok((json, bin))
}
