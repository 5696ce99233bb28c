//! Surfaces at hits: geometry, materials, shading normals, dispersion.

pub mod dispersion;
pub mod geometry;
pub mod materials;
pub(super) mod shading_normal;
