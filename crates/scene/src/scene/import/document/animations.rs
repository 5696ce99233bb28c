//! Animations: channels that drive properties, each identified by a JSON pointer, and the accessors of their keys.

pub use gltf::json::animation::Interpolation;

use super::json::Json;
use crate::error::Result;

#[derive(Debug)]
pub struct Channel {
    /// JSON pointer (RFC 6901).
    pub pointer: String,
    /// Accessor of the keys' times in seconds.
    pub input: usize,
    /// Accessor of the keys' values.
    pub output: usize,
    pub interpolation: Interpolation,
    pub at: String,
}

#[derive(Debug)]
pub struct Animation {
    /// Name; may be empty.
    pub name: String,
    pub channels: Vec<Channel>,
}

impl Animation {
    /// Parses an animation. Channels without a known target are ignored, as the specification requires.
    pub fn parse(json: &Json) -> Result<Self> {
        let samplers = json.items("samplers")?;
        let mut read = Vec::with_capacity(samplers.len());
        for sampler in &samplers {
            let accessor = |key| sampler.need(key, sampler.index(key, "accessors")?);
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
            let sampler = channel.index_below("sampler", samplers.len(), "this animation's samplers")?;
            let (input, output, interpolation) = read[channel.need("sampler", sampler)?];
            let target = channel.need("target", channel.get("target")?)?;
            let node = target.index("node", "nodes")?;
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
