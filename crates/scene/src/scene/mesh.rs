//! Triangle meshes, objects and their instances.

use std::ops::{Deref, Range};
use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};

use super::material::TextureRef;
use super::motion::{Motion, key_before, mix};

/// Vertex positions that can be handed to Embree without a copy: Embree reads 16 bytes from the start of the last
/// vertex, so one unused vertex follows it.
#[derive(Debug, Clone, Default)]
pub struct Positions {
    padded: Vec<[f32; 3]>,
}

impl Positions {
    /// Takes the vertices over and adds the padding.
    pub fn new(mut vertices: Vec<[f32; 3]>) -> Self {
        vertices.reserve_exact(1);
        vertices.push([0.0; 3]);
        Self { padded: vertices }
    }

    /// The vertices and the unused one that follows them.
    pub fn padded(&self) -> &[[f32; 3]] {
        &self.padded
    }

    /// The vertices, for changes in place.
    pub fn as_mut_slice(&mut self) -> &mut [[f32; 3]] {
        let n = self.padded.len().saturating_sub(1);
        &mut self.padded[..n]
    }
}

impl Deref for Positions {
    type Target = [[f32; 3]];

    fn deref(&self) -> &Self::Target {
        &self.padded[..self.padded.len().saturating_sub(1)]
    }
}

/// Vertices of a mesh that deforms: at least two keys, evenly spaced in time.
#[derive(Debug, Clone, Default)]
pub struct Deformation {
    /// Positions of each key; see [`Mesh::positions`].
    pub positions: Vec<Positions>,
    /// Normals of each key; see [`Mesh::normals`]. Empty if the mesh has none.
    pub normals: Vec<Vec<[f32; 3]>>,
}

impl Deformation {
    /// Size in memory, in bytes.
    pub fn bytes(&self) -> usize {
        let positions: usize = self.positions.iter().map(|p| size_of_val(p.padded())).sum();
        positions + self.normals.iter().map(|n| size_of_val(&n[..])).sum::<usize>()
    }

    /// Positions of three vertices at a time in [0, 1] of the shutter.
    #[inline]
    pub fn corners(&self, vertices: [u32; 3], time: f32) -> [Vec3; 3] {
        let (before, weight) = key_before(self.positions.len(), time);
        let (a, b) = (&self.positions[before], &self.positions[before + 1]);
        vertices.map(|i| mix(a[i as usize].into(), b[i as usize].into(), weight))
    }

    /// Normals of three vertices at a time in [0, 1] of the shutter, not normalized; `None` if the mesh has none.
    #[inline]
    pub fn normals(&self, vertices: [u32; 3], time: f32) -> Option<[Vec3; 3]> {
        if self.normals.is_empty() {
            return None;
        }
        let (before, weight) = key_before(self.normals.len(), time);
        let (a, b) = (&self.normals[before], &self.normals[before + 1]);
        Some(vertices.map(|i| mix(a[i as usize].into(), b[i as usize].into(), weight)))
    }
}

/// An indexed triangle mesh with one material. All attribute arrays are as long as `positions`; every index is below
/// that length (the importer checks this, Embree does not).
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Name for messages.
    pub name: String,
    /// Object-space positions in metres, finite; world-space if the instance has no transform.
    pub positions: Positions,
    /// Unit normals; `None` means flat shading.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Unit tangents, with the bitangent's sign (±1) in `w`; present only if the material needs tangents.
    pub tangents: Option<Vec<[f32; 4]>>,
    /// Likewise of the clear coat's normal map, where that follows other texture coordinates.
    pub coat_tangents: Option<Vec<[f32; 4]>>,
    /// TEXCOORD_0 and TEXCOORD_1; present only if the material samples them.
    pub texcoords: [Option<Vec<[f32; 2]>>; 2],
    /// TEXCOORD_2 and higher that the material samples, each with its number.
    pub more_texcoords: Vec<(u8, Vec<[f32; 2]>)>,
    /// COLOR_0: linear RGBA that multiplies the base colour.
    pub colors: Option<Vec<[f32; 4]>>,
    /// Triangles, counter-clockwise seen from the front.
    pub indices: Vec<[u32; 3]>,
    /// Index into [`super::Scene::materials`].
    pub material: u32,
    /// Deformation while the shutter is open, `None` if rigid. Tangents, texture coordinates and colours do not change.
    pub motion: Option<Deformation>,
    /// Positions one frame before and one after, for velocities; `None` if equal to `positions` or not requested.
    pub adjacent_frames: Option<[Positions; 2]>,
}

impl Mesh {
    /// A flat-shaded mesh without texture coordinates, with the scene's first material; [`super::Scene::add`] places it
    /// with a material of its own. `positions` in metres; `indices` counter-clockwise seen from the front, each below the
    /// number of positions.
    pub fn new(positions: Vec<[f32; 3]>, indices: Vec<[u32; 3]>) -> Self {
        Self { name: "mesh".into(), positions: Positions::new(positions), indices, ..Self::default() }
    }

    /// A set of texture coordinates; `None` if the mesh does not have it.
    pub fn texcoord_set(&self, set: u8) -> Option<&[[f32; 2]]> {
        match self.texcoords.get(usize::from(set)) {
            Some(texcoords) => texcoords.as_deref(),
            None => self.more_texcoords.iter().find(|(number, _)| *number == set).map(|(_, texcoords)| &texcoords[..]),
        }
    }

    /// Coordinates at which `texture` is sampled at three vertices; (0, 0) if the mesh does not have the set.
    #[inline]
    pub fn corner_texcoords(&self, texture: &TextureRef, vertices: [u32; 3]) -> [Vec2; 3] {
        match self.texcoord_set(texture.set) {
            Some(texcoords) => vertices.map(|i| Vec2::from_array(texcoords[i as usize])),
            None => [Vec2::ZERO; 3],
        }
    }

    /// Coordinates at which `texture` is sampled on triangle `prim`, at barycentric weights (`u`, `v`) of its second and
    /// third vertex; (0, 0) if the mesh does not have the set.
    #[inline]
    pub fn texcoord(&self, texture: &TextureRef, prim: u32, (u, v): (f32, f32)) -> Vec2 {
        let [a, b, c] = self.corner_texcoords(texture, self.indices[prim as usize]);
        a + (b - a) * u + (c - a) * v
    }
}

/// Meshes that are placed together.
#[derive(Debug, Clone)]
pub struct Object {
    /// Name for messages.
    pub name: String,
    /// Range of [`super::Scene::meshes`].
    pub meshes: Range<u32>,
}

/// A placement of an object.
#[derive(Debug, Clone, Default)]
pub struct Instance {
    /// Name of the node, for messages.
    pub name: String,
    /// Category in data sets: `extras.category` of the node or of the nearest node above it that has one.
    pub category: Option<Arc<str>>,
    /// Group of lights: `extras.light_group`, likewise.
    pub light_group: Option<Arc<str>>,
    /// Index into [`super::Scene::objects`].
    pub object: u32,
    /// Object to world at the picture's own time; `None` if the meshes are already in world space. Invertible and
    /// finite.
    pub transform: Option<Affine3A>,
    /// Motion while the shutter is open; `None` if the instance does not move.
    pub motion: Option<Arc<Motion>>,
    /// Object to world one frame before and one after, for velocities; `None` if equal to `transform` or not requested.
    pub adjacent_frames: Option<[Affine3A; 2]>,
}

impl Instance {
    /// Object to world at a time in [0, 1] of the shutter; `None` if the meshes are already in world space.
    #[inline]
    pub fn at(&self, time: f32) -> Option<Affine3A> {
        self.motion.as_ref().map(|motion| motion.at(time)).or(self.transform)
    }
}

/// Largest coordinate of placed geometry in metres. Squares of distances must fit a 32-bit float, and Embree silently
/// omits triangles beyond 1.8e18.
pub const MAX_COORDINATE: f32 = 1e18;
