//! Pictures, samplers and textures. Every picture's header is checked; only those that a material samples are
//! decoded.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;

use super::accessors::{Budget, View};
use super::container::read_regular;
use super::document::{Document, Lengths};
use super::json::{Json, bad};
use super::materials::TextureInfo;
use super::report::Notes;
use super::uri::{self, Files, Resource};
use crate::error::{Error, Result};
use crate::scene::{self, Encoding, Filter, Texels, TextureRef, Wrap};

/// Texels a side and in all. Larger pictures are refused before anything is decoded.
const LARGEST_SIDE: u32 = 1 << 15;
const LARGEST_TEXELS: u64 = 1 << 28;

#[derive(Debug)]
enum Source {
    File(PathBuf),
    Memory(Vec<u8>),
    View(usize),
    /// Neither `uri` nor `bufferView`.
    Nothing,
}

/// A document's image: where its bytes are.
#[derive(Debug)]
pub(super) struct Image {
    source: Source,
    name: String,
    /// Encoded bytes.
    length: u64,
    pub at: String,
}

impl Image {
    pub fn parse(json: &Json, folder: &Path, files: &mut Files, views: &[View]) -> Result<Self> {
        let mut name = json.name()?;
        let mime = json.string("mimeType")?.unwrap_or_default().to_string();
        let view = json.index("bufferView", views.len(), "bufferViews")?;
        let (source, mime, length) = match (json.string("uri")?, view) {
            (Some(_), Some(_)) => return Err(json.bad("bufferView", "either uri or bufferView", "both")),
            (Some(text), None) => match uri::resolve(text, folder, &json.path("uri"))? {
                Resource::File(path, size) => {
                    if name == json.at {
                        name = text.into();
                    }
                    files.add(&path, size);
                    (Source::File(path), mime, size)
                }
                Resource::Data { mime: own, bytes } => {
                    if mime != own && !mime.is_empty() && own.starts_with("image/") {
                        return Err(json.bad("mimeType", format!("\"{own}\" as in the URI"), format!("\"{mime}\"")));
                    }
                    let length = bytes.len() as u64;
                    (Source::Memory(bytes), own, length)
                }
            },
            (None, Some(index)) => {
                if views[index].stride.is_some() {
                    return Err(json.bad("bufferView", "a view without byteStride", &views[index].at));
                }
                (Source::View(index), mime, views[index].length)
            }
            (None, None) => (Source::Nothing, mime, 0),
        };
        const KNOWN: &[&str] = &["png", "jpeg", "jpg", "webp", "ktx2", "vnd-ms.dds", "x-basis"];
        if mime.strip_prefix("image/").is_some_and(|kind| !KNOWN.contains(&kind)) {
            return Err(json.bad("mimeType", "image/png or image/jpeg", format!("\"{mime}\"")));
        }
        Ok(Self { source, name, length, at: json.at.clone() })
    }

    pub fn view(&self) -> Option<usize> {
        if let Source::View(view) = self.source { Some(view) } else { None }
    }

    /// Reads the header.
    ///
    /// # Errors
    /// A PNG or JPEG whose header is damaged. Other formats are not errors here.
    pub fn probe(&self, document: &Document) -> Result<Probe> {
        match &self.source {
            Source::Nothing => Ok(Probe::Unreadable("an image without data")),
            Source::Memory(bytes) => probe(Cursor::new(bytes), &self.at),
            Source::View(_) => probe(Cursor::new(self.bytes(document)?.as_ref()), &self.at),
            Source::File(path) => {
                probe(BufReader::new(File::open(path).map_err(|e| Error::reading(path, &e))?), &self.at)
            }
        }
    }

    fn bytes<'a>(&'a self, document: &'a Document) -> Result<std::borrow::Cow<'a, [u8]>> {
        const LARGEST_FILE: u64 = 4 << 30;
        Ok(match &self.source {
            Source::Nothing => (&[][..]).into(),
            Source::Memory(bytes) => bytes.as_slice().into(),
            Source::File(path) => read_regular(path, LARGEST_FILE)?.into(),
            Source::View(index) => {
                let view = &document.views[*index];
                document.buffers[view.buffer].bytes(view.offset, view.length)?.into()
            }
        })
    }

    fn decode(&self, document: &Document, format: ImageFormat) -> Result<scene::Image> {
        let bytes = self.bytes(document)?;
        let mut reader = ImageReader::with_format(Cursor::new(bytes.as_ref()), format);
        let mut limits = Limits::default();
        limits.max_image_width = Some(LARGEST_SIDE);
        limits.max_image_height = Some(LARGEST_SIDE);
        limits.max_alloc = Some(LARGEST_TEXELS * 16);
        reader.limits(limits);
        let picture = reader.decode().map_err(|e| damaged(&self.at, &e))?;
        let (width, height) = (picture.width(), picture.height());
        Ok(scene::Image { name: self.name.clone(), width, height, texels: texels(picture) })
    }
}

/// What a picture's header says.
#[derive(Debug, Clone, Copy)]
pub(super) enum Probe {
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

fn probe(mut reader: impl BufRead + Seek, at: &str) -> Result<Probe> {
    let mut start = Vec::new();
    let read = reader.by_ref().take(16).read_to_end(&mut start).and_then(|_| reader.rewind());
    read.map_err(|e| Error::Io(format!("{at}: cannot read the picture: {e}")))?;
    let format = match start.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => ImageFormat::Png,
        [0xFF, 0xD8, 0xFF, ..] => ImageFormat::Jpeg,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => {
            return Ok(Probe::Unreadable("WebP pictures are not read: use PNG or JPEG"));
        }
        [0xAB, b'K', b'T', b'X', ..] => return Ok(Probe::Unreadable("KTX2 pictures are not read: use PNG or JPEG")),
        [b'D', b'D', b'S', b' ', ..] => return Ok(Probe::Unreadable("DDS pictures are not read: use PNG or JPEG")),
        _ => return Ok(Probe::Unreadable("the picture is neither PNG nor JPEG")),
    };
    let decoder = ImageReader::with_format(reader, format).into_decoder().map_err(|e| damaged(at, &e))?;
    let (width, height) = image::ImageDecoder::dimensions(&decoder);
    if width == 0 || height == 0 {
        return Err(bad(at, "a picture of at least 1x1", format!("{width}x{height}")));
    }
    let bytes = match image::ImageDecoder::color_type(&decoder) {
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

/// A document's sampler.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampler {
    wrap_s: Wrap,
    wrap_t: Wrap,
    filter: Filter,
}

impl Sampler {
    pub fn parse(json: &Json) -> Result<Self> {
        json.name()?;
        let wrap = |key: &str| match json.integer(key)?.unwrap_or(10497) {
            33071 => Ok(Wrap::ClampToEdge),
            33648 => Ok(Wrap::MirroredRepeat),
            10497 => Ok(Wrap::Repeat),
            other => Err(json.bad(key, "33071, 33648 or 10497", other)),
        };
        let filter = match json.integer("magFilter")?.unwrap_or(9729) {
            9728 => Filter::Nearest,
            9729 => Filter::Linear,
            other => return Err(json.bad("magFilter", "9728 or 9729", other)),
        };
        if let Some(min) = json.integer("minFilter")?.filter(|f| !matches!(f, 9728 | 9729 | 9984..=9987)) {
            return Err(json.bad("minFilter", "9728, 9729 or 9984 to 9987", min));
        }
        Ok(Self { wrap_s: wrap("wrapS")?, wrap_t: wrap("wrapT")?, filter })
    }
}

/// A document's texture.
#[derive(Debug)]
pub(super) struct Texture {
    source: Option<usize>,
    sampler: Option<usize>,
    /// Pictures in formats of extensions.
    alternatives: Vec<String>,
    at: String,
}

impl Texture {
    pub fn parse(json: &Json, lengths: &Lengths) -> Result<Self> {
        json.name()?;
        let source = json.index("source", lengths.images, "images")?;
        let sampler = json.index("sampler", lengths.samplers, "samplers")?;
        let mut alternatives = Vec::new();
        for name in json.extension_names()? {
            if let Some(extension) = json.extension(name)?
                && extension.index("source", lengths.images, "images")?.is_some()
            {
                alternatives.push(name.into());
            }
        }
        Ok(Self { source, sampler, alternatives, at: json.at.clone() })
    }
}

/// The scene's textures and pictures, registered as materials ask for them.
pub(super) struct TextureTable {
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
            probes.push(image.probe(document)?);
        }
        Ok(Self { textures: Vec::new(), probes, images: Vec::new(), by_image: HashMap::new(), by_use: HashMap::new() })
    }

    /// The scene's reference for a document's; `None` with a note when there is nothing to sample.
    pub fn register(
        &mut self,
        document: &Document,
        info: &TextureInfo,
        encoding: Encoding,
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
        Some(TextureRef { texture: index, set, transform: info.transform, encoding })
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
        let decoded: Vec<_> = jobs.par_iter().map(|(image, format)| image.decode(document, *format)).collect();
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
