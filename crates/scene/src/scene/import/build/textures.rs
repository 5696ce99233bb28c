//! Pictures and textures of the scene. Only those that a material samples are read; unusable ones are omitted with a note.

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

use super::cache::ImportCache;
use super::decode::basis;
use super::reader::Budget;
use crate::error::{Error, Result};
use crate::scene::import::document::Document;
use crate::scene::import::document::images::{Image, ImageData, Sampler, Texture};
use crate::scene::import::document::texture_info::TextureInfo;
use crate::scene::import::report::Notes;
use crate::scene::{self, Filter, Scene, Texels, TextureRef, TextureSlot, Wrap};

/// Limits of a picture's size in texels. Larger pictures are refused before decoding.
const MAX_TEXELS_PER_SIDE: u32 = 1 << 15;
const MAX_TEXELS: u64 = 1 << 28;

/// Encoded bytes of a picture; empty if it has no data.
/// Errors: A file that cannot be read, bytes that are not in the buffer.
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

/// Decodes a picture; the inner error says why it cannot be decoded.
fn decode(image: &Image, document: &Document, format: Format) -> Result<std::result::Result<scene::Image, String>> {
    let bytes = stored(image, document)?;
    let hash = blake3::hash(&bytes).to_hex().to_string();
    let made = |(width, height), texels: Texels| scene::Image { name: image.name.clone(), width, height, texels, hash };
    let Format::Image(format) = format else {
        let Ok(size) = basis::probe(&bytes) else { return Ok(Err("a damaged KTX2 picture".into())) };
        return Ok(basis::decode(&bytes).map(|texels| made(size, eight_bits(texels))));
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_TEXELS_PER_SIDE);
    limits.max_image_height = Some(MAX_TEXELS_PER_SIDE);
    limits.max_alloc = Some(MAX_TEXELS * 16);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| damaged(&e));
    Ok(picture.map(|picture| made((picture.width(), picture.height()), texels(picture))))
}

/// Decoder of a picture.
#[derive(Debug, Clone, Copy)]
pub enum Format {
    Image(ImageFormat),
    Basis,
}

/// A picture's header: its decoder, width and height in texels, and bytes per decoded texel; or why it cannot be decoded.
type Probe = std::result::Result<(Format, [u32; 2], u64), String>;

fn damaged(error: &ImageError) -> String {
    // Some decoders end their text with a line feed.
    let error = error.to_string();
    format!("the picture is damaged: {}; export or save it again", error.trim_end())
}

/// Reads the header. A missing, damaged or unsupported picture is not an error here.
/// Errors: Bytes that are not in the buffer, sizes beyond the decoders' limits.
fn probe(image: &Image, document: &Document) -> Result<Probe> {
    match &image.data {
        ImageData::Nothing => return Ok(Err("an image without data".into())),
        ImageData::Unreadable(error) => return Ok(Err(error.to_string())),
        ImageData::Bytes(_) | ImageData::View(_) => {}
    }
    let (bytes, at) = (stored(image, document)?, &image.at);
    let format = match &bytes[..] {
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [0xFF, 0xD8, 0xFF, ..] => ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', ..] => {
            return Ok(basis::probe(&bytes).map(|(width, height)| (Format::Basis, [width, height], 4)));
        }
        [0xAB, b'K', b'T', b'X', ..] => return Ok(Err("KTX 1 pictures are not read: use PNG or JPEG".into())),
        [b'D', b'D', b'S', b' ', ..] => return Ok(Err("DDS pictures are not read: use PNG or JPEG".into())),
        _ => return Ok(Err("the picture is none of PNG, JPEG, WebP and KTX2".into())),
    };
    let decoder = match ImageReader::with_format(Cursor::new(bytes), format).into_decoder() {
        Ok(decoder) => decoder,
        Err(e @ ImageError::Limits(_)) => return Err(Error::Data(format!("{at}: {}", damaged(&e)))),
        Err(e) => return Ok(Err(damaged(&e))),
    };
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Ok(Err(format!("a picture of {width}x{height} texels")));
    }
    let bytes = match decoder.color_type() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => 8,
        _ => 4,
    };
    Ok(Ok((Format::Image(format), [width, height], bytes)))
}

fn texels(picture: DynamicImage) -> Texels {
    match picture.color() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            Texels::Rgba16(grouped(picture.into_rgba16().into_raw()))
        }
        ColorType::La8 | ColorType::Rgba8 => eight_bits(picture.into_rgba8().into_raw()),
        _ => Texels::Rgb8(grouped(picture.into_rgb8().into_raw())),
    }
}

/// Drops the alpha of opaque pictures, so that their surfaces need no intersection filter.
fn eight_bits(raw: Vec<u8>) -> Texels {
    let texels = raw.as_chunks::<4>().0;
    match texels.iter().all(|t| t[3] == 255) {
        true => Texels::Rgb8(texels.iter().map(|t| [t[0], t[1], t[2]]).collect()),
        false => Texels::Rgba8(grouped(raw)),
    }
}

/// Groups channels into texels, without a copy unless the allocation's capacity is not a multiple of a texel.
fn grouped<T: Pod, const N: usize>(raw: Vec<T>) -> Vec<[T; N]>
where
    [T; N]: Pod,
{
    try_cast_vec(raw).unwrap_or_else(|(_, raw)| raw.as_chunks::<N>().0.to_vec())
}

/// The scene's textures and pictures, registered as materials ask for them.
pub struct TextureTable {
    textures: Vec<scene::Texture>,
    /// Headers by the document's image index.
    probes: HashMap<usize, Probe>,
    budget: Budget,
    /// Index of the document's image for each of the scene's images.
    images: Vec<usize>,
    by_image: HashMap<usize, u32>,
    by_use: HashMap<(usize, Sampler), u32>,
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
                // Some decoders read the whole file for its header, and many images may share one file.
                self.budget.take(&image.at, image.length, 1)?;
                Ok(unknown.insert(probe(image, document)?))
            }
        }
    }

    /// The first decodable picture of a texture; `None` with a note if there is none.
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
                Ok(_) => return Ok(Some(source)),
                Err(why) => why_not = Some((source, why.clone())),
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

    /// Registers a texture; `None` with a note if it cannot be sampled.
    pub fn register(
        &mut self,
        document: &Document,
        info: &TextureInfo,
        slot: TextureSlot,
        notes: &mut Notes,
    ) -> Result<Option<TextureRef>> {
        let texture = document.textures.get(info.texture)?;
        let Some(source) = self.readable(document, texture, &info.at, notes)? else { return Ok(None) };
        let Ok(set) = u8::try_from(info.set) else {
            let text = "a texture on TEXCOORD_256 or higher, which are not read: the factor alone is used";
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
        let index = *self.by_use.entry((source, sampler)).or_insert_with(|| {
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

    /// Decodes the sampled pictures that are not in `cache`, in parallel, and adds pictures and textures to `scene`. Textures with
    /// a damaged picture are removed from their materials.
    /// Errors: The first picture, in the document's order, that is too large.
    pub fn decode(
        self,
        document: &Document,
        file_bytes: u64,
        cache: &ImportCache,
        scene: &mut Scene,
        notes: &mut Notes,
    ) -> Result<()> {
        // Flat colours compress a thousandfold; the base admits ordinary pictures.
        const BASE: u64 = 1 << 30;
        const FACTOR: u64 = 256;
        let mut budget = Budget::new(BASE, FACTOR, file_bytes);
        let mut jobs = Vec::new();
        for &index in &self.images {
            let image = document.images.get(index)?;
            let Some(&Ok((format, [width, height], bytes))) = self.probes.get(&index) else { continue };
            let count = u64::from(width) * u64::from(height);
            if width.max(height) > MAX_TEXELS_PER_SIDE || count > MAX_TEXELS {
                return Err(Error::Data(format!(
                    "{}: the picture has {width}x{height} texels; at most {MAX_TEXELS_PER_SIDE} a side and {MAX_TEXELS} in \
                     all can be used: scale it down",
                    image.at
                )));
            }
            budget.take(&image.at, count, bytes)?;
            let cached = cache.images().get(&index).cloned();
            jobs.push((index, image, format, cached));
        }
        let start = Instant::now();
        let decoded = jobs.par_iter().map(|(_, image, format, cached)| match cached {
            Some(cached) => Ok(Ok(Arc::clone(cached))),
            None => decode(image, document, *format).map(|decoded| decoded.map(Arc::new)),
        });
        let decoded: Vec<_> = decoded.collect();
        let new = jobs.iter().filter(|(.., cached)| cached.is_none()).count();
        debug!("{new} pictures decoded: {:.3} s", start.elapsed().as_secs_f64());
        // The scene's index of each usable picture and texture.
        let (mut image_index, mut texture_index) = (Vec::new(), Vec::new());
        for ((index, image, ..), decoded) in jobs.iter().zip(decoded) {
            image_index.push(match decoded? {
                Ok(picture) => {
                    cache.images().insert(*index, Arc::clone(&picture));
                    Some(push(&mut scene.images, picture))
                }
                Err(why) => {
                    notes.ignored(&image.at, format!("{why}; the factor alone is used"));
                    None
                }
            });
        }
        for texture in self.textures {
            let left = image_index[texture.image as usize];
            texture_index.push(left.map(|image| push(&mut scene.textures, scene::Texture { image, ..texture })));
        }
        if image_index.contains(&None) {
            drop_textures(scene, &texture_index);
        }
        Ok(())
    }

    /// Notes the pictures that nothing samples.
    pub(crate) fn note_unused(&self, document: &Document, notes: &mut Notes) {
        for (index, image) in document.images.sound() {
            if !self.by_image.contains_key(&index) {
                notes.not_loaded(&image.at, "a picture that no visible material samples");
            }
        }
    }
}

fn push<T>(list: &mut Vec<T>, item: T) -> u32 {
    list.push(item);
    (list.len() - 1) as u32
}

/// Renumbers the materials' textures; removes those without a new index, and tangents that are no longer needed.
fn drop_textures(scene: &mut Scene, left: &[Option<u32>]) {
    for material in &mut scene.materials {
        for slot in TextureSlot::ALL {
            let reference = material.textures[slot].take();
            material.textures[slot] =
                reference.and_then(|old| Some(TextureRef { texture: left[old.texture as usize]?, ..old }));
        }
    }
    for mesh in &mut scene.meshes {
        let material = &scene.materials[mesh.material as usize];
        let [own, coat] = material.tangent_sets();
        if mesh.tangents.is_some() && own.is_none() {
            Arc::make_mut(mesh).tangents = None;
        }
        if mesh.coat_tangents.is_some() && coat.is_none() {
            let mesh = Arc::make_mut(mesh);
            let left = mesh.coat_tangents.take();
            // Its map may be the only one that is left.
            if material.textures[TextureSlot::ClearcoatNormal].is_some() {
                mesh.tangents = left;
            }
        }
    }
}
