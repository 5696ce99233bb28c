//! What a scene's files hash to, and what memory loading them will take.

use std::io::Cursor;
use std::path::PathBuf;

use image::ImageReader;
use serde_json::Value;

use super::Source;

/// What a scene's files say of themselves.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// BLAKE3 of the scene file and the files that it names, hexadecimal.
    pub hash: String,
    /// The files, the scene file first.
    pub files: Vec<PathBuf>,
    /// Bytes of these files.
    pub file_bytes: u64,
    /// Triangles in memory, at most.
    pub triangles: u64,
    /// Bytes of vertices and indices in memory, at most.
    pub geometry_bytes: u64,
    /// Bytes of decoded pictures, at most.
    pub image_bytes: u64,
}

impl Source {
    /// Hashes and measures the files, and decodes none. What is wrong with them is left for the import to say.
    pub fn survey(&self) -> Survey {
        let mut survey =
            Survey { hash: self.hash(), files: self.files.clone(), file_bytes: self.file_bytes, ..Default::default() };
        survey.image_bytes = (0..self.images.len()).map(|i| decoded_bytes(self.image_bytes(i))).sum();
        self.measure_meshes(&mut survey);
        survey
    }

    fn hash(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        // Numbers and strings of the document as they are written, whatever the white space.
        hasher.update(self.json.to_string().as_bytes());
        for data in self.buffers.iter().chain(&self.images).flatten().flatten() {
            hasher.update(&(data.bytes.len() as u64).to_le_bytes());
            hasher.update_rayon(&data.bytes);
        }
        if let Some(bin) = &self.bin {
            hasher.update_rayon(bin);
        }
        hasher.finalize().to_hex().to_string()
    }

    /// A picture as it is stored; nothing if there is none.
    fn image_bytes(&self, index: usize) -> &[u8] {
        if let Some(Some(Ok(data))) = self.images.get(index) {
            return &data.bytes;
        }
        let view = &self.json["images"][index]["bufferView"];
        if !view.is_u64() {
            return &[];
        }
        let view = &self.json["bufferViews"][number(view)];
        let buffer = number(&view["buffer"]);
        let named = self.buffers.get(buffer).and_then(|named| named.as_ref()?.as_ref().ok());
        let Some(bytes) = named.map(|data| &data.bytes).or(self.bin.as_ref().filter(|_| buffer == 0)) else {
            return &[];
        };
        let start = number(&view["byteOffset"]);
        bytes.get(start..start.saturating_add(number(&view["byteLength"]))).unwrap_or_default()
    }

    fn measure_meshes(&self, survey: &mut Survey) {
        let json = &self.json;
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
            let a_vertex: u64 =
                sizes.iter().filter(|(name, _)| attributes[*name].is_u64()).map(|(_, bytes)| bytes).sum();
            survey.triangles += triangles;
            survey.geometry_bytes += vertices * a_vertex + 12 * triangles;
        }
    }
}

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
