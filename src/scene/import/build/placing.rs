//! Where placements take what they place.

use glam::{Affine3A, DAffine3, DVec3};

use super::nodes::Placement;
use crate::error::{Error, Result};
use crate::scene::import::report::Notes;
use crate::scene::{FARTHEST, Mesh};

/// Where a placement takes a box's corners.
///
/// # Errors
/// One that takes them, or finds them, too far away.
pub fn moved(corners: &[DVec3], world: &DAffine3, at: &str, mesh: &str) -> Result<Vec<DVec3>> {
    let moved: Vec<DVec3> = corners.iter().map(|&c| world.transform_point3(c)).collect();
    match corners.iter().chain(&moved).any(|p| p.abs().max_element() > f64::from(FARTHEST)) {
        true => Err(Error::Data(format!(
            "{at}: places {mesh} beyond {FARTHEST:e} m, where rays cannot be traced; scale the scene down"
        ))),
        false => Ok(moved),
    }
}

pub fn to_single(world: &DAffine3) -> Affine3A {
    world.as_affine3a()
}

/// Drops what a transform makes flat or infinite.
pub fn is_solid(placement: &Placement, notes: &mut Notes) -> bool {
    let solid = is_invertible(&placement.world);
    if !solid {
        notes.not_loaded(&placement.at, "a placement with zero or infinite scale: nothing to see");
    }
    solid
}

pub fn is_invertible(world: &DAffine3) -> bool {
    let single = to_single(world);
    world.matrix3.determinant() != 0.0 && single.is_finite() && single.inverse().is_finite()
}

pub fn points<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> impl Iterator<Item = DVec3> {
    meshes.flat_map(|m| m.positions.iter()).map(|p| DVec3::from(p.map(f64::from)))
}

/// Corners of the meshes' box.
pub fn corners<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> Vec<DVec3> {
    let bounds = |b: Option<(DVec3, DVec3)>, p: DVec3| Some(b.map_or((p, p), |(low, high)| (low.min(p), high.max(p))));
    let Some((low, high)) = points(meshes).fold(None, bounds) else { return Vec::new() };
    let pick = |i: u32, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
    (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect()
}
