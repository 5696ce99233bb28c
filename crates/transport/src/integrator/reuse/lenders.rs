//! Samples of first surfaces, and what second surfaces lend them.

use glam::Vec3;

use crate::integrator::data::light_groups::MAX_GROUPS;

/// Marks a sample or a ray that lends nothing.
pub const NONE: u32 = u32::MAX;

/// A BSDF sample of a first surface.
#[derive(Debug, Clone, Copy)]
pub struct FirstSample {
    /// Row of the first surface.
    pub x: u32,
    /// Index of the path in the wave.
    pub path: u32,
    /// Index in the pixel's sequence.
    pub index: u32,
    /// Its lender, or [`NONE`].
    pub lender: u32,
    /// Is its direction no mirror image ([`MIRROR_PDF`](crate::integrator::data::history::MIRROR_PDF))?
    pub rough: bool,
}

/// A second surface whose light is lent.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lender {
    /// Row of the second surface.
    pub y: u32,
    /// Unit directions at it: of its light sample, of its sample of the punctual lights, of its path's next ray.
    pub directions: [Vec3; 3],
    /// Outgoing radiance of its light sample and of its sample of the punctual lights toward the own first surface, linear RGB.
    pub sampled: [Vec3; 2],
    /// Their groups of lights.
    pub groups: [u8; 2],
    /// By groups of lights, the same of what its path finds from there on.
    pub beyond: [Vec3; MAX_GROUPS],
    /// A bit for each group whose light it has found.
    pub lit: u32,
}

impl Lender {
    /// Adds what its path finds from there on.
    pub fn add(&mut self, group: u8, radiance: Vec3) {
        self.beyond[usize::from(group)] += radiance;
        self.lit |= 1 << group;
    }

    /// Divides what it has found by f cos in its three directions, and forgets those of nothing.
    pub fn divide(&mut self, values: [Vec3; 3]) {
        let over = |found: Vec3, value: Vec3| Vec3::select(value.cmpgt(Vec3::ZERO), found / value, Vec3::ZERO);
        self.sampled = [0, 1].map(|i| over(self.sampled[i], values[i]));
        self.beyond = self.beyond.map(|found| over(found, values[2]));
        let found = [self.sampled[0], self.sampled[1], self.beyond.iter().sum()];
        self.directions = [0, 1, 2].map(|i| if found[i] == Vec3::ZERO { Vec3::ZERO } else { self.directions[i] });
    }

    /// Is there anything to lend?
    pub fn is_lit(&self) -> bool {
        self.lit != 0
    }
}
