//! What the surfaces of a document reach while its animations play, so that all frames have one view and one ground.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DMat4, DQuat, DVec3};
use rayon::prelude::*;
use serde_json::Value;

use super::nodes::instances;
use super::placements::corners;
use super::pose::{Track, chosen};
use super::reader::Reader;
use super::skins::joint_matrices;
use super::transforms::is_visible;
use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::attributes::Semantic;
use crate::scene::import::document::nodes::top_nodes;
use crate::scene::import::document::primitives::Primitive;
use crate::scene::import::options::Pose;
use crate::scene::{AnimatedBounds, Framing, MAX_COORDINATE};

/// Times at most, so many that there is one between keys that are closer, times between two keys, and points at all times together.
const MAX_TIMES: usize = 512;
const ENOUGH_TIMES: usize = 64;
const TIMES_BETWEEN_KEYS: usize = 16;
const MAX_POINTS: usize = 1 << 18;
/// A mesh of more vertices is represented by the outermost ones in so many directions, or in fewer of each joint.
const MAX_VERTICES: usize = 512;
const DIRECTIONS: usize = 66;
const DIRECTIONS_PER_JOINT: usize = 26;

/// Calls a function with each of some points (world space).
type VisitPoints<'a> = dyn Fn(&mut dyn FnMut(DVec3)) + 'a;

/// A vertex, with what moves it.
struct Vertex {
    position: DVec3,
    /// Displacements by the morph targets.
    morphs: Vec<DVec3>,
    /// Joints with their weights, whose sum is 1; without a skin the node is joint 0.
    joints: Vec<(usize, f64)>,
}

impl Vertex {
    fn rigid(position: DVec3) -> Self {
        Self { position, morphs: Vec::new(), joints: vec![(0, 1.0)] }
    }
}

/// A moving mesh at a node.
struct Shown<'a> {
    node: usize,
    vertices: Vec<Vertex>,
    /// Of the morph targets: the weights at rest, their tracks, and the track of all.
    weights: Vec<(f64, Option<&'a Track>)>,
    all_weights: Option<&'a Track>,
    /// Nodes that move the vertices, with inverse bind matrices; its own where there is no skin.
    joints: Vec<(usize, DMat4)>,
}

/// A node that moves: what it hangs on, and its translation, rotation and scale at rest.
struct Part<'a> {
    node: usize,
    parent: DAffine3,
    /// Index of the parent's part, if it moves too.
    moving_parent: Option<usize>,
    /// Is it visible at rest, and what is above it up to the moving parent?
    visible: bool,
    shown: bool,
    rest: [Vec<f64>; 3],
    /// Those of `rest`, and of visibility.
    tracks: [Option<&'a Track>; 4],
}

/// The keys that move, show or hide surfaces.
#[derive(Debug)]
pub struct Played {
    tracks: HashMap<String, Track>,
    /// By node: does it, or one above it, move?
    moved: Vec<bool>,
    /// By node: do its surfaces move?
    surfaces: Vec<bool>,
    /// What came of [`Self::reach`].
    pub reached: OnceLock<Option<Arc<AnimatedBounds>>>,
}

impl Played {
    /// `None` if no surface moves. Faulty channels are left out; where they are played, reading them is an error.
    /// Errors: An animation that is not there.
    pub fn read(reader: &mut Reader, pose: &Pose) -> Result<Option<Self>> {
        let document = reader.document;
        let mut tracks = HashMap::new();
        let channels =
            chosen(document, pose)?.filter_map(|i| document.animations.get(i).ok()).flat_map(|a| &a.channels);
        for channel in channels.filter(|channel| moves(&channel.pointer)) {
            if let Ok(Some(track)) = Track::read(reader, channel) {
                tracks.insert(channel.pointer.clone(), track);
            }
        }
        let mut moved = vec![false; document.nodes.len()];
        let node = |pointer: &String| pointer.strip_prefix("/nodes/")?.split('/').next()?.parse::<usize>().ok();
        tracks.keys().filter_map(node).for_each(|node| moved.get_mut(node).into_iter().for_each(|moved| *moved = true));
        let mut stack: Vec<usize> = (0..moved.len()).filter(|&node| moved[node]).collect();
        while let Some(node) = stack.pop() {
            stack.extend(
                document.nodes[node].children.iter().filter(|&&child| !std::mem::replace(&mut moved[child], true)),
            );
        }
        let moves = |node: usize| {
            let Ok(content) = document.nodes[node].content() else { return false };
            let Some(mesh) = content.mesh else { return false };
            let joints =
                content.skin.and_then(|skin| document.skins.get(skin).ok()).map_or(&[][..], |skin| &skin.joints);
            let weights = format!("/meshes/{mesh}/weights");
            moved[node] || joints.iter().any(|joint| moved[*joint]) || tracks.keys().any(|p| p.starts_with(&weights))
        };
        let surfaces: Vec<bool> = (0..moved.len()).map(moves).collect();
        Ok(surfaces.contains(&true).then_some(Self { tracks, moved, surfaces, reached: OnceLock::new() }))
    }

    /// Do surfaces at the node stay where they are?
    pub(crate) fn is_still(&self, node: usize) -> bool {
        !self.surfaces[node]
    }

    /// The bounds over the whole animation: keys, and times between them. `json` is the document at rest; `still` visits the
    /// points of surfaces that do not move. Faulty elements are left out; where they are shown, reading them is an error.
    pub fn reach(&self, reader: &mut Reader, json: &Value, still: &VisitPoints) -> Option<AnimatedBounds> {
        let document = reader.document;
        let base = document.world_transforms();
        let shown = self.shown(reader);
        let parts = self.parts(document, json, &base);
        let part_of: HashMap<usize, usize> = parts.iter().enumerate().map(|(i, part)| (part.node, i)).collect();
        let points: usize = shown.iter().map(|shown| shown.vertices.len()).sum();
        let at = |seconds: f64| {
            let state = state(&parts, seconds);
            let place = |node: usize| part_of.get(&node).map_or((base[node], true), |&part| state[part]);
            shown.iter().flat_map(|shown| shown.points(seconds, &place)).collect::<Vec<_>>()
        };
        let times = self.times((MAX_POINTS / points.max(1)).clamp(16, MAX_TIMES));
        let mut all: Vec<DVec3> = times.into_par_iter().map(at).collect::<Vec<_>>().concat();
        // What lies beyond cannot be shown.
        all.retain(|p| p.abs().max_element() <= f64::from(MAX_COORDINATE));
        let (mut framing, mut low, mut high, mut radius) =
            (Framing::default(), DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0_f64);
        all.chunks(8).for_each(|near| framing.include_near(near));
        let visit = |include: &mut dyn FnMut(DVec3)| {
            all.iter().copied().for_each(&mut *include);
            still(include);
        };
        visit(&mut |p| (low, high) = (low.min(p), high.max(p)));
        still(&mut |p| framing.include(p));
        let centre = 0.5 * (low + high);
        visit(&mut |p| radius = radius.max(p.distance(centre)));
        let bounds = [low.as_vec3(), high.as_vec3()];
        centre.is_finite().then_some(AnimatedBounds { bounds, sphere: (centre, radius), framing })
    }

    /// The meshes of the shown scene that move, hidden ones too.
    fn shown(&self, reader: &mut Reader) -> Vec<Shown<'_>> {
        let document = reader.document;
        let (mut shown, mut stack) = (Vec::new(), document.roots.clone());
        while let Some(node) = stack.pop() {
            let Ok(content) = document.nodes[node].content() else { continue };
            if !content.visible && !self.moved[node] {
                continue;
            }
            stack.extend(&document.nodes[node].children);
            let Some(mesh) = content.mesh.filter(|_| self.surfaces[node]) else { continue };
            let skin = content.skin.and_then(|skin| document.skins.get(skin).ok());
            let binds =
                skin.and_then(|skin| joint_matrices(skin, reader, &|_| DAffine3::IDENTITY).ok()).unwrap_or_default();
            let placements = content.instancing.as_ref().map(|from| instances(from, reader).unwrap_or_default());
            let mut vertices = vertices(reader, mesh, !binds.is_empty()).unwrap_or_default();
            if let (Some(placements), None) = (placements, skin) {
                let shapes =
                    vertices.iter().flat_map(|v| [DVec3::ZERO].iter().chain(&v.morphs).map(|d| v.position + *d));
                let of_one = corners(shapes);
                let all = placements.iter().flat_map(|own| of_one.iter().map(|p| own.transform_point3(*p)));
                vertices = corners(all.filter(|p| p.is_finite())).into_iter().map(Vertex::rigid).collect();
            }
            let joints = skin.map_or_else(|| vec![node], |skin| skin.joints.clone());
            vertices.retain(|v| v.joints.iter().all(|(joint, _)| *joint < joints.len()));
            let of_mesh = document.meshes.get(mesh).map(|mesh| &mesh.weights[..]).unwrap_or_default();
            let rest = content.weights.as_deref().unwrap_or(of_mesh);
            let own = format!("/nodes/{node}/weights");
            let is_own = content.weights.is_some() || self.tracks.keys().any(|pointer| pointer.starts_with(&own));
            let base = if is_own { own } else { format!("/meshes/{mesh}/weights") };
            let one = |(i, rest): (usize, &f32)| (f64::from(*rest), self.tracks.get(&format!("{base}/{i}")));
            let weights: Vec<_> = rest.iter().enumerate().map(one).collect();
            let bind = |(joint, node): (usize, usize)| (node, binds.get(joint).copied().unwrap_or(DMat4::IDENTITY));
            let (all_weights, joints) = (self.tracks.get(&base), joints.into_iter().enumerate().map(bind).collect());
            shown.push(Shown { node, vertices, weights, all_weights, joints });
        }
        shown
    }

    /// The nodes that move, parents before children.
    fn parts(&self, document: &Document, json: &Value, base: &[DAffine3]) -> Vec<Part<'_>> {
        let nodes = &document.nodes;
        let mut parts = Vec::new();
        let mut stack: Vec<(usize, DAffine3, Option<usize>, bool)> =
            top_nodes(nodes).into_iter().map(|i| (i, document.base(), None, true)).collect();
        while let Some((node, parent, mut moving_parent, mut visible)) = stack.pop() {
            let own = nodes[node].content().is_ok_and(|content| content.visible);
            if self.moved[node] {
                let tracks = ["translation", "rotation", "scale", "extensions/KHR_node_visibility/visible"]
                    .map(|name| self.tracks.get(&format!("/nodes/{node}/{name}")));
                let rest = at_rest(&json["nodes"][node]);
                parts.push(Part { node, parent, moving_parent, visible: own, shown: visible, rest, tracks });
                (moving_parent, visible) = (Some(parts.len() - 1), true);
            } else {
                visible &= own;
            }
            stack.extend(nodes[node].children.iter().map(|&child| (child, base[node], moving_parent, visible)));
        }
        parts
    }

    /// The times of all keys, as many as `most`, and times between them.
    fn times(&self, most: usize) -> Vec<f64> {
        let mut keys: Vec<f64> = self.tracks.values().flat_map(|track| &track.times).copied().collect();
        keys.sort_by(f64::total_cmp);
        keys.dedup();
        let steps = keys.len() - 1;
        if steps + 1 >= most {
            return (0..most).map(|i| keys[i * steps / (most - 1)]).collect();
        }
        let parts = (ENOUGH_TIMES.min(most) / steps.max(1)).clamp(1, TIMES_BETWEEN_KEYS);
        let between = |pair: &[f64]| {
            (0..parts).map(|i| pair[0] + (pair[1] - pair[0]) * i as f64 / parts as f64).collect::<Vec<_>>()
        };
        keys.windows(2).flat_map(between).chain(keys.last().copied()).collect()
    }
}

/// World transforms of the parts at one time, and whether they are visible.
fn state(parts: &[Part], seconds: f64) -> Vec<(DAffine3, bool)> {
    let mut placed: Vec<(DAffine3, bool)> = Vec::with_capacity(parts.len());
    for part in parts {
        let value = |i: usize| part.tracks[i].map_or_else(|| part.rest[i].clone(), |track| track.at(seconds));
        let rotation = DQuat::from_slice(&value(1));
        let local = DAffine3::from_scale_rotation_translation(
            DVec3::from_slice(&value(2)),
            if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY },
            DVec3::from_slice(&value(0)),
        );
        let visible = part.tracks[3].map_or(part.visible, |track| track.at(seconds)[0] != 0.0);
        let (parent, above) = part.moving_parent.map_or((part.parent, part.shown), |parent| placed[parent]);
        placed.push((parent * local, above && visible));
    }
    placed
}

impl Shown<'_> {
    /// The vertices at one time; none while it is hidden or has no size.
    fn points(&self, seconds: f64, place: &dyn Fn(usize) -> (DAffine3, bool)) -> Vec<DVec3> {
        let worlds: Vec<DAffine3> = self.joints.iter().map(|(node, _)| place(*node).0).collect();
        if !place(self.node).1 || !worlds.iter().any(is_visible) {
            return Vec::new();
        }
        let all = self.all_weights.map(|track| track.at(seconds));
        let weight = |(i, (rest, track)): (usize, &(f64, Option<&Track>))| {
            let one = track.map(|track| track.at(seconds)[0]);
            one.or_else(|| all.as_ref()?.get(i).copied()).unwrap_or(*rest)
        };
        let weights: Vec<f64> = self.weights.iter().enumerate().map(weight).collect();
        let matrices: Vec<DMat4> =
            worlds.iter().zip(&self.joints).map(|(world, (_, bind))| DMat4::from(*world) * *bind).collect();
        let position = |vertex: &Vertex| {
            let p = vertex.morphs.iter().zip(&weights).fold(vertex.position, |p, (delta, w)| p + *delta * *w);
            vertex.joints.iter().map(|(joint, w)| matrices[*joint].transform_point3(p) * *w).sum::<DVec3>()
        };
        self.vertices.iter().map(position).collect()
    }
}

/// Does the property move surfaces, or show and hide them?
fn moves(pointer: &str) -> bool {
    let name = pointer.rsplit('/').find(|name| !name.bytes().all(|b| b.is_ascii_digit()));
    pointer.starts_with("/nodes/") && matches!(name, Some("translation" | "rotation" | "scale" | "weights" | "visible"))
        || pointer.starts_with("/meshes/") && name == Some("weights")
}

/// Translation, rotation and scale of a node.
fn at_rest(node: &Value) -> [Vec<f64>; 3] {
    let numbers = |name: &str| node.get(name)?.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>();
    if let Some(Ok(matrix)) = numbers("matrix").map(<[f64; 16]>::try_from) {
        let (s, r, t) = DMat4::from_cols_array(&matrix).to_scale_rotation_translation();
        return [t.to_array().to_vec(), r.to_array().to_vec(), s.to_array().to_vec()];
    }
    [("translation", &[0.0; 3][..]), ("rotation", &[0.0, 0.0, 0.0, 1.0]), ("scale", &[1.0; 3])]
        .map(|(name, rest)| numbers(name).filter(|v| v.len() == rest.len()).unwrap_or_else(|| rest.to_vec()))
}

/// The vertices of a mesh's triangles; of a large mesh, those that its poses move outermost.
fn vertices(reader: &mut Reader, mesh: usize, skinned: bool) -> Result<Vec<Vertex>> {
    let mut all = Vec::new();
    let primitives = &reader.document.meshes.get(mesh)?.primitives;
    reader.unpack(primitives.iter())?;
    for primitive in primitives {
        let fades = |index: usize| reader.document.fades(index);
        let plain = |index: usize| reader.document.materials.get(index).ok().map(|material| &material.plain);
        let seen = |index| fades(index) || plain(index).is_none_or(|plain| plain.shows(1.0));
        if primitive.mode >= 4 && primitive.material.is_none_or(seen) {
            read(reader, primitive, skinned, &mut all)?;
        }
    }
    if all.len() <= MAX_VERTICES {
        return Ok(all);
    }
    let count = if skinned { DIRECTIONS_PER_JOINT } else { DIRECTIONS };
    // A spiral of evenly spread directions, and the axes.
    let spiral = (0..count - 6).map(|i| {
        let (y, turn) = (1.0 - (2 * i + 1) as f64 / (count - 6) as f64, 2.399_963 * i as f64);
        DVec3::new(turn.cos() * (1.0 - y * y).sqrt(), y, turn.sin() * (1.0 - y * y).sqrt())
    });
    let directions: Vec<DVec3> = spiral.chain(DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis])).collect();
    let mut best: HashMap<(usize, usize), Vec<(f64, usize)>> = HashMap::new();
    for (i, vertex) in all.iter().enumerate() {
        let heaviest = vertex.joints.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(usize::MAX, |(joint, _)| *joint);
        for (shape, delta) in [DVec3::ZERO].iter().chain(&vertex.morphs).enumerate() {
            let best = best.entry((heaviest, shape)).or_insert_with(|| vec![(f64::NEG_INFINITY, i); count]);
            let p = vertex.position + *delta;
            for (best, direction) in best.iter_mut().zip(&directions) {
                let along = direction.dot(p);
                if along > best.0 {
                    *best = (along, i);
                }
            }
        }
    }
    let mut keep: Vec<usize> = best.into_values().flatten().map(|(_, i)| i).collect();
    keep.sort_unstable();
    keep.dedup();
    let mut rest = all.into_iter().enumerate();
    Ok(keep.into_iter().filter_map(|i| rest.find(|(j, _)| *j == i)).map(|(_, vertex)| vertex).collect())
}

/// Adds the vertices of a primitive's triangles.
fn read(reader: &mut Reader, primitive: &Primitive, skinned: bool, all: &mut Vec<Vertex>) -> Result<()> {
    reader.check_stream(primitive)?;
    let Some(&index) = primitive.attributes.get(&Semantic::Position) else { return Ok(()) };
    let positions = reader.floats::<3>(index)?;
    let mut used = vec![primitive.indices.is_none(); positions.len()];
    if let Some(index) = primitive.indices {
        let indices = reader.integers::<1>(index)?;
        indices.iter().for_each(|[i]| used.get_mut(*i as usize).into_iter().for_each(|used| *used = true));
    }
    let mut morphs = Vec::new();
    for target in &primitive.targets {
        morphs.push(target.get(&Semantic::Position).map(|&index| reader.floats::<3>(index)).transpose()?);
    }
    let mut joints = Vec::new();
    for (chosen, weights) in primitive.skin_sets().filter(|_| skinned) {
        joints.push((reader.integers::<4>(chosen)?, reader.floats::<4>(weights)?));
    }
    let double = |p: [f32; 3]| DVec3::from(p.map(f64::from));
    let finite = |p: &DVec3| p.is_finite();
    for (i, p) in positions.iter().enumerate().filter(|(i, _)| used[*i]).map(|(i, p)| (i, double(*p))) {
        let mut vertex = Vertex::rigid(p);
        let delta = |deltas: &Option<Vec<[f32; 3]>>| deltas.as_ref().map(|deltas| double(deltas[i])).filter(finite);
        vertex.morphs = morphs.iter().map(|deltas| delta(deltas).unwrap_or(DVec3::ZERO)).collect();
        let weighted = joints.iter().flat_map(|(chosen, weights)| chosen[i].into_iter().zip(weights[i]));
        let weighted: Vec<(usize, f64)> = weighted
            .filter(|(_, weight)| *weight > 0.0 && weight.is_finite())
            .map(|(joint, weight)| (joint as usize, weight.into()))
            .collect();
        let sum: f64 = weighted.iter().map(|(_, weight)| weight).sum();
        if sum > 0.0 {
            vertex.joints = weighted.into_iter().map(|(joint, weight)| (joint, weight / sum)).collect();
        }
        all.extend(Some(vertex).filter(|_| p.is_finite()));
    }
    Ok(())
}
