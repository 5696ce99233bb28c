//! Wavefront path tracing: a batch of paths is advanced by stages between ray queries ([`wave`]). [`scalar`] traces single
//! paths as a reference.

pub mod back_faces;
pub mod batch;
pub mod camera;
pub mod clients;
pub mod counts;
pub mod dispersion;
pub mod emission_rays;
pub mod events;
pub mod geometry;
pub mod glass_bounces;
pub mod glass_shadows;
pub mod guides;
pub mod materials;
pub mod path_states;
pub mod prepared;
pub mod proposal;
pub mod queues;
pub mod replay;
pub mod scalar;
mod shading_normal;
pub mod stages;
pub mod thin_walls;
pub mod transport;
pub mod velocity;
pub mod vertices;
pub mod wave;

pub use batch::PixelTask;
pub use camera::CameraRays;
pub use clients::PixelSums;
pub use counts::WaveCounts;
pub use events::{PathEvents, WaveContext};
pub use geometry::Geometry;
pub use guides::guides;
pub use materials::Materials;
pub use prepared::{Names, PreparedScene};
pub use proposal::{EmissionRayCounts, Proposal};
pub use transport::Transport;
pub use wave::Wave;
