//! Rays under way and shadow rays' messages, as structure of arrays.

use crate::lanes::{F, Survivors, U, V3, V3Column, grow, store, store_bits};

/// What belongs to each ray of a batch besides the ray, a row each.
#[derive(Debug, Default)]
pub struct Paths {
    /// Radiance that arrives here counts this much.
    pub beta: V3Column,
    /// Geometric normal where the ray begins; unused for camera rays.
    pub normal: V3Column,
    /// BSDF pdf of the ray times its technique's samples a path; unused for camera rays.
    pub weighted_pdf: Vec<f32>,
    /// Path of the wave.
    pub slot: Vec<u32>,
    /// Index into its pixel's sequence.
    pub index: Vec<u32>,
    /// BSDF sample of a first surface that it descends from.
    pub child: Vec<u32>,
    /// Seed of its pixel's sequence.
    pub seed: Vec<u32>,
    /// How many rows count.
    pub len: usize,
}

impl Paths {
    /// Forgets all rows and makes room for `most`.
    pub fn open(&mut self, most: usize) {
        self.beta.grow(most);
        self.normal.grow(most);
        grow(&mut self.weighted_pdf, most);
        for column in [&mut self.slot, &mut self.index, &mut self.child, &mut self.seed] {
            grow(column, most);
        }
        self.len = 0;
    }

    /// Appends a group, of which the first `n` rows count.
    #[inline(always)]
    pub fn push(&mut self, n: usize, beta: V3, normal: V3, weighted_pdf: F, [slot, index, child, seed]: [U; 4]) {
        self.beta.store(self.len, beta);
        self.normal.store(self.len, normal);
        store(&mut self.weighted_pdf, self.len, weighted_pdf);
        store_bits(&mut self.slot, self.len, slot);
        store_bits(&mut self.index, self.len, index);
        store_bits(&mut self.child, self.len, child);
        store_bits(&mut self.seed, self.len, seed);
        self.len += n;
    }
}

/// What shadow rays bring if nothing is in their way, a row each.
#[derive(Debug, Default)]
pub struct Pending {
    /// Radiance, weighed.
    pub radiance: V3Column,
    /// Path of the wave.
    pub slot: Vec<u32>,
    /// BSDF sample of a first surface that it descends from.
    pub child: Vec<u32>,
    /// The balance's W and r; W = 0 where nothing is to be learned.
    pub w: Vec<f32>,
    /// See `w`.
    pub r: Vec<f32>,
    /// How many rows count.
    pub len: usize,
}

impl Pending {
    /// Forgets all rows and makes room for `most`.
    pub fn open(&mut self, most: usize) {
        self.radiance.grow(most);
        grow(&mut self.w, most);
        grow(&mut self.r, most);
        grow(&mut self.slot, most);
        grow(&mut self.child, most);
        self.len = 0;
    }

    /// Appends the survivors of a group.
    #[inline(always)]
    pub fn push(&mut self, survivors: &Survivors, radiance: V3, [slot, child]: [U; 2], [w, r]: [F; 2]) {
        self.radiance.store(self.len, survivors.compress_v3(radiance));
        store_bits(&mut self.slot, self.len, survivors.compress_bits(slot));
        store_bits(&mut self.child, self.len, survivors.compress_bits(child));
        store(&mut self.w, self.len, survivors.compress(w));
        store(&mut self.r, self.len, survivors.compress(r));
        self.len += survivors.len;
    }
}
