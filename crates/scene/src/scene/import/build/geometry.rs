//! From a primitive's accessors to a triangle mesh with only the attributes that its material uses.

use std::collections::HashMap;

use glam::{DAffine3, DVec3, Vec3};

use super::deform::{Pose, Poses, step, take_pose, transform_frame};
use super::reader::Reader;
use super::tangents;
use crate::error::Result;
use crate::scene::import::complaint::bad;
use crate::scene::import::document::accessors::Shape;
use crate::scene::import::document::primitives::{Primitive, Semantic};
use crate::scene::import::report::Notes;
use crate::scene::{self, Deformation, Material, Positions};

/// Vertex data in the making; all arrays as long as `positions`.
#[derive(Debug, Default)]
pub struct Geometry {
    pub positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    pub tangents: Option<Vec<[f32; 4]>>,
    pub texcoords: [Option<Vec<[f32; 2]>>; 2],
    pub colors: Option<Vec<[f32; 4]>>,
    pub indices: Vec<[u32; 3]>,
    /// Vertices of the file, where other time samples are asked for.
    pub source: Option<Vec<u32>>,
    pub motion: Option<Deformation>,
    pub adjacent_frames: Option<[Positions; 2]>,
    /// The texture coordinates along which tangents are still to be made.
    pub tangents_for: Option<u8>,
}

/// A mesh that only wants what can fail no more.
#[derive(Debug)]
pub struct Draft {
    pub geometry: Geometry,
    pub name: String,
    /// Of the scene.
    pub material: u32,
    /// Where it is put for good, and where that is a frame before and after if it is elsewhere.
    pub world: Option<(DAffine3, Option<[DAffine3; 2]>)>,
}

impl Draft {
    /// Does what it wants take long?
    pub fn takes_long(&self) -> bool {
        self.geometry.tangents_for.is_some() && self.geometry.tangents.is_none()
    }

    /// A mesh with the positions alone.
    pub fn outline(&self) -> scene::Mesh {
        let geometry = Geometry { positions: self.geometry.positions.clone(), ..Default::default() };
        Self { geometry, name: String::new(), material: self.material, world: self.world }.finish()
    }

    /// The scene's mesh.
    pub fn finish(mut self) -> scene::Mesh {
        if let Some(set) = self.geometry.tangents_for {
            tangents::make(&mut self.geometry, set);
        }
        let mut mesh = self.geometry.into_mesh(self.name, self.material);
        if let Some((world, adjacent_frames)) = self.world {
            bake(&mut mesh, &world, adjacent_frames);
        }
        mesh
    }
}

/// Reads and checks one primitive. `None` when it has no triangles; a note says why.
///
/// # Errors
/// Data that breaks the specification.
pub fn read(
    reader: &mut Reader,
    primitive: &Primitive,
    material: &Material,
    Poses { own: pose, over, adjacent_frames }: &Poses,
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
    let mut steps =
        |poses: &[Pose]| -> Result<Vec<_>> { poses.iter().map(|p| step(reader, primitive, p, &g)).collect() };
    let (steps, adjacent_frames) = (steps(over)?, steps(adjacent_frames)?);
    g.source = (!steps.is_empty() || !adjacent_frames.is_empty()).then(|| (0..g.positions.len() as u32).collect());
    take_pose(reader, primitive, pose, &mut g)?;
    drop_degenerate(&mut g, &primitive.at, notes);
    if g.indices.is_empty() {
        notes.not_loaded(&primitive.at, "a primitive without a triangle of any area");
        return Ok(None);
    }
    compact(&mut g);
    repair_normals(&mut g, &primitive.at, notes);
    g.tangents_for = material.tangent_set().filter(|&set| tangents::prepare(&mut g, set, &primitive.at, notes));
    if g.source.is_some()
        && let Some(set) = g.tangents_for.take()
    {
        // They part vertices, which the other time samples then have as well.
        tangents::make(&mut g, set);
    }
    if let Some(source) = g.source.take() {
        let pick = |values: &Vec<[f32; 3]>| source.iter().map(|&i| values[i as usize]).collect::<Vec<_>>();
        let unit = |n: [f32; 3]| Vec3::from(n).normalize_or_zero().to_array();
        let normals =
            steps.iter().filter_map(|step| Some(pick(step.normals.as_ref()?).into_iter().map(unit).collect()));
        let positions =
            |steps: &[Geometry]| steps.iter().map(|s| Positions::new(pick(&s.positions))).collect::<Vec<_>>();
        if !steps.is_empty() {
            g.motion = Some(Deformation { positions: positions(&steps), normals: normals.collect() });
        }
        g.adjacent_frames = positions(&adjacent_frames).try_into().ok();
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

/// Moves a mesh to world space for good; `beside` is where it stands a frame before and after, if that is elsewhere.
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
    g.source.iter_mut().for_each(|v| filter(v, &keep));
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
        self.source.iter_mut().for_each(|v| spread(v, &self.indices));
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
        self.source.iter_mut().for_each(|v| pick(v, &kept));
        self.normals.iter_mut().for_each(|v| pick(v, &kept));
        self.tangents.iter_mut().for_each(|v| pick(v, &kept));
        self.texcoords.iter_mut().flatten().for_each(|v| pick(v, &kept));
        self.colors.iter_mut().for_each(|v| pick(v, &kept));
        self.indices.iter_mut().flatten().for_each(|i| *i = target[*i as usize]);
    }

    /// The scene's mesh.
    fn into_mesh(self, name: String, material: u32) -> scene::Mesh {
        scene::Mesh {
            name,
            positions: Positions::new(self.positions),
            normals: self.normals,
            tangents: self.tangents,
            texcoords: self.texcoords,
            colors: self.colors,
            indices: self.indices,
            material,
            motion: self.motion,
            adjacent_frames: self.adjacent_frames,
        }
    }
}
