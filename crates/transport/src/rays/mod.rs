//! Ray queries over batches, behind one small trait with two implementations: Debian's Embree 4 ([`embree`]) and
//! obvhs ([`cwbvh`]).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::lanes::{F, LANES, Rows, U, V3, load, store, store_bits};
use crate::scene::{Instance, Scene};
use crate::{Error, Result};

mod check;
pub mod cwbvh;
pub mod embree;

/// Which library answers ray queries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// Embree 4, as the system has it.
    #[default]
    Embree,
    /// obvhs, in pure Rust.
    Obvhs,
}

/// Builds a scene into ray queries, with as many threads as the current rayon pool has.
///
/// # Errors
/// See [`embree::EmbreeRays::build`] and [`cwbvh::ObvhsRays::build`].
pub fn build(backend: Backend, scene: Arc<Scene>) -> Result<Box<dyn RayQueries>> {
    build_watched(backend, scene, &|_| true)
}

/// As [`build`], followed by `watch`.
///
/// # Errors
/// As [`build`], and [`Error::Interrupted`] when `watch` says so.
pub fn build_watched(backend: Backend, scene: Arc<Scene>, watch: Watch) -> Result<Box<dyn RayQueries>> {
    Ok(match backend {
        Backend::Embree => {
            // Embree's threads are its own.
            let options = embree::EmbreeOptions { threads: rayon::current_num_threads(), ..Default::default() };
            Box::new(embree::EmbreeRays::build(scene, &options, watch)?)
        }
        Backend::Obvhs => Box::new(cwbvh::ObvhsRays::build(scene, &cwbvh::ObvhsOptions::default(), watch)?),
    })
}

/// Follows a build: is handed the share that is done, in [0, 1], from any thread and not always in order, and answers
/// whether to go on. Embree asks every some thousand triangles, obvhs before each object.
pub type Watch<'a> = &'a (dyn Fn(f64) -> bool + Sync);

/// Asks `watch` whether to go on.
fn go_on(watch: Watch, done: f64) -> Result<()> {
    if watch(done) { Ok(()) } else { Err(stopped()) }
}

fn stopped() -> Error {
    Error::Interrupted(
        "interrupted while building the acceleration structure: nothing new is saved; run the same command again"
            .to_owned(),
    )
}

/// What a build is long for: triangles, each once for every time that it is built, and placements.
fn units(scene: &Scene) -> usize {
    let mut built = vec![false; scene.objects.len()];
    let of_instance = |instance: &Instance| {
        let again = instance.transform.is_some() && std::mem::replace(&mut built[instance.object as usize], true);
        1 + if again { 0 } else { scene.triangles(instance.object) }
    };
    scene.instances.iter().map(of_instance).sum()
}

/// No hit, in [`HitBatch`]'s index columns.
pub const MISS: u32 = u32::MAX;

/// Rays as structure of arrays; all columns are equally long.
#[derive(Debug, Default, Clone, Serialize, Deserialize)]
pub struct RayBatch {
    /// World-space origins, x, y, z.
    pub origin: [Vec<f32>; 3],
    /// World-space directions, x, y, z; unit length unless the producer says otherwise (`t` is in their units).
    pub direction: [Vec<f32>; 3],
    /// Where the interval starts, ≥ 0.
    pub tnear: Vec<f32>,
    /// Where the interval ends.
    pub tfar: Vec<f32>,
    /// A random number of the ray's own: the seed of the choice at surfaces with alpha blending.
    pub key: Vec<u32>,
    /// When it is, from 0, where the shutter opens, to 1, where it closes; empty where nothing moves.
    #[serde(default)]
    pub time: Vec<f32>,
}

/// The closest hits of a [`RayBatch`], in its order.
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
    /// Triangle of that mesh, or [`MISS`].
    pub prim: Vec<u32>,
}

/// How like its neighbours a ray of a batch is. A hint: hits do not depend on it, but for which of coincident surfaces is
/// hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RayOrder {
    /// Camera rays of one tile.
    Coherent,
    /// Anything else.
    Incoherent,
}

/// What a backend says of itself, for `--stats` and picture headers.
#[derive(Debug, Clone)]
pub struct BackendInfo {
    /// `embree` or `obvhs`.
    pub name: &'static str,
    /// Library version.
    pub version: String,
    /// Instruction set that traversal uses.
    pub isa: String,
    /// Seconds that the build took.
    pub build_seconds: f64,
    /// Bytes of the acceleration structure.
    pub memory_bytes: u64,
    /// The most that the library held at once while it built, where it says so.
    pub peak_bytes: Option<u64>,
}

/// A scene that rays can be shot at. Surfaces with alpha are resolved inside: a hit is a hit that counts.
pub trait RayQueries: Send + Sync {
    /// Closest hits; resizes `hits` to the batch.
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch);
    /// Is anything in each ray's interval? Resizes `occluded` to the batch.
    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>);
    /// What it is.
    fn info(&self) -> &BackendInfo;
}

impl<T: RayQueries + ?Sized> RayQueries for &T {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        (**self).closest_hits(rays, order, hits);
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        (**self).occluded(rays, order, occluded);
    }

    fn info(&self) -> &BackendInfo {
        (**self).info()
    }
}

impl RayBatch {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.tfar.len()
    }

    /// Has it no rays?
    pub fn is_empty(&self) -> bool {
        self.tfar.is_empty()
    }

    /// Removes all rays, keeps the memory.
    pub fn clear(&mut self) {
        for column in self.origin.iter_mut().chain(&mut self.direction) {
            column.clear();
        }
        self.tnear.clear();
        self.tfar.clear();
        self.key.clear();
        self.time.clear();
    }

    /// The direction of a ray.
    #[inline]
    pub fn direction(&self, i: usize) -> glam::Vec3 {
        glam::Vec3::new(self.direction[0][i], self.direction[1][i], self.direction[2][i])
    }

    /// The origin of a ray.
    #[inline]
    pub fn origin(&self, i: usize) -> glam::Vec3 {
        glam::Vec3::new(self.origin[0][i], self.origin[1][i], self.origin[2][i])
    }

    /// The directions of eight rays.
    #[inline(always)]
    pub fn directions(&self, rows: &Rows) -> V3 {
        let [x, y, z] = &self.direction;
        V3 { x: load(x, rows), y: load(y, rows), z: load(z, rows) }
    }

    /// When a ray is; 0 where nothing moves.
    #[inline]
    pub fn time(&self, i: usize) -> f32 {
        self.time.get(i).copied().unwrap_or(0.0)
    }

    /// When eight rays are; 0 where nothing moves.
    #[inline(always)]
    pub fn times(&self, rows: &Rows) -> F {
        if self.time.is_empty() { F::ZERO } else { load(&self.time, rows) }
    }

    /// Makes room for `most` rays, with their times if something `moves`, to be filled with [`put`](Self::put) and ended with
    /// [`close`](Self::close).
    pub fn open(&mut self, most: usize, moves: bool) {
        let len = most + LANES;
        for column in self.origin.iter_mut().chain(&mut self.direction).chain([&mut self.tnear, &mut self.tfar]) {
            column.resize(len, 0.0);
        }
        self.key.resize(len, 0);
        self.time.resize(if moves { len } else { 0 }, 0.0);
    }

    /// Writes rays from `at` on, eight at a time; `tnear` is zero, and `time` counts where something moves.
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

    /// Keeps the first `len` rays.
    pub fn close(&mut self, len: usize) {
        for column in self.origin.iter_mut().chain(&mut self.direction).chain([&mut self.tnear, &mut self.tfar]) {
            column.truncate(len);
        }
        self.key.truncate(len);
        self.time.truncate(len);
    }

    /// Adds a ray.
    #[inline]
    pub fn push(&mut self, origin: glam::Vec3, direction: glam::Vec3, tnear: f32, tfar: f32, key: u32) {
        for (axis, column) in self.origin.iter_mut().enumerate() {
            column.push(origin[axis]);
        }
        for (axis, column) in self.direction.iter_mut().enumerate() {
            column.push(direction[axis]);
        }
        self.tnear.push(tnear);
        self.tfar.push(tfar);
        self.key.push(key);
    }
}

impl HitBatch {
    /// Number of hits and misses.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Has it neither hits nor misses?
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Makes every column `len` long; the old entries stay.
    pub(crate) fn resize(&mut self, len: usize) {
        for column in [&mut self.t, &mut self.u, &mut self.v] {
            column.resize(len, 0.0);
        }
        for column in [&mut self.instance, &mut self.mesh, &mut self.prim] {
            column.resize(len, MISS);
        }
    }
}
