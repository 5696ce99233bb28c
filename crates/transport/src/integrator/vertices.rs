//! The vertices of a batch's paths as structure of arrays: what light and BSDF sampling need.

use wide::bytemuck::cast;

use super::Transport;
use super::queues::Identity;
use crate::bsdf::{Bsdf, Core, LobeSet, Parameters};
use crate::lanes::{F, LANES, Rows, U, V3, V3Column, grow, load, load_bits, store, store_bits};

/// Lowest cosine between eye and shading normal.
pub const MIN_COS: f32 = 1e-3;

/// One path vertex a row.
#[derive(Debug, Default)]
pub struct Vertices {
    /// Where rays leave, on the eye's side.
    pub origin: V3Column,
    /// Unit geometric normal on the eye's side.
    pub ng: V3Column,
    /// Unit shading normal, the eye just above its horizon at least.
    pub ns: V3Column,
    /// Unit, toward the eye.
    pub wo: V3Column,
    /// Radiance that leaves toward the eye counts this much.
    pub beta: V3Column,
    bsdf: <Bsdf as Parameters>::Columns,
    /// How far `origin` stands off the surface along `ng`.
    pub origin_offset: Vec<f32>,
    /// Path of the wave.
    pub path: Vec<u32>,
    /// Index into its pixel's sequence.
    pub index: Vec<u32>,
    /// BSDF sample of a first surface that it descends from.
    pub sub_path: Vec<u32>,
    /// Seed of its pixel's sequence.
    pub seed: Vec<u32>,
    /// The media on the eye's side and beyond, of [`Materials::media`](super::Materials::media); where some absorb.
    pub media: Option<[Vec<u32>; 2]>,
    /// What guiding knows; where there is a field, or one is learned.
    pub guided: Option<Guided>,
    /// When they are, as in [`RayBatch`](crate::rays::RayBatch); empty where nothing moves.
    time: Vec<f32>,
    len: usize,
}

/// Of each vertex, what guiding knows.
#[derive(Debug, Default)]
pub struct Guided {
    /// Does its surface scatter widely ([`Lobe::diffuseness`](crate::bsdf::Lobe::diffuseness))? 0 or 1.
    pub broad: Vec<u32>,
    /// Cell of the field, or [`NOWHERE`](crate::guiding::NOWHERE).
    pub cell: Vec<u32>,
    /// Chances of a light sample and of going on, of vertices beyond the first; meant where the field knows them.
    pub chances: [Vec<f32>; 2],
}

/// Rays that leave vertices.
#[derive(Debug, Clone, Copy)]
pub struct Leaving {
    /// Where they begin, on the side to which they go.
    pub origin: V3,
    /// Mask: the geometric normal allows it.
    pub allowed: F,
    /// Mask: they go beyond the surface.
    pub beyond: F,
}

/// What scatters at eight points.
#[derive(Debug, Clone, Copy)]
pub enum Scattering<'a> {
    /// Any lobes.
    Any([&'a Bsdf; LANES]),
    /// Those of the core model; where no vertex has any other.
    Core([&'a Core; LANES]),
}

/// Up to eight points on their way into the columns.
#[derive(Debug, Clone, Copy)]
pub struct Group<'a> {
    /// World space.
    pub position: V3,
    /// Normals on the winding's front side, of any length.
    pub ng: V3,
    /// Shading normals, as `ng`.
    pub ns: V3,
    /// Unit directions of the rays that arrive.
    pub direction: V3,
    /// As in [`Vertices`].
    pub beta: V3,
    /// As in [`Vertices`].
    pub origin_offset: F,
    /// The scattering at the points.
    pub bsdfs: Scattering<'a>,
    /// As in [`Vertices`]; read where there are columns for them.
    pub media: [U; 2],
    /// Whose they are.
    pub identity: Identity,
}

impl Vertices {
    /// How many vertices.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Forgets all vertices and makes room for `most`, on surfaces with no lobes but those in `lobes`, in media if some
    /// `absorb`, on paths that are `guided` or learned from, at times of their own if something `moves`.
    pub fn open(&mut self, most: usize, lobes: LobeSet, absorb: bool, guided: bool, moves: bool) {
        for column in [&mut self.origin, &mut self.ng, &mut self.ns, &mut self.wo, &mut self.beta] {
            column.grow(most);
        }
        Bsdf::grow(&mut self.bsdf, most, lobes);
        grow(&mut self.origin_offset, most);
        for column in [&mut self.path, &mut self.index, &mut self.sub_path, &mut self.seed] {
            grow(column, most);
        }
        self.media = absorb.then(|| self.media.take().unwrap_or_default());
        self.media.iter_mut().flatten().for_each(|column| grow(column, most));
        self.guided = guided.then(|| self.guided.take().unwrap_or_default());
        if let Some(Guided { broad, cell, chances }) = &mut self.guided {
            grow(broad, most);
            grow(cell, most);
            chances.iter_mut().for_each(|column| grow(column, most));
        }
        match moves {
            true => grow(&mut self.time, most),
            false => self.time.clear(),
        }
        self.len = 0;
    }

    /// Appends a group, of which the first `n` count: turns normals to the eye's side and normalises them.
    #[inline(always)]
    pub fn push(&mut self, n: usize, group: &Group) {
        let at = self.len;
        self.len += n;
        let wo = group.direction * F::splat(-1.0);
        let ng = group.ng.normalize_or(wo);
        // The side of the eye, as a sign.
        let side = (ng.dot(wo) & F::splat(-0.0)) | F::ONE;
        let ng = ng * side;
        let ns = group.ns.normalize_or(ng * side) * side;
        // Interpolated and mapped normals may face away from the eye where the triangle does not: tilt them back until
        // the eye is just above the shading horizon.
        let cos = ns.dot(wo);
        let low = F::splat(MIN_COS);
        let tilted = (ns + wo * (low - cos)).normalize_or(ng);
        let ns = V3::select(cos.simd_lt(low), tilted, ns);
        self.origin.store(at, group.position + ng * group.origin_offset);
        self.ng.store(at, ng);
        self.ns.store(at, ns);
        self.wo.store(at, wo);
        self.beta.store(at, group.beta);
        store(&mut self.origin_offset, at, group.origin_offset);
        store_bits(&mut self.path, at, group.identity.path);
        store_bits(&mut self.index, at, group.identity.index);
        store_bits(&mut self.sub_path, at, group.identity.sub_path);
        store_bits(&mut self.seed, at, group.identity.seed);
        match group.bsdfs {
            Scattering::Any(bsdfs) => Bsdf::store(&mut self.bsdf, at, bsdfs),
            Scattering::Core(cores) => Core::store(Bsdf::core_mut(&mut self.bsdf), at, cores),
        }
        if let Some(columns) = &mut self.media {
            columns.iter_mut().zip(group.media).for_each(|(column, medium)| store_bits(column, at, medium));
        }
        if !self.time.is_empty() {
            store(&mut self.time, at, group.identity.time);
        }
    }

    /// The geometric normals at some rows by which lights are chosen: zero in lanes of `both`, which light reaches from
    /// both sides.
    #[inline(always)]
    pub fn facing(&self, rows: &Rows, both: F) -> V3 {
        V3::select(both, V3::ZERO, self.ng.load(rows))
    }

    /// Rays toward `wi` from some rows, of which lanes of `both` transmit: there, both normals must see `wi` on the same
    /// side.
    #[inline(always)]
    pub fn leave(&self, rows: &Rows, both: F, wi: V3) -> Leaving {
        let (origin, ng) = (self.origin.load(rows), self.ng.load(rows));
        let cos = ng.dot(wi);
        let above = cos.simd_gt(F::ZERO);
        if !both.any() {
            return Leaving { origin, allowed: above, beyond: F::ZERO };
        }
        let beyond = both & cos.simd_lt(F::ZERO);
        let far = origin - ng * (F::splat(2.0) * load(&self.origin_offset, rows));
        let alike = (cos * self.ns.load(rows).dot(wi)).simd_gt(F::ZERO);
        Leaving { origin: V3::select(beyond, far, origin), allowed: (above | beyond) & alike, beyond }
    }

    /// The media that rays are in which leave some rows, those of `beyond` on the far side.
    #[inline(always)]
    pub fn media(&self, rows: &Rows, beyond: F) -> Option<U> {
        let [near, far] = self.media.as_ref()?;
        let beyond: U = cast(beyond);
        Some((load_bits(far, rows) & beyond) | (load_bits(near, rows) & !beyond))
    }

    /// The chances of a light sample and of going on at some rows, beyond first surfaces; `None` where no field knows them.
    #[inline(always)]
    pub fn chances(&self, transport: &Transport, rows: &Rows) -> Option<[F; 2]> {
        let guided = self.guided.as_ref().filter(|_| transport.has_roulette())?;
        Some([load(&guided.chances[0], rows), load(&guided.chances[1], rows)])
    }

    /// Are they at times of their own?
    pub fn moves(&self) -> bool {
        !self.time.is_empty()
    }

    /// When some rows are; 0 where nothing moves.
    #[inline(always)]
    pub fn times(&self, rows: &Rows) -> F {
        if self.time.is_empty() { F::ZERO } else { load(&self.time, rows) }
    }

    /// Whose some rows are.
    #[inline(always)]
    pub fn identity(&self, rows: &Rows) -> Identity {
        Identity {
            path: load_bits(&self.path, rows),
            index: load_bits(&self.index, rows),
            sub_path: load_bits(&self.sub_path, rows),
            seed: load_bits(&self.seed, rows),
            time: self.times(rows),
        }
    }

    /// The scattering at some rows.
    #[inline(always)]
    pub fn bsdf(&self, rows: &Rows) -> <Bsdf as Parameters>::Eight {
        Bsdf::load(&self.bsdf, rows)
    }
    /// Those of the core model, where no vertex has any other lobe.
    #[inline(always)]
    pub fn core(&self) -> Option<&<Core as Parameters>::Columns> {
        Bsdf::core(&self.bsdf)
    }
}
