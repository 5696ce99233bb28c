//! Batches of rays and hits, as structure of arrays.

use crate::lanes::{F, LANES, Rows, U, V3, load, store, store_bits};
use crate::scene::Primitive;

/// Marks a miss in the index columns of [`HitBatch`].
pub const MISS: u32 = u32::MAX;

/// The triangle of a miss.
pub(super) const NO_PRIMITIVE: Primitive = Primitive { instance: MISS, mesh: MISS, prim: MISS };

/// Rays as structure of arrays; all columns have the same length.
#[derive(Debug, Default, Clone)]
pub struct RayBatch {
    /// World-space origins, x, y, z.
    pub origin: [Vec<f32>; 3],
    /// World-space directions, x, y, z, usually of unit length; `t` is in units of their length.
    pub direction: [Vec<f32>; 3],
    /// Start of the ray interval, ≥ 0.
    pub tnear: Vec<f32>,
    /// End of the ray interval.
    pub tfar: Vec<f32>,
    /// Random number of the ray: seed of the stochastic test at alpha-blended surfaces.
    pub key: Vec<u32>,
    /// Time from 0 (shutter opens) to 1 (shutter closes); empty where nothing moves.
    pub time: Vec<f32>,
}

/// The closest hits of a [`RayBatch`], in the same order.
#[derive(Debug, Default, Clone)]
pub struct HitBatch {
    /// Distance in units of the direction's length; infinite for a miss.
    pub t: Vec<f32>,
    /// Barycentric weight of the triangle's second vertex.
    pub u: Vec<f32>,
    /// Barycentric weight of the triangle's third vertex.
    pub v: Vec<f32>,
    /// Index into [`Scene::instances`](crate::scene::Scene::instances), or [`MISS`].
    pub instance: Vec<u32>,
    /// Index into [`Scene::meshes`](crate::scene::Scene::meshes), or [`MISS`].
    pub mesh: Vec<u32>,
    /// Index of the triangle in the mesh, or [`MISS`].
    pub prim: Vec<u32>,
    /// Is it the triangle's back that is hit ([`Scene::is_back`](crate::scene::Scene::is_back))? No meaning for a miss.
    pub back: Vec<bool>,
}

/// One of all hits of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnyHit {
    pub ray: u32,
    /// Distance in units of the direction's length.
    pub t: f32,
    pub primitive: Primitive,
}

/// Coherence of neighbouring rays in a batch. A hint: it may only change which one of several coincident surfaces is hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayOrder {
    /// Neighbours are similar: camera rays of one tile.
    Coherent,
    /// Neighbours are unrelated: all other rays.
    Incoherent,
}

impl RayBatch {
    pub fn len(&self) -> usize {
        self.tfar.len()
    }

    pub fn is_empty(&self) -> bool {
        self.tfar.is_empty()
    }

    /// Removes all rays and keeps the memory.
    pub fn clear(&mut self) {
        self.close(0);
    }

    /// The columns of origins, directions, starts and ends.
    fn floats(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        self.origin.iter_mut().chain(&mut self.direction).chain([&mut self.tnear, &mut self.tfar])
    }

    #[inline]
    pub fn direction(&self, i: usize) -> glam::Vec3 {
        glam::Vec3::new(self.direction[0][i], self.direction[1][i], self.direction[2][i])
    }

    #[inline]
    pub fn origin(&self, i: usize) -> glam::Vec3 {
        glam::Vec3::new(self.origin[0][i], self.origin[1][i], self.origin[2][i])
    }

    #[inline(always)]
    pub fn directions(&self, rows: &Rows) -> V3 {
        let [x, y, z] = &self.direction;
        V3 { x: load(x, rows), y: load(y, rows), z: load(z, rows) }
    }

    #[inline(always)]
    pub fn origins(&self, rows: &Rows) -> V3 {
        let [x, y, z] = &self.origin;
        V3 { x: load(x, rows), y: load(y, rows), z: load(z, rows) }
    }

    /// The time of a ray; 0 where nothing moves.
    #[inline]
    pub fn time(&self, i: usize) -> f32 {
        self.time.get(i).copied().unwrap_or(0.0)
    }

    /// The times of eight rays; 0 where nothing moves.
    #[inline(always)]
    pub fn times(&self, rows: &Rows) -> F {
        if self.time.is_empty() { F::ZERO } else { load(&self.time, rows) }
    }

    /// Makes room for `capacity` rays, with times if something `moves`. Fill it with [`put`](Self::put), then call
    /// [`close`](Self::close).
    pub fn open(&mut self, capacity: usize, moves: bool) {
        let len = capacity + LANES;
        self.floats().for_each(|column| column.resize(len, 0.0));
        self.key.resize(len, 0);
        self.time.resize(if moves { len } else { 0 }, 0.0);
    }

    /// Writes eight rays to the rows from `at` on, with `tnear` zero; `time` is ignored where nothing moves.
    #[inline(always)]
    pub fn put(&mut self, at: usize, (origin, direction): (V3, V3), tfar: F, key: U, time: F) {
        let ([ox, oy, oz], [dx, dy, dz]) = (&mut self.origin, &mut self.direction);
        store(ox, at, origin.x);
        store(oy, at, origin.y);
        store(oz, at, origin.z);
        store(dx, at, direction.x);
        store(dy, at, direction.y);
        store(dz, at, direction.z);
        store(&mut self.tnear, at, F::ZERO);
        store(&mut self.tfar, at, tfar);
        store_bits(&mut self.key, at, key);
        if !self.time.is_empty() {
            store(&mut self.time, at, time);
        }
    }

    /// Truncates the batch to `len` rays.
    pub fn close(&mut self, len: usize) {
        self.floats().for_each(|column| column.truncate(len));
        self.key.truncate(len);
        self.time.truncate(len);
    }

    /// Appends a ray without a time.
    #[inline]
    pub fn push(&mut self, origin: glam::Vec3, direction: glam::Vec3, tnear: f32, tfar: f32, key: u32) {
        let values = [origin.x, origin.y, origin.z, direction.x, direction.y, direction.z, tnear, tfar];
        self.floats().zip(values).for_each(|(column, value)| column.push(value));
        self.key.push(key);
    }
}

impl HitBatch {
    /// Number of rows, hits and misses.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The triangle of a hit; its indices are [`MISS`] for a miss.
    #[inline]
    pub fn primitive(&self, row: usize) -> Primitive {
        Primitive { instance: self.instance[row], mesh: self.mesh[row], prim: self.prim[row] }
    }

    /// Replaces a hit by one of another batch.
    pub fn replace(&mut self, row: usize, by: &Self, from: usize) {
        self.set(row, (by.t[from], by.u[from], by.v[from]), by.primitive(from), by.back[from]);
    }

    pub(crate) fn set_miss(&mut self, row: usize) {
        self.set(row, (self.t[row], self.u[row], self.v[row]), NO_PRIMITIVE, false);
    }

    /// Replaces a hit: distance, barycentric weights, triangle and side.
    #[inline(always)]
    pub(super) fn set(&mut self, row: usize, (t, u, v): (f32, f32, f32), primitive: Primitive, back: bool) {
        self.back[row] = back;
        (self.t[row], self.u[row], self.v[row]) = (t, u, v);
        (self.instance[row], self.mesh[row], self.prim[row]) = (primitive.instance, primitive.mesh, primitive.prim);
    }

    /// Copies all hits of another batch, into the memory that this one has.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.t.clone_from(&other.t);
        self.u.clone_from(&other.u);
        self.v.clone_from(&other.v);
        self.instance.clone_from(&other.instance);
        self.mesh.clone_from(&other.mesh);
        self.prim.clone_from(&other.prim);
        self.back.clone_from(&other.back);
    }

    /// Resizes all columns to `len`; old entries stay.
    pub(crate) fn resize(&mut self, len: usize) {
        for column in [&mut self.t, &mut self.u, &mut self.v] {
            column.resize(len, 0.0);
        }
        for column in [&mut self.instance, &mut self.mesh, &mut self.prim] {
            column.resize(len, MISS);
        }
        self.back.resize(len, false);
    }
}
