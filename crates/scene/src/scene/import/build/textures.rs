//! Pictures and textures for the scene. Only those that a material samples are looked at; one that cannot be used is left
//! out with a note.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::Cursor;
use std::sync::Arc;
use std::time::Instant;

use bytemuck::{Pod, allocation::try_cast_vec};
use bytes::Bytes;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;
use tracing::debug;

use super::cache::Kept;
use super::decode::basis;
use super::reader::Budget;
use crate::error::{Error, Result};
use crate::scene::import::document::Document;
use crate::scene::import::document::images::{Image, ImageData, Sampler, Texture};
use crate::scene::import::document::materials::TextureInfo;
use crate::scene::import::report::Notes;
use crate::scene::{self, Filter, Scene, Texels, TextureRef, TextureSlot, Wrap};

/// Texels a side and in all. Larger pictures are refused before anything is decoded.
const LARGEST_SIDE: u32 = 1 << 15;
const LARGEST_TEXELS: u64 = 1 << 28;

/// A picture as it is stored; nothing if it has no data.
///
/// # Errors
/// A file that cannot be read, bytes that are not in the buffer.
fn stored(image: &Image, document: &Document) -> Result<Bytes> {
    match &image.data {
        ImageData::Nothing => Ok(Bytes::new()),
        ImageData::Unreadable(error) => Err(error.clone()),
        ImageData::Bytes(bytes) => Ok(bytes.clone()),
        ImageData::View(index) => {
            let view = document.views.get(*index)?;
            document.buffers.get(view.buffer)?.bytes(view.offset, view.length)
        }
    }
}

/// The picture, or what is wrong with it.
fn decode(image: &Image, document: &Document, format: Format) -> Result<std::result::Result<scene::Image, String>> {
    let bytes = stored(image, document)?;
    let Format::Image(format) = format else {
        let Ok((width, height)) = basis::probe(&bytes) else { return Ok(Err("a damaged KTX2 picture".into())) };
        let made = |texels| scene::Image { name: image.name.clone(), width, height, texels: eight_bits(texels) };
        return Ok(basis::decode(&bytes).map(made));
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    limits.max_alloc = Some(LARGEST_TEXELS * 16);
    reader.limits(limits);
    Ok(reader.decode().map_err(|e| damaged(&e)).map(|picture| {
        let (width, height) = (picture.width(), picture.height());
        scene::Image { name: image.name.clone(), width, height, texels: texels(picture) }
    }))
}

/// Who decodes a picture.
#[derive(Debug, Clone, Copy)]
pub enum Format {
    Image(ImageFormat),
    Basis,
}

/// What a picture's header says.
#[derive(Debug)]
pub enum Probe {
    /// Can be decoded; width, height and bytes a texel once decoded.
    Readable(Format, u32, u32, u64),
    /// Cannot be decoded; why.
    Unreadable(String),
}

impl Probe {
    fn unreadable(why: impl Into<String>) -> Self {
        Self::Unreadable(why.into())
    }
}

fn damaged(error: &ImageError) -> String {
    // Some decoders end their text with a line feed.
    let error = error.to_string();
    format!("the picture is damaged: {}; export or save it again", error.trim_end())
}

/// Reads the header. A picture that is not there, damaged or of another format is no error here.
///
/// # Errors
/// Bytes that are not in the buffer, sizes beyond the decoders' limits.
fn probe(image: &Image, document: &Document) -> Result<Probe> {
    match &image.data {
        ImageData::Nothing => return Ok(Probe::unreadable("an image without data")),
        ImageData::Unreadable(error) => return Ok(Probe::unreadable(error.to_string())),
        ImageData::Bytes(_) | ImageData::View(_) => {}
    }
    let (bytes, at) = (stored(image, document)?, &image.at);
    let format = match &bytes[..] {
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [0xFF, 0xD8, 0xFF, ..] => ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', ..] => {
            return Ok(match basis::probe(&bytes) {
                Ok((width, height)) => Probe::Readable(Format::Basis, width, height, 4),
                Err(why) => Probe::Unreadable(why),
            });
        }
        [0xAB, b'K', b'T', b'X', ..] => return Ok(Probe::unreadable("KTX 1 pictures are not read: use PNG or JPEG")),
        [b'D', b'D', b'S', b' ', ..] => return Ok(Probe::unreadable("DDS pictures are not read: use PNG or JPEG")),
        _ => return Ok(Probe::unreadable("the picture is none of PNG, JPEG, WebP and KTX2")),
    };
    let decoder = ImageReader::with_format(Cursor::new(bytes), format).into_decoder();
    let decoder = match decoder {
        Ok(decoder) => decoder,
        Err(e @ ImageError::Limits(_)) => return Err(Error::Data(format!("{at}: {}", damaged(&e)))),
        Err(e) => return Ok(Probe::Unreadable(damaged(&e))),
    };
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Ok(Probe::unreadable(format!("a picture of {width}x{height} texels")));
    }
    let bytes = match decoder.color_type() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => 8,
        _ => 4,
    };
    Ok(Probe::Readable(Format::Image(format), width, height, bytes))
}

fn texels(picture: DynamicImage) -> Texels {
    match picture.color() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let raw = picture.into_rgba16().into_raw();
            Texels::Rgba16(grouped(raw))
        }
        ColorType::La8 | ColorType::Rgba8 => eight_bits(picture.into_rgba8().into_raw()),
        _ => Texels::Rgb8(grouped(picture.into_rgb8().into_raw())),
    }
}

/// Opaque pictures need no alpha, and then no filter at their surfaces either.
fn eight_bits(raw: Vec<u8>) -> Texels {
    let texels = raw.as_chunks::<4>().0;
    match texels.iter().all(|t| t[3] == 255) {
        true => Texels::Rgb8(texels.iter().map(|t| [t[0], t[1], t[2]]).collect()),
        false => Texels::Rgba8(grouped(raw)),
    }
}

/// Without a second copy in memory, unless there is room for half a texel at the end.
fn grouped<T: Pod, const N: usize>(raw: Vec<T>) -> Vec<[T; N]>
where
    [T; N]: Pod,
{
    try_cast_vec(raw).unwrap_or_else(|(_, raw)| raw.as_chunks::<N>().0.to_vec())
}

/// The scene's textures and pictures, registered as materials ask for them.
pub struct TextureTable {
    textures: Vec<scene::Texture>,
    /// By the document's image, of those that were asked for.
    probes: HashMap<usize, Probe>,
    budget: Budget,
    /// Document's image of each of the scene's.
    images: Vec<usize>,
    by_image: HashMap<usize, u32>,
    by_use: HashMap<(usize, Wrap, Wrap, Filter), u32>,
}

impl TextureTable {
    pub fn new(file_bytes: u64) -> Self {
        Self {
            textures: Vec::new(),
            probes: HashMap::new(),
            budget: Budget::for_data(file_bytes),
            images: Vec::new(),
            by_image: HashMap::new(),
            by_use: HashMap::new(),
        }
    }

    fn probe(&mut self, document: &Document, index: usize) -> Result<&Probe> {
        match self.probes.entry(index) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(unknown) => {
                let image = document.images.get(index)?;
                // Some decoders read all for the header, and many images may share one picture.
                self.budget.take(&image.at, image.length, 1)?;
                Ok(unknown.insert(probe(image, document)?))
            }
        }
    }

    /// The first of a texture's pictures that can be decoded; `None` with a note when there is none.
    fn readable(
        &mut self,
        document: &Document,
        texture: &Texture,
        at: &str,
        notes: &mut Notes,
    ) -> Result<Option<usize>> {
        let mut why_not = None;
        for &source in &texture.sources {
            match self.probe(document, source)? {
                Probe::Readable(..) => return Ok(Some(source)),
                Probe::Unreadable(why) => why_not = Some((source, why.clone())),
            }
        }
        match (why_not, texture.alternatives.first()) {
            (Some((source, why)), _) => {
                notes.ignored(&document.images.get(source)?.at, format!("{why}; the factor alone is used"));
            }
            (None, Some(name)) => {
                notes.ignored(at, format!("a texture only in {name}, which is not read: the factor alone is used"));
            }
            (None, None) => notes.ignored(at, "a texture without a picture: the factor alone is used"),
        }
        Ok(None)
    }

    /// The scene's reference for a document's; `None` with a note when there is nothing to sample.
    pub fn register(
        &mut self,
        document: &Document,
        info: &TextureInfo,
        slot: TextureSlot,
        notes: &mut Notes,
    ) -> Result<Option<TextureRef>> {
        let texture = document.textures.get(info.texture)?;
        let Some(source) = self.readable(document, texture, &info.at, notes)? else { return Ok(None) };
        let Some(set) = u8::try_from(info.set).ok().filter(|set| *set < 2) else {
            let text = "a texture on TEXCOORD_2 or higher, of which only 0 and 1 are read: the factor alone is used";
            notes.ignored(&info.at, text);
            return Ok(None);
        };
        if texture.sources.len() > 1 || !texture.alternatives.is_empty() {
            notes.not_loaded(&texture.at, "other pictures of the texture: one is used");
        }
        let default = Sampler { wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, filter: Filter::Linear };
        let sampler = match texture.sampler {
            Some(index) => *document.samplers.get(index)?,
            None => default,
        };
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
        Ok(Some(TextureRef { texture: index, set, transform: info.transform, encoding: slot.encoding() }))
    }

    /// Decodes the pictures that are sampled and not kept, in parallel, into `scene`, with their textures. Materials lose the textures
    /// whose picture is damaged.
    ///
    /// # Errors
    /// The first picture that is too large, by the document's order.
    pub fn decode(
        self,
        document: &Document,
        file_bytes: u64,
        kept: &Kept,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<()> {
        // Flat colours compress a thousandfold; a floor lets ordinary ones pass.
        const BASE: u64 = 1 << 30;
        const FACTOR: u64 = 256;
        let mut budget = Budget::new(BASE, FACTOR, file_bytes);
        let mut jobs = Vec::new();
        for &index in &self.images {
            let image = document.images.get(index)?;
            let Some(&Probe::Readable(format, width, height, bytes)) = self.probes.get(&index) else { continue };
            let count = u64::from(width) * u64::from(height);
            if width.max(height) > LARGEST_SIDE || count > LARGEST_TEXELS {
                return Err(Error::Data(format!(
                    "{}: the picture has {width}x{height} texels; at most {LARGEST_SIDE} a side and {LARGEST_TEXELS} in \
                     all can be used: scale it down",
                    image.at
                )));
            }
            budget.take(&image.at, count, bytes)?;
            let there = kept.images().get(&index).cloned();
            jobs.push((index, image, format, there));
        }
        let one = |(_, image, format, there): &(usize, &Image, Format, Option<Arc<scene::Image>>)| match there {
            Some(there) => Ok(Ok(Arc::clone(there))),
            None => decode(image, document, *format).map(|decoded| decoded.map(Arc::new)),
        };
        let start = Instant::now();
        let decoded: Vec<_> = jobs.par_iter().map(one).collect();
        let new = jobs.iter().filter(|(.., there)| there.is_none()).count();
        debug!("{new} pictures decoded: {:.3} s", start.elapsed().as_secs_f64());
        // The scene's index of each picture and texture that is left.
        let (mut image_left, mut texture_left) = (Vec::new(), Vec::new());
        for ((index, image, ..), decoded) in jobs.iter().zip(decoded) {
            image_left.push(match decoded? {
                Ok(picture) => {
                    kept.images().insert(*index, Arc::clone(&picture));
                    Some(push(&mut scene.images, picture))
                }
                Err(why) => {
                    notes.ignored(&image.at, format!("{why}; the factor alone is used"));
                    None
                }
            });
        }
        for texture in self.textures {
            let left = image_left[texture.image as usize];
            texture_left.push(left.map(|image| push(&mut scene.textures, scene::Texture { image, ..texture })));
        }
        if image_left.contains(&None) {
            drop_textures(scene, &texture_left);
        }
        Ok(())
    }

    /// Notes the pictures that nothing samples.
    pub fn note_unused(&self, document: &Document, notes: &mut Notes) {
        for (index, image) in document.images.sound() {
            if !self.by_image.contains_key(&index) {
                notes.not_loaded(&image.at, "a picture that no visible material samples");
            }
        }
    }
}

/// Appends, and gives the index.
fn push<T>(list: &mut Vec<T>, item: T) -> u32 {
    list.push(item);
    (list.len() - 1) as u32
}

/// Renumbers the materials' textures; those without a new number are taken away, and tangents that stood for them.
fn drop_textures(scene: &mut Scene, left: &[Option<u32>]) {
    for material in &mut scene.materials {
        for slot in TextureSlot::ALL {
            let reference = material.textures[slot].take();
            material.textures[slot] =
                reference.and_then(|old| Some(TextureRef { texture: left[old.texture as usize]?, ..old }));
        }
    }
    for mesh in &mut scene.meshes {
        if mesh.tangents.is_some() && scene.materials[mesh.material as usize].tangent_set().is_none() {
            Arc::make_mut(mesh).tangents = None;
        }
    }
}
