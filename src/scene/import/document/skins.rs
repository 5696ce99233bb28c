//! Skins, and animations, of which only the references are checked.

use super::Lengths;
use super::accessors::{Accessor, Component, Shape, View};
use super::json::Json;
use crate::error::Result;

/// A glTF skin.
#[derive(Debug)]
pub struct Skin {
    pub joints: Vec<usize>,
    pub inverse_bind: Option<usize>,
}

impl Skin {
    pub fn parse(json: &Json, lengths: &Lengths, accessors: &[Accessor], views: &[View]) -> Result<Self> {
        json.name()?;
        let joints = json.indices("joints", lengths.nodes, "nodes")?;
        if joints.is_empty() {
            return Err(json.bad("joints", "at least one joint", "none"));
        }
        json.index("skeleton", lengths.nodes, "nodes")?;
        let inverse_bind = json.index("inverseBindMatrices", lengths.accessors, "accessors")?;
        if let Some(index) = inverse_bind {
            let a = &accessors[index];
            if a.shape != Shape::Mat4 || a.component != Component::F32 {
                return Err(json.bad("inverseBindMatrices", "MAT4 of FLOAT", a.format()));
            }
            if a.count < joints.len() as u64 {
                return Err(json.bad(
                    "inverseBindMatrices",
                    format!("{} matrices, one a joint", joints.len()),
                    a.count,
                ));
            }
            if let Some(view) = a.view.filter(|&v| views[v].stride.is_some()) {
                return Err(json.bad("inverseBindMatrices", "a bufferView without byteStride", &views[view].at));
            }
        }
        Ok(Self { joints, inverse_bind })
    }
}

/// Checks every reference of every animation; gives the accessors that they use.
pub fn check_animations(animations: &[Json], lengths: &Lengths) -> Result<Vec<usize>> {
    let mut used = Vec::new();
    for animation in animations {
        animation.name()?;
        let samplers = animation.items("samplers")?;
        for sampler in &samplers {
            for key in ["input", "output"] {
                used.push(sampler.need(key, sampler.index(key, lengths.accessors, "accessors")?)?);
            }
            sampler.string("interpolation")?;
        }
        for channel in animation.items("channels")? {
            channel.need("sampler", channel.index("sampler", samplers.len(), "this animation's samplers")?)?;
            let target = channel.need("target", channel.get("target")?)?;
            target.index("node", lengths.nodes, "nodes")?;
            target.need("path", target.string("path")?)?;
            if let Some(pointer) = target.extension("KHR_animation_pointer")? {
                pointer.need("pointer", pointer.string("pointer")?)?;
            }
        }
    }
    Ok(used)
}
