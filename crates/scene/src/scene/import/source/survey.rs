//! Hash of a scene's files, and an estimate of the memory that loading them takes.

use std::cmp::Reverse;
use std::io::Cursor;
use std::path::PathBuf;

use bytes::Bytes;
use image::{ColorType, ImageDecoder, ImageReader};
use serde_json::Value;

use super::Source;
use super::census::{Census, census, shines};
use super::reach::items;

/// Hash and sizes of a scene's files, without decoding them.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// BLAKE3 of the bytes that were read of the scene file and the files that it refers to; hexadecimal.
    pub hash: String,
    /// Paths of the files, the scene file first; none for what comes from standard input.
    pub files: Vec<PathBuf>,
    /// Could all files be read that a scene of the document can show?
    pub is_whole: bool,
    /// Size of these files in bytes.
    pub file_bytes: u64,
    /// Bytes that were read: all but those that no scene of the document can show.
    pub read_bytes: u64,
    /// Numbers of the scene's elements.
    pub census: Census,
    /// Upper bound of the bytes of decoded pictures.
    pub image_bytes: u64,
    /// Bytes that each takes besides while it is decoded, the largest first.
    pub decoding_bytes: Vec<u64>,
    /// May a light of the document, or an emissive material, shine?
    pub has_lights: bool,
}

impl Source {
    /// Hashes and measures the files without decoding them. Faults are left for the import to report.
    pub fn survey(&self) -> Survey {
        let Self { file_bytes, read_bytes, .. } = *self;
        let (hash, files) = (self.hash(), self.files.clone());
        let pictures = self.images.iter().zip(&self.reach.images).filter(|(_, is_shown)| **is_shown);
        let is_whole =
            !self.buffers.iter().chain(pictures.map(|(data, _)| data)).any(|data| matches!(data, Some(Err(_))));
        let mut survey = Survey { hash, files, is_whole, file_bytes, read_bytes, ..Default::default() };
        let shown = (0..self.reach.images.len()).filter(|&i| self.reach.images[i]);
        for (kept, while_decoding) in shown.map(|i| decoded_bytes(&self.image_bytes(i))) {
            survey.image_bytes = survey.image_bytes.saturating_add(kept).min(MOST_BYTES);
            survey.decoding_bytes.push(while_decoding);
        }
        survey.decoding_bytes.sort_unstable_by_key(|bytes| Reverse(*bytes));
        survey.census = census(&self.json, &self.reach);
        survey.has_lights = has_lights(&self.json);
        survey
    }

    fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        // The document without insignificant white space.
        hasher.update(self.json.to_string().as_bytes());
        for (i, data) in self.buffers.iter().chain(&self.images).enumerate() {
            match data {
                Some(Ok(data)) => {
                    hasher.update(&data.bytes.length.to_le_bytes());
                    data.bytes.hash(&mut hasher);
                }
                // A scene is shown without a picture that could not be read: it is another scene.
                Some(Err(_)) => {
                    hasher.update(format!("unread {i}").as_bytes());
                }
                None => {}
            }
        }
        if let Some(bin) = &self.bin {
            bin.hash(&mut hasher);
        }
        hasher.finalize().to_hex().to_string()
    }

    /// Encoded bytes of a picture; empty if there are none.
    fn image_bytes(&self, index: usize) -> Bytes {
        if let Some(Some(Ok(data))) = self.images.get(index) {
            return data.bytes.all();
        }
        let view = &self.json["images"][index]["bufferView"];
        if !view.is_u64() {
            return Bytes::new();
        }
        let view = &self.json["bufferViews"][number(view)];
        let buffer = number(&view["buffer"]);
        let named = self.buffers.get(buffer).and_then(|named| named.as_ref()?.as_ref().ok());
        let Some(bytes) = named.map(|data| &data.bytes).or(self.bin.as_ref().filter(|_| buffer == 0)) else {
            return Bytes::new();
        };
        let start = number(&view["byteOffset"]) as u64;
        bytes.get(start..start.saturating_add(number(&view["byteLength"]) as u64)).unwrap_or_default()
    }
}

fn has_lights(json: &Value) -> bool {
    items(&json["extensions"]["KHR_lights_punctual"]["lights"]).next().is_some()
        || items(&json["materials"]).any(shines)
        // Animated factors, and lights of other extensions.
        || items(&json["extensionsUsed"]).any(|name| name == "KHR_animation_pointer")
}

/// More than any memory holds; leaves room for sums.
const MOST_BYTES: u64 = 1 << 48;

/// Bytes of a picture in memory, and those that it takes besides while it is decoded; 0 for other data.
fn decoded_bytes(bytes: &[u8]) -> (u64, u64) {
    if let [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', ..] = bytes {
        let side = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
        let texels = u64::from(side(20).unwrap_or(0)) * u64::from(side(24).unwrap_or(0));
        let bytes = texels.saturating_mul(4).min(MOST_BYTES);
        return (bytes, bytes);
    }
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok();
    let Some(decoder) = reader.and_then(|reader| reader.into_decoder().ok()) else { return (0, 0) };
    let (width, height) = decoder.dimensions();
    // What the decoder makes is converted where it is none of the texels that are kept. Opaque alpha is dropped.
    let (kept, besides) = match decoder.color_type() {
        ColorType::Rgb8 => (3, 0),
        ColorType::Rgba8 => (4, 3),
        ColorType::L8 => (3, 1),
        ColorType::La8 => (4, 3),
        ColorType::Rgba16 => (8, 0),
        ColorType::L16 => (8, 2),
        ColorType::La16 => (8, 4),
        ColorType::Rgb16 => (8, 6),
        _ => (4, 4),
    };
    let texels = u64::from(width) * u64::from(height);
    (texels.saturating_mul(kept).min(MOST_BYTES), texels.saturating_mul(besides).min(MOST_BYTES))
}

/// An index or size; 0 (the default) if absent.
fn number(json: &Value) -> usize {
    json.as_u64().map_or(0, |n| n as usize)
}
