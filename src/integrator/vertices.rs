//! The vertices of a batch's paths as structure of arrays: what light and BSDF sampling need.

use wide::{CmpLt, Select};

use crate::bsdf::{Lobes, MetallicRoughness};
use crate::lanes::{F, LANES, Rows, V3, V3Column, grow, load, store};

/// Lowest cosine between eye and shading normal.
const MIN_COS: f32 = 1e-3;

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
    diffuse: V3Column,
    f0: V3Column,
    f90: Vec<f32>,
    layer0: Vec<f32>,
    layer90: Vec<f32>,
    alpha: Vec<f32>,
    /// How far `origin` stands off the surface along `ng`.
    pub stand_off: Vec<f32>,
    /// Path of the wave.
    pub slot: Vec<u32>,
    /// Index into its pixel's sequence.
    pub index: Vec<u32>,
    /// BSDF sample of a first surface that it descends from.
    pub child: Vec<u32>,
}

/// Up to eight points on their way into the columns.
#[derive(Debug, Clone, Copy)]
pub struct Group {
    /// World space.
    pub position: [[f32; LANES]; 3],
    /// Normals on the winding's front side, of any length.
    pub ng: [[f32; LANES]; 3],
    /// Shading normals, as `ng`.
    pub ns: [[f32; LANES]; 3],
    /// Unit directions of the rays that arrive.
    pub direction: [[f32; LANES]; 3],
    /// As in [`Vertices`].
    pub beta: [[f32; LANES]; 3],
    /// As in [`Vertices`].
    pub stand_off: [f32; LANES],
    /// The scattering at the points.
    pub bsdf: [MetallicRoughness; LANES],
}

impl Vertices {
    /// How many vertices.
    pub fn len(&self) -> usize {
        self.slot.len()
    }

    /// Are there none?
    pub fn is_empty(&self) -> bool {
        self.slot.is_empty()
    }

    /// Forgets all vertices and makes room for `most`.
    pub fn clear(&mut self, most: usize) {
        for column in [
            &mut self.origin,
            &mut self.ng,
            &mut self.ns,
            &mut self.wo,
            &mut self.beta,
            &mut self.diffuse,
            &mut self.f0,
        ] {
            column.grow(most);
        }
        for column in [&mut self.f90, &mut self.layer0, &mut self.layer90, &mut self.alpha, &mut self.stand_off] {
            grow(column, most);
        }
        self.slot.clear();
        self.index.clear();
        self.child.clear();
    }

    /// Writes a group at row `at`, a multiple of [`LANES`]: turns normals to the eye's side and normalises them.
    #[inline]
    pub fn put(&mut self, at: usize, group: &Group) {
        let wo = V3::from_arrays(group.direction) * F::splat(-1.0);
        let ng = V3::from_arrays(group.ng).normalize_or(wo);
        // The side of the eye, as a sign.
        let side = (ng.dot(wo) & F::splat(-0.0)) | F::ONE;
        let ng = ng * side;
        let ns = V3::from_arrays(group.ns).normalize_or(ng * side) * side;
        // Interpolated and mapped normals may face away from the eye where the triangle does not: tilt them back until
        // the eye is just above the shading horizon.
        let cos = ns.dot(wo);
        let low = F::splat(MIN_COS);
        let tilted = (ns + wo * (low - cos)).normalize_or(ng);
        let ns = V3::select(cos.simd_lt(low), tilted, ns);
        let stand_off = F::from(group.stand_off);
        self.origin.store(at, V3::from_arrays(group.position) + ng * stand_off);
        self.ng.store(at, ng);
        self.ns.store(at, ns);
        self.wo.store(at, wo);
        self.beta.store(at, V3::from_arrays(group.beta));
        store(&mut self.stand_off, at, stand_off);
        let b = &group.bsdf;
        self.diffuse
            .store(at, V3::from_arrays([b.map(|m| m.diffuse.x), b.map(|m| m.diffuse.y), b.map(|m| m.diffuse.z)]));
        self.f0.store(at, V3::from_arrays([b.map(|m| m.f0.x), b.map(|m| m.f0.y), b.map(|m| m.f0.z)]));
        store(&mut self.f90, at, F::from(b.map(|m| m.f90)));
        store(&mut self.layer0, at, F::from(b.map(|m| m.layer0)));
        store(&mut self.layer90, at, F::from(b.map(|m| m.layer90)));
        store(&mut self.alpha, at, F::from(b.map(|m| m.alpha)));
    }

    /// The scattering at some rows.
    #[inline(always)]
    pub fn lobes(&self, rows: &Rows) -> Lobes {
        Lobes {
            diffuse: self.diffuse.load(rows),
            f0: self.f0.load(rows),
            f90: load(&self.f90, rows),
            layer0: load(&self.layer0, rows),
            layer90: load(&self.layer90, rows),
            alpha: load(&self.alpha, rows),
        }
    }
}
