//! Nodes of the document, which form a forest.

use std::sync::Arc;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::accessors::{Accessor, Component, Shape};
use super::json::{Json, extra};
use super::lights::LIGHTS;
use super::lights::Size;
use super::primitives::{Mesh, read_weights};
use super::table::Table;
use crate::error::Result;
use crate::scene::import::complaint::bad;

#[derive(Debug)]
pub struct Node {
    pub name: String,
    /// `extras.category`, if it is a text.
    pub category: Option<Arc<str>>,
    /// `extras.light_group`, if it is a text.
    pub light_group: Option<Arc<str>>,
    /// A size in its `extras`, which goes before that of its light.
    pub light_size: Size,
    pub children: Vec<usize>,
    /// To the parent's space.
    pub transform: DAffine3,
    pub at: String,
    content: Result<Content>,
}

/// What a node refers to.
#[derive(Debug)]
pub struct Content {
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub camera: Option<usize>,
    pub light: Option<usize>,
    pub weights: Option<Vec<f32>>,
    pub instancing: Option<Instancing>,
    pub visible: bool,
    pub extensions: Vec<String>,
}

/// EXT_mesh_gpu_instancing: accessors of translation, rotation, scale.
#[derive(Debug)]
pub struct Instancing {
    pub translation: Option<usize>,
    pub rotation: Option<usize>,
    pub scale: Option<usize>,
    /// Accessors of all attributes, including unknown ones.
    pub all: Vec<usize>,
}

impl Node {
    /// Parses a node. Faults of its transform and children are errors; faults of its content are errors where it is shown.
    pub fn parse(json: &Json, meshes: &Table<Mesh>, accessors: &Table<Accessor>) -> Result<Self> {
        Ok(Self {
            name: json.name()?,
            category: extra(json, "category"),
            light_group: extra(json, "light_group"),
            light_size: Size::parse(json),
            children: json.indices("children", "nodes")?,
            transform: transform(json)?,
            at: json.at.clone(),
            content: Content::parse(json, meshes, accessors),
        })
    }

    /// What the node refers to.
    /// Errors: Its fault, if it is invalid.
    pub fn content(&self) -> Result<&Content> {
        self.content.as_ref().map_err(Clone::clone)
    }
}

impl Content {
    fn parse(json: &Json, meshes: &Table<Mesh>, accessors: &Table<Accessor>) -> Result<Self> {
        let mesh = json.index("mesh", "meshes")?;
        let skin = json.index("skin", "skins")?;
        let shape = mesh.map(|index| meshes.get(index)).transpose()?;
        if let (Some(shape), Some(_)) = (shape, skin)
            && let Some(primitive) = shape.primitives.iter().find(|p| p.skin_sets().next().is_none())
        {
            return Err(json.bad("skin", format!("JOINTS_0 and WEIGHTS_0 in {}", primitive.at), "none"));
        }
        let weights = read_weights(json, shape.map_or(0, |shape| shape.weights.len()))?;
        let index = |json: Json| json.need("light", json.index("light", LIGHTS)?);
        let light = json.extension("KHR_lights_punctual")?.map(index).transpose()?;
        let instancing = json.extension("EXT_mesh_gpu_instancing")?;
        let instancing = instancing.map(|json| Instancing::parse(&json, accessors)).transpose()?;
        let visible = json.extension("KHR_node_visibility")?.map_or(Ok(true), |json| json.boolean("visible", true))?;
        let camera = json.index("camera", "cameras")?;
        let extensions = json.extension_names()?;
        Ok(Self { mesh, skin, camera, light, weights, instancing, visible, extensions })
    }
}

fn transform(json: &Json) -> Result<DAffine3> {
    let translation = json.vector::<3>("translation")?.map_or(DVec3::ZERO, DVec3::from);
    let scale = json.vector::<3>("scale")?.map_or(DVec3::ONE, DVec3::from);
    let rotation = json.vector::<4>("rotation")?.map_or(DQuat::IDENTITY, DQuat::from_array);
    if rotation.length_squared() == 0.0 {
        return Err(json.bad("rotation", "a quaternion of length 1", "zeros"));
    }
    match json.vector::<16>("matrix")? {
        None => Ok(DAffine3::from_scale_rotation_translation(scale, rotation.normalize(), translation)),
        Some(m) => {
            let off = [m[3], m[7], m[11], m[15] - 1.0].into_iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            if off > 0.0 && off < 1e-5 {
                json.repaired("matrix", "a fourth row that is 0, 0, 0, 1 but for rounding");
            } else if off > 0.0 {
                let row = format!("{}, {}, {}, {}", m[3], m[7], m[11], m[15]);
                return Err(json.bad("matrix", "a fourth row of 0, 0, 0, 1", row));
            }
            Ok(DAffine3::from_mat4(DMat4::from_cols_array(&m)))
        }
    }
}

impl Instancing {
    fn parse(json: &Json, accessors: &Table<Accessor>) -> Result<Self> {
        let attributes = json.need("attributes", json.get("attributes")?)?;
        let mut out = Self { translation: None, rotation: None, scale: None, all: Vec::new() };
        for name in attributes.object()?.keys() {
            let index = attributes.need(name, attributes.index(name, "accessors")?)?;
            let a = accessors.get(index)?;
            let float = a.component == Component::F32;
            let (fits, slot) = match name.as_str() {
                "TRANSLATION" => (a.shape == Shape::Vec3 && float, Some(&mut out.translation)),
                "SCALE" => (a.shape == Shape::Vec3 && float, Some(&mut out.scale)),
                "ROTATION" => {
                    let snorm = a.normalized && matches!(a.component, Component::I8 | Component::I16);
                    (a.shape == Shape::Vec4 && (float || snorm), Some(&mut out.rotation))
                }
                _ => (true, None),
            };
            if !fits {
                return Err(attributes.bad(name, "VEC3 of FLOAT (ROTATION: VEC4, or normalized integers)", a.format()));
            }
            if let Some(slot) = slot {
                *slot = Some(index);
            }
            out.all.push(index);
        }
        let counts = out.all.iter().map(|&index| Ok(accessors.get(index)?.count)).collect::<Result<Vec<_>>>()?;
        if let Some(other) = counts.iter().find(|&&count| count != counts[0]) {
            return Err(json.bad("attributes", format!("{} elements in every attribute", counts[0]), other));
        }
        Ok(out)
    }
}

/// Checks that every node has at most one parent and is not its own ancestor.
pub(crate) fn check_forest(nodes: &[Node]) -> Result<()> {
    let mut parent: Vec<Option<usize>> = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for (i, &child) in node.children.iter().enumerate() {
            if let Some(other) = parent[child].replace(index) {
                return Err(bad(
                    &format!("{}.children[{i}]", node.at),
                    "nodes with at most one parent, and no cycles",
                    format!("nodes[{child}], which is also a child of nodes[{other}]"),
                ));
            }
        }
    }
    // Nodes that cannot be reached from a node without a parent form a cycle.
    let mut reached = vec![false; nodes.len()];
    let mut stack: Vec<usize> = (0..nodes.len()).filter(|&i| parent[i].is_none()).collect();
    while let Some(index) = stack.pop() {
        reached[index] = true;
        stack.extend(&nodes[index].children);
    }
    match reached.iter().position(|r| !r) {
        None => Ok(()),
        Some(index) => Err(bad(&nodes[index].at, "a tree of nodes", "a node that is its own ancestor")),
    }
}

/// For each node: is it a child of another?
pub(crate) fn have_parents(nodes: &[Node]) -> Vec<bool> {
    let mut is_child = vec![false; nodes.len()];
    nodes.iter().flat_map(|n| &n.children).for_each(|&child| is_child[child] = true);
    is_child
}

/// Indices of the nodes without a parent.
pub(crate) fn top_nodes(nodes: &[Node]) -> Vec<usize> {
    let is_child = have_parents(nodes);
    (0..nodes.len()).filter(|&i| !is_child[i]).collect()
}
