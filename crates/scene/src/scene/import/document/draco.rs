//! Primitives under KHR_draco_mesh_compression: the parameters of the decoder.

use std::collections::BTreeMap;

use super::attributes::{Attributes, Semantic};
use super::json::Json;
use crate::error::Result;

/// Parameters of a compressed primitive: the view with the Draco stream, and the stream's id of each attribute.
#[derive(Debug)]
pub struct Draco {
    pub view: usize,
    pub attributes: BTreeMap<Semantic, u32>,
    pub at: String,
}

impl Draco {
    /// Parses the extension of a primitive; `None` if it has none.
    pub fn parse(primitive: &Json, attributes: &Attributes) -> Result<Option<Self>> {
        let Some(json) = primitive.extension("KHR_draco_mesh_compression")? else { return Ok(None) };
        let view = json.need("bufferView", json.index("bufferView", "bufferViews")?)?;
        let members = json.need("attributes", json.get("attributes")?)?;
        let mut ids = BTreeMap::new();
        for name in members.object()?.keys() {
            let id = members.need(name, members.index_below(name, u32::MAX as usize, "the stream's attributes")?)?;
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
