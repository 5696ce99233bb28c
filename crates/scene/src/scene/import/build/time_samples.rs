//! What moves, over time: world transforms, lights and morph weights of the nodes that an animation changes.

use std::collections::{HashMap, HashSet};

use glam::DAffine3;
use serde_json::Value;

use super::lights;
use super::pose::{Animation, Element};
use crate::error::Result;
use crate::scene::LightKey;
use crate::scene::import::document::Document;
use crate::scene::import::document::lights::LIGHTS;
use crate::scene::import::document::nodes::top_nodes;
use crate::scene::import::options::{Pose, Shutter};
use crate::scene::import::report::Notes;
use crate::scene::motion::MAX_STEPS;

/// Largest number of keys that adaptive sampling makes: a discontinuity would be subdivided without end.
const MAX_ADAPTIVE_KEYS: usize = 64;
/// Largest deviation from linear interpolation between two time samples, as a fraction of the value's range.
const MAX_DEVIATION: f64 = 1.0 / 256.0;
/// Relative rounding error of keys in files.
const KEY_ROUNDING_ERROR: f64 = 1e-6;

/// State of a node at one time.
pub struct NodeSample {
    pub world: DAffine3,
    pub weights: Vec<f32>,
    pub light: Option<LightKey>,
}

/// Samples of the nodes that change: while the shutter is open, then one frame before and one after; either part may be empty.
#[derive(Default)]
pub struct TimeSamples {
    by_node: HashMap<usize, Vec<NodeSample>>,
    /// Number of samples while the shutter is open.
    pub shutter: usize,
    pub count: usize,
}

impl TimeSamples {
    /// The samples of a node; empty if it does not change.
    pub fn of(&self, node: usize) -> &[NodeSample] {
        self.by_node.get(&node).map_or(&[], |samples| samples)
    }
}

/// Gives the document, which is at rest as `json` is, the values of a pose, and returns what moves around its time.
pub fn play(
    document: &mut Document,
    json: &Value,
    file_bytes: u64,
    pose: &Pose,
    notes: &mut Notes,
) -> Result<TimeSamples> {
    // The picture's own time lies within the shutter, so that the rest of the scene agrees with it.
    let own = pose.seconds + pose.shutter.map_or(0.0, |shutter| 0.0_f64.clamp(shutter.opens, shutter.closes));
    let animation = Animation::read(document, json, file_bytes, pose, own, notes)?;
    let (changing, mut worlds) = (changing(document, &animation), document.world_transforms());
    let mut at = |seconds: f64| {
        animation.pose(document, seconds, &mut Notes::default())?;
        Ok(changing.iter().map(|&(node, parent)| NodeSample::of(document, node, parent, &mut worlds)).collect())
    };
    let mut samples = shutter_samples(pose, &mut at)?;
    let shutter = samples.len();
    for seconds in pose.frame.into_iter().flat_map(|frame| [pose.seconds - frame, pose.seconds + frame]) {
        samples.push(at(seconds)?);
    }
    animation.pose(document, own, notes)?;
    let count = samples.len();
    let mut by_node = HashMap::<usize, Vec<NodeSample>>::new();
    for (&(node, _), sample) in samples.into_iter().flat_map(|sample| changing.iter().zip(sample)) {
        by_node.entry(node).or_default().push(sample);
    }
    Ok(TimeSamples { by_node, shutter, count })
}

/// The nodes that change, each after its parent, which comes with it.
fn changing(document: &Document, animation: &Animation) -> Vec<(usize, Option<usize>)> {
    let nodes = &document.nodes;
    let elements: HashSet<Element> = animation.elements().collect();
    let content = |node: usize| {
        let Ok(content) = nodes[node].content() else { return false };
        content.mesh.is_some_and(|mesh| elements.contains(&("meshes", mesh)))
            || content.light.is_some_and(|light| elements.contains(&(LIGHTS, light)))
    };
    let mut found = Vec::new();
    let mut stack: Vec<_> = top_nodes(nodes).into_iter().map(|node| (node, None, false)).collect();
    while let Some((node, parent, above)) = stack.pop() {
        let moves = above || elements.contains(&("nodes", node));
        found.extend((moves || content(node)).then_some((node, parent)));
        stack.extend(nodes[node].children.iter().map(|&child| (child, Some(node), moves)));
    }
    found
}

type Sample = Vec<NodeSample>;

/// Samples evenly spaced from the shutter's opening to its closing: as many as requested, else as many as are needed for linear
/// interpolation to be accurate. `sample` evaluates a time in seconds.
fn shutter_samples(pose: &Pose, sample: &mut dyn FnMut(f64) -> Result<Sample>) -> Result<Vec<Sample>> {
    let Some(Shutter { opens, closes, steps }) = pose.shutter else { return Ok(Vec::new()) };
    let mut at = |fraction: f64| sample(pose.seconds + opens + (closes - opens) * fraction);
    if let Some(steps) = steps.map(|steps| (steps as usize).clamp(1, MAX_STEPS)) {
        return (0..=steps).map(|step| at(step as f64 / steps as f64)).collect();
    }
    let mut keys = vec![at(0.0)?, at(1.0)?];
    loop {
        let steps = keys.len() - 1;
        let middles = (0..steps).map(|i| at((i as f64 + 0.5) / steps as f64)).collect::<Result<Vec<_>>>()?;
        let ranges = node_ranges(keys.iter().chain(&middles));
        let curved = (0..steps).any(|i| is_curved([&keys[i], &middles[i], &keys[i + 1]], &ranges));
        if !curved {
            return Ok(keys);
        }
        let mut finer = Vec::with_capacity(2 * steps + 1);
        for (sample, middle) in keys.into_iter().zip(middles.into_iter().map(Some).chain([None])) {
            finer.push(sample);
            finer.extend(middle);
        }
        keys = finer;
        if keys.len() > MAX_ADAPTIVE_KEYS {
            return Ok(keys);
        }
    }
}

impl NodeSample {
    /// The state of a node in a posed document; sets its transform in `worlds`, which has those of its parent.
    fn of(document: &Document, node: usize, parent: Option<usize>, worlds: &mut [DAffine3]) -> Self {
        let of = &document.nodes[node];
        worlds[node] = parent.map_or(document.base(), |parent| worlds[parent]) * of.transform;
        // Faults of shown nodes are reported for the document at the picture's own time.
        let content = of.content().ok();
        let mesh = content.and_then(|c| document.meshes.get(c.mesh?).ok());
        let weights = content.and_then(|c| c.weights.clone()).or(mesh.map(|m| m.weights.clone())).unwrap_or_default();
        let light = content.and_then(|c| document.lights.get(c.light?).ok());
        let light = light.and_then(|light| lights::place(light, "", &worlds[node], &mut Notes::default()));
        Self { world: worlds[node], weights, light: light.map(|light| light.key()) }
    }

    /// Values that may change, in groups of one scale: matrix, translation, weights, light intensity.
    fn numbers(&self) -> [Vec<f64>; 4] {
        [
            self.world.matrix3.to_cols_array().to_vec(),
            self.world.translation.to_array().to_vec(),
            self.weights.iter().map(|w| f64::from(*w)).collect(),
            self.light.iter().flat_map(|key| key.intensity.to_array().map(f64::from)).collect(),
        ]
    }
}

fn max_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Range of each node's values, by group.
fn node_ranges<'a>(mut samples: impl Iterator<Item = &'a Sample>) -> Vec<[f64; 4]> {
    let Some(first) = samples.next() else { return Vec::new() };
    let mut ranges = vec![[0.0_f64; 4]; first.len()];
    for sample in samples {
        for ((first, own), ranges) in first.iter().zip(sample).zip(&mut ranges) {
            let (a, b) = (first.numbers(), own.numbers());
            for group in 0..4 {
                ranges[group] = ranges[group].max(max_difference(&a[group], &b[group]));
            }
        }
    }
    ranges
}

/// Does a value in the middle deviate too far from linear interpolation?
fn is_curved(samples: [&Sample; 3], ranges: &[[f64; 4]]) -> bool {
    (0..ranges.len()).filter(|&node| ranges[node].iter().any(|w| *w > 0.0)).any(|node| {
        let [a, m, b] = samples.map(|sample| sample[node].numbers());
        (0..4).any(|group| {
            let line: Vec<f64> = a[group].iter().zip(&b[group]).map(|(a, b)| 0.5 * (a + b)).collect();
            let size = line.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            max_difference(&line, &m[group]) > MAX_DEVIATION * ranges[node][group] + KEY_ROUNDING_ERROR * size
        })
    })
}
