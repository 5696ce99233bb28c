//! Pictures and textures for the scene. Every picture's header is checked; only those that a material samples are
//! decoded.

use std::collections::HashMap;
use std::io::Cursor;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::reader::Budget;
use crate::error::{Error, Result};
use crate::scene::import::complaint::bad;
use crate::scene::import::document::Document;
use crate::scene::import::document::images::{Image, ImageData, Sampler};
use crate::scene::import::document::materials::TextureInfo;
use crate::scene::import::report::Notes;
use crate::scene::{self, Filter, Texels, TextureRef, TextureSlot, Wrap};

/// Texels a side and in all. Larger pictures are refused before anything is decoded.
const LARGEST_SIDE: u32 = 1 << 15;
const LARGEST_TEXELS: u64 = 1 << 28;

/// A picture as it is stored; nothing if it has no data.
fn stored<'a>(image: &'a Image, document: &'a Document) -> Result<&'a [u8]> {
    match &image.data {
        ImageData::Nothing => Ok(&[]),
        ImageData::Bytes(bytes) => Ok(bytes),
        ImageData::View(index) => {
            let view = &document.views[*index];
            document.buffers[view.buffer].bytes(view.offset, view.length)
        }
    }
}

fn decode(image: &Image, document: &Document, format: ImageFormat) -> Result<scene::Image> {
    let mut reader = ImageReader::with_format(Cursor::new(stored(image, document)?), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    limits.max_alloc = Some(LARGEST_TEXELS * 16);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| damaged(&image.at, &e))?;
    let (width, height) = (picture.width(), picture.height());
    Ok(scene::Image { name: image.name.clone(), width, height, texels: texels(picture) })
}

/// What a picture's header says.
#[derive(Debug, Clone, Copy)]
pub enum Probe {
    /// Can be decoded; width, height and bytes a texel once decoded.
    Readable(ImageFormat, u32, u32, u64),
    /// Cannot be decoded; why.
    Unreadable(&'static str),
}

fn damaged(at: &str, error: &image::ImageError) -> Error {
    // Some decoders end their text with a line feed.
    let error = error.to_string();
    Error::Data(format!("{at}: the picture is damaged: {}; export or save it again", error.trim_end()))
}

/// Reads the header.
///
/// # Errors
/// A PNG or JPEG whose header is damaged. Other formats are not errors here.
fn probe(image: &Image, document: &Document) -> Result<Probe> {
    if matches!(image.data, ImageData::Nothing) {
        return Ok(Probe::Unreadable("an image without data"));
    }
    let (bytes, at) = (stored(image, document)?, &image.at);
    let format = match bytes {
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [0xFF, 0xD8, 0xFF, ..] => ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => {
            return Ok(Probe::Unreadable("WebP pictures are not read: use PNG or JPEG"));
        }
        [0xAB, b'K', b'T', b'X', ..] => return Ok(Probe::Unreadable("KTX2 pictures are not read: use PNG or JPEG")),
        [b'D', b'D', b'S', b' ', ..] => return Ok(Probe::Unreadable("DDS pictures are not read: use PNG or JPEG")),
        _ => return Ok(Probe::Unreadable("the picture is neither PNG nor JPEG")),
    };
    let decoder = ImageReader::with_format(Cursor::new(bytes), format).into_decoder().map_err(|e| damaged(at, &e))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(bad(at, "a picture of at least 1x1", format!("{width}x{height}")));
    }
    let bytes = match decoder.color_type() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => 8,
        _ => 4,
    };
    Ok(Probe::Readable(format, width, height, bytes))
}

fn texels(picture: DynamicImage) -> Texels {
    match picture.color() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let raw = picture.into_rgba16().into_raw();
            Texels::Rgba16(raw.as_chunks::<4>().0.to_vec())
        }
        ColorType::La8 | ColorType::Rgba8 => {
            let raw = picture.into_rgba8().into_raw();
            let texels = raw.as_chunks::<4>().0;
            // Opaque pictures need no alpha, and then no filter at their surfaces either.
            if texels.iter().all(|t| t[3] == 255) {
                Texels::Rgb8(texels.iter().map(|t| [t[0], t[1], t[2]]).collect())
            } else {
                Texels::Rgba8(texels.to_vec())
            }
        }
        _ => Texels::Rgb8(picture.into_rgb8().into_raw().as_chunks::<3>().0.to_vec()),
    }
}

/// The scene's textures and pictures, registered as materials ask for them.
pub struct TextureTable {
    pub textures: Vec<scene::Texture>,
    probes: Vec<Probe>,
    /// Document's image of each of the scene's.
    images: Vec<usize>,
    by_image: HashMap<usize, u32>,
    by_use: HashMap<(usize, Wrap, Wrap, Filter), u32>,
}

impl TextureTable {
    /// Checks the header of every picture of the document.
    ///
    /// # Errors
    /// Damaged headers.
    pub fn new(document: &Document, budget: &mut Budget) -> Result<Self> {
        let mut probes = Vec::with_capacity(document.images.len());
        for image in &document.images {
            // Some decoders read all for the header, and many images may share one picture.
            budget.take(&image.at, image.length, 1)?;
            probes.push(probe(image, document)?);
        }
        Ok(Self { textures: Vec::new(), probes, images: Vec::new(), by_image: HashMap::new(), by_use: HashMap::new() })
    }

    /// The scene's reference for a document's; `None` with a note when there is nothing to sample.
    pub fn register(
        &mut self,
        document: &Document,
        info: &TextureInfo,
        slot: TextureSlot,
        notes: &mut Notes,
    ) -> Option<TextureRef> {
        let texture = &document.textures[info.texture];
        let Some(source) = texture.source else {
            let text = match texture.alternatives.first() {
                Some(name) => format!("a texture only in {name}, which is not read: the factor alone is used"),
                None => "a texture without a picture: the factor alone is used".into(),
            };
            notes.ignored(&info.at, text);
            return None;
        };
        if let Probe::Unreadable(why) = self.probes[source] {
            notes.ignored(&document.images[source].at, format!("{why}; the factor alone is used"));
            return None;
        }
        let Some(set) = u8::try_from(info.set).ok().filter(|set| *set < 2) else {
            let text = "a texture on TEXCOORD_2 or higher, of which only 0 and 1 are read: the factor alone is used";
            notes.ignored(&info.at, text);
            return None;
        };
        if !texture.alternatives.is_empty() {
            notes.not_loaded(&texture.at, "an alternative picture of an extension: the core one is used");
        }
        let default = Sampler { wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, filter: Filter::Linear };
        let sampler = texture.sampler.map_or(default, |index| document.samplers[index]);
        let key = (source, sampler.wrap_s, sampler.wrap_t, sampler.filter);
        let index = *self.by_use.entry(key).or_insert_with(|| {
            let image = *self.by_image.entry(source).or_insert_with(|| {
                self.images.push(source);
                (self.images.len() - 1) as u32
            });
            let Sampler { wrap_s, wrap_t, filter } = sampler;
            self.textures.push(scene::Texture { image, wrap_s, wrap_t, filter });
            (self.textures.len() - 1) as u32
        });
        Some(TextureRef { texture: index, set, transform: info.transform, encoding: slot.encoding() })
    }

    /// Decodes the pictures that are sampled, in parallel.
    ///
    /// # Errors
    /// The first damaged or too large picture, by the document's order.
    pub fn decode(&self, document: &Document, file_bytes: u64) -> Result<Vec<scene::Image>> {
        // Flat colours compress a thousandfold; a floor lets ordinary ones pass.
        const BASE: u64 = 1 << 30;
        const FACTOR: u64 = 256;
        let mut budget = Budget::new(BASE, FACTOR, file_bytes);
        let mut jobs = Vec::new();
        for &index in &self.images {
            let image = &document.images[index];
            let Probe::Readable(format, width, height, bytes) = self.probes[index] else { continue };
            let count = u64::from(width) * u64::from(height);
            if width.max(height) > LARGEST_SIDE || count > LARGEST_TEXELS {
                return Err(Error::Data(format!(
                    "{}: the picture has {width}x{height} texels; at most {LARGEST_SIDE} a side and {LARGEST_TEXELS} in \
                     all can be used: scale it down",
                    image.at
                )));
            }
            budget.take(&image.at, count, bytes)?;
            jobs.push((image, format));
        }
        let decoded: Vec<_> = jobs.par_iter().map(|(image, format)| decode(image, document, *format)).collect();
        decoded.into_iter().collect()
    }

    /// Notes the pictures that nothing samples.
    pub fn note_unused(&self, document: &Document, notes: &mut Notes) {
        for (index, image) in document.images.iter().enumerate() {
            if !self.by_image.contains_key(&index) {
                notes.not_loaded(&image.at, "a picture that no visible material samples");
            }
        }
    }
}
