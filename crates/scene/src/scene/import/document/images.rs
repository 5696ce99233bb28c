//! Images, samplers and textures of the document.

use bytes::Bytes;

use super::accessors::View;
use super::json::Json;
use super::table::Table;
use crate::error::{Error, Result};
use crate::scene::import::source::{Data, Source};
use crate::scene::{Filter, Wrap};

/// Location of a picture's encoded bytes.
#[derive(Debug)]
pub enum ImageData {
    /// A file or data URI.
    Bytes(Bytes),
    View(usize),
    /// Neither `uri` nor `bufferView`.
    Nothing,
    /// A `uri` that cannot be read, with the reason.
    Unreadable(Error),
}

#[derive(Debug)]
pub struct Image {
    pub data: ImageData,
    pub name: String,
    /// Length of the encoded picture in bytes.
    pub length: u64,
    pub at: String,
}

impl Image {
    pub fn parse(json: &Json, index: usize, source: &Source, views: &Table<View>) -> Result<Self> {
        let mut name = json.name()?;
        json.string("mimeType")?; // The bytes say what they are.
        let view = json.index("bufferView", "bufferViews")?;
        let uri = json.string("uri")?;
        if uri.is_some() && view.is_some() {
            return Err(json.bad("bufferView", "either uri or bufferView", "both"));
        }
        let (data, length) = match (source.image(index), view) {
            (Err(error), _) => (ImageData::Unreadable(error), 0),
            (Ok(Some(Data { bytes, mime })), _) => {
                if let Some(uri) = uri.filter(|_| mime.is_none() && name == json.at) {
                    name = uri.into();
                }
                (ImageData::Bytes(bytes.all()), bytes.length)
            }
            (Ok(None), Some(index)) => {
                let view = views.get(index)?;
                if view.stride.is_some() {
                    return Err(json.bad("bufferView", "a view without byteStride", &view.at));
                }
                (ImageData::View(index), view.length)
            }
            (Ok(None), None) => (ImageData::Nothing, 0),
        };
        Ok(Self { data, name, length, at: json.at.clone() })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sampler {
    pub wrap_s: Wrap,
    pub wrap_t: Wrap,
    pub filter: Filter,
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
            _ => {
                json.repaired("magFilter", "an unknown filter: linear is used");
                Filter::Linear
            }
        };
        if json.integer("minFilter")?.is_some_and(|f| !matches!(f, 9728 | 9729 | 9984..=9987)) {
            json.repaired("minFilter", "an unknown filter; minification filters are not used");
        }
        Ok(Self { wrap_s: wrap("wrapS")?, wrap_t: wrap("wrapT")?, filter })
    }
}

const WEBP: &str = "EXT_texture_webp";
const BASIS: &str = "KHR_texture_basisu";

#[derive(Debug)]
pub struct Texture {
    /// Images in order of preference: of EXT_texture_webp, of the core texture, of KHR_texture_basisu.
    pub sources: Vec<usize>,
    pub sampler: Option<usize>,
    /// Extensions that offer other picture formats.
    pub alternatives: Vec<String>,
    pub at: String,
}

impl Texture {
    pub fn parse(json: &Json) -> Result<Self> {
        json.name()?;
        let sampler = json.index("sampler", "samplers")?;
        let core = json.index("source", "images")?;
        let extension_source =
            |name: &str| json.extension(name)?.map_or(Ok(None), |extension| extension.index("source", "images"));
        let sources = [extension_source(WEBP)?, core, extension_source(BASIS)?].into_iter().flatten().collect();
        let mut alternatives = Vec::new();
        for name in json.extension_names()?.into_iter().filter(|name| ![WEBP, BASIS].contains(&&name[..])) {
            if let Some(extension) = json.extension(&name)?
                && extension.object()?.contains_key("source")
                && (core.is_some() || extension.index("source", "images")?.is_some())
            {
                alternatives.push(name);
            }
        }
        Ok(Self { sources, sampler, alternatives, at: json.at.clone() })
    }
}
