//! Time samples while the shutter is open: world transforms, lights and morph weights of all nodes.

use glam::DAffine3;
use serde_json::Value;

use super::{lights, pose};
use crate::error::Result;
use crate::scene::LightKey;
use crate::scene::import::document::Document;
use crate::scene::import::options::{Pose, Shutter};
use crate::scene::import::report::Notes;
use crate::scene::motion::MAX_STEPS;

/// Largest number of keys that adaptive sampling makes: a discontinuity would be subdivided without end.
const MAX_ADAPTIVE_KEYS: usize = 64;
/// Largest deviation from linear interpolation between two time samples, as a fraction of the value's range.
const MAX_DEVIATION: f64 = 1.0 / 256.0;
/// Relative rounding error of keys in files.
const KEY_ROUNDING_ERROR: f64 = 1e-6;

/// State of all nodes at one time; lists are indexed by the document's nodes.
pub struct TimeSample {
    /// Transforms to world space.
    pub worlds: Vec<DAffine3>,
    /// Weights of morph targets.
    pub weights: Vec<Vec<f32>>,
    /// Punctual lights.
    pub lights: Vec<Option<LightKey>>,
}

/// The time sample of a pose. `parse` checks the document with the values at that time.
///
/// # Errors
/// Errors of [`pose::posed`] and of `parse`.
pub fn time_sample(
    at_rest: &Document,
    json: &Value,
    file_bytes: u64,
    pose: &Pose,
    parse: &dyn Fn(&Value) -> Result<Document>,
) -> Result<TimeSample> {
    TimeSample::from_document(&parse(&pose::posed(at_rest, json, file_bytes, pose, &mut Notes::default())?)?)
}

/// Time samples evenly spaced from the shutter's opening to its closing: as many as requested, else as many as are needed
/// for linear interpolation to be accurate. `time_sample` evaluates a time in seconds.
///
/// # Errors
/// Errors of `time_sample`.
pub fn time_samples(pose: &Pose, time_sample: &dyn Fn(f64) -> Result<TimeSample>) -> Result<Vec<TimeSample>> {
    let Some(Shutter { opens, closes, steps }) = pose.shutter else { return Ok(Vec::new()) };
    let at = |fraction: f64| time_sample(pose.seconds + opens + (closes - opens) * fraction);
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
        for (time_sample, middle) in keys.into_iter().zip(middles.into_iter().map(Some).chain([None])) {
            finer.push(time_sample);
            finer.extend(middle);
        }
        keys = finer;
        if keys.len() > MAX_ADAPTIVE_KEYS {
            return Ok(keys);
        }
    }
}

impl TimeSample {
    fn from_document(document: &Document) -> Result<Self> {
        let worlds = document.world_transforms();
        let (mut weights, mut keys) = (Vec::new(), Vec::new());
        for (node, world) in document.nodes.iter().zip(&worlds) {
            // Faults of shown nodes are reported for the document at the picture's own time.
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

    /// Values of a node that may change, in groups of one scale: matrix, translation, weights, light intensity.
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

fn max_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Range of each node's values, by group.
fn node_ranges<'a>(mut time_samples: impl Iterator<Item = &'a TimeSample>) -> Vec<[f64; 4]> {
    let Some(first) = time_samples.next() else { return Vec::new() };
    let mut ranges = vec![[0.0_f64; 4]; first.worlds.len()];
    for time_sample in time_samples {
        for (node, ranges) in ranges.iter_mut().enumerate() {
            let (a, b) = (first.numbers(node), time_sample.numbers(node));
            for group in 0..4 {
                ranges[group] = ranges[group].max(max_difference(&a[group], &b[group]));
            }
        }
    }
    ranges
}

/// Does a value in the middle deviate too far from linear interpolation?
fn is_curved([a, middle, b]: [&TimeSample; 3], ranges: &[[f64; 4]]) -> bool {
    (0..ranges.len()).filter(|&node| ranges[node].iter().any(|w| *w > 0.0)).any(|node| {
        let [a, m, b] = [a, middle, b].map(|time_sample| time_sample.numbers(node));
        (0..4).any(|group| {
            let line: Vec<f64> = a[group].iter().zip(&b[group]).map(|(a, b)| 0.5 * (a + b)).collect();
            let size = line.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            max_difference(&line, &m[group]) > MAX_DEVIATION * ranges[node][group] + KEY_ROUNDING_ERROR * size
        })
    })
}
