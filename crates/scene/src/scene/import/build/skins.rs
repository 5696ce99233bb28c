//! Joint matrices of skins.

use glam::{DAffine3, DMat4};

use super::reader::Reader;
use crate::error::Result;
use crate::scene::import::document::skins::Skin;

/// Mesh-to-world matrix of each joint, given nodes' world transforms.
pub(crate) fn joint_matrices(
    from: &Skin,
    reader: &mut Reader,
    worlds: &dyn Fn(usize) -> DAffine3,
) -> Result<Vec<DMat4>> {
    reader.budget.take("skins", from.joints.len() as u64, size_of::<DMat4>() as u64)?;
    let inverse_bind = from.inverse_bind.map(|index| reader.floats::<16>(index)).transpose()?;
    let bind = |i: usize| match &inverse_bind {
        Some(matrices) => DMat4::from_cols_array(&matrices[i].map(f64::from)),
        None => DMat4::IDENTITY,
    };
    Ok(from.joints.iter().enumerate().map(|(i, &joint)| DMat4::from(worlds(joint)) * bind(i)).collect())
}
