//! Triangles and where they stand.

use std::ops::{Deref, Range};
use std::sync::Arc;

use glam::Affine3A;

use super::motion::{Deformation, Motion};

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

/// One indexed triangle mesh with one material. All attribute arrays are as long as `positions`; every index is
/// below that length (checked by the importer: Embree does not check).
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Name for messages.
    pub name: String,
    /// Object-space positions (world space once baked), finite.
    pub positions: Positions,
    /// Unit normals; absent means flat shading.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Unit tangents, `w` = ±1 the bitangent's sign; present only when the material has a normal map.
    pub tangents: Option<Vec<[f32; 4]>>,
    /// TEXCOORD_0 and TEXCOORD_1; present only when the material samples them.
    pub texcoords: [Option<Vec<[f32; 2]>>; 2],
    /// COLOR_0, linear RGBA, multiplies the base colour.
    pub colors: Option<Vec<[f32; 4]>>,
    /// Triangles, counter-clockwise from the front.
    pub indices: Vec<[u32; 3]>,
    /// Index into [`super::Scene::materials`].
    pub material: u32,
    /// What it does while the shutter is open; `None` if it holds its form. Tangents, coordinates and colours stay.
    pub motion: Option<Deformation>,
    /// Positions a frame before and after, for velocities; `None` if they are the same, or nobody asks.
    pub adjacent_frames: Option<[Positions; 2]>,
}

/// Meshes that are placed together.
#[derive(Debug, Clone)]
pub struct Object {
    /// Name for messages.
    pub name: String,
    /// Range of [`super::Scene::meshes`].
    pub meshes: Range<u32>,
}

/// One placement of an object.
#[derive(Debug, Clone, Default)]
pub struct Instance {
    /// Name of the node, for messages.
    pub name: String,
    /// Index into [`super::Scene::objects`].
    pub object: u32,
    /// Object to world, at the picture's own moment; `None` when the meshes are already in world space. Invertible and
    /// finite.
    pub transform: Option<Affine3A>,
    /// What it does while the shutter is open; `None` if it stands still.
    pub motion: Option<Arc<Motion>>,
    /// Object to world a frame before and after, for velocities; `None` if it is the same, or nobody asks.
    pub adjacent_frames: Option<[Affine3A; 2]>,
}

impl Instance {
    /// Object to world at a time in [0, 1] of the shutter; `None` when the meshes are already in world space.
    #[inline]
    pub fn at(&self, time: f32) -> Option<Affine3A> {
        self.motion.as_ref().map(|motion| motion.at(time)).or(self.transform)
    }
}

/// Largest coordinate, in metres, of what is placed: squares of distances must fit a 32-bit float, and Embree leaves
/// triangles beyond 1.8e18 out silently.
pub const FARTHEST: f32 = 1e18;
