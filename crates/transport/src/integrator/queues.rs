//! The queues between stages, as structure of arrays: rays under way, hits sorted by what comes next, shadow rays.

use glam::Vec3;

use crate::balance::{Contribution, Technique};
use crate::lanes::{F, LANES, Survivors, U, V3, V3Column, grow, store, store_bits};
use crate::rays::RayBatch;

/// Rays under way, and what belongs to each besides the ray, a row each.
#[derive(Debug, Default)]
pub struct PathRays {
    /// The rays.
    pub rays: RayBatch,
    /// Radiance that arrives here counts this much.
    pub beta: V3Column,
    /// Geometric normal where the ray begins, zero on what transmits; unused for camera rays.
    pub normal: V3Column,
    /// BSDF pdf of the ray times its technique's samples a path; unused for camera rays.
    pub weighted_pdf: Vec<f32>,
    /// Path of the wave.
    pub path: Vec<u32>,
    /// Index into its pixel's sequence.
    pub index: Vec<u32>,
    /// BSDF sample of a first surface that it descends from; unused for camera rays.
    pub sub_path: Vec<u32>,
    /// Seed of its pixel's sequence.
    pub seed: Vec<u32>,
    /// The medium that the ray is in, of [`Materials::media`](super::Materials::media); unused where none absorbs.
    pub medium: Vec<u32>,
    /// The chance that a light sample had where the ray begins; unused where no field knows it.
    pub light_chance: Vec<f32>,
    /// How many rows count.
    pub len: usize,
}

/// To which path rows belong, and where in its pixel's sequence they are.
#[derive(Debug, Clone, Copy)]
pub struct Identity {
    /// As in [`PathRays`].
    pub path: U,
    /// As in [`PathRays`].
    pub index: U,
    /// As in [`PathRays`].
    pub sub_path: U,
    /// As in [`PathRays`].
    pub seed: U,
    /// When they are, as in [`RayBatch`]; 0 where nothing moves.
    pub time: F,
}

impl PathRays {
    /// Forgets all rows and makes room for `most`, at times of their own if something `moves`, to be filled with
    /// [`push`](Self::push) and ended with [`close`](Self::close).
    pub fn open(&mut self, most: usize, moves: bool) {
        self.rays.open(most, moves);
        self.beta.grow(most);
        self.normal.grow(most);
        grow(&mut self.weighted_pdf, most);
        for column in [&mut self.path, &mut self.index, &mut self.sub_path, &mut self.seed] {
            grow(column, most);
        }
        self.len = 0;
    }

    /// Appends a group, of which the first `n` rows count. `key` is for [`RayBatch::put`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(&mut self, n: usize, ray: (V3, V3), key: U, beta: V3, normal: V3, weighted_pdf: F, identity: Identity) {
        self.rays.put(self.len, ray, F::splat(f32::INFINITY), key, identity.time);
        self.beta.store(self.len, beta);
        self.normal.store(self.len, normal);
        store(&mut self.weighted_pdf, self.len, weighted_pdf);
        store_bits(&mut self.path, self.len, identity.path);
        store_bits(&mut self.index, self.len, identity.index);
        store_bits(&mut self.sub_path, self.len, identity.sub_path);
        store_bits(&mut self.seed, self.len, identity.seed);
        self.len += n;
    }

    /// No more rows come.
    pub fn close(&mut self) {
        self.rays.close(self.len);
    }
}

/// The rays of a batch by what comes next, as row numbers, in order.
#[derive(Debug, Default)]
pub struct SortedHits {
    /// They hit nothing.
    pub escaped: Vec<u32>,
    /// They hit a surface that shines.
    pub emissive: Vec<u32>,
    /// They hit a surface that scatters, whose scattering is the same everywhere.
    pub plain: Vec<u32>,
    /// They hit another surface that scatters: it has to be looked up point by point.
    pub detailed: Vec<u32>,
}

impl SortedHits {
    /// Forgets all of them.
    pub fn clear(&mut self) {
        for list in [&mut self.escaped, &mut self.emissive, &mut self.plain, &mut self.detailed] {
            list.clear();
        }
    }
}

/// Of a light sample that nobody learns from.
pub const NO_RECORD: u32 = u32::MAX;

/// The group of shadow rays toward lights without extent.
pub const PUNCTUAL: u32 = 2;

/// Shadow rays, and what they bring if nothing is in their way, a row each.
#[derive(Debug, Default)]
pub struct ShadowRays {
    /// The rays.
    pub rays: RayBatch,
    /// Radiance, weighed.
    pub radiance: V3Column,
    /// Path of the wave.
    pub path: Vec<u32>,
    /// BSDF sample of a first surface that it descends from; unused at first surfaces.
    pub sub_path: Vec<u32>,
    /// What the light comes from, as for [`ExtraSums::add_light`](crate::film::ExtraSums::add_light).
    pub group: Vec<u32>,
    /// Number of the light sample among those that are learned from, [`NO_RECORD`] of others; empty where none are.
    pub light_sample_record: Vec<u32>,
    /// How many rows count.
    pub len: usize,
    /// Columns for observers; present where somebody is to be told.
    observed: Option<Observed>,
}

/// What the balance wants to know of light samples at first surfaces.
#[derive(Debug, Default, Clone)]
struct Observed {
    /// Index of the sample in its technique's sequence.
    index: Vec<u32>,
    /// All bits where the sample is toward an area light by count, else none.
    area: Vec<u32>,
    /// As in [`Contribution`]; W = 0 where nothing is to be learned.
    w: Vec<f32>,
    /// As in [`Contribution`].
    r: Vec<f32>,
}

/// What the balance wants to know of a group of light samples.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// Index of the sample in its technique's sequence.
    pub index: U,
    /// Mask: toward an area light by count.
    pub area: U,
    /// As in [`Contribution`].
    pub w: F,
    /// As in [`Contribution`].
    pub r: F,
}

impl ShadowRays {
    /// Forgets all rows and makes room for `most`, at times of their own if something `moves`, with columns for observers if
    /// `observed`, and for who `learns` of the lights.
    pub fn open(&mut self, most: usize, moves: bool, observed: bool, learns: bool) {
        self.rays.open(most, moves);
        self.radiance.grow(most);
        grow(&mut self.path, most);
        grow(&mut self.sub_path, most);
        grow(&mut self.group, most);
        self.light_sample_record.clear();
        if learns {
            self.light_sample_record.resize(most + LANES, NO_RECORD);
        }
        self.len = 0;
        self.observed = observed.then(|| {
            let mut columns = self.observed.take().unwrap_or_default();
            grow(&mut columns.index, most);
            grow(&mut columns.area, most);
            grow(&mut columns.w, most);
            grow(&mut columns.r, most);
            columns
        });
    }

    /// Says which light-sample records the survivors of a group are that comes next.
    pub fn set_records(&mut self, survivors: &Survivors, light_sample_records: U) {
        store_bits(&mut self.light_sample_record, self.len, survivors.compress_bits(light_sample_records));
    }

    /// Appends the survivors of a group: rays of length `tfar`, `radiance`, their path, sub-path and group. `key` and `time`
    /// are for [`RayBatch::put`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(
        &mut self,
        survivors: &Survivors,
        (origin, direction): (V3, V3),
        tfar: F,
        (key, time): (U, F),
        radiance: V3,
        [path, sub_path, group]: [U; 3],
        observation: impl FnOnce() -> Observation,
    ) {
        let ray = (survivors.compress_v3(origin), survivors.compress_v3(direction));
        let (key, time) = (survivors.compress_bits(key), survivors.compress(time));
        self.rays.put(self.len, ray, survivors.compress(tfar), key, time);
        self.radiance.store(self.len, survivors.compress_v3(radiance));
        store_bits(&mut self.path, self.len, survivors.compress_bits(path));
        store_bits(&mut self.sub_path, self.len, survivors.compress_bits(sub_path));
        store_bits(&mut self.group, self.len, survivors.compress_bits(group));
        if let Some(columns) = &mut self.observed {
            let seen = observation();
            store_bits(&mut columns.index, self.len, survivors.compress_bits(seen.index));
            store_bits(&mut columns.area, self.len, survivors.compress_bits(seen.area));
            store(&mut columns.w, self.len, survivors.compress(seen.w));
            store(&mut columns.r, self.len, survivors.compress(seen.r));
        }
        self.len += survivors.len;
    }

    /// No more rows come.
    pub fn close(&mut self) {
        self.rays.close(self.len);
    }

    /// What an observer is to be told of row `i`, which brings `radiance`; its pixel is left open.
    pub fn observed(&self, i: usize, radiance: Vec3) -> Option<Contribution> {
        let seen = self.observed.as_ref().filter(|columns| columns.w[i] > 0.0)?;
        let (index, area) = (seen.index[i], seen.area[i] != 0);
        let (technique, r, w) = (Technique::Light, seen.r[i], seen.w[i]);
        Some(Contribution { pixel: 0, technique, area, index, r, w, radiance })
    }
}
