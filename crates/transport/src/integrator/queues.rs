//! The queues between stages, as structure of arrays: path rays, sorted hits, shadow rays.

use glam::Vec3;

use crate::balance::{Contribution, Technique};
use crate::lanes::{F, LANES, Survivors, U, V3, V3Column, grow, store, store_bits};
use crate::rays::RayBatch;

/// The rays of the current path segments with their path data, one row per ray.
#[derive(Debug, Default)]
pub struct PathRays {
    /// The rays.
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
    /// Index of the sub-path; unused for camera rays.
    pub sub_path: Vec<u32>,
    /// Seed of the pixel's sequence.
    pub seed: Vec<u32>,
    /// Medium of the ray, an index into [`Materials::media`](super::Materials::media); unused if none absorbs.
    pub medium: Vec<u32>,
    /// Roulette probability of the light sample at the ray origin; unused without a guiding field.
    pub light_probability: Vec<f32>,
    /// Number of valid rows.
    pub len: usize,
}

/// Eight rows' path, sub-path, and position in the pixel's sample sequence.
#[derive(Debug, Clone, Copy)]
pub struct PathIds {
    /// Index of the path in the wave.
    pub path: U,
    /// Sample index in the pixel's sequence.
    pub index: U,
    /// Index of the sub-path.
    pub sub_path: U,
    /// Seed of the pixel's sequence.
    pub seed: U,
    /// Time in [0, 1] of the shutter interval; 0 where nothing moves.
    pub time: F,
}

impl PathRays {
    /// Clears the rows and makes room for `capacity`, with times if something `moves`. Fill it with [`push`](Self::push), then
    /// call [`close`](Self::close).
    pub fn open(&mut self, capacity: usize, moves: bool) {
        self.rays.open(capacity, moves);
        self.beta.grow(capacity);
        self.normal.grow(capacity);
        grow(&mut self.weighted_pdf, capacity);
        for column in [&mut self.path, &mut self.index, &mut self.sub_path, &mut self.seed] {
            grow(column, capacity);
        }
        self.len = 0;
    }

    /// Appends a group of eight rows, of which the first `n` are valid. `key` is that of [`RayBatch::key`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(&mut self, n: usize, ray: (V3, V3), key: U, beta: V3, normal: V3, weighted_pdf: F, path_ids: PathIds) {
        self.rays.put(self.len, ray, F::splat(f32::INFINITY), key, path_ids.time);
        self.beta.store(self.len, beta);
        self.normal.store(self.len, normal);
        store(&mut self.weighted_pdf, self.len, weighted_pdf);
        store_bits(&mut self.path, self.len, path_ids.path);
        store_bits(&mut self.index, self.len, path_ids.index);
        store_bits(&mut self.sub_path, self.len, path_ids.sub_path);
        store_bits(&mut self.seed, self.len, path_ids.seed);
        self.len += n;
    }

    /// Ends filling: truncates the rays to the valid rows.
    pub fn close(&mut self) {
        self.rays.close(self.len);
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
    /// Empties all lists.
    pub fn clear(&mut self) {
        for list in [&mut self.escaped, &mut self.emissive, &mut self.constant, &mut self.varying] {
            list.clear();
        }
    }
}

/// Index of light samples without a [`LightSampleRecord`](crate::light::LightSampleRecord).
pub const NO_RECORD: u32 = u32::MAX;

/// Light group of punctual lights in [`ShadowRays::light_group`].
pub const PUNCTUAL_GROUP: u32 = 2;

/// Shadow rays with their contributions if unoccluded, one row per ray.
#[derive(Debug, Default)]
pub struct ShadowRays {
    /// The rays.
    pub rays: RayBatch,
    /// Contribution with throughput and MIS weight, linear RGB.
    pub radiance: V3Column,
    /// Index of the path in the wave.
    pub path: Vec<u32>,
    /// Index of the sub-path; unused at first surfaces.
    pub sub_path: Vec<u32>,
    /// Light group of [`ExtraSums::add_light`](crate::film::ExtraSums::add_light): 0 environment, 1 area light, 2 punctual.
    pub light_group: Vec<u32>,
    /// Index of the light-sample record, or [`NO_RECORD`]; empty if none are recorded.
    pub light_sample_record: Vec<u32>,
    /// Number of valid rows.
    pub len: usize,
    /// Columns for the observer; present if there is one.
    contributions: Option<ContributionColumns>,
}

/// The terms of a [`Contribution`] by a light sample at a first surface, as columns.
#[derive(Debug, Default, Clone)]
struct ContributionColumns {
    /// Sample index in the technique's sequence.
    index: Vec<u32>,
    /// All bits set if the sample was allocated to area lights, else none.
    area: Vec<u32>,
    /// [`Contribution::w`]; 0 for samples that are not reported.
    w: Vec<f32>,
    /// [`Contribution::r`].
    r: Vec<f32>,
}

/// The terms of the [`Contribution`]s by eight light samples at first surfaces.
#[derive(Debug, Clone, Copy)]
pub struct ContributionTerms {
    /// Sample index in the technique's sequence.
    pub index: U,
    /// Mask: allocated to area lights.
    pub area: U,
    /// [`Contribution::w`].
    pub w: F,
    /// [`Contribution::r`].
    pub r: F,
}

impl ShadowRays {
    /// Clears the rows and makes room for `capacity`: with times if something `moves`, with the terms of `contributions` if there
    /// is an observer, with indices of light-sample records if light distributions are learned (`learns`).
    pub fn open(&mut self, capacity: usize, moves: bool, contributions: bool, learns: bool) {
        self.rays.open(capacity, moves);
        self.radiance.grow(capacity);
        grow(&mut self.path, capacity);
        grow(&mut self.sub_path, capacity);
        grow(&mut self.light_group, capacity);
        self.light_sample_record.clear();
        if learns {
            self.light_sample_record.resize(capacity + LANES, NO_RECORD);
        }
        self.len = 0;
        self.contributions = contributions.then(|| {
            let mut columns = self.contributions.take().unwrap_or_default();
            grow(&mut columns.index, capacity);
            grow(&mut columns.area, capacity);
            grow(&mut columns.w, capacity);
            grow(&mut columns.r, capacity);
            columns
        });
    }

    /// Sets the light-sample records of the survivors of the group that is pushed next.
    pub fn set_records(&mut self, survivors: &Survivors, light_sample_records: U) {
        store_bits(&mut self.light_sample_record, self.len, survivors.compress_bits(light_sample_records));
    }

    /// Appends the survivors of a group: rays of length `tfar`, contribution, path, sub-path and light group. `key` and `time`
    /// are those of [`RayBatch`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "a row's columns")]
    pub fn push(
        &mut self,
        survivors: &Survivors,
        (origin, direction): (V3, V3),
        tfar: F,
        (key, time): (U, F),
        radiance: V3,
        [path, sub_path, light_group]: [U; 3],
        contribution_terms: impl FnOnce() -> ContributionTerms,
    ) {
        let ray = (survivors.compress_v3(origin), survivors.compress_v3(direction));
        let (key, time) = (survivors.compress_bits(key), survivors.compress(time));
        self.rays.put(self.len, ray, survivors.compress(tfar), key, time);
        self.radiance.store(self.len, survivors.compress_v3(radiance));
        store_bits(&mut self.path, self.len, survivors.compress_bits(path));
        store_bits(&mut self.sub_path, self.len, survivors.compress_bits(sub_path));
        store_bits(&mut self.light_group, self.len, survivors.compress_bits(light_group));
        if let Some(columns) = &mut self.contributions {
            let terms = contribution_terms();
            store_bits(&mut columns.index, self.len, survivors.compress_bits(terms.index));
            store_bits(&mut columns.area, self.len, survivors.compress_bits(terms.area));
            store(&mut columns.w, self.len, survivors.compress(terms.w));
            store(&mut columns.r, self.len, survivors.compress(terms.r));
        }
        self.len += survivors.len;
    }

    /// Ends filling: truncates the rays to the valid rows.
    pub fn close(&mut self) {
        self.rays.close(self.len);
    }

    /// The contribution to report for row `i`, which adds `radiance`; the caller sets its pixel.
    pub fn contribution(&self, i: usize, radiance: Vec3) -> Option<Contribution> {
        let terms = self.contributions.as_ref().filter(|columns| columns.w[i] > 0.0)?;
        let (index, area) = (terms.index[i], terms.area[i] != 0);
        let (technique, r, w) = (Technique::Light, terms.r[i], terms.w[i]);
        Some(Contribution { pixel: 0, technique, area, index, r, w, radiance })
    }
}
