//! Skins of the document.

use super::accessors::{Accessor, Component, Shape, View, check_tight};
use super::json::Json;
use super::table::Table;
use crate::error::Result;

#[derive(Debug)]
pub struct Skin {
    pub joints: Vec<usize>,
    pub inverse_bind: Option<usize>,
}

impl Skin {
    pub fn parse(json: &Json, accessors: &Table<Accessor>, views: &Table<View>) -> Result<Self> {
        json.name()?;
        let joints = json.indices("joints", "nodes")?;
        if joints.is_empty() {
            return Err(json.bad("joints", "at least one joint", "none"));
        }
        json.index("skeleton", "nodes")?;
        let inverse_bind = json.index("inverseBindMatrices", "accessors")?;
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
            if let Some(view) = a.view {
                check_tight(json, "inverseBindMatrices", views.get(view)?, a.element_bytes())?;
            }
        }
        Ok(Self { joints, inverse_bind })
    }
}
