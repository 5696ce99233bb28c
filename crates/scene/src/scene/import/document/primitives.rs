//! Meshes of the document: attributes, their formats, and what belongs together.

use std::collections::BTreeMap;

use super::Lengths;
use super::accessors::{Accessor, Component, Shape, View};
use super::compression::Draco;
use super::json::Json;
use super::materials::Material;
use super::table::Table;
use crate::error::Result;
use crate::scene::import::complaint::bad;
use crate::scene::import::report::Notes;

/// What an attribute means. Sets other than 0 and 1 are checked, but not read.
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
        let (stem, set) = match name.split_once('_') {
            Some((stem, set)) => (stem, Some(set)),
            None => (name, None),
        };
        let set = match set {
            None => None,
            Some(digits) if digits.bytes().all(|b| b.is_ascii_digit()) => Some(digits.parse().ok()?),
            Some(_) => return None,
        };
        match (stem, set) {
            ("POSITION", None) => Some(Self::Position),
            ("NORMAL", None) => Some(Self::Normal),
            ("TANGENT", None) => Some(Self::Tangent),
            ("TEXCOORD", Some(set)) => Some(Self::TexCoord(set)),
            ("COLOR", Some(set)) => Some(Self::Color(set)),
            ("JOINTS", Some(set)) => Some(Self::Joints(set)),
            ("WEIGHTS", Some(set)) => Some(Self::Weights(set)),
            _ => None,
        }
    }

    /// Is this format allowed? `morph` for displacements, `quantized` with KHR_mesh_quantization.
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
            Self::Joints(_) => a.shape == Shape::Vec4 && !a.normalized && matches!(a.component, U8 | U16),
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

/// Accessor by semantic.
pub type Attributes = BTreeMap<Semantic, usize>;

/// One part of a mesh with one material.
#[derive(Debug)]
pub struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<usize>,
    pub mode: u64,
    pub material: Option<usize>,
    /// Displacements by morph target.
    pub targets: Vec<Attributes>,
    /// Where its accessors' elements are, if those have no view.
    pub draco: Option<Draco>,
    pub extensions: Vec<String>,
    pub at: String,
}

/// A glTF mesh.
#[derive(Debug)]
pub struct Mesh {
    pub name: String,
    pub primitives: Vec<Primitive>,
    /// Default weights, one a morph target.
    pub weights: Vec<f32>,
    pub at: String,
}

impl Mesh {
    pub fn parse(
        json: &Json,
        lengths: &Lengths,
        accessors: &Table<Accessor>,
        views: &Table<View>,
        materials: &Table<Material>,
        quantized: bool,
        notes: &mut Notes,
    ) -> Result<Self> {
        let items = json.items("primitives")?;
        if items.is_empty() {
            return Err(json.bad("primitives", "at least one primitive", "none"));
        }
        let primitives = items
            .iter()
            .map(|item| Primitive::parse(item, lengths, accessors, views, materials, quantized, notes))
            .collect::<Result<Vec<_>>>()?;
        let targets = primitives[0].targets.len();
        if let Some(other) = primitives.iter().find(|p| p.targets.len() != targets) {
            let wanted = format!("{targets} targets as in the first primitive");
            return Err(bad(&format!("{}.targets", other.at), wanted, other.targets.len()));
        }
        let weights = read_weights(json, targets)?.unwrap_or_else(|| vec![0.0; targets]);
        Ok(Self { name: json.name()?, primitives, weights, at: json.at.clone() })
    }
}

/// `weights` of a mesh or node, one a morph target.
pub fn read_weights(json: &Json, targets: usize) -> Result<Option<Vec<f32>>> {
    let Some(weights) = json.numbers("weights")? else { return Ok(None) };
    if weights.len() != targets {
        return Err(json.bad("weights", format!("{targets} numbers, one a morph target"), weights.len()));
    }
    Ok(Some(weights.into_iter().map(|w| w as f32).collect()))
}

impl Primitive {
    fn parse(
        json: &Json,
        lengths: &Lengths,
        accessors: &Table<Accessor>,
        views: &Table<View>,
        materials: &Table<Material>,
        quantized: bool,
        notes: &mut Notes,
    ) -> Result<Self> {
        let mode = json.integer("mode")?.unwrap_or(4);
        if mode > 6 {
            return Err(json.bad("mode", "0 to 6", mode));
        }
        let mut all_accessors = Vec::new();
        let members = json.need("attributes", json.get("attributes")?)?;
        let attributes = parse_attributes(&members, accessors, false, quantized, &mut all_accessors, notes)?;
        let mut targets = Vec::new();
        for target in json.items("targets")? {
            targets.push(parse_attributes(&target, accessors, true, quantized, &mut all_accessors, notes)?);
        }
        // Every attribute, also those that are not read, has one element a vertex.
        if let Some(&first) = attributes.values().next().or(all_accessors.first()) {
            let count = accessors.get(first)?.count;
            for &other in &all_accessors {
                let found = accessors.get(other)?.count;
                if found != count {
                    let wanted =
                        format!("as many elements in every attribute and target ({count}, as in accessors[{first}])");
                    return Err(json.bad("attributes", wanted, format!("{found} in accessors[{other}]")));
                }
            }
        }
        let sets = |f: fn(u32) -> Semantic| (0..).take_while(|&i| attributes.contains_key(&f(i))).count();
        let all = |f: fn(&Semantic) -> bool| attributes.keys().filter(|s| f(s)).count();
        let joints = (sets(Semantic::Joints), all(|s| matches!(s, Semantic::Joints(_))));
        let weights = (sets(Semantic::Weights), all(|s| matches!(s, Semantic::Weights(_))));
        if joints != weights || joints.0 != joints.1 {
            return Err(json.bad(
                "attributes",
                "JOINTS_n and WEIGHTS_n in pairs, from 0 on",
                format!("{} and {}", joints.1, weights.1),
            ));
        }
        let indices = json.index("indices", lengths.accessors, "accessors")?;
        if let Some(index) = indices {
            let a = accessors.get(index)?;
            let unsigned = matches!(a.component, Component::U8 | Component::U16 | Component::U32);
            if a.shape != Shape::Scalar || !unsigned || a.normalized {
                return Err(json.bad("indices", "SCALAR of UNSIGNED_BYTE, UNSIGNED_SHORT or UNSIGNED_INT", a.format()));
            }
            if let Some(view) = a.view.map(|view| views.get(view)).transpose()?.filter(|view| view.stride.is_some()) {
                return Err(json.bad("indices", "a bufferView without byteStride", &view.at));
            }
            all_accessors.push(index);
        }
        let mut material = json.index("material", lengths.materials, "materials")?;
        if let Some(variants) = json.extension("KHR_materials_variants")? {
            for mapping in variants.items("mappings")? {
                let to = mapping.index("material", lengths.materials, "materials")?;
                let of = "extensions.KHR_materials_variants.variants";
                let whose = mapping.indices("variants", lengths.variants, of)?;
                if lengths.variant.is_some_and(|chosen| whose.contains(&chosen)) {
                    material = to;
                }
            }
        }
        // From normals, tangents could be made; without both there is no tangent space at all.
        let no_tangents = !attributes.contains_key(&Semantic::Tangent) && !attributes.contains_key(&Semantic::Normal);
        let shading = material.map(|index| materials.get(index)).transpose()?;
        if let Some(at) = shading.and_then(|m| m.needs_tangents.as_ref()).filter(|_| no_tangents) {
            return Err(json.bad("attributes", format!("NORMAL or TANGENT, which {at} needs"), "none"));
        }
        // With an uncompressed fallback there is nothing to decode.
        let draco = Draco::parse(json, &attributes, views.len())?.filter(|draco| {
            let mut coded = draco.attributes.keys().map(|semantic| attributes[semantic]).chain(indices);
            coded.any(|index| accessors.get(index).is_ok_and(|accessor| accessor.view.is_none()))
        });
        if draco.is_some() && (mode != 4 || indices.is_none()) {
            let wanted = "triangles with indices, as KHR_draco_mesh_compression packs them";
            return Err(json.bad(
                "mode",
                wanted,
                if indices.is_none() { "no indices".into() } else { mode.to_string() },
            ));
        }
        let extensions = json.extension_names()?.into_iter().map(Into::into).collect();
        Ok(Self { attributes, indices, mode, material, targets, draco, extensions, at: json.at.clone() })
    }

    /// Number of JOINTS/WEIGHTS pairs.
    pub fn skin_sets(&self) -> u32 {
        (0..).take_while(|&i| self.attributes.contains_key(&Semantic::Joints(i))).count() as u32
    }
}

fn parse_attributes(
    json: &Json,
    accessors: &Table<Accessor>,
    morph: bool,
    quantized: bool,
    all: &mut Vec<usize>,
    notes: &mut Notes,
) -> Result<Attributes> {
    let mut attributes = Attributes::new();
    for name in json.object()?.keys() {
        let index = json.need(name, json.index(name, accessors.len(), "accessors")?)?;
        all.push(index);
        if name.starts_with('_') {
            continue; // An application's own.
        }
        let Some(semantic) = Semantic::parse(name) else {
            notes.repaired(&json.path(name), format!("an attribute {name}, which the specification does not know"));
            continue;
        };
        let accessor = accessors.get(index)?;
        if !semantic.allows(accessor, morph, quantized) {
            return Err(json.bad(name, semantic.formats(), accessor.format()));
        }
        attributes.insert(semantic, index);
    }
    Ok(attributes)
}
