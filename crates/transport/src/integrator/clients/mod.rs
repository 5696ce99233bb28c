//! Clients of a wave ([`PathEvents`](crate::integrator::PathEvents)), a file each.

pub mod aovs;
pub mod contributions;
pub mod ground;
pub mod light_samples;
pub mod mean_variance;
pub mod mirrors;
pub mod path_log;
pub mod pixel_sums;
pub mod scattered_sums;
pub mod training_samples;
mod velocity;

pub use aovs::{AovColumns, Aovs};
pub use contributions::{ContributionColumns, Contributions};
pub use ground::{Ground, GroundColumns};
pub use light_samples::LightSampleRecorder;
pub use mean_variance::{BlockSums, MeanVariance, MeanVarianceColumns, MeanVarianceSums};
pub use path_log::PathLog;
pub use pixel_sums::PixelSums;
pub use scattered_sums::ScatteredSums;
pub use training_samples::TrainingRecorder;
