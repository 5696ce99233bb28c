//! Scattering at a surface point: `sample`, `eval`, `pdf`. Directions point away from the surface, `wo` toward the eye
//! and `wi` toward the light, both in world space and unit.
//!
//! A model is lobes in layers, and [`Bsdf`] lists them. A lobe is a file: it declares its parameters once, from which
//! follow those of eight points and the columns of a batch ([`parameters`]), and answers [`Lobe`].

pub mod clearcoat;
pub mod diffuse_transmission;
pub mod general_microfacet;
pub mod ggx;
pub mod glass;
pub mod lambert;
pub mod layered;
pub mod lobe;
pub mod lobe_set;
pub mod metallic_roughness;
pub mod microfacet;
pub mod model;
pub mod parameters;
mod refraction;
pub mod sheen;
pub mod thin_film;

pub use clearcoat::Clearcoat;
pub use diffuse_transmission::DiffuseTransmission;
pub use general_microfacet::GeneralMicrofacet;
pub use glass::Glass;
pub use lambert::Lambert;
pub use layered::Layered;
pub use lobe::{BsdfSample, DirectionSample, Directions, Frames, Lobe, Response};
pub use lobe_set::LobeSet;
pub use metallic_roughness::{Anisotropy, Iridescence, Surface};
pub use microfacet::Microfacet;
pub use model::{Bsdf, Core};
pub use parameters::{Columns, Eight, One, Parameters, Width};
pub use sheen::Sheen;
