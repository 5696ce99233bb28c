//! Pools of BSDF samples of first surfaces that share what they find.

use glam::Vec3;
use wide::bytemuck::cast;

use crate::integrator::data::dimensions;
use crate::integrator::data::proposal::Reuse;
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::lanes::{F, U};
use crate::sampling::{self, hashes};

/// Octants of the normals of eight samples, and two random numbers.
pub fn keys(vertices: &Vertices, packet: &RequestPacket) -> [U; 3] {
    let normal = vertices.ng.load(&packet.rows);
    let sign = |x: F, bit: u32| (cast::<F, U>(x) >> 31) << bit;
    let ids = &packet.path_ids;
    let random = hashes(sampling::keys(ids.seed, ids.index, dimensions::REUSE));
    [sign(normal.x, 0) | sign(normal.y, 1) | sign(normal.z, 2), random, hashes(random)]
}

/// A pool.
#[derive(Debug, Clone, Copy)]
pub struct Pool {
    /// End of its samples in [`Pools::members`].
    end: u32,
    /// Fraction of its samples that go on from far second surfaces.
    pub traced: f32,
    /// Mean squared distance of its first surfaces from their centre.
    pub extent2: f32,
}

impl Pool {
    /// Probability with which a sample goes on from a second surface, by the squared distance between first and second. Near
    /// surfaces have few lenders: where the own sample is most of the divisor, it should not be missing. All samples go on
    /// from `sharp` surfaces, which keep a part of what their paths find.
    #[inline(always)]
    pub fn goes_on(&self, distance2: F, sharp: bool) -> F {
        let near = F::splat(self.extent2) / distance2.fast_max(F::splat(f32::MIN_POSITIVE));
        if sharp { F::ONE } else { (F::splat(self.traced) * (F::ONE + near)).fast_min(F::ONE) }
    }
}

/// A sample's place in its pool.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Index of the pool.
    pub pool: u32,
    /// Uniform in [0, 1), stratified over the samples of the pool: the sample goes on with a probability above it.
    pub order: f32,
}

/// The pools of a wave.
#[derive(Debug, Default)]
pub struct Pools {
    /// Keys of samples, and the samples.
    keyed: Vec<([u32; 4], u32)>,
    /// The samples, pool by pool.
    members: Vec<u32>,
    /// The pools.
    list: Vec<Pool>,
    /// By sample.
    places: Vec<Option<Place>>,
}

impl Pools {
    /// Removes all.
    pub fn clear(&mut self) {
        self.keyed.clear();
        self.members.clear();
        self.list.clear();
        self.places.clear();
    }

    /// Is no sample in a pool?
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Adds a sample that borrows. Those of a pool have the same first two numbers; the others are random.
    pub fn add(&mut self, key: [u32; 4], sample: u32) {
        self.keyed.push((key, sample));
    }

    /// Forms the pools of all samples, of equal sizes. `position` is that of a sample's first surface.
    pub fn form(&mut self, reuse: Reuse, position: impl Fn(u32) -> Vec3) {
        let Self { keyed, members, list, places } = self;
        keyed.sort_unstable();
        let samples = keyed.iter().map(|(_, sample)| sample + 1).max().unwrap_or(0);
        places.resize(samples as usize, None);
        for alike in keyed.chunk_by(|a, b| a.0[..2] == b.0[..2]) {
            let size = alike.len().div_ceil(alike.len().div_ceil(reuse.group as usize));
            for pool in alike.chunks(size).filter(|pool| pool.len() > 1) {
                let n = pool.len() as f32;
                let centre = pool.iter().map(|(_, sample)| position(*sample)).sum::<Vec3>() / n;
                let extent2 =
                    pool.iter().map(|(_, sample)| position(*sample).distance_squared(centre)).sum::<f32>() / n;
                for (i, ([.., random], sample)) in pool.iter().enumerate() {
                    let order = (i as f32 + (random >> 8) as f32 / (1 << 24) as f32) / n;
                    places[*sample as usize] = Some(Place { pool: list.len() as u32, order });
                }
                members.extend(pool.iter().map(|(_, sample)| sample));
                list.push(Pool { end: members.len() as u32, traced: reuse.traced_of(pool.len()) as f32 / n, extent2 });
            }
        }
    }

    /// The place of a sample, and its pool; `None` if it is in none.
    pub fn place(&self, sample: u32) -> Option<(Place, Pool)> {
        let place = self.places.get(sample as usize).copied().flatten()?;
        Some((place, self.list[place.pool as usize]))
    }

    /// The pools, with their samples.
    pub fn each(&self) -> impl Iterator<Item = (Pool, &[u32])> {
        let mut start = 0;
        self.list.iter().map(move |pool| {
            let members = &self.members[start..pool.end as usize];
            start = pool.end as usize;
            (*pool, members)
        })
    }
}
