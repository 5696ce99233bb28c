//! Moments while the shutter is open: where nodes stand then, and what their lights and weights are.

use glam::{DAffine3, DMat4};
use serde_json::Value;

use super::{lights, nodes, pose};
use crate::error::Result;
use crate::scene::LightKey;
use crate::scene::import::document::Document;
use crate::scene::import::report::Notes;
use crate::scene::import::{Pose, Shutter};
use crate::scene::motion::MOST_STEPS;

/// Steps that are enough by need: a jump between two frames never is.
const MOST_BY_NEED: usize = 64;
/// How far, of its whole way, a thing may be from the line between two time samples.
const BENDS: f64 = 1.0 / 256.0;
/// Roundings of keys in files.
const ROUNDING: f64 = 1e-6;

/// A time sample; lists by the document's nodes.
pub struct TimeSample {
    /// To world space.
    pub worlds: Vec<DAffine3>,
    /// Of morph targets.
    pub weights: Vec<Vec<f32>>,
    pub lights: Vec<Option<LightKey>>,
}

/// That of a pose. `parse` makes a document of one with its values then.
///
/// # Errors
/// Those of [`pose::posed`] and of `parse`.
pub fn time_sample(
    at_rest: &Document,
    json: &Value,
    file_bytes: u64,
    pose: &Pose,
    parse: &dyn Fn(&Value) -> Result<Document>,
) -> Result<TimeSample> {
    TimeSample::of(&parse(&pose::posed(at_rest, json, file_bytes, pose, &mut Notes::default())?)?)
}

/// Evenly spaced ones from where the shutter opens to where it closes, as many as asked for or as it takes for all that
/// moves to be close to the lines between. `time_sample` is that of a time in seconds.
///
/// # Errors
/// Those of `time_sample`.
pub fn time_samples(pose: &Pose, time_sample: &dyn Fn(f64) -> Result<TimeSample>) -> Result<Vec<TimeSample>> {
    let Some(Shutter { opens, closes, steps }) = pose.shutter else { return Ok(Vec::new()) };
    let at = |share: f64| time_sample(pose.seconds + opens + (closes - opens) * share);
    if let Some(steps) = steps.map(|steps| (steps as usize).clamp(1, MOST_STEPS)) {
        return (0..=steps).map(|step| at(step as f64 / steps as f64)).collect();
    }
    let mut known = vec![at(0.0)?, at(1.0)?];
    loop {
        let steps = known.len() - 1;
        let middles = (0..steps).map(|i| at((i as f64 + 0.5) / steps as f64)).collect::<Result<Vec<_>>>()?;
        let way = way(known.iter().chain(&middles));
        let bends = (0..steps).any(|i| bends([&known[i], &middles[i], &known[i + 1]], &way));
        if !bends {
            return Ok(known);
        }
        let mut finer = Vec::with_capacity(2 * steps + 1);
        for (time_sample, middle) in known.into_iter().zip(middles.into_iter().map(Some).chain([None])) {
            finer.push(time_sample);
            finer.extend(middle);
        }
        known = finer;
        if known.len() > MOST_BY_NEED {
            return Ok(known);
        }
    }
}

impl TimeSample {
    fn of(document: &Document) -> Result<Self> {
        let worlds = nodes::worlds(document);
        let (mut weights, mut keys) = (Vec::new(), Vec::new());
        for (node, world) in document.nodes.iter().zip(&worlds) {
            // What is wrong with nodes that are shown is told of those at the picture's time sample.
            let content = node.content().ok();
            let mesh = content.and_then(|c| document.meshes.get(c.mesh?).ok());
            weights
                .push(content.and_then(|c| c.weights.clone()).or(mesh.map(|m| m.weights.clone())).unwrap_or_default());
            let light = content.and_then(|c| document.lights.get(c.light?).ok());
            let placed = light.and_then(|light| lights::place(light, "", world, &mut Notes::default()));
            keys.push(placed.map(|light| light.key()));
        }
        Ok(Self { worlds, weights, lights: keys })
    }

    /// As [`Self::worlds`].
    pub fn matrices(&self) -> Vec<DMat4> {
        self.worlds.iter().map(|&world| world.into()).collect()
    }

    /// Numbers of a node that may move, in groups of one scale.
    fn numbers(&self, node: usize) -> [Vec<f64>; 4] {
        let world = &self.worlds[node];
        [
            world.matrix3.to_cols_array().to_vec(),
            world.translation.to_array().to_vec(),
            self.weights[node].iter().map(|w| f64::from(*w)).collect(),
            self.lights[node].iter().flat_map(|key| key.intensity.to_array().map(f64::from)).collect(),
        ]
    }
}

fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// How far each node's numbers go, by group.
fn way<'a>(mut all: impl Iterator<Item = &'a TimeSample>) -> Vec<[f64; 4]> {
    let Some(first) = all.next() else { return Vec::new() };
    let mut way = vec![[0.0_f64; 4]; first.worlds.len()];
    for time_sample in all {
        for (node, way) in way.iter_mut().enumerate() {
            let (a, b) = (first.numbers(node), time_sample.numbers(node));
            for group in 0..4 {
                way[group] = way[group].max(farthest(&a[group], &b[group]));
            }
        }
    }
    way
}

/// Is something in the middle too far from the line?
fn bends([a, middle, b]: [&TimeSample; 3], way: &[[f64; 4]]) -> bool {
    (0..way.len()).filter(|&node| way[node].iter().any(|w| *w > 0.0)).any(|node| {
        let [a, m, b] = [a, middle, b].map(|time_sample| time_sample.numbers(node));
        (0..4).any(|group| {
            let line: Vec<f64> = a[group].iter().zip(&b[group]).map(|(a, b)| 0.5 * (a + b)).collect();
            let size = line.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            farthest(&line, &m[group]) > BENDS * way[node][group] + ROUNDING * size
        })
    })
}
