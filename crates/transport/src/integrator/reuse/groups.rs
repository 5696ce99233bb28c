//! Groups of BSDF samples of first surfaces that share what they find.

use wide::bytemuck::cast;

use crate::integrator::data::dimensions;
use crate::integrator::data::proposal::Reuse;
use crate::integrator::data::requests::RequestGroup;
use crate::integrator::data::vertices::Vertices;
use crate::lanes::{F, U};
use crate::sampling::{self, hashes};

/// Octants of the normals of eight samples, and random numbers.
pub fn keys(vertices: &Vertices, group: &RequestGroup) -> [U; 2] {
    let normal = vertices.ng.load(&group.rows);
    let sign = |x: F, bit: u32| (cast::<F, U>(x) >> 31) << bit;
    let ids = &group.path_ids;
    let random = hashes(sampling::keys(ids.seed, ids.index, dimensions::REUSE));
    [sign(normal.x, 0) | sign(normal.y, 1) | sign(normal.z, 2), random]
}

/// The groups of a wave.
#[derive(Debug, Default)]
pub struct Groups {
    /// Keys of samples, and the samples.
    keyed: Vec<([u32; 3], u32)>,
    /// The samples, group by group.
    members: Vec<u32>,
    /// End of each group in `members`.
    ends: Vec<u32>,
    /// By sample: does it go on ([`is_traced`](Self::is_traced))?
    traced: Vec<Option<bool>>,
}

impl Groups {
    /// Removes all.
    pub fn clear(&mut self) {
        self.keyed.clear();
        self.members.clear();
        self.ends.clear();
        self.traced.clear();
    }

    /// Is no sample in a group?
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Adds a sample that borrows. Those of a group have the same first two numbers; the third one orders them.
    pub fn add(&mut self, key: [u32; 3], sample: u32) {
        self.keyed.push((key, sample));
    }

    /// Forms the groups of all samples, of equal sizes.
    pub fn form(&mut self, reuse: Reuse) {
        let Self { keyed, members, ends, traced } = self;
        keyed.sort_unstable();
        let samples = keyed.iter().map(|(_, sample)| sample + 1).max().unwrap_or(0);
        traced.resize(samples as usize, None);
        for alike in keyed.chunk_by(|a, b| a.0[..2] == b.0[..2]) {
            let size = alike.len().div_ceil(alike.len().div_ceil(reuse.group as usize));
            for group in alike.chunks(size).filter(|group| group.len() > 1) {
                let goes_on = reuse.traced_of(group.len());
                members.extend(group.iter().map(|(_, sample)| sample));
                ends.push(members.len() as u32);
                for (i, (_, sample)) in group.iter().enumerate() {
                    traced[*sample as usize] = Some(i < goes_on);
                }
            }
        }
    }

    /// Does the path of a sample go on from the second surface? `None` if the sample is in no group.
    pub fn is_traced(&self, sample: u32) -> Option<bool> {
        self.traced.get(sample as usize).copied().flatten()
    }

    /// The samples of each group, and the number of them that go on: these are the first ones.
    pub fn each(&self, reuse: Reuse) -> impl Iterator<Item = (&[u32], usize)> {
        let mut start = 0;
        self.ends.iter().map(move |end| {
            let members = &self.members[start..*end as usize];
            start = *end as usize;
            (members, reuse.traced_of(members.len()))
        })
    }
}
