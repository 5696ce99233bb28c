//! Reads a primitive's accessors into a triangle mesh with only the attributes that its material uses.

use glam::{DAffine3, DVec3, Vec3};

use super::deform::{MeshPose, MeshPoses, apply_pose, geometry_at, transform_frame};
use super::geometry::Geometry;
use super::reader::Reader;
use super::tangents;
use crate::error::Result;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::accessors::Shape;
use crate::scene::import::document::attributes::Semantic;
use crate::scene::import::document::extensions::SPLATS;
use crate::scene::import::document::primitives::Primitive;
use crate::scene::import::report::Notes;
use crate::scene::{self, Deformation, Material, Positions};

/// A mesh whose remaining steps cannot fail.
#[derive(Debug)]
pub struct Draft {
    pub geometry: Geometry,
    /// Transform to bake into the vertices, and those one frame before and after if they differ.
    pub world: Option<(DAffine3, Option<[DAffine3; 2]>)>,
}

impl Draft {
    pub(crate) fn needs_tangents(&self) -> bool {
        let [own, coat] = self.geometry.tangents_for;
        coat.is_some() || own.is_some() && self.geometry.mesh.tangents.is_none()
    }

    /// A stand-in mesh with positions only.
    pub fn outline(&self) -> scene::Mesh {
        let scene::Mesh { positions, material, .. } = &self.geometry.mesh;
        let mesh = scene::Mesh { positions: positions.clone(), material: *material, ..Default::default() };
        Self { geometry: Geometry { mesh, ..Default::default() }, world: self.world }.finish()
    }

    pub fn finish(mut self) -> scene::Mesh {
        let sets = self.geometry.tangents_for;
        tangents::make(&mut self.geometry, sets);
        let mut mesh = self.geometry.mesh;
        if let Some((world, adjacent_frames)) = self.world {
            bake(&mut mesh, &world, adjacent_frames);
        }
        mesh
    }
}

/// Reads and checks one primitive, without triangles that nothing can see unless the material `fades`. `None` if it has no triangles;
/// a note says why.
///
/// # Errors
/// Data that breaks the specification.
pub fn read(
    reader: &mut Reader,
    primitive: &Primitive,
    (material, fades): (&Material, bool),
    MeshPoses { picture: pose, shutter, adjacent_frames }: &MeshPoses,
    notes: &mut Notes,
) -> Result<Option<Geometry>> {
    let attributes = &primitive.attributes;
    let Some(&position) = attributes.get(&Semantic::Position) else {
        notes.ignored(&primitive.at, "a primitive without POSITION: nothing to show");
        return Ok(None);
    };
    if primitive.mode < 4 {
        let text = match primitive.extensions.iter().any(|name| name == SPLATS) {
            true => format!("{} splats, not shown ({SPLATS})", reader.document.accessors.get(position)?.count),
            false => "points and lines are not shown, only triangles".into(),
        };
        notes.ignored(&primitive.at, text);
        return Ok(None);
    }
    reader.check_stream(primitive)?;
    let mut g = Geometry::default();
    g.mesh.positions = Positions::new(reader.floats::<3>(position)?);
    g.mesh.indices = read_triangles(reader, primitive, g.mesh.positions.len(), notes)?;
    let optional = |semantic| attributes.get(&semantic).copied();
    let (normal, tangent) = (optional(Semantic::Normal), optional(Semantic::Tangent));
    g.mesh.normals = normal.map(|i| reader.floats::<3>(i)).transpose()?;
    // The specification ignores tangents without normals.
    let tangent = tangent.filter(|_| material.tangent_sets()[0].is_some() && g.mesh.normals.is_some());
    g.mesh.tangents = tangent.map(|i| reader.floats::<4>(i)).transpose()?;
    if let Some(index) = optional(Semantic::Color(0)) {
        let colors = read_colors(reader, index, notes)?;
        let is_morphed = primitive.targets.iter().any(|target| target.contains_key(&Semantic::Color(0)));
        g.mesh.colors = Some(colors).filter(|c| is_morphed || c.iter().any(|c| *c != [1.0; 4]));
    }
    let mut sets: Vec<u8> = material.textures.iter().map(|texture| texture.set).chain([0, 1]).collect();
    sets.sort_unstable();
    sets.dedup();
    for set in sets {
        let index = optional(Semantic::TexCoord(set.into()));
        let texcoords = if material.textures.iter().any(|t| t.set == set) {
            Some(match index {
                Some(index) => reader.floats::<2>(index)?,
                None => {
                    let text = format!("no TEXCOORD_{set}, which the material's textures need: zeros are used");
                    notes.approximated(&primitive.at, text);
                    vec![[0.0; 2]; g.mesh.positions.len()]
                }
            })
        } else {
            let for_tangents = g.mesh.tangents.is_none() && material.tangent_sets()[0] == Some(set);
            // The AOV `uv` shows TEXCOORD_0 of all surfaces with textures.
            let for_aov = set == 0 && material.textures.iter().next().is_some();
            index.filter(|_| for_tangents || for_aov).map(|i| reader.floats::<2>(i)).transpose()?
        };
        match g.mesh.texcoords.get_mut(usize::from(set)) {
            Some(slot) => *slot = texcoords,
            None => g.mesh.more_texcoords.extend(texcoords.map(|texcoords| (set, texcoords))),
        }
    }
    if attributes.contains_key(&Semantic::Color(1)) {
        notes.not_loaded(&primitive.at, "COLOR_1 and higher, which no material of the specification uses");
    }
    let mut steps = |poses: &[MeshPose]| -> Result<Vec<_>> {
        poses.iter().map(|p| geometry_at(reader, primitive, p, &g)).collect()
    };
    let (steps, adjacent_frames) = (steps(shutter)?, steps(adjacent_frames)?);
    g.source = (!steps.is_empty() || !adjacent_frames.is_empty()).then(|| (0..g.mesh.positions.len() as u32).collect());
    apply_pose(reader, primitive, pose, &mut g)?;
    g.mend_numbers(&primitive.at, notes);
    g.drop_not_finite(steps.iter().chain(&adjacent_frames), &primitive.at, notes);
    g.drop_clear(|alpha| fades || material.shows(alpha), &primitive.at, notes);
    g.drop_degenerate(&primitive.at, notes);
    if g.mesh.indices.is_empty() {
        notes.not_loaded(&primitive.at, "a primitive without a triangle to see");
        return Ok(None);
    }
    g.compact();
    let sign = if g.repair_normals(&primitive.at, notes) { -1.0 } else { 1.0 };
    g.tangents_for = tangents::prepare(&mut g, material.tangent_sets(), &primitive.at, notes);
    if g.source.is_some() {
        // Tangent generation splits vertices; it must precede the other time samples, which use the same vertices.
        let sets = std::mem::take(&mut g.tangents_for);
        tangents::make(&mut g, sets);
    }
    if let Some(source) = g.source.take() {
        let pick = |values: &[[f32; 3]]| source.iter().map(|&i| values[i as usize]).collect::<Vec<_>>();
        let unit = |n: [f32; 3]| (sign * Vec3::from(n).normalize_or_zero()).to_array();
        let positions = |step: &Geometry| Positions::new(pick(&step.mesh.positions));
        if !steps.is_empty() {
            let mut motion = Deformation::default();
            // One after the other, so that not all are in memory twice.
            for step in steps {
                motion.positions.push(positions(&step));
                motion.normals.extend(step.mesh.normals.map(|normals| pick(&normals).into_iter().map(unit).collect()));
            }
            g.mesh.motion = Some(motion);
        }
        g.mesh.adjacent_frames = adjacent_frames.iter().map(positions).collect::<Vec<_>>().try_into().ok();
    }
    Ok(Some(g))
}

/// Vertex colours as linear RGBA in [0, 1].
fn read_colors(reader: &mut Reader, index: usize, notes: &mut Notes) -> Result<Vec<[f32; 4]>> {
    let accessor = reader.document.accessors.get(index)?;
    let mut colors: Vec<[f32; 4]> = match accessor.shape {
        Shape::Vec3 => reader.floats::<3>(index)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect(),
        _ => reader.floats::<4>(index)?,
    };
    // The specification requires clamping.
    if colors.iter().flatten().any(|x| x.is_finite() && !(0.0..=1.0).contains(x)) {
        notes.repaired(&accessor.at, "vertex colours outside of 0 to 1 are clamped");
        colors.iter_mut().flatten().filter(|x| x.is_finite()).for_each(|x| *x = x.clamp(0.0, 1.0));
    }
    Ok(colors)
}

/// Triangles of modes 4 to 6 (list, strip, fan), with every index below `vertices`.
fn read_triangles(reader: &mut Reader, p: &Primitive, vertices: usize, notes: &mut Notes) -> Result<Vec<[u32; 3]>> {
    let (list, restart): (Vec<u32>, _) = match p.indices {
        None => {
            reader.budget.take(&p.at, vertices as u64, 4)?;
            ((0..vertices as u32).collect(), None)
        }
        Some(index) => {
            let accessor = reader.document.accessors.get(index)?;
            let restart = u32::MAX >> (32 - 8 * accessor.component.size());
            let list: Vec<u32> = reader.integers::<1>(index)?.into_iter().map(|[i]| i).collect();
            let restarts = p.mode > 4 && reader.document.extensions.contains_key("EXT_mesh_primitive_restart");
            let ends = restarts.then_some(restart);
            if let Some(i) = list.iter().position(|&v| (v as usize >= vertices || v == restart) && Some(v) != ends) {
                let found = format!("{} as number {i}", list[i]);
                return Err(bad(&accessor.at, format!("vertex indices below {} (and not {restart})", vertices), found));
            }
            (list, ends)
        }
    };
    let n = list.len();
    let parts = list.split(|i| Some(*i) == restart).map(|part| (part, 0..part.len().saturating_sub(2)));
    reader.budget.take(&p.at, n as u64, 12)?;
    if p.mode == 4 && !n.is_multiple_of(3) {
        notes.repaired(&p.at, "a number of indices that is no multiple of 3: the last ones are dropped");
    }
    Ok(match p.mode {
        4 => list.as_chunks::<3>().0.to_vec(),
        // The specification's formulas for strips and fans.
        5 => parts.flat_map(|(v, all)| all.map(|i| [v[i], v[i + 1 + i % 2], v[i + 2 - i % 2]])).collect(),
        _ => parts.flat_map(|(v, all)| all.map(|i| [v[i + 1], v[i + 2], v[0]])).collect(),
    })
}

/// Bakes a transform into a mesh; `adjacent_frames` are the transforms one frame before and after, if they differ.
fn bake(mesh: &mut scene::Mesh, world: &DAffine3, adjacent_frames: Option<[DAffine3; 2]>) {
    let place = |positions: &mut Positions, world: &DAffine3| {
        for p in positions.as_mut_slice() {
            *p = world.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array();
        }
    };
    if mesh.adjacent_frames.is_some() || adjacent_frames.is_some() {
        let both = mesh.adjacent_frames.get_or_insert_with(|| [mesh.positions.clone(), mesh.positions.clone()]);
        both.iter_mut()
            .zip(adjacent_frames.unwrap_or([*world; 2]))
            .for_each(|(positions, world)| place(positions, &world));
    }
    if *world == DAffine3::IDENTITY {
        return;
    }
    let (mut steps, mut normals) = (Vec::new(), Vec::new());
    if let Some(motion) = &mut mesh.motion {
        steps.extend(&mut motion.positions);
        normals.extend(motion.normals.iter_mut().flatten());
    }
    steps.into_iter().chain([&mut mesh.positions]).for_each(|positions| place(positions, world));
    for n in normals.into_iter().chain(mesh.normals.iter_mut().flatten()) {
        transform_frame(&world.matrix3, Some(n), None);
    }
    for t in [&mut mesh.tangents, &mut mesh.coat_tangents].into_iter().flatten().flatten() {
        transform_frame(&world.matrix3, None, Some(t));
    }
    if world.matrix3.determinant() < 0.0 {
        mesh.indices.iter_mut().for_each(|t| t.swap(1, 2));
    }
}
