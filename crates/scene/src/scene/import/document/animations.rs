//! Animations, as the document has them: properties, each named by a JSON pointer, and where their keys are.

use super::Lengths;
use super::json::Json;
use crate::error::Result;

/// What is between keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The key before.
    Step,
    /// A straight line; of rotations the shortest way on the sphere.
    Linear,
    /// Cubic Hermite splines with tangents beside the keys.
    CubicSpline,
}

/// One property that moves.
#[derive(Debug)]
pub struct Channel {
    /// JSON pointer (RFC 6901).
    pub pointer: String,
    /// Accessor of the keys' times.
    pub input: usize,
    /// Accessor of its values.
    pub output: usize,
    pub interpolation: Interpolation,
    pub at: String,
}

/// An animation.
#[derive(Debug)]
pub struct Animation {
    /// Empty without one.
    pub name: String,
    pub channels: Vec<Channel>,
}

impl Animation {
    /// Channels without a target, or with one that the specification does not know, are left out, as it says.
    pub fn parse(json: &Json, lengths: &Lengths) -> Result<Self> {
        let samplers = json.items("samplers")?;
        let mut read = Vec::with_capacity(samplers.len());
        for sampler in &samplers {
            let accessor = |key| sampler.need(key, sampler.index(key, lengths.accessors, "accessors")?);
            let interpolation = match sampler.string("interpolation")?.unwrap_or("LINEAR") {
                "STEP" => Interpolation::Step,
                "LINEAR" => Interpolation::Linear,
                "CUBICSPLINE" => Interpolation::CubicSpline,
                other => return Err(sampler.bad("interpolation", "STEP, LINEAR or CUBICSPLINE", other)),
            };
            read.push((accessor("input")?, accessor("output")?, interpolation));
        }
        let mut channels = Vec::new();
        for channel in json.items("channels")? {
            let sampler = channel.index("sampler", samplers.len(), "this animation's samplers")?;
            let (input, output, interpolation) = read[channel.need("sampler", sampler)?];
            let target = channel.need("target", channel.get("target")?)?;
            let node = target.index("node", lengths.nodes, "nodes")?;
            let pointer = match (target.need("path", target.string("path")?)?, node) {
                (path @ ("translation" | "rotation" | "scale" | "weights"), Some(node)) => {
                    format!("/nodes/{node}/{path}")
                }
                ("pointer", _) => {
                    let Some(json) = target.extension("KHR_animation_pointer")? else { continue };
                    json.need("pointer", json.string("pointer")?)?.into()
                }
                _ => continue,
            };
            channels.push(Channel { pointer, input, output, interpolation, at: channel.at });
        }
        Ok(Self { name: json.string("name")?.unwrap_or_default().into(), channels })
    }
}
