//! Compressed geometry, as the document has it: what a decoder needs to know.

use std::collections::BTreeMap;

use meshoptimizer_rs::codec::Mode;

use super::buffers::Buffer;
use super::json::Json;
use super::primitives::{Attributes, Semantic};
use super::table::Table;
use crate::error::Result;

/// What is undone after a meshopt stream of attributes was decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    None,
    Octahedral,
    Quaternion,
    Exponential,
    /// KHR_meshopt_compression alone.
    Color,
}

/// EXT_meshopt_compression and KHR_meshopt_compression: where a view's bytes are compressed, and how.
#[derive(Debug)]
pub struct Meshopt {
    pub buffer: usize,
    pub offset: u64,
    pub length: u64,
    pub stride: u64,
    pub count: u64,
    pub mode: Mode,
    pub filter: Filter,
    pub at: String,
}

impl Meshopt {
    /// `view` is the buffer view. `None` if it is not compressed.
    pub fn parse(view: &Json, buffers: &Table<Buffer>) -> Result<Option<Self>> {
        let khr = view.extension("KHR_meshopt_compression")?;
        let color = khr.is_some();
        let Some(json) = khr.map_or_else(|| view.extension("EXT_meshopt_compression"), |json| Ok(Some(json)))? else {
            return Ok(None);
        };
        let need = |key: &str| json.need(key, json.integer(key)?);
        let buffer = json.need("buffer", json.index("buffer", buffers.len(), "buffers")?)?;
        let (offset, length) = (json.integer("byteOffset")?.unwrap_or(0), need("byteLength")?);
        let (stride, count) = (need("byteStride")?, need("count")?);
        let text = json.need("mode", json.string("mode")?)?;
        let mode = match Mode::parse(text) {
            Ok(mode) => mode,
            Err(_) => return Err(json.bad("mode", "ATTRIBUTES, TRIANGLES or INDICES", text)),
        };
        let filter = match json.string("filter")?.unwrap_or("NONE") {
            "NONE" => Filter::None,
            "OCTAHEDRAL" => Filter::Octahedral,
            "QUATERNION" => Filter::Quaternion,
            "EXPONENTIAL" => Filter::Exponential,
            "COLOR" if color => Filter::Color,
            other => return Err(json.bad("filter", "NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL", other)),
        };
        let whole = view.need("byteLength", view.integer("byteLength")?)?;
        if count == 0 || count.checked_mul(stride) != Some(whole) {
            let wanted = format!("elements that fill the view's {whole} bytes");
            return Err(json.bad("count", wanted, format!("{count} of {stride} bytes")));
        }
        Ok(Some(Self { buffer, offset, length, stride, count, mode, filter, at: json.at }))
    }
}

/// KHR_draco_mesh_compression: a view with a Draco stream, and the stream's id of each attribute.
#[derive(Debug)]
pub struct Draco {
    pub view: usize,
    pub attributes: BTreeMap<Semantic, u32>,
    pub at: String,
}

impl Draco {
    /// `None` if the primitive has no such extension.
    pub fn parse(primitive: &Json, attributes: &Attributes, views: usize) -> Result<Option<Self>> {
        let Some(json) = primitive.extension("KHR_draco_mesh_compression")? else { return Ok(None) };
        let view = json.need("bufferView", json.index("bufferView", views, "bufferViews")?)?;
        let members = json.need("attributes", json.get("attributes")?)?;
        let mut ids = BTreeMap::new();
        for name in members.object()?.keys() {
            let id = members.need(name, members.index(name, u32::MAX as usize, "the stream's attributes")?)?;
            match Semantic::parse(name) {
                Some(semantic) if attributes.contains_key(&semantic) => {
                    ids.insert(semantic, id as u32);
                }
                Some(_) => return Err(members.bad(name, "an attribute that the primitive has too", "none")),
                None => {}
            }
        }
        Ok(Some(Self { view, attributes: ids, at: json.at }))
    }
}
