//! Transforms that flatten space, and what they leave of it.

use glam::{DAffine3, DMat3, DVec3};

/// Does the transform leave a surface, if only a flat one?
pub(crate) fn is_visible(world: &DAffine3) -> bool {
    is_invertible(world) || is_flat(world)
}

/// Does the transform flatten space to a plane (rank 2)?
pub(crate) fn is_flat(world: &DAffine3) -> bool {
    const ROUNDING: f64 = 1e-12;
    let (longest, area) = sizes(&world.matrix3);
    is_thin(&world.matrix3) && world.as_affine3a().is_finite() && area > ROUNDING * longest * longest
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
pub(crate) fn lost_direction(matrix: &DMat3) -> DVec3 {
    let rows = matrix.transpose();
    let all = [0, 1, 2].map(|axis| normal_of_others(&rows, axis));
    all.into_iter().max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or(DVec3::Z).normalize()
}

/// A transform that flattens space, with a thickness beyond the rounding of rays, so that the front and back of what was closed
/// are apart and it has an inverse. `corners` are those of the mesh's box, whose middle stays. Others are unchanged.
pub(crate) fn thickened(world: &DAffine3, corners: &[DVec3]) -> DAffine3 {
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

fn is_invertible(world: &DAffine3) -> bool {
    let single = world.as_affine3a();
    !is_thin(&world.matrix3) && single.is_finite() && single.inverse().is_finite()
}
