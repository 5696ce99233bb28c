//! Path vertices as structure of arrays: the input of light and BSDF sampling.

use wide::bytemuck::cast;

use super::history::{MIRROR_PDF, RayHistory};
use super::queues::PathIds;
use super::transport::Transport;
use crate::bsdf::{Bsdf, Core, Lobe, LobeSet, Parameters};
use crate::integrator::surface::shading_normal;
use crate::lanes::{F, LANES, Rows, U, V3, V3Column, grow, load, load_bits, store, store_bits};

/// Path vertices, one per row. Vectors are in world space.
#[derive(Debug, Default)]
pub struct Vertices {
    /// Origin of scattered rays, offset from the surface to the side of `wo`.
    pub origin: V3Column,
    /// Unit geometric normal on the side of `wo`.
    pub ng: V3Column,
    /// Unit shading normal, with n·wo ≥ 0.001.
    pub ns: V3Column,
    /// Unit direction to the previous vertex.
    pub wo: V3Column,
    /// Path throughput before scattering, linear RGB.
    pub beta: V3Column,
    bsdf: <Bsdf as Parameters>::Columns,
    /// Offset of `origin` from the surface along `ng`, in metres.
    pub origin_offset: Vec<f32>,
    /// Index of the path in the wave.
    pub path: Vec<u32>,
    /// Sample index in the pixel's sequence.
    pub index: Vec<u32>,
    /// Number in the wave of the ray that arrived.
    pub ray: Vec<u32>,
    /// Seed of the pixel's sequence.
    pub seed: Vec<u32>,
    /// [`PathRays::root`](super::queues::PathRays::root) of the ray that arrived.
    pub root: Vec<u32>,
    /// [`RayHistory`] of the ray that arrived.
    history: Vec<u32>,
    /// Media on the side of `wo` and beyond the surface, stacks of [`Materials::media`](crate::integrator::Materials::media); present if
    /// rays track them.
    pub media: Option<[Vec<u32>; 2]>,
    /// Columns for path guiding; present if there is a field.
    pub guiding: Option<GuidingColumns>,
    /// Do the paths end here? Empty where none does.
    pub ended: Vec<bool>,
    /// Times in [0, 1] of the shutter interval; empty where nothing moves.
    time: Vec<f32>,
    len: usize,
}

/// Columns of [`Vertices`] for path guiding.
#[derive(Debug, Default)]
pub struct GuidingColumns {
    /// Cell of the guiding field, or [`NO_CELL`](crate::guiding::NO_CELL).
    pub cell: Vec<u32>,
    /// Roulette probabilities of the light sample and of continuing the path; valid beyond first surfaces, if the field sets
    /// them.
    pub roulette: [Vec<f32>; 2],
}

/// Eight rays that leave vertices.
#[derive(Debug, Clone, Copy)]
pub struct SpawnedRays {
    /// Origins, offset to the side of the directions.
    pub origin: V3,
    /// Mask: the direction is consistent with the geometric normal.
    pub allowed: F,
    /// Mask: the ray crosses the surface.
    pub beyond: F,
}

/// What the shadow rays of eight light samples do at bodies of smooth glass.
#[derive(Debug, Clone, Copy)]
pub struct ShadowPolicy {
    /// Mask: they pass bodies.
    pub passes: F,
    /// Mask: they are left out.
    pub excluded: F,
}

/// The BSDFs of eight points.
#[derive(Debug, Clone, Copy)]
pub enum BsdfPacket<'a> {
    Any([&'a Bsdf; LANES]),
    /// BSDFs of the core model, for scenes that need no others.
    Core([&'a Core; LANES]),
}

/// Up to eight vertices, input of [`Vertices::push`].
#[derive(Debug, Clone, Copy)]
pub struct VertexPacket<'a> {
    /// World space.
    pub position: V3,
    /// Geometric normals on the front side, any length.
    pub ng: V3,
    /// Shading normals on the front side, any length.
    pub ns: V3,
    /// Unit directions of the arriving rays.
    pub direction: V3,
    /// Path throughputs before scattering.
    pub beta: V3,
    /// Offsets of ray origins along the geometric normals, in metres.
    pub origin_offset: F,
    pub bsdfs: BsdfPacket<'a>,
    /// Media on the side of `wo` and beyond; read if there are columns for them.
    pub media: [U; 2],
    /// Paths that they belong to.
    pub path_ids: PathIds,
    /// Numbers in the wave of the arriving rays.
    pub ray: U,
}

impl Vertices {
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Clears the vertices and makes room for `capacity`: with columns for the lobes in `lobes`, for media if rays track them, for
    /// path guiding if `guiding`, and for times if something `moves`.
    pub fn open(&mut self, capacity: usize, lobes: LobeSet, media: bool, guiding: bool, moves: bool) {
        for column in [&mut self.origin, &mut self.ng, &mut self.ns, &mut self.wo, &mut self.beta] {
            column.grow(capacity);
        }
        Bsdf::grow(&mut self.bsdf, capacity, lobes);
        grow(&mut self.origin_offset, capacity);
        let Self { path, index, ray, seed, root, history, .. } = self;
        for column in [path, index, ray, seed, root, history] {
            grow(column, capacity);
        }
        self.media = media.then(|| self.media.take().unwrap_or_default());
        self.media.iter_mut().flatten().for_each(|column| grow(column, capacity));
        self.guiding = guiding.then(|| self.guiding.take().unwrap_or_default());
        if let Some(GuidingColumns { cell, roulette }) = &mut self.guiding {
            grow(cell, capacity);
            roulette.iter_mut().for_each(|column| grow(column, capacity));
        }
        match moves {
            true => grow(&mut self.time, capacity),
            false => self.time.clear(),
        }
        self.len = 0;
    }

    /// Appends a packet, of which the first `n` are valid. Normalises the normals and turns them to the side of `wo`.
    #[inline(always)]
    pub fn push(&mut self, n: usize, packet: &VertexPacket) {
        let at = self.len;
        self.len += n;
        let wo = packet.direction * F::splat(-1.0);
        let (ng, ns) = shading_normal::facing(packet.ng, packet.ns, wo);
        self.origin.store(at, packet.position + ng * packet.origin_offset);
        self.ng.store(at, ng);
        self.ns.store(at, ns);
        self.wo.store(at, wo);
        self.beta.store(at, packet.beta);
        store(&mut self.origin_offset, at, packet.origin_offset);
        store_bits(&mut self.path, at, packet.path_ids.path);
        store_bits(&mut self.index, at, packet.path_ids.index);
        store_bits(&mut self.ray, at, packet.ray);
        store_bits(&mut self.seed, at, packet.path_ids.seed);
        store_bits(&mut self.root, at, packet.path_ids.root);
        store_bits(&mut self.history, at, packet.path_ids.history);
        match packet.bsdfs {
            BsdfPacket::Any(bsdfs) => Bsdf::store(&mut self.bsdf, at, bsdfs),
            BsdfPacket::Core(cores) => Core::store(Bsdf::core_mut(&mut self.bsdf), at, cores),
        }
        if let Some(columns) = &mut self.media {
            columns.iter_mut().zip(packet.media).for_each(|(column, medium)| store_bits(column, at, medium));
        }
        if !self.time.is_empty() {
            store(&mut self.time, at, packet.path_ids.time);
        }
    }

    /// The geometric normals for light selection; zero in lanes of the mask `transmits`, which light reaches from both sides.
    #[inline(always)]
    pub(crate) fn light_sampling_normals(&self, rows: &Rows, transmits: F) -> V3 {
        V3::select(transmits, V3::ZERO, self.ng.load(rows))
    }

    /// Rays from eight vertices in the directions `wi`. In lanes of the mask `transmits` the surface transmits; there `wi` must
    /// be on the same side of both normals.
    #[inline(always)]
    pub(crate) fn spawn_rays(&self, rows: &Rows, transmits: F, wi: V3) -> SpawnedRays {
        let (origin, ng) = (self.origin.load(rows), self.ng.load(rows));
        let cos = ng.dot(wi);
        let above = cos.simd_gt(F::ZERO);
        if !transmits.any() {
            return SpawnedRays { origin, allowed: above, beyond: F::ZERO };
        }
        let beyond = transmits & cos.simd_lt(F::ZERO);
        let far = origin - ng * (F::splat(2.0) * load(&self.origin_offset, rows));
        let consistent = (cos * self.ns.load(rows).dot(wi)).simd_gt(F::ZERO);
        SpawnedRays { origin: V3::select(beyond, far, origin), allowed: (above | beyond) & consistent, beyond }
    }

    /// The media of rays that leave eight vertices; those in the mask `beyond` cross the surface. `None` if rays track none.
    #[inline(always)]
    pub fn media(&self, rows: &Rows, beyond: F) -> Option<U> {
        let [near, far] = self.media.as_ref()?;
        let beyond: U = cast(beyond);
        Some((load_bits(far, rows) & beyond) | (load_bits(near, rows) & !beyond))
    }

    /// Roulette probabilities of the light sample and of continuing the path, beyond first surfaces; `None` unless a field sets
    /// them.
    #[inline(always)]
    pub fn roulette(&self, transport: &Transport, rows: &Rows) -> Option<[F; 2]> {
        let guiding = self.guiding.as_ref().filter(|_| transport.proposal.has_roulette())?;
        Some([load(&guiding.roulette[0], rows), load(&guiding.roulette[1], rows)])
    }

    /// Mask of the vertices on smooth glass.
    #[inline(never)]
    pub(crate) fn is_smooth_glass(&self, rows: &Rows, bsdf: &impl Lobe) -> F {
        let straight = bsdf.straight(self.ns.load(rows), self.wo.load(rows), F::ONE, true);
        straight.weight.max_element().simd_gt(F::ZERO)
    }

    /// What shadow rays of light samples with these BSDF densities do at bodies of glass; those in the mask `beyond` cross the
    /// surface. `None` where shadow rays do not pass bodies.
    #[inline(always)]
    pub(crate) fn shadow_policy(
        &self,
        transport: &Transport,
        rows: &Rows,
        bsdf: &impl Lobe,
        bsdf_pdf: F,
        beyond: F,
    ) -> Option<ShadowPolicy> {
        if !transport.passes_bodies() {
            return None;
        }
        let passes = bsdf_pdf.simd_lt(F::splat(MIRROR_PDF));
        let refracted = RayHistory::are_after_rough(load_bits(&self.history, rows)) & beyond & !passes;
        let excluded = if refracted.any() { refracted & self.is_smooth_glass(rows, bsdf) } else { F::ZERO };
        Some(ShadowPolicy { passes, excluded })
    }

    /// Bits of the shadow rays that pass back faces, of light samples in whose directions the BSDFs alone have these densities, as
    /// [`RayHistory::after`] decides of BSDF samples.
    #[inline(always)]
    pub fn passes_backs(&self, transport: &Transport, rows: &Rows, bsdf_pdf: F) -> U {
        if !transport.culls() {
            return U::ZERO;
        }
        let mirrored = bsdf_pdf.simd_ge(F::splat(MIRROR_PDF));
        cast(mirrored & RayHistory::are_mirror_images(load_bits(&self.history, rows)))
    }

    /// Times of eight vertices; 0 where nothing moves.
    #[inline(always)]
    pub fn times(&self, rows: &Rows) -> F {
        if self.time.is_empty() { F::ZERO } else { load(&self.time, rows) }
    }

    #[inline(always)]
    pub fn path_ids(&self, rows: &Rows) -> PathIds {
        PathIds {
            path: load_bits(&self.path, rows),
            index: load_bits(&self.index, rows),
            seed: load_bits(&self.seed, rows),
            time: self.times(rows),
            root: load_bits(&self.root, rows),
            history: load_bits(&self.history, rows),
        }
    }

    #[inline(always)]
    pub fn bsdf(&self, rows: &Rows) -> <Bsdf as Parameters>::Eight {
        Bsdf::load(&self.bsdf, rows)
    }

    /// The core model's columns, if no vertex has other lobes.
    #[inline(always)]
    pub fn core(&self) -> Option<&<Core as Parameters>::Columns> {
        Bsdf::core(&self.bsdf)
    }
}
