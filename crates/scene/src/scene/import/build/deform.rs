//! Morph targets and skinning.

use glam::{DMat3, DMat4, DVec3};

use super::geometry::Geometry;
use super::reader::Reader;
use crate::error::Result;
use crate::scene::Mesh;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::attributes::{Attributes, Semantic};
use crate::scene::import::document::primitives::Primitive;

/// Deformation state of a mesh.
#[derive(PartialEq)]
pub struct MeshPose<'a> {
    /// One weight per morph target.
    pub weights: &'a [f32],
    /// Mesh-to-world matrix of each joint; `None` for a mesh without a skin.
    pub joints: Option<&'a [DMat4]>,
}

/// Deformation states of a mesh over time.
pub struct MeshPoses<'a> {
    /// At the picture's own time.
    pub picture: MeshPose<'a>,
    /// At the time samples of the shutter; empty if all are equal to `picture`.
    pub shutter: &'a [MeshPose<'a>],
    /// One frame before and after; empty if equal to `picture` or not requested.
    pub adjacent_frames: &'a [MeshPose<'a>],
}

/// Applies morph targets and skin to a primitive's vertices.
/// Errors: Deltas, joints or weights that cannot be read.
pub(crate) fn apply_pose(reader: &mut Reader, primitive: &Primitive, pose: &MeshPose, g: &mut Geometry) -> Result<()> {
    morph(reader, primitive, pose.weights, g)?;
    if let Some(joints) = pose.joints {
        skin(reader, primitive, joints, g)?;
    }
    Ok(())
}

/// Positions and normals of the undeformed vertices `g` at another time.
pub(crate) fn geometry_at(
    reader: &mut Reader,
    primitive: &Primitive,
    pose: &MeshPose,
    g: &Geometry,
) -> Result<Geometry> {
    reader.budget.take(&primitive.at, g.mesh.positions.len() as u64, 24)?;
    // The deltas and weights are not kept in memory: their budget is given back.
    let budget = reader.budget.clone();
    let mesh = Mesh { positions: g.mesh.positions.clone(), normals: g.mesh.normals.clone(), ..Default::default() };
    let mut posed = Geometry { mesh, ..Default::default() };
    apply_pose(reader, primitive, pose, &mut posed)?;
    reader.budget = budget;
    Ok(posed)
}

/// Adds the weighted displacements of the morph targets.
fn morph(reader: &mut Reader, primitive: &Primitive, weights: &[f32], g: &mut Geometry) -> Result<()> {
    let (vertices, mut mended) = (g.mesh.positions.len(), 0);
    let mut add_to = |x: &mut f32, weight: f32, delta: f32| match delta.is_finite() {
        true => *x += weight * delta,
        false => mended += 1,
    };
    for (target, &weight) in primitive.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        let target: &Attributes = target;
        let mut add = |semantic: Semantic, out: &mut dyn Iterator<Item = &mut [f32]>| -> Result<()> {
            if let Some(&index) = target.get(&semantic) {
                let deltas = reader.floats::<3>(index)?;
                for (x, delta) in out.zip(deltas) {
                    x.iter_mut().zip(delta).for_each(|(x, d)| add_to(x, weight, d));
                }
            }
            Ok(())
        };
        add(Semantic::Position, &mut g.mesh.positions.as_mut_slice().iter_mut().map(|p| p.as_mut_slice()))?;
        add(Semantic::Normal, &mut g.mesh.normals.iter_mut().flatten().map(|n| n.as_mut_slice()))?;
        add(Semantic::Tangent, &mut g.mesh.tangents.iter_mut().flatten().map(|t| &mut t[..3]))?;
        if let (Some(colors), Some(&index)) = (&mut g.mesh.colors, target.get(&Semantic::Color(0))) {
            let deltas = reader.flat(index)?;
            for (color, delta) in colors.iter_mut().zip(deltas.chunks(deltas.len() / vertices)) {
                color.iter_mut().zip(delta).for_each(|(x, d)| add_to(x, weight, *d as f32));
            }
        }
        let first = (0..).zip(&mut g.mesh.texcoords).filter_map(|(set, out)| Some((set, out.as_mut()?)));
        let more = g.mesh.more_texcoords.iter_mut().map(|(set, out)| (u32::from(*set), out));
        for (set, out) in first.chain(more) {
            if let Some(&index) = target.get(&Semantic::TexCoord(set)) {
                let deltas = reader.floats::<2>(index)?;
                for (x, d) in out.iter_mut().zip(deltas) {
                    x.iter_mut().zip(d).for_each(|(x, d)| add_to(x, weight, d));
                }
            }
        }
    }
    g.mended += mended;
    g.mesh.colors.iter_mut().flatten().flatten().filter(|x| x.is_finite()).for_each(|x| *x = x.clamp(0.0, 1.0));
    Ok(())
}

/// Linear blend skinning: transforms every vertex by the weighted mean of its joints' matrices.
fn skin(reader: &mut Reader, primitive: &Primitive, joints: &[DMat4], g: &mut Geometry) -> Result<()> {
    reader.budget.take(&primitive.at, g.mesh.positions.len() as u64, size_of::<DMat4>() as u64)?;
    let mut blended = vec![(DMat4::ZERO, 0.0_f64); g.mesh.positions.len()];
    for (joint_index, weight_index) in primitive.skin_sets() {
        let chosen = reader.integers::<4>(joint_index)?;
        let weights = reader.floats::<4>(weight_index)?;
        for (vertex, ((matrix, sum), (chosen, weights))) in
            blended.iter_mut().zip(chosen.iter().zip(&weights)).enumerate()
        {
            for (&joint, &weight) in chosen.iter().zip(weights) {
                if weight == 0.0 || !weight.is_finite() {
                    g.mended += usize::from(weight != 0.0);
                    continue;
                }
                let Some(joint_matrix) = joints.get(joint as usize) else {
                    let at = &reader.document.accessors.get(joint_index)?.at;
                    return Err(bad(
                        at,
                        format!("joints below {}", joints.len()),
                        format!("{joint} at vertex {vertex}"),
                    ));
                };
                *matrix += *joint_matrix * f64::from(weight);
                *sum += f64::from(weight);
            }
        }
    }
    for (vertex, (matrix, sum)) in blended.into_iter().enumerate() {
        // A vertex without weights follows the first joint.
        let matrix = if sum > 0.0 { matrix * (1.0 / sum) } else { joints.first().copied().unwrap_or(DMat4::IDENTITY) };
        let linear = DMat3::from_mat4(matrix);
        let p = &mut g.mesh.positions.as_mut_slice()[vertex];
        *p = matrix.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array();
        transform_frame(
            &linear,
            g.mesh.normals.as_mut().map(|n| &mut n[vertex]),
            g.mesh.tangents.as_mut().map(|t| &mut t[vertex]),
        );
    }
    Ok(())
}

/// Transforms a normal by the inverse transpose and a tangent by the matrix; multiplies the bitangent's sign by that of
/// the determinant. Vectors that become zero remain zero.
pub(crate) fn transform_frame(linear: &DMat3, normal: Option<&mut [f32; 3]>, tangent: Option<&mut [f32; 4]>) {
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    if let Some(n) = normal {
        // The cofactor matrix is the inverse transpose times the determinant; it also exists for singular matrices.
        let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
        let v = DVec3::from(n.map(f64::from));
        let out = (y.cross(z) * v.x + z.cross(x) * v.y + x.cross(y) * v.z) * sign;
        *n = out.normalize_or_zero().as_vec3().to_array();
    }
    if let Some(t) = tangent {
        let out = (*linear * DVec3::new(t[0].into(), t[1].into(), t[2].into())).normalize_or_zero().as_vec3();
        *t = [out.x, out.y, out.z, t[3] * sign as f32];
    }
}
