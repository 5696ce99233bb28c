//! Where placements take what they place.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DVec3};

use super::nodes::Placement;
use crate::error::{Error, Result};
use crate::scene::import::report::Notes;
use crate::scene::{FARTHEST, Framing, Mesh, Scene};

/// Are a box's corners near enough, where they are and where a placement takes them?
///
/// # Errors
/// If not.
pub fn check_near(corners: &[DVec3], world: &DAffine3, at: &str, mesh: &str) -> Result<()> {
    let moved = corners.iter().map(|&c| world.transform_point3(c));
    match corners.iter().copied().chain(moved).any(|p| p.abs().max_element() > f64::from(FARTHEST)) {
        true => Err(Error::Data(format!(
            "{at}: places {mesh} beyond {FARTHEST:e} m, where rays cannot be traced; scale the scene down"
        ))),
        false => Ok(()),
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

/// Corners of the points' box.
pub fn corners(points: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let bounds = |b: Option<(DVec3, DVec3)>, p: DVec3| Some(b.map_or((p, p), |(low, high)| (low.min(p), high.max(p))));
    let Some((low, high)) = points.fold(None, bounds) else { return Vec::new() };
    let pick = |i: u32, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
    (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect()
}

/// A view of everything: of objects by their number, which are in world space for good or not, and their places.
pub fn framed(scene: &Scene, seen: &[(u32, bool, Vec<DAffine3>)]) -> Framing {
    let mut framing = Framing::default();
    for (object, baked, worlds) in seen {
        let range = &scene.objects[*object as usize].meshes;
        let points = points(scene.meshes[range.start as usize..range.end as usize].iter().map(Arc::as_ref));
        match (baked, &worlds[..]) {
            (true, _) => points.for_each(|p| framing.include(p)),
            (false, [only]) => points.for_each(|p| framing.include(only.transform_point3(p))),
            _ => {
                let corners = corners(points);
                let all = worlds.iter().flat_map(|world| corners.iter().map(|&c| world.transform_point3(c)));
                all.for_each(|p| framing.include(p));
            }
        }
    }
    framing
}
