//! Vertex attributes: semantics, and the accessor formats that each allows.

use std::collections::BTreeMap;

use super::accessors::{Accessor, Component, NOT_NORMALIZED, Shape};
use super::json::Json;
use super::table::Table;
use crate::error::Result;

/// Meaning of an attribute. Sets above 1 are checked but not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Semantic {
    Position,
    Normal,
    Tangent,
    TexCoord(u32),
    Color(u32),
    Joints(u32),
    Weights(u32),
}

impl Semantic {
    pub fn parse(name: &str) -> Option<Self> {
        let Some((stem, digits)) = name.split_once('_') else {
            return match name {
                "POSITION" => Some(Self::Position),
                "NORMAL" => Some(Self::Normal),
                "TANGENT" => Some(Self::Tangent),
                _ => None,
            };
        };
        let set = digits.parse().ok().filter(|_| digits.bytes().all(|b| b.is_ascii_digit()))?;
        match stem {
            "TEXCOORD" => Some(Self::TexCoord(set)),
            "COLOR" => Some(Self::Color(set)),
            "JOINTS" => Some(Self::Joints(set)),
            "WEIGHTS" => Some(Self::Weights(set)),
            _ => None,
        }
    }

    /// Is the accessor's format allowed? `morph` for displacements, `quantized` with KHR_mesh_quantization.
    fn allows(self, a: &Accessor, morph: bool, quantized: bool) -> bool {
        use Component::*;
        let unorm = a.normalized && matches!(a.component, U8 | U16);
        let snorm = a.normalized && matches!(a.component, I8 | I16);
        let small = matches!(a.component, I8 | U8 | I16 | U16);
        let float = a.component == F32;
        match self {
            Self::Position => {
                let integer = if morph { matches!(a.component, I8 | I16) } else { small };
                a.shape == Shape::Vec3 && (float || quantized && integer)
            }
            Self::Normal => a.shape == Shape::Vec3 && (float || quantized && snorm),
            Self::Tangent => a.shape == if morph { Shape::Vec3 } else { Shape::Vec4 } && (float || quantized && snorm),
            Self::TexCoord(_) => a.shape == Shape::Vec2 && (float || unorm || quantized && small || morph && snorm),
            Self::Color(_) => matches!(a.shape, Shape::Vec3 | Shape::Vec4) && (float || unorm || morph && snorm),
            Self::Joints(_) => a.shape == Shape::Vec4 && matches!(a.component, U8 | U16),
            Self::Weights(_) => a.shape == Shape::Vec4 && (float || unorm),
        }
    }

    fn formats(self) -> &'static str {
        match self {
            Self::Position | Self::Normal => {
                "VEC3 of FLOAT (integers need KHR_mesh_quantization in extensionsRequired)"
            }
            Self::Tangent => "VEC4 of FLOAT (VEC3 in morph targets; integers need KHR_mesh_quantization)",
            Self::TexCoord(_) => "VEC2 of FLOAT or normalized UNSIGNED_BYTE or UNSIGNED_SHORT",
            Self::Color(_) => "VEC3 or VEC4 of FLOAT or normalized UNSIGNED_BYTE or UNSIGNED_SHORT",
            Self::Joints(_) => "VEC4 of UNSIGNED_BYTE or UNSIGNED_SHORT",
            Self::Weights(_) => "VEC4 of FLOAT or normalized UNSIGNED_BYTE or UNSIGNED_SHORT",
        }
    }
}

/// Accessor index by semantic.
pub type Attributes = BTreeMap<Semantic, usize>;

/// Reads the attributes of a primitive, or those of a morph target (`morph`); `quantized` with KHR_mesh_quantization.
/// Appends the accessors of every attribute, also of unknown ones, to `all_accessors`.
pub(crate) fn parse_attributes(
    json: &Json,
    accessors: &Table<Accessor>,
    morph: bool,
    quantized: bool,
    all_accessors: &mut Vec<usize>,
) -> Result<Attributes> {
    let mut attributes = Attributes::new();
    for name in json.object()?.keys() {
        let index = json.need(name, json.index(name, "accessors")?)?;
        all_accessors.push(index);
        if name.starts_with('_') {
            continue; // Application-specific.
        }
        let Some(semantic) = Semantic::parse(name) else {
            json.repaired(name, format!("an attribute {name}, which the specification does not know"));
            continue;
        };
        let accessor = accessors.get(index)?;
        if !semantic.allows(accessor, morph, quantized) {
            return Err(json.bad(name, semantic.formats(), accessor.format()));
        }
        if accessor.normalized && matches!(semantic, Semantic::Joints(_)) {
            json.repaired(name, NOT_NORMALIZED);
        }
        attributes.insert(semantic, index);
    }
    Ok(attributes)
}
