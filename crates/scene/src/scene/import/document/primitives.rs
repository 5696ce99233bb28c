//! Meshes and their primitives.

use super::accessors::{Accessor, Component, NOT_NORMALIZED, Shape, View, check_tight};
use super::attributes::{Attributes, Semantic, parse_attributes};
use super::draco::Draco;
use super::json::Json;
use super::materials::Material;
use super::table::Table;
use crate::error::Result;
use crate::scene::import::complaint::bad;

/// One part of a mesh with one material.
#[derive(Debug)]
pub struct Primitive {
    pub attributes: Attributes,
    pub indices: Option<usize>,
    pub mode: u64,
    pub material: Option<usize>,
    pub targets: Vec<Attributes>,
    /// Compressed source of the elements, if the accessors have no view.
    pub draco: Option<Draco>,
    pub extensions: Vec<String>,
    pub at: String,
}

#[derive(Debug)]
pub struct Mesh {
    pub name: String,
    pub primitives: Vec<Primitive>,
    /// Default weights, one per morph target.
    pub weights: Vec<f32>,
    pub at: String,
}

/// The parts of a document that primitives refer to.
#[derive(Clone, Copy)]
pub struct References<'a> {
    pub accessors: &'a Table<Accessor>,
    pub views: &'a Table<View>,
    pub materials: &'a Table<Material>,
    /// Whether the document requires KHR_mesh_quantization, which allows more formats of attributes.
    pub quantized: bool,
    pub variant: Option<usize>,
}

impl Mesh {
    pub fn parse(json: &Json, references: References) -> Result<Self> {
        let items = json.items("primitives")?;
        if items.is_empty() {
            json.repaired("primitives", "a mesh without primitives shows nothing");
        }
        let parsed = items.iter().map(|item| Primitive::parse(item, references)).collect::<Result<Vec<_>>>()?;
        let primitives: Vec<Primitive> = parsed.into_iter().flatten().collect();
        let targets = primitives.first().map_or(0, |first| first.targets.len());
        if let Some(other) = primitives.iter().find(|p| p.targets.len() != targets) {
            let wanted = format!("{targets} targets as in the first primitive");
            return Err(bad(&format!("{}.targets", other.at), wanted, other.targets.len()));
        }
        let weights = read_weights(json, targets)?.unwrap_or_else(|| vec![0.0; targets]);
        Ok(Self { name: json.name()?, primitives, weights, at: json.at.clone() })
    }
}

/// `weights` of a mesh or node, one per morph target.
pub(crate) fn read_weights(json: &Json, targets: usize) -> Result<Option<Vec<f32>>> {
    let Some(weights) = json.numbers("weights")? else { return Ok(None) };
    if targets == 0 && !weights.is_empty() {
        json.repaired("weights", "weights without morph targets have no effect");
        return Ok(None);
    }
    if weights.len() != targets {
        return Err(json.bad("weights", format!("{targets} numbers, one a morph target"), weights.len()));
    }
    Ok(Some(weights.into_iter().map(|w| w as f32).collect()))
}

impl Primitive {
    /// Parses a primitive; `None` for one without attributes, vertices or indices, which exporters leave beside others.
    fn parse(json: &Json, references: References) -> Result<Option<Self>> {
        let References { accessors, views, materials, quantized, variant } = references;
        let mode = json.integer("mode")?.unwrap_or(4);
        if mode > 6 {
            return Err(json.bad("mode", "0 to 6", mode));
        }
        let mut all_accessors = Vec::new();
        let members = json.need("attributes", json.get("attributes")?)?;
        let indices = json.index("indices", "accessors")?;
        let mut counted = [members.index("POSITION", "accessors")?, indices].into_iter().flatten();
        if members.object()?.is_empty() || counted.any(|i| json.is_empty_accessor(i)) {
            json.repaired("attributes", "a primitive without vertices or indices shows nothing");
            return Ok(None);
        }
        let attributes = parse_attributes(&members, accessors, false, quantized, &mut all_accessors)?;
        let mut targets = Vec::new();
        for target in json.items("targets")? {
            targets.push(parse_attributes(&target, accessors, true, quantized, &mut all_accessors)?);
        }
        // Every attribute, including unknown ones, has one element per vertex.
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
        if let Some(index) = indices {
            let a = accessors.get(index)?;
            let unsigned = matches!(a.component, Component::U8 | Component::U16 | Component::U32);
            if a.shape != Shape::Scalar || !unsigned {
                return Err(json.bad("indices", "SCALAR of UNSIGNED_BYTE, UNSIGNED_SHORT or UNSIGNED_INT", a.format()));
            }
            if a.normalized {
                json.repaired("indices", NOT_NORMALIZED);
            }
            if let Some(view) = a.view {
                check_tight(json, "indices", views.get(view)?, a.element_bytes())?;
            }
            all_accessors.push(index);
        }
        let mut material = json.index("material", "materials")?;
        if let Some(variants) = json.extension("KHR_materials_variants")? {
            for mapping in variants.items("mappings")? {
                let to = mapping.index("material", "materials")?;
                let whose = mapping.indices("variants", "extensions.KHR_materials_variants.variants")?;
                if variant.is_some_and(|chosen| whose.contains(&chosen)) {
                    material = to;
                }
            }
        }
        // Tangents can be generated from normals; without both there is no tangent space.
        let no_tangents = !attributes.contains_key(&Semantic::Tangent) && !attributes.contains_key(&Semantic::Normal);
        let shading = material.map(|index| materials.get(index)).transpose()?;
        if let Some(at) = shading.and_then(|m| m.needs_tangents.as_ref()).filter(|_| no_tangents) {
            return Err(json.bad("attributes", format!("NORMAL or TANGENT, which {at} needs"), "none"));
        }
        // An uncompressed fallback is used instead of the stream.
        let draco = Draco::parse(json, &attributes)?.filter(|draco| {
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
        let extensions = json.extension_names()?;
        Ok(Some(Self { attributes, indices, mode, material, targets, draco, extensions, at: json.at.clone() }))
    }

    /// Accessors of each pair of JOINTS and WEIGHTS.
    pub(crate) fn skin_sets(&self) -> impl Iterator<Item = (usize, usize)> {
        let accessor = move |semantic| self.attributes.get(&semantic).copied();
        (0..).map_while(move |i| Some((accessor(Semantic::Joints(i))?, accessor(Semantic::Weights(i))?)))
    }
}
