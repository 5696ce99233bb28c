//! Checks of placements, and the view that frames all of them.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DMat3, DVec3};

use super::nodes::Placement;
use crate::error::{Error, Result};
use crate::scene::import::report::Notes;
use crate::scene::{MAX_COORDINATE, Mesh, Scene};

/// Checks the corners of a mesh's box, untransformed and placed, against [`MAX_COORDINATE`].
///
/// # Errors
/// A coordinate beyond it, with the node (`at`) and the mesh.
pub fn check_extent(corners: &[DVec3], world: &DAffine3, at: &str, mesh: &str) -> Result<()> {
    let moved = corners.iter().map(|&c| world.transform_point3(c));
    match corners.iter().copied().chain(moved).any(|p| p.abs().max_element() > f64::from(MAX_COORDINATE)) {
        true => Err(Error::Data(format!(
            "{at}: places {mesh} beyond {MAX_COORDINATE:e} m, where rays cannot be traced; scale the scene down"
        ))),
        false => Ok(()),
    }
}

pub fn to_f32(world: &DAffine3) -> Affine3A {
    world.as_affine3a()
}

/// Does the transform leave a surface, if only a flat one?
pub fn is_visible(world: &DAffine3) -> bool {
    is_invertible(world) || is_flat(world)
}

/// Is the placement visible? Notes it if not.
pub fn keep_visible(placement: &Placement, notes: &mut Notes) -> bool {
    let visible = is_visible(&placement.world);
    if !visible {
        notes.not_loaded(
            &placement.at,
            "a placement with zero or infinite scale, or that is not finite: nothing to see",
        );
    }
    visible
}

/// Does the transform flatten space to a plane (rank 2)?
pub fn is_flat(world: &DAffine3) -> bool {
    const ROUNDING: f64 = 1e-12;
    let (longest, area) = sizes(&world.matrix3);
    is_thin(&world.matrix3) && to_f32(world).is_finite() && area > ROUNDING * longest * longest
}

/// Is the thickness that the transform leaves none, or so small that squares of its inverse are beyond 32 bits?
fn is_thin(matrix: &DMat3) -> bool {
    let (longest, area) = sizes(matrix);
    matrix.determinant().abs() <= 1e-10 * longest * area
}

/// The length of the longest column, and the largest area between two.
fn sizes(matrix: &DMat3) -> (f64, f64) {
    let largest = |sizes: [f64; 3]| sizes.into_iter().fold(0.0, f64::max);
    let axes = [0, 1, 2];
    (
        largest(axes.map(|axis| matrix.col(axis).length())),
        largest(axes.map(|axis| normal_of_others(matrix, axis).length())),
    )
}

/// The unit vector that a flat transform makes 0 long.
pub fn lost_direction(matrix: &DMat3) -> DVec3 {
    let rows = matrix.transpose();
    let all = [0, 1, 2].map(|axis| normal_of_others(&rows, axis));
    all.into_iter().max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or(DVec3::Z).normalize()
}

/// A transform that flattens space, with a thickness beyond the rounding of rays, so that the front and back of what was closed
/// are apart and it has an inverse. `corners` are those of the mesh's box, whose middle stays. Others are unchanged.
pub fn thickened(world: &DAffine3, corners: &[DVec3]) -> DAffine3 {
    /// Relative to the largest coordinate; rays begin 16 roundings away from surfaces.
    const THICKNESS: f64 = 64.0 * f32::EPSILON as f64;
    if !is_flat(world) {
        return *world;
    }
    let matrix = &world.matrix3;
    let lost = lost_direction(matrix);
    // The cofactor matrix gives the side on which the front stays.
    let normal = (0..3).map(|axis| normal_of_others(matrix, axis) * lost[axis]).sum::<DVec3>().normalize();
    let largest = corners.iter().map(|c| world.transform_point3(*c).abs().max_element()).fold(0.0, f64::max);
    let [low, high] = [f64::min, f64::max].map(|pick| corners.iter().map(|c| c.dot(lost)).reduce(pick).unwrap_or(0.0));
    let scale = (THICKNESS * largest / (high - low)).min(sizes(matrix).0);
    let [x, y, z] = (lost * scale).to_array().map(|weight| normal * weight);
    DAffine3 {
        matrix3: *matrix + DMat3::from_cols(x, y, z),
        translation: world.translation - normal * (scale * 0.5 * (low + high)),
    }
}

fn normal_of_others(matrix: &DMat3, axis: usize) -> DVec3 {
    matrix.col((axis + 1) % 3).cross(matrix.col((axis + 2) % 3))
}

/// The unit direction of a local axis; of one that the transform makes 0 long, the normal of the plane that remains. `None` if
/// there is none.
pub fn axis(world: &DAffine3, axis: usize) -> Option<DVec3> {
    world.matrix3.col(axis).try_normalize().or_else(|| normal_of_others(&world.matrix3, axis).try_normalize())
}

pub fn is_invertible(world: &DAffine3) -> bool {
    let single = to_f32(world);
    !is_thin(&world.matrix3) && single.is_finite() && single.inverse().is_finite()
}

pub fn points<'a>(meshes: impl Iterator<Item = &'a Mesh>) -> impl Iterator<Item = DVec3> {
    meshes.flat_map(|m| m.positions.iter()).map(|p| DVec3::from(p.map(f64::from)))
}

/// The eight corners of the points' bounding box; none without points.
pub fn corners(points: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    let bounds = |b: Option<(DVec3, DVec3)>, p: DVec3| Some(b.map_or((p, p), |(low, high)| (low.min(p), high.max(p))));
    let Some((low, high)) = points.fold(None, bounds) else { return Vec::new() };
    let pick = |i: u32, axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
    (0..8).map(|i| DVec3::new(pick(i, 0), pick(i, 1), pick(i, 2))).collect()
}

/// Visits the points of placed objects, each with its index, whether its meshes are in world space, and its transforms. Objects
/// with several placements enter by their bounding box.
pub fn visit_points(scene: &Scene, seen: &[(u32, bool, Vec<DAffine3>)], visit: &mut dyn FnMut(DVec3)) {
    for (object, baked, worlds) in seen {
        let range = &scene.objects[*object as usize].meshes;
        let points = points(scene.meshes[range.start as usize..range.end as usize].iter().map(Arc::as_ref));
        match (baked, &worlds[..]) {
            (true, _) => points.for_each(&mut *visit),
            (false, [only]) => points.for_each(|p| visit(only.transform_point3(p))),
            _ => {
                let corners = corners(points);
                worlds
                    .iter()
                    .flat_map(|world| corners.iter().map(|&c| world.transform_point3(c)))
                    .for_each(&mut *visit);
            }
        }
    }
}
