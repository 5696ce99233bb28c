//! Scattering at a surface point: `sample`, `eval`, `pdf`. Directions point away from the surface, `wo` toward the eye
//! and `wi` toward the light.

pub mod ggx;
pub mod metallic_roughness;

pub use metallic_roughness::{BsdfSample, Lobes, MetallicRoughness, Surface};
