//! Scenes and pictures: what an importer fills, what files hold, and the errors and tools that all of the renderer shares.
//!
//! A part of [bismar](https://docs.rs/bismar), which shows all of it by the same paths; a crate of its own only so that it is
//! compiled in parallel with the others.

pub mod color;
pub mod error;
pub mod film;
pub mod guard;
pub mod scene;

pub use error::{Error, Result};
