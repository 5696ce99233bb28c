//! Wavefront path tracing: a batch of paths is advanced by stages between ray queries ([`wave`]). Each folder imports only
//! those listed before it: [`surface`], [`data`], [`events`], [`stages`], [`through`], [`clients`], [`reuse`].

pub mod clients;
pub mod data;
pub mod events;
pub mod guides;
pub mod reuse;
pub mod stages;
pub mod surface;
pub mod through;
pub mod wave;

pub use clients::PixelSums;
pub use data::camera::CameraRays;
pub use data::context::WaveContext;
pub use data::counts::WaveCounts;
pub use data::prepared::{Names, PreparedScene};
pub use data::proposal::{EmissionRayCounts, Proposal, Reuse};
pub use data::task::PixelTask;
pub use data::transport::Transport;
pub use events::PathEvents;
pub use guides::guides;
pub use reuse::Loan;
pub use surface::geometry::Geometry;
pub use surface::materials::Materials;
pub use wave::Wave;
