//! From a primitive's accessors to a triangle mesh with only the attributes that its material uses.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};

use super::reader::Reader;
use super::tangents;
use crate::error::Result;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::accessors::Shape;
use crate::scene::import::document::primitives::{Attributes, Primitive, Semantic};
use crate::scene::import::report::Notes;
use crate::scene::{self, Material, Positions};

/// How a mesh is deformed at rest.
pub struct Pose<'a> {
    /// One weight a morph target.
    pub weights: &'a [f32],
    /// Mesh to world by joint.
    pub joints: Option<&'a [DMat4]>,
}

/// Vertex data in the making; all arrays as long as `positions`.
#[derive(Debug, Default)]
pub struct Geometry {
    pub positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    pub tangents: Option<Vec<[f32; 4]>>,
    pub texcoords: [Option<Vec<[f32; 2]>>; 2],
    pub colors: Option<Vec<[f32; 4]>>,
    pub indices: Vec<[u32; 3]>,
}

/// Reads and checks one primitive. `None` when it has no triangles; a note says why.
///
/// # Errors
/// Data that breaks the specification.
pub fn read(
    reader: &mut Reader,
    primitive: &Primitive,
    material: &Material,
    pose: &Pose,
    notes: &mut Notes,
) -> Result<Option<Geometry>> {
    let attributes = &primitive.attributes;
    let Some(&position) = attributes.get(&Semantic::Position) else {
        notes.ignored(&primitive.at, "a primitive without POSITION: nothing to show");
        return Ok(None);
    };
    if primitive.mode < 4 {
        notes.ignored(&primitive.at, "points and lines are not shown, only triangles");
        return Ok(None);
    }
    reader.check_stream(primitive)?;
    let mut g = Geometry { positions: reader.floats::<3>(position)?, ..Default::default() };
    g.indices = read_triangles(reader, primitive, g.positions.len(), notes)?;
    let optional = |semantic| attributes.get(&semantic).copied();
    let (normal, tangent) = (optional(Semantic::Normal), optional(Semantic::Tangent));
    g.normals = normal.map(|i| reader.floats::<3>(i)).transpose()?;
    // Without normals, the file's tangents do not count either.
    let tangent = tangent.filter(|_| material.tangent_set().is_some() && g.normals.is_some());
    g.tangents = tangent.map(|i| reader.floats::<4>(i)).transpose()?;
    if let Some(index) = optional(Semantic::Color(0)) {
        let colors = read_colors(reader, index, notes)?;
        let moves = primitive.targets.iter().any(|target| target.contains_key(&Semantic::Color(0)));
        g.colors = Some(colors).filter(|c| moves || c.iter().any(|c| *c != [1.0; 4]));
    }
    for (set, slot) in [0_u8, 1].into_iter().zip(&mut g.texcoords) {
        let for_tangents = g.tangents.is_none() && material.tangent_set() == Some(set);
        if !material.textures.iter().any(|t| t.set == set) {
            let index = optional(Semantic::TexCoord(set.into())).filter(|_| for_tangents);
            *slot = index.map(|i| reader.floats::<2>(i)).transpose()?;
            continue;
        }
        *slot = Some(match optional(Semantic::TexCoord(set.into())) {
            Some(index) => reader.floats::<2>(index)?,
            None => {
                let text = format!("no TEXCOORD_{set}, which the material's textures need: zeros are used");
                notes.approximated(&primitive.at, text);
                vec![[0.0; 2]; g.positions.len()]
            }
        });
    }
    if attributes.contains_key(&Semantic::Color(1)) {
        notes.not_loaded(&primitive.at, "COLOR_1 and higher, which no material of the specification uses");
    }
    morph(reader, primitive, pose.weights, &mut g)?;
    if let Some(joints) = pose.joints {
        skin(reader, primitive, joints, &mut g)?;
    }
    if let Some(i) = g.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(bad(
            &primitive.at,
            "finite positions in the rest pose",
            format!("{:?} at vertex {i}", g.positions[i]),
        ));
    }
    drop_degenerate(&mut g, &primitive.at, notes);
    if g.indices.is_empty() {
        notes.not_loaded(&primitive.at, "a primitive without a triangle of any area");
        return Ok(None);
    }
    compact(&mut g);
    repair_normals(&mut g, &primitive.at, notes);
    if let Some(set) = material.tangent_set() {
        tangents::complete(&mut g, set, &primitive.at, notes);
    }
    Ok(Some(g))
}

fn read_colors(reader: &mut Reader, index: usize, notes: &mut Notes) -> Result<Vec<[f32; 4]>> {
    let accessor = reader.document.accessors.get(index)?;
    let mut colors: Vec<[f32; 4]> = match accessor.shape {
        Shape::Vec3 => reader.floats::<3>(index)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect(),
        _ => reader.floats::<4>(index)?,
    };
    // As the specification asks.
    if !colors.iter().flatten().all(|x| (0.0..=1.0).contains(x)) {
        notes.repaired(&accessor.at, "vertex colours outside of 0 to 1 are clamped");
        colors.iter_mut().flatten().for_each(|x| *x = x.clamp(0.0, 1.0));
    }
    Ok(colors)
}

/// Indices as triangles: modes 4 to 6, every index below `vertices`.
fn read_triangles(reader: &mut Reader, p: &Primitive, vertices: usize, notes: &mut Notes) -> Result<Vec<[u32; 3]>> {
    let list: Vec<u32> = match p.indices {
        None => {
            reader.budget.take(&p.at, vertices as u64, 4)?;
            (0..vertices as u32).collect()
        }
        Some(index) => {
            let accessor = reader.document.accessors.get(index)?;
            let restart = u32::MAX >> (32 - 8 * accessor.component.size());
            let list: Vec<u32> = reader.integers::<1>(index)?.into_iter().map(|[i]| i).collect();
            if let Some(i) = list.iter().position(|&v| v as usize >= vertices || v == restart) {
                let found = format!("{} as number {i}", list[i]);
                return Err(bad(&accessor.at, format!("vertex indices below {} (and not {restart})", vertices), found));
            }
            list
        }
    };
    let n = list.len();
    let corner = |i: usize| list[i];
    reader.budget.take(&p.at, n as u64, 12)?;
    if p.mode == 4 && !n.is_multiple_of(3) {
        notes.repaired(&p.at, "a number of indices that is no multiple of 3: the last ones are dropped");
    }
    Ok(match p.mode {
        4 => list.as_chunks::<3>().0.to_vec(),
        // The specification's formulas for strips and fans.
        5 => (0..n.saturating_sub(2)).map(|i| [corner(i), corner(i + 1 + i % 2), corner(i + 2 - i % 2)]).collect(),
        _ => (0..n.saturating_sub(2)).map(|i| [corner(i + 1), corner(i + 2), corner(0)]).collect(),
    })
}

/// Adds the morph targets with their weights.
fn morph(reader: &mut Reader, primitive: &Primitive, weights: &[f32], g: &mut Geometry) -> Result<()> {
    let vertices = g.positions.len();
    for (target, &weight) in primitive.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        let target: &Attributes = target;
        let mut add = |semantic: Semantic, out: &mut dyn Iterator<Item = &mut [f32]>| -> Result<()> {
            if let Some(&index) = target.get(&semantic) {
                let deltas = reader.floats::<3>(index)?;
                for (x, delta) in out.zip(deltas) {
                    x.iter_mut().zip(delta).for_each(|(x, d)| *x += weight * d);
                }
            }
            Ok(())
        };
        add(Semantic::Position, &mut g.positions.iter_mut().map(|p| p.as_mut_slice()))?;
        add(Semantic::Normal, &mut g.normals.iter_mut().flatten().map(|n| n.as_mut_slice()))?;
        add(Semantic::Tangent, &mut g.tangents.iter_mut().flatten().map(|t| &mut t[..3]))?;
        if let (Some(colors), Some(&index)) = (&mut g.colors, target.get(&Semantic::Color(0))) {
            let deltas = reader.flat(index)?;
            for (color, delta) in colors.iter_mut().zip(deltas.chunks(deltas.len() / vertices)) {
                color.iter_mut().zip(delta).for_each(|(x, d)| *x += weight * *d as f32);
            }
        }
        for (set, out) in (0..).zip(&mut g.texcoords) {
            if let (Some(out), Some(&index)) = (out, target.get(&Semantic::TexCoord(set))) {
                let deltas = reader.floats::<2>(index)?;
                for (x, d) in out.iter_mut().zip(deltas) {
                    *x = [x[0] + weight * d[0], x[1] + weight * d[1]];
                }
            }
        }
    }
    g.colors.iter_mut().flatten().flatten().for_each(|x| *x = x.clamp(0.0, 1.0));
    Ok(())
}

/// Moves every vertex by the weighted mean of its joints' matrices.
fn skin(reader: &mut Reader, primitive: &Primitive, joints: &[DMat4], g: &mut Geometry) -> Result<()> {
    reader.budget.take(&primitive.at, g.positions.len() as u64, size_of::<DMat4>() as u64)?;
    let mut blended = vec![(DMat4::ZERO, 0.0_f64); g.positions.len()];
    for set in 0..primitive.skin_sets() {
        let (Some(&joint_index), Some(&weight_index)) =
            (primitive.attributes.get(&Semantic::Joints(set)), primitive.attributes.get(&Semantic::Weights(set)))
        else {
            continue;
        };
        let chosen = reader.integers::<4>(joint_index)?;
        let weights = reader.floats::<4>(weight_index)?;
        for (vertex, ((matrix, sum), (chosen, weights))) in
            blended.iter_mut().zip(chosen.iter().zip(&weights)).enumerate()
        {
            for (&joint, &weight) in chosen.iter().zip(weights) {
                if weight == 0.0 {
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
        // A vertex that no joint holds stays with the first one.
        let matrix = if sum > 0.0 { matrix * (1.0 / sum) } else { joints.first().copied().unwrap_or(DMat4::IDENTITY) };
        let linear = DMat3::from_mat4(matrix);
        let p = &mut g.positions[vertex];
        *p = matrix.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array();
        transform_frame(
            &linear,
            g.normals.as_mut().map(|n| &mut n[vertex]),
            g.tangents.as_mut().map(|t| &mut t[vertex]),
        );
    }
    Ok(())
}

/// Normal by the inverse transpose, tangent by the matrix, the bitangent's sign by the determinant's. What has no
/// direction left becomes zeros.
fn transform_frame(linear: &DMat3, normal: Option<&mut [f32; 3]>, tangent: Option<&mut [f32; 4]>) {
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    if let Some(n) = normal {
        // The cofactors are the inverse transpose times the determinant, and exist always.
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

/// Moves a mesh to world space for good.
pub fn bake(mesh: &mut scene::Mesh, world: &DAffine3) {
    if *world == DAffine3::IDENTITY {
        return;
    }
    for p in mesh.positions.as_mut_slice() {
        *p = world.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array();
    }
    for n in mesh.normals.iter_mut().flatten() {
        transform_frame(&world.matrix3, Some(n), None);
    }
    for t in mesh.tangents.iter_mut().flatten() {
        transform_frame(&world.matrix3, None, Some(t));
    }
    if world.matrix3.determinant() < 0.0 {
        mesh.indices.iter_mut().for_each(|t| t.swap(1, 2));
    }
}

fn point(g: &Geometry, i: u32) -> DVec3 {
    DVec3::from(g.positions[i as usize].map(f64::from))
}

/// The triangle's area vector, twice.
pub fn cross(g: &Geometry, [a, b, c]: [u32; 3]) -> DVec3 {
    (point(g, b) - point(g, a)).cross(point(g, c) - point(g, a))
}

fn drop_degenerate(g: &mut Geometry, at: &str, notes: &mut Notes) {
    let before = g.indices.len();
    let mut indices = std::mem::take(&mut g.indices);
    indices.retain(|&t| cross(g, t) != DVec3::ZERO);
    g.indices = indices;
    if g.indices.len() < before {
        notes.not_loaded(at, "triangles without area");
    }
}

/// Keeps the vertices that triangles use: primitives often share one large array.
fn compact(g: &mut Geometry) {
    const UNUSED: u32 = u32::MAX;
    let mut new_index = vec![UNUSED; g.positions.len()];
    g.indices.iter().flatten().for_each(|&i| new_index[i as usize] = 0);
    if !new_index.contains(&UNUSED) {
        return;
    }
    let keep: Vec<bool> = new_index.iter().map(|&i| i != UNUSED).collect();
    for (next, slot) in (0..).zip(new_index.iter_mut().filter(|slot| **slot != UNUSED)) {
        *slot = next;
    }
    g.indices.iter_mut().flatten().for_each(|i| *i = new_index[*i as usize]);
    fn filter<T: Copy>(values: &mut Vec<T>, keep: &[bool]) {
        *values = values.iter().zip(keep).filter(|(_, keep)| **keep).map(|(v, _)| *v).collect();
    }
    filter(&mut g.positions, &keep);
    g.normals.iter_mut().for_each(|v| filter(v, &keep));
    g.tangents.iter_mut().for_each(|v| filter(v, &keep));
    g.texcoords.iter_mut().flatten().for_each(|v| filter(v, &keep));
    g.colors.iter_mut().for_each(|v| filter(v, &keep));
}

/// Makes normals unit vectors; those without a direction become their triangles' mean.
fn repair_normals(g: &mut Geometry, at: &str, notes: &mut Notes) {
    let Some(mut normals) = g.normals.take() else { return };
    let mut missing = false;
    for n in &mut normals {
        let unit = Vec3::from(*n).as_dvec3().try_normalize();
        missing |= unit.is_none();
        *n = unit.unwrap_or(DVec3::ZERO).as_vec3().to_array();
    }
    if missing {
        notes.repaired(at, "normals of length 0: the triangles' own are used");
        let mut sums = vec![DVec3::ZERO; normals.len()];
        for &t in &g.indices {
            let area = cross(g, t);
            t.iter().for_each(|&i| sums[i as usize] += area);
        }
        for (n, sum) in normals.iter_mut().zip(sums).filter(|(n, _)| **n == [0.0; 3]) {
            *n = sum.try_normalize().unwrap_or(DVec3::Y).as_vec3().to_array();
        }
    }
    g.normals = Some(normals);
}

impl Geometry {
    /// Splits vertices so that no two triangles share one.
    pub fn unweld(&mut self) {
        fn spread<T: Copy>(values: &mut Vec<T>, indices: &[[u32; 3]]) {
            *values = indices.iter().flatten().map(|&i| values[i as usize]).collect();
        }
        spread(&mut self.positions, &self.indices);
        self.normals.iter_mut().for_each(|v| spread(v, &self.indices));
        self.tangents.iter_mut().for_each(|v| spread(v, &self.indices));
        self.texcoords.iter_mut().flatten().for_each(|v| spread(v, &self.indices));
        self.colors.iter_mut().for_each(|v| spread(v, &self.indices));
        for (i, triangle) in self.indices.iter_mut().enumerate() {
            *triangle = [0, 1, 2].map(|corner| 3 * i as u32 + corner);
        }
    }

    /// Joins the corners of a split mesh whose old vertex (`origin`) and tangent are equal.
    pub fn weld(&mut self, origin: &[u32]) {
        let mut by_key: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
        let mut kept: Vec<usize> = Vec::new();
        let tangents = self.tangents.as_ref();
        let mut target = Vec::with_capacity(origin.len());
        for (corner, &vertex) in origin.iter().enumerate() {
            let tangent = tangents.map_or([0; 4], |t| t[corner].map(f32::to_bits));
            target.push(*by_key.entry((vertex, tangent)).or_insert_with(|| {
                kept.push(corner);
                (kept.len() - 1) as u32
            }));
        }
        fn pick<T: Copy>(values: &mut Vec<T>, kept: &[usize]) {
            *values = kept.iter().map(|&i| values[i]).collect();
        }
        pick(&mut self.positions, &kept);
        self.normals.iter_mut().for_each(|v| pick(v, &kept));
        self.tangents.iter_mut().for_each(|v| pick(v, &kept));
        self.texcoords.iter_mut().flatten().for_each(|v| pick(v, &kept));
        self.colors.iter_mut().for_each(|v| pick(v, &kept));
        self.indices.iter_mut().flatten().for_each(|i| *i = target[*i as usize]);
    }

    /// The scene's mesh.
    pub fn into_mesh(self, name: String, material: u32) -> scene::Mesh {
        scene::Mesh {
            name,
            positions: Positions::new(self.positions),
            normals: self.normals,
            tangents: self.tangents,
            texcoords: self.texcoords,
            colors: self.colors,
            indices: self.indices,
            material,
        }
    }
}
