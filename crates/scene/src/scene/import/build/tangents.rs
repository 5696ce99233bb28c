//! Tangents for normal maps and anisotropy: the file's, or MikkTSpace's, which is what the specification asks for.

use bevy_mikktspace::{Geometry as MikkGeometry, TangentSpace, generate_tangents};
use glam::{DVec3, Vec3};

use super::geometry::{Geometry, cross};
use crate::scene::import::report::Notes;

struct Mikk<'a> {
    geometry: &'a Geometry,
    texcoords: &'a [[f32; 2]],
    normals: &'a [[f32; 3]],
    /// By corner.
    tangents: Vec<[f32; 4]>,
}

impl Mikk<'_> {
    fn vertex(&self, face: usize, vert: usize) -> usize {
        self.geometry.indices[face][vert] as usize
    }
}

impl MikkGeometry for Mikk<'_> {
    fn num_faces(&self) -> usize {
        self.geometry.indices.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.geometry.positions[self.vertex(face, vert)]
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        self.normals[self.vertex(face, vert)]
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        self.texcoords[self.vertex(face, vert)]
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, vert: usize) {
        // glTF's v runs down, MikkTSpace's up: the bitangent points the other way.
        let [x, y, z, w] = space.unwrap_or_default().tangent_encoded();
        self.tangents[3 * face + vert] = [x, y, z, -w];
    }
}

/// Prepares a mesh for [`make`], which takes long and notes nothing: gives it normals if it has none (then flat ones).
/// Can it have tangents for texture coordinates `set`?
pub fn prepare(g: &mut Geometry, set: u8, at: &str, notes: &mut Notes) -> bool {
    if g.normals.is_none() {
        g.unweld();
        let flat = |t: [u32; 3]| [cross(g, t).try_normalize().unwrap_or(DVec3::Y).as_vec3().to_array(); 3];
        g.normals = Some(g.indices.iter().flat_map(|&t| flat(t)).collect());
    }
    if g.tangents.is_none() && g.texcoords[usize::from(set)].is_none() {
        notes.approximated(at, "neither TANGENT nor texture coordinates: highlights are isotropic");
        return false;
    }
    if g.tangents.is_none() {
        notes.convention(at, "tangents are not in the file: made by MikkTSpace");
    }
    true
}

/// Gives the mesh unit tangents for texture coordinates `set`.
pub fn make(g: &mut Geometry, set: u8) {
    if g.tangents.is_none() {
        generate(g, set);
    }
    let (Some(tangents), Some(normals)) = (&mut g.tangents, &g.normals) else { return };
    for (t, n) in tangents.iter_mut().zip(normals) {
        let unit = Vec3::new(t[0], t[1], t[2]).as_dvec3().try_normalize().map(|d| d.as_vec3());
        let unit = unit.unwrap_or_else(|| Vec3::from(*n).any_orthonormal_vector());
        *t = [unit.x, unit.y, unit.z, if t[3] < 0.0 { -1.0 } else { 1.0 }];
    }
}

fn generate(g: &mut Geometry, set: u8) {
    let (Some(normals), Some(texcoords)) = (&g.normals, &g.texcoords[usize::from(set)]) else { return };
    let mut mikk = Mikk { geometry: g, texcoords, normals, tangents: vec![[0.0; 4]; 3 * g.indices.len()] };
    if generate_tangents(&mut mikk).is_err() {
        return;
    }
    let tangents = mikk.tangents;
    // MikkTSpace gives a tangent a corner; corners of one vertex may differ and are split then.
    let origin: Vec<u32> = g.indices.iter().flatten().copied().collect();
    g.unweld();
    g.tangents = Some(tangents);
    g.weld(&origin);
}
