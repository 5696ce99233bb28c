//! Skins, and animations, of which only the references are checked.

use super::Lengths;
use super::accessors::{Accessor, Component, Shape, View};
use super::json::Json;
use super::table::Table;
use crate::error::Result;

/// A glTF skin.
#[derive(Debug)]
pub struct Skin {
    pub joints: Vec<usize>,
    pub inverse_bind: Option<usize>,
}

impl Skin {
    pub fn parse(json: &Json, lengths: &Lengths, accessors: &Table<Accessor>, views: &Table<View>) -> Result<Self> {
        json.name()?;
        let joints = json.indices("joints", lengths.nodes, "nodes")?;
        if joints.is_empty() {
            return Err(json.bad("joints", "at least one joint", "none"));
        }
        json.index("skeleton", lengths.nodes, "nodes")?;
        let inverse_bind = json.index("inverseBindMatrices", lengths.accessors, "accessors")?;
        if let Some(index) = inverse_bind {
            let a = accessors.get(index)?;
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
            if let Some(view) = a.view.map(|view| views.get(view)).transpose()?.filter(|view| view.stride.is_some()) {
                return Err(json.bad("inverseBindMatrices", "a bufferView without byteStride", &view.at));
            }
        }
        Ok(Self { joints, inverse_bind })
    }
}

/// Checks every reference of an animation.
pub fn check_animation(animation: &Json, lengths: &Lengths) -> Result<()> {
    animation.name()?;
    let samplers = animation.items("samplers")?;
    for sampler in &samplers {
        for key in ["input", "output"] {
            sampler.need(key, sampler.index(key, lengths.accessors, "accessors")?)?;
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
    Ok(())
}
