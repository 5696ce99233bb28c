//! Flattens the node tree into placed objects, cameras and lights, without recursion.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Affine3A, DAffine3, DQuat, DVec3};

use super::reader::Reader;
use super::time_samples::TimeSamples;
use super::unshown::note_extensions;
use super::{cameras, lights};
use crate::error::{Error, Result};
use crate::scene::import::document::Document;
use crate::scene::import::document::cameras::STAND_IN;
use crate::scene::import::document::nodes::Instancing;
use crate::scene::import::report::Notes;
use crate::scene::{Camera, Instance, LightNode, Motion, PunctualLight};

/// Identity of an object: nodes with equal keys share their meshes.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct ObjectKey {
    pub mesh: usize,
    /// Bits of the morph weights.
    pub weights: Vec<u32>,
    /// Bits of the morph weights at each time sample; empty if they do not change.
    pub weights_over_time: Vec<Vec<u32>>,
    pub skin: Option<usize>,
}

pub struct Placement {
    pub name: String,
    /// [`Instance::category`].
    pub category: Option<Arc<str>>,
    /// [`Instance::light_group`].
    pub light_group: Option<Arc<str>>,
    pub world: DAffine3,
    pub at: String,
    /// Index of the node that has the mesh.
    pub from: usize,
    /// Index of the node, and the transform from object to node space; `None` for skinned meshes, which joints place.
    pub node: Option<(usize, DAffine3)>,
}

impl Placement {
    /// The instance of an object whose meshes are in world space.
    pub fn instance(&self, object: u32) -> Instance {
        let (name, category, light_group) = (self.name.clone(), self.category.clone(), self.light_group.clone());
        Instance { name, category, light_group, object, ..Default::default() }
    }

    /// Object to world at each time sample; empty for what does not move, and for skinned meshes.
    pub(crate) fn transforms_at(&self, times: &TimeSamples) -> Vec<DAffine3> {
        self.node.iter().flat_map(|&(node, local)| times.of(node).iter().map(move |m| m.world * local)).collect()
    }
}

/// Contents of the shown scene, in world space.
#[derive(Default)]
pub struct FlattenedScene {
    /// Objects with their placements, in the order of their first placement.
    pub objects: Vec<(ObjectKey, Vec<Placement>)>,
    pub cameras: Vec<Camera>,
    pub lights: Vec<PunctualLight>,
    pub light_nodes: Vec<LightNode>,
    /// Every node's transform to world space, also those of other scenes (joints may be anywhere).
    pub worlds: Vec<DAffine3>,
}

/// Flattens the shown scene.
/// Errors: Instance data that cannot be read.
pub fn flatten(
    document: &Document,
    times: &TimeSamples,
    reader: &mut Reader,
    notes: &mut Notes,
) -> Result<FlattenedScene> {
    let (nodes, worlds) = (&document.nodes, document.world_transforms());
    let mut out = FlattenedScene::default();
    let mut by_key: HashMap<ObjectKey, usize> = HashMap::new();
    let mut shown = vec![false; nodes.len()];
    // In the document's order, depth first.
    let mut stack: Vec<_> =
        document.roots.iter().rev().map(|&root| (root, true, [const { None::<Arc<str>> }; 2])).collect();
    while let Some((index, parent_visible, [parent_category, parent_group])) = stack.pop() {
        let (node, samples) = (&nodes[index], times.of(index));
        let content = node.content()?;
        let visible = parent_visible && content.visible;
        shown[index] = true;
        let category = node.category.clone().or(parent_category);
        let light_group = node.light_group.clone().or(parent_group);
        let inherited = [category.clone(), light_group.clone()];
        stack.extend(node.children.iter().rev().map(|&child| (child, visible, inherited.clone())));
        note_extensions(&node.at, &content.extensions, notes);
        let world = worlds[index];
        if let Some(camera) = content.camera.map(|c| document.cameras.get(c)) {
            // An error where it is the one that is rendered.
            let (camera, fault) = match camera {
                Ok(camera) => (camera, None),
                Err(error) => (&STAND_IN, Some(error.to_string().into())),
            };
            let name = if node.name == node.at { camera.name.clone() } else { None };
            match cameras::place(camera, name.unwrap_or_else(|| node.name.clone()), &world) {
                Some(placed) => {
                    let transforms = samples.iter().map(|m| cameras::place(camera, String::new(), &m.world));
                    let transforms: Option<Vec<_>> = transforms.map(|camera| Some(camera?.to_world)).collect();
                    let (transforms, after) = transforms.as_deref().map_or((&[][..], &[][..]), |transforms| {
                        transforms.split_at(times.shutter.min(transforms.len()))
                    });
                    let motion = Motion::new(&transforms.iter().map(to_f64).collect::<Vec<_>>()).map(Arc::new);
                    let adjacent_frames =
                        after.try_into().ok().filter(|adjacent_frames| *adjacent_frames != [placed.to_world; 2]);
                    out.cameras.push(Camera { motion, adjacent_frames, fault, ..placed });
                }
                None => notes.ignored(&node.at, "a camera whose node has no direction or place"),
            }
        }
        if !visible {
            if content.mesh.is_some() || content.light.is_some() {
                notes.not_loaded(&node.at, "a node that KHR_node_visibility hides");
            }
            continue;
        }
        let light = content.light.map(|light| document.lights.get(light)).transpose()?;
        if let Some(mut placed) = light.and_then(|light| lights::place(light, &node.name, &world, notes)) {
            placed.set_size(node.light_size.radius, node.light_size.angle);
            let motion: Option<Vec<_>> = samples.iter().take(times.shutter).map(|m| m.light).collect();
            let motion = motion.filter(|keys| keys.iter().any(|key| *key != placed.key()));
            let group = light_group.clone().or_else(|| light?.group.clone());
            out.light_nodes.push(LightNode { name: node.name.clone(), group });
            out.lights.push(PunctualLight { motion: motion.unwrap_or_default(), ..placed });
        }
        let Some(mesh) = content.mesh else { continue };
        let weights = content.weights.as_ref().unwrap_or(&document.meshes.get(mesh)?.weights);
        let bits = |weights: &[f32]| weights.iter().map(|w| w.to_bits()).collect::<Vec<_>>();
        let mut weights_over_time: Vec<_> = samples.iter().map(|m| bits(&m.weights)).collect();
        if weights_over_time.iter().all(|time_sample| *time_sample == bits(weights)) {
            weights_over_time.clear();
        }
        let key = ObjectKey { mesh, weights: bits(weights), weights_over_time, skin: content.skin };
        let object = *by_key.entry(key.clone()).or_insert(out.objects.len());
        if object == out.objects.len() {
            out.objects.push((key, Vec::new()));
        }
        let placements = &mut out.objects[object].1;
        let place = |world: DAffine3, inside: Option<(usize, DAffine3)>| Placement {
            name: node.name.clone(),
            category: category.clone(),
            light_group: light_group.clone(),
            world,
            at: node.at.clone(),
            from: index,
            node: inside,
        };
        match &content.instancing {
            // The specification ignores the node transform of a skinned mesh.
            _ if content.skin.is_some() => placements.push(place(DAffine3::IDENTITY, None)),
            Some(instancing) => {
                let all = instances(instancing, reader)?;
                placements.extend(all.into_iter().map(|t| place(world * t, Some((index, t)))));
            }
            None => placements.push(place(world, Some((index, DAffine3::IDENTITY)))),
        }
    }
    for (node, _) in nodes.iter().zip(shown).filter(|(_, shown)| !shown) {
        if node.content().is_ok_and(|c| c.mesh.is_some() || c.camera.is_some() || c.light.is_some()) {
            notes.not_loaded(&node.at, "a node that is not in the shown scene");
        }
    }
    out.worlds = worlds;
    Ok(out)
}

fn to_f64(transform: &Affine3A) -> DAffine3 {
    DAffine3::from_cols_array(&transform.to_cols_array().map(f64::from))
}

/// Transforms from instance to node space (EXT_mesh_gpu_instancing).
pub fn instances(from: &Instancing, reader: &mut Reader) -> Result<Vec<DAffine3>> {
    let Some(&any) = from.all.first() else { return Ok(Vec::new()) };
    let accessor = reader.document.accessors.get(any)?;
    let (at, count) = (accessor.at.clone(), accessor.count);
    // All of them are in one place: every ray that meets one meets all.
    const MAX_IN_ONE_PLACE: u64 = 4096;
    let without_data = |&index: &usize| match reader.document.accessors.get(index) {
        Ok(accessor) if accessor.view.is_none() => {
            count.saturating_sub(accessor.sparse.as_ref().map_or(0, |sparse| sparse.count))
        }
        _ => 0,
    };
    let in_one_place = from.all.iter().map(without_data).min().unwrap_or(0);
    if in_one_place > MAX_IN_ONE_PLACE {
        return Err(Error::Data(format!(
            "{at}: {in_one_place} instances without data, that is all in one place; at most {MAX_IN_ONE_PLACE} are shown: give the \
             accessor a bufferView, or is the file damaged?"
        )));
    }
    // Size of a placement, which exceeds that of the attributes that it is read from.
    const BYTES_PER_PLACEMENT: u64 = 256;
    reader.budget.take(&at, count, BYTES_PER_PLACEMENT)?;
    let translation = from.translation.map(|i| reader.floats::<3>(i)).transpose()?;
    let rotation = from.rotation.map(|i| reader.floats::<4>(i)).transpose()?;
    let scale = from.scale.map(|i| reader.floats::<3>(i)).transpose()?;
    let place = |i: usize| {
        let t = translation.as_ref().map_or(DVec3::ZERO, |v| DVec3::from(v[i].map(f64::from)));
        let s = scale.as_ref().map_or(DVec3::ONE, |v| DVec3::from(v[i].map(f64::from)));
        let r = rotation.as_ref().map_or(DQuat::IDENTITY, |v| DQuat::from_array(v[i].map(f64::from)));
        let r = if r.length_squared() == 0.0 { DQuat::IDENTITY } else { r.normalize() };
        DAffine3::from_scale_rotation_translation(s, r, t)
    };
    Ok((0..count as usize).map(place).collect())
}
