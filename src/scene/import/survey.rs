//! A look at a scene's files before they are loaded: what they hash to, and what memory loading them will take.

use std::io::Cursor;
use std::path::Path;

use image::ImageReader;
use serde_json::Value;

use super::container::read_regular;
use super::uri::{self, Resource};
use super::{container, environment};
use crate::error::Result;

/// What a scene's files say of themselves.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// BLAKE3 of the scene file and the files that it names, hexadecimal.
    pub hash: String,
    /// Bytes of these files.
    pub file_bytes: u64,
    /// Triangles in memory, at most.
    pub triangles: u64,
    /// Bytes of vertices and indices in memory, at most.
    pub geometry_bytes: u64,
    /// Bytes of decoded pictures, at most.
    pub image_bytes: u64,
}

/// Reads, hashes and measures a scene's files, and decodes none. What is wrong with them is left for the import to say.
///
/// # Errors
/// The scene file missing, forbidden, not regular or not glTF, as [`import`](super::import()) says it.
pub fn survey(path: &Path) -> Result<Survey> {
    let container = container::read(path)?;
    let json = &container.json;
    let mut hasher = blake3::Hasher::new();
    // Numbers and strings of the document as they are written, whatever the white space.
    hasher.update(json.to_string().as_bytes());
    let mut survey = Survey { file_bytes: container.file_bytes, ..Default::default() };
    let folder = uri::folder_of(path)?;
    let mut read = |item: &Value| {
        let resource = item["uri"].as_str().and_then(|uri| uri::resolve(uri, &folder, "").ok())?;
        let bytes = match resource {
            Resource::File(path, size) => {
                survey.file_bytes += size;
                read_regular(&path, u64::MAX).ok()?
            }
            Resource::Data { bytes, .. } => bytes,
        };
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update_rayon(&bytes);
        Some(bytes)
    };
    let bin = container.bin;
    let buffers: Vec<Option<Vec<u8>>> = items(json, "buffers").map(&mut read).collect();
    let mut image_bytes = 0;
    for image in items(json, "images") {
        let own = read(image);
        let view = &json["bufferViews"][number(&image["bufferView"])];
        let buffer = number(&view["buffer"]);
        let shared = buffers.get(buffer).and_then(Option::as_ref).or(if buffer == 0 { bin.as_ref() } else { None });
        let start = number(&view["byteOffset"]);
        let shared =
            shared.and_then(|b| b.get(start..start.saturating_add(number(&view["byteLength"])))).unwrap_or_default();
        let bytes = own.as_deref().unwrap_or(if image["bufferView"].is_u64() { shared } else { &[] });
        image_bytes += decoded_bytes(bytes);
    }
    if let Some(bin) = &bin {
        hasher.update_rayon(bin);
    }
    survey.image_bytes = image_bytes;
    survey.hash = hasher.finalize().to_hex().to_string();
    let accessor = |index: &Value| {
        let count = index.as_u64().map(|i| json["accessors"][i as usize]["count"].as_u64().unwrap_or(0));
        count.filter(|&n| n < 1 << 40)
    };
    for primitive in items(json, "meshes").flat_map(|mesh| items(mesh, "primitives")) {
        let attributes = &primitive["attributes"];
        let vertices = accessor(&attributes["POSITION"]).unwrap_or(0);
        let corners = accessor(&primitive["indices"]).unwrap_or(vertices);
        let triangles = match primitive["mode"].as_u64() {
            None | Some(4) => corners / 3,
            Some(5 | 6) => corners.saturating_sub(2),
            _ => continue,
        };
        let sizes = [("POSITION", 12), ("NORMAL", 12), ("TEXCOORD_0", 8), ("TEXCOORD_1", 8), ("COLOR_0", 16)];
        let a_vertex: u64 = sizes.iter().filter(|(name, _)| attributes[*name].is_u64()).map(|(_, bytes)| bytes).sum();
        survey.triangles += triangles;
        survey.geometry_bytes += vertices * a_vertex + 12 * triangles;
    }
    Ok(survey)
}

/// BLAKE3 of an environment's file, hexadecimal, and the bytes that it takes in memory.
///
/// # Errors
/// The file missing, forbidden or not regular.
pub fn survey_environment(path: &Path) -> Result<(String, u64)> {
    let bytes = read_regular(path, environment::LARGEST_FILE)?;
    // Radiance or OpenEXR: half a byte a channel at the least, were it well packed; the import says what is wrong.
    let pixels = match ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map(ImageReader::into_dimensions) {
        Ok(Ok((width, height))) => u64::from(width) * u64::from(height),
        _ => bytes.len() as u64 / 4,
    };
    Ok((blake3::hash(&bytes).to_hex().to_string(), pixels * ENVIRONMENT_PIXEL))
}

/// Three floats, and the tables that it is sampled with.
const ENVIRONMENT_PIXEL: u64 = 12 + 24;

fn decoded_bytes(bytes: &[u8]) -> u64 {
    match ImageReader::new(Cursor::new(bytes)).with_guessed_format().map(ImageReader::into_dimensions) {
        Ok(Ok((width, height))) => 4 * u64::from(width) * u64::from(height),
        _ => 0,
    }
}

fn items<'a>(json: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    json[key].as_array().into_iter().flatten()
}

/// An index or size; 0, their default, when it is not there.
fn number(json: &Value) -> usize {
    json.as_u64().map_or(0, |n| n as usize)
}
