//! Scattering at a surface point: `sample`, `eval`, `pdf`. Directions are in the local shading frame (z is the
//! shading normal), point away from the surface, `wo` toward the eye and `wi` toward the light.

pub mod ggx;
pub mod metallic_roughness;

pub use metallic_roughness::{BsdfSample, MetallicRoughness, Surface};
