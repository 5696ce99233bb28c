//! Surfaces at hits: geometry, materials, media, shading normals, dispersion.

pub mod dispersion;
pub mod geometry;
pub mod materials;
pub mod media;
pub mod shading_normal;
