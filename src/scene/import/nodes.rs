//! The node tree, walked without recursion.

use std::collections::HashMap;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::accessors::{Accessor, Component, Reader, Shape};
use super::document::{Document, Lengths};
use super::extensions::{Support, support};
use super::json::{Json, bad};
use super::primitives::{Mesh, read_weights};
use super::report::Notes;
use crate::error::Result;
use crate::scene::{Camera, PunctualLight};

/// A checked node.
#[derive(Debug)]
pub(super) struct Node {
    pub name: String,
    pub children: Vec<usize>,
    /// To the parent's space.
    transform: DAffine3,
    mesh: Option<usize>,
    skin: Option<usize>,
    camera: Option<usize>,
    light: Option<usize>,
    weights: Option<Vec<f32>>,
    instancing: Option<Instancing>,
    visible: bool,
    extensions: Vec<String>,
    pub at: String,
}

/// EXT_mesh_gpu_instancing: accessors of translation, rotation, scale.
#[derive(Debug)]
struct Instancing {
    translation: Option<usize>,
    rotation: Option<usize>,
    scale: Option<usize>,
    all: Vec<usize>,
}

impl Node {
    pub fn parse(json: &Json, lengths: &Lengths, meshes: &[Mesh], accessors: &[Accessor]) -> Result<Self> {
        let mesh = json.index("mesh", lengths.meshes, "meshes")?;
        let skin = json.index("skin", lengths.skins, "skins")?;
        if let (Some(mesh), Some(_)) = (mesh, skin)
            && let Some(primitive) = meshes[mesh].primitives.iter().find(|p| p.skin_sets() == 0)
        {
            return Err(json.bad("skin", format!("JOINTS_0 and WEIGHTS_0 in {}", primitive.at), "none"));
        }
        let weights = read_weights(json, mesh.map_or(0, |m| meshes[m].weights.len()))?;
        let light = match json.extension("KHR_lights_punctual")? {
            Some(json) => {
                Some(json.need("light", json.index("light", lengths.lights, "extensions.KHR_lights_punctual.lights")?)?)
            }
            None => None,
        };
        let instancing = match json.extension("EXT_mesh_gpu_instancing")? {
            Some(json) => Some(Instancing::parse(&json, accessors)?),
            None => None,
        };
        let visible = match json.extension("KHR_node_visibility")? {
            Some(json) => json.boolean("visible", true)?,
            None => true,
        };
        Ok(Self {
            name: json.name()?,
            children: json.indices("children", lengths.nodes, "nodes")?,
            transform: transform(json)?,
            mesh,
            skin,
            camera: json.index("camera", lengths.cameras, "cameras")?,
            light,
            weights,
            instancing,
            visible,
            extensions: json.extension_names()?.into_iter().map(Into::into).collect(),
            at: json.at.clone(),
        })
    }

    /// Accessors of EXT_mesh_gpu_instancing.
    pub fn instancing_accessors(&self) -> impl Iterator<Item = usize> {
        self.instancing.iter().flat_map(|i| i.all.iter().copied())
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
            if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
                let row = format!("{}, {}, {}, {}", m[3], m[7], m[11], m[15]);
                return Err(json.bad("matrix", "a fourth row of 0, 0, 0, 1", row));
            }
            Ok(DAffine3::from_mat4(DMat4::from_cols_array(&m)))
        }
    }
}

impl Instancing {
    fn parse(json: &Json, accessors: &[Accessor]) -> Result<Self> {
        let attributes = json.need("attributes", json.get("attributes")?)?;
        let mut out = Self { translation: None, rotation: None, scale: None, all: Vec::new() };
        for name in attributes.object()?.keys() {
            let index = attributes.need(name, attributes.index(name, accessors.len(), "accessors")?)?;
            let a = &accessors[index];
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
        if let Some(&first) = out.all.first()
            && let Some(&other) = out.all.iter().find(|&&i| accessors[i].count != accessors[first].count)
        {
            let wanted = format!("{} elements in every attribute", accessors[first].count);
            return Err(json.bad("attributes", wanted, accessors[other].count));
        }
        Ok(out)
    }

    /// Instance to node space.
    fn transforms(&self, reader: &mut Reader) -> Result<Vec<DAffine3>> {
        let Some(&any) = self.all.first() else { return Ok(Vec::new()) };
        let accessor = &reader.document.accessors[any];
        let (at, count) = (accessor.at.clone(), accessor.count);
        // Each becomes a placement, which is larger than what it is read from.
        const PLACEMENT: u64 = 256;
        reader.budget.take(&at, count, PLACEMENT)?;
        let translation = self.translation.map(|i| reader.floats::<3>(i)).transpose()?;
        let rotation = self.rotation.map(|i| reader.floats::<4>(i)).transpose()?;
        let scale = self.scale.map(|i| reader.floats::<3>(i)).transpose()?;
        let place = |i: usize| {
            let t = translation.as_ref().map_or(DVec3::ZERO, |v| DVec3::from(v[i].map(f64::from)));
            let s = scale.as_ref().map_or(DVec3::ONE, |v| DVec3::from(v[i].map(f64::from)));
            let r = rotation.as_ref().map_or(DQuat::IDENTITY, |v| DQuat::from_array(v[i].map(f64::from)));
            let r = if r.length_squared() > 0.0 { r.normalize() } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(s, r, t)
        };
        Ok((0..count as usize).map(place).collect())
    }
}

/// Every node has at most one parent and nothing is its own ancestor.
pub(super) fn check_forest(nodes: &[Node]) -> Result<()> {
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
    // What cannot be reached from a node without a parent is a cycle.
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

/// What an object is made from: equal keys share their meshes.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct ObjectKey {
    pub mesh: usize,
    /// Bits of the morph weights.
    pub weights: Vec<u32>,
    pub skin: Option<usize>,
}

/// Where an object stands.
pub(super) struct Placement {
    pub name: String,
    pub world: DAffine3,
    pub at: String,
}

/// What the shown scene holds.
#[derive(Default)]
pub(super) struct Walk {
    /// Objects in the order of their first placement.
    pub objects: Vec<(ObjectKey, Vec<Placement>)>,
    pub cameras: Vec<Camera>,
    pub lights: Vec<PunctualLight>,
    /// Every node's transform to world space, also those of other scenes (joints may be anywhere).
    pub worlds: Vec<DMat4>,
}

/// Walks the shown scene.
///
/// # Errors
/// Instance data that cannot be read.
pub(super) fn walk(document: &Document, reader: &mut Reader, notes: &mut Notes) -> Result<Walk> {
    let nodes = &document.nodes;
    let mut worlds = vec![DAffine3::IDENTITY; nodes.len()];
    let mut is_child = vec![false; nodes.len()];
    nodes.iter().flat_map(|n| &n.children).for_each(|&c| is_child[c] = true);
    let mut stack: Vec<(usize, DAffine3)> =
        (0..nodes.len()).filter(|&i| !is_child[i]).map(|i| (i, DAffine3::IDENTITY)).collect();
    while let Some((index, parent)) = stack.pop() {
        worlds[index] = parent * nodes[index].transform;
        stack.extend(nodes[index].children.iter().map(|&child| (child, worlds[index])));
    }

    let mut out = Walk { worlds: worlds.iter().map(|&w| w.into()).collect(), ..Default::default() };
    let mut by_key: HashMap<ObjectKey, usize> = HashMap::new();
    let mut shown = vec![false; nodes.len()];
    // In the document's order, depth first.
    let mut stack: Vec<(usize, bool)> = document.roots.iter().rev().map(|&root| (root, true)).collect();
    while let Some((index, parent_visible)) = stack.pop() {
        let node = &nodes[index];
        let visible = parent_visible && node.visible;
        shown[index] = true;
        stack.extend(node.children.iter().rev().map(|&child| (child, visible)));
        for name in &node.extensions {
            if let Support::Ignored { why, .. } = support(name) {
                notes.ignored(&format!("{}.extensions.{name}", node.at), format!("{name}: {why}"));
            }
        }
        let world = worlds[index];
        if let Some(camera) = node.camera.map(|c| &document.cameras[c]) {
            let name = if node.name == node.at { camera.name.clone() } else { None };
            match camera.place(name.unwrap_or_else(|| node.name.clone()), &world) {
                Some(camera) => out.cameras.push(camera),
                None => notes.ignored(&node.at, "a camera whose node has no direction or place"),
            }
        }
        if !visible {
            if node.mesh.is_some() || node.light.is_some() {
                notes.not_loaded(&node.at, "a node that KHR_node_visibility hides");
            }
            continue;
        }
        if let Some(light) = node.light {
            out.lights.extend(document.lights[light].place(&node.name, &world, notes));
        }
        let Some(mesh) = node.mesh else { continue };
        let weights = node.weights.as_ref().unwrap_or(&document.meshes[mesh].weights);
        let key = ObjectKey { mesh, weights: weights.iter().map(|w| w.to_bits()).collect(), skin: node.skin };
        let placements = match by_key.get(&key) {
            Some(&i) => &mut out.objects[i].1,
            None => {
                by_key.insert(key.clone(), out.objects.len());
                out.objects.push((key, Vec::new()));
                match out.objects.last_mut() {
                    Some((_, placements)) => placements,
                    None => continue,
                }
            }
        };
        let place = |world: DAffine3| Placement { name: node.name.clone(), world, at: node.at.clone() };
        match &node.instancing {
            // Joints alone place a skinned mesh.
            _ if node.skin.is_some() => placements.push(place(DAffine3::IDENTITY)),
            Some(instancing) => {
                placements.extend(instancing.transforms(reader)?.into_iter().map(|t| place(world * t)));
            }
            None => placements.push(place(world)),
        }
    }
    for (node, _) in nodes.iter().zip(shown).filter(|(_, shown)| !shown) {
        if node.mesh.is_some() || node.camera.is_some() || node.light.is_some() {
            notes.not_loaded(&node.at, "a node that is not in the shown scene");
        }
    }
    Ok(out)
}
