//! BSDFs: evaluation and sampling of scattering at surface points, eight points at a time.
//!
//! All directions are unit vectors in world space and point away from the surface: `wo` toward the camera, `wi` toward the
//! light. Values include the cosine |n·wi|; densities are per solid angle.
//!
//! A BSDF is a stack of lobes; [`Bsdf`] lists them. Each lobe has a file. It declares its parameters once, from which
//! [`parameters`] derives the types for one point, for eight points and for a batch, and it implements [`Lobe`].

mod albedo;
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
mod schlick;
pub mod sheen;
pub mod thin_film;

pub use clearcoat::Clearcoat;
pub use diffuse_transmission::DiffuseTransmission;
pub use general_microfacet::GeneralMicrofacet;
pub use glass::Glass;
pub use lambert::Lambert;
pub use layered::Layered;
pub use lobe::{BsdfSample, DirectionSample, Directions, Frames, Lobe, MIN_ROUGH_ALPHA, Response, Straight};
pub use lobe_set::LobeSet;
pub use metallic_roughness::{Anisotropy, Iridescence, Surface, refraction_index};
pub use microfacet::Microfacet;
pub use model::{Bsdf, Core};
pub use parameters::{Columns, Eight, One, Parameters, Width};
pub use sheen::Sheen;
