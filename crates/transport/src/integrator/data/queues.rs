//! The queues between stages, as structure of arrays: path rays, sorted hits, shadow rays.

use super::history::RayHistory;
pub use super::light_layers::{LightKind, LightNumber};
use super::transport::Transport;
use crate::lanes::{F, Rows, Survivors, U, V3, V3Column, grow, load_bits, store, store_bits};
use crate::rays::RayBatch;

/// The rays of the current path segments with their path data, one row per ray.
#[derive(Debug, Default)]
pub struct PathRays {
    pub rays: RayBatch,
    /// Path throughput, linear RGB.
    pub beta: V3Column,
    /// Geometric normal at the ray origin, zero on surfaces that transmit; unused for camera rays.
    pub normal: V3Column,
    /// Density of the ray times BSDF samples per path; unused for camera rays.
    pub weighted_pdf: Vec<f32>,
    /// Index of the path in the wave.
    pub path: Vec<u32>,
    /// Sample index in the pixel's sequence.
    pub index: Vec<u32>,
    /// Seed of the pixel's sequence.
    pub seed: Vec<u32>,
    /// Media of the ray, a stack of [`Materials::media`](crate::integrator::Materials::media); unused if rays track none.
    pub medium: Vec<u32>,
    /// Roulette probability of the light sample at the ray origin; unused without a guiding field.
    pub light_probability: Vec<f32>,
    /// Camera rays that have passed a thin wall; empty for others and in scenes without thin walls.
    pub passed_wall: Vec<bool>,
    /// Index in the wave of the first surface's BSDF sample that the path has come by; without meaning for camera rays.
    pub root: Vec<u32>,
    /// [`RayHistory`]: what the path has met before.
    pub history: Vec<u32>,
    /// Number in the wave of the ray of row 0. Rays are numbered in the order in which the wave generates them.
    pub first: u32,
    pub len: usize,
}

/// Eight rows' path, position in the pixel's sample sequence, and what is behind them.
#[derive(Debug, Clone, Copy)]
pub struct PathIds {
    /// Index of the path in the wave.
    pub path: U,
    /// Sample index in the pixel's sequence.
    pub index: U,
    /// Seed of the pixel's sequence.
    pub seed: U,
    /// Time in [0, 1] of the shutter interval; 0 where nothing moves.
    pub time: F,
    pub root: U,
    pub history: U,
}

impl PathRays {
    /// Clears the rows and makes room for `capacity`, with times if something `moves`. `first` is the number in the wave of the
    /// first ray. Fill it with [`push`](Self::push), then call [`close`](Self::close).
    pub fn open(&mut self, capacity: usize, moves: bool, first: u32) {
        self.rays.open(capacity, moves);
        self.beta.grow(capacity);
        self.normal.grow(capacity);
        grow(&mut self.weighted_pdf, capacity);
        for column in [&mut self.path, &mut self.index, &mut self.seed, &mut self.root, &mut self.history] {
            grow(column, capacity);
        }
        self.passed_wall.clear();
        self.first = first;
        self.len = 0;
    }

    /// Appends a packet of eight rows, of which the first `n` are valid. `key` is that of [`RayBatch::key`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(&mut self, n: usize, ray: (V3, V3), key: U, beta: V3, normal: V3, weighted_pdf: F, path_ids: PathIds) {
        self.rays.put(self.len, ray, F::splat(f32::INFINITY), key, path_ids.time);
        self.beta.store(self.len, beta);
        self.normal.store(self.len, normal);
        store(&mut self.weighted_pdf, self.len, weighted_pdf);
        store_bits(&mut self.path, self.len, path_ids.path);
        store_bits(&mut self.index, self.len, path_ids.index);
        store_bits(&mut self.seed, self.len, path_ids.seed);
        store_bits(&mut self.root, self.len, path_ids.root);
        store_bits(&mut self.history, self.len, path_ids.history);
        self.len += n;
    }

    /// Ends filling: truncates the rays to the valid rows.
    pub fn close(&mut self) {
        self.rays.close(self.len);
    }

    /// What the path has met before a ray.
    #[inline]
    pub fn history(&self, row: usize) -> RayHistory {
        RayHistory(self.history[row])
    }

    /// Paths of eight rays.
    #[inline(always)]
    pub fn path_ids(&self, rows: &Rows) -> PathIds {
        PathIds {
            path: load_bits(&self.path, rows),
            index: load_bits(&self.index, rows),
            seed: load_bits(&self.seed, rows),
            time: self.rays.times(rows),
            root: load_bits(&self.root, rows),
            history: load_bits(&self.history, rows),
        }
    }

    /// Does a ray pass back faces ([`back_faces`](crate::integrator::through::back_faces))?
    #[inline]
    pub fn passes_backs(&self, transport: &Transport, row: usize) -> bool {
        transport.culls() && self.history(row).is_mirror_image()
    }

    /// Number in the wave of the first ray after these.
    pub(crate) fn next_number(&self) -> u32 {
        self.first + self.len as u32
    }
}

/// Row numbers of a batch's rays, sorted by the next stage, in ascending order. A ray may be in several lists.
#[derive(Debug, Default)]
pub struct SortedHits {
    /// Rays that hit nothing.
    pub escaped: Vec<u32>,
    /// Rays that hit a surface that emits.
    pub emissive: Vec<u32>,
    /// Rays that hit a scattering surface with a constant BSDF.
    pub constant: Vec<u32>,
    /// Rays that hit a scattering surface whose BSDF depends on the point.
    pub varying: Vec<u32>,
}

impl SortedHits {
    pub fn clear(&mut self) {
        for list in [&mut self.escaped, &mut self.emissive, &mut self.constant, &mut self.varying] {
            list.clear();
        }
    }
}

/// Columns of [`ShadowRays`] for [`glass_shadows`](crate::integrator::through::glass_shadows).
#[derive(Debug, Default)]
pub struct BodyColumns {
    /// All bits set if the ray passes bodies, else none.
    pub passes: Vec<u32>,
    /// Media at the origin, a stack of [`Materials::media`](crate::integrator::Materials::media). `radiance` is not attenuated yet.
    pub medium: Vec<u32>,
}

/// Shadow rays with their contributions if unoccluded, one row per ray.
#[derive(Debug, Default)]
pub struct ShadowRays {
    pub rays: RayBatch,
    /// Contribution with throughput and MIS weight, linear RGB.
    pub radiance: V3Column,
    /// Index of the path in the wave.
    pub path: Vec<u32>,
    /// Number in the wave of the ray that arrived at the vertex.
    pub ray: Vec<u32>,
    /// [`PathRays::root`] of that ray.
    pub root: Vec<u32>,
    /// [`LightNumber`].
    light: Vec<u32>,
    pub occluded: Vec<bool>,
    /// Columns for shadow rays that pass bodies of glass; present if they do.
    pub bodies: Option<BodyColumns>,
    /// Not 0 if the ray passes back faces ([`back_faces`](crate::integrator::through::back_faces)); empty where none does.
    pub backs: Vec<u32>,
    /// What thin walls leave of the contribution, as a ratio of lengths, at most 1; empty in scenes without thin walls.
    pub through: Vec<f32>,
    pub len: usize,
}

impl ShadowRays {
    /// Clears the rows and makes room for `capacity`, with the columns that the scene needs.
    pub fn open(&mut self, transport: &Transport, capacity: usize) {
        self.rays.open(capacity, transport.geometry.moves);
        self.radiance.grow(capacity);
        for column in [&mut self.path, &mut self.ray, &mut self.root, &mut self.light] {
            grow(column, capacity);
        }
        self.bodies = transport.passes_bodies().then(|| self.bodies.take().unwrap_or_default());
        if let Some(BodyColumns { passes, medium }) = &mut self.bodies {
            grow(passes, capacity);
            grow(medium, capacity);
        }
        self.backs.clear();
        if transport.culls() {
            grow(&mut self.backs, capacity);
        }
        // A wave is used for one scene after another.
        self.through.clear();
        self.len = 0;
    }

    /// Sets the columns of [`BodyColumns`] of the survivors that are pushed next.
    #[inline(always)]
    pub(crate) fn set_bodies(&mut self, survivors: &Survivors, passes: U, medium: U) {
        if let Some(bodies) = &mut self.bodies {
            store_bits(&mut bodies.passes, self.len, survivors.compress_bits(passes));
            store_bits(&mut bodies.medium, self.len, survivors.compress_bits(medium));
        }
    }

    /// Sets which of the survivors that are pushed next pass back faces; else none does.
    #[inline(always)]
    pub(crate) fn set_backs(&mut self, survivors: &Survivors, passes: U) {
        if !self.backs.is_empty() {
            store_bits(&mut self.backs, self.len, survivors.compress_bits(passes));
        }
    }

    /// Appends the survivors of a packet: rays of length `tfar`, contribution, path, arriving ray, its root and [`LightNumber`]. `key` and
    /// `time` are those of [`RayBatch`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(
        &mut self,
        survivors: &Survivors,
        (origin, direction): (V3, V3),
        tfar: F,
        (key, time): (U, F),
        radiance: V3,
        [path, ray_number, root, light]: [U; 4],
    ) {
        let ray = (survivors.compress_v3(origin), survivors.compress_v3(direction));
        let (key, time) = (survivors.compress_bits(key), survivors.compress(time));
        self.rays.put(self.len, ray, survivors.compress(tfar), key, time);
        self.radiance.store(self.len, survivors.compress_v3(radiance));
        store_bits(&mut self.path, self.len, survivors.compress_bits(path));
        store_bits(&mut self.ray, self.len, survivors.compress_bits(ray_number));
        store_bits(&mut self.root, self.len, survivors.compress_bits(root));
        store_bits(&mut self.light, self.len, survivors.compress_bits(light));
        self.len += survivors.len;
    }

    /// Ends filling: truncates the rays to the valid rows.
    pub fn close(&mut self) {
        self.rays.close(self.len);
    }

    /// The light at the end of a ray.
    #[inline]
    pub fn light(&self, row: usize) -> LightNumber {
        LightNumber(self.light[row])
    }

    /// Kind of the light at the end of a ray.
    #[inline]
    pub fn kind(&self, row: usize) -> LightKind {
        self.light(row).kind()
    }
}
