//! Tiles, their passes, and when they end.

pub mod adaptive;
pub mod decisions;
pub mod fireflies;
pub mod goal;
pub mod pixels;
pub mod progress;
pub mod rendered;
pub mod sampler;
pub mod scheduler;
pub mod stats;
pub mod tile;
