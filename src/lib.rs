//! Bismar: an offline renderer that finds, for each pixel and while it renders, the balance between light and
//! BSDF sampling.
//!
//! Data flows one way: [`scene`] → [`rays`] → [`integrator`] (with [`bsdf`], [`light`], [`sampling`],
//! [`balance`]) → [`render`] → [`film`]. Only [`cli`] sees everything.

pub mod balance;
pub mod batch;
pub mod bsdf;
pub mod cli;
pub mod color;
pub mod error;
pub mod farm;
pub mod film;
pub mod integrator;
pub mod lanes;
pub mod light;
pub mod rays;
pub mod render;
pub mod report;
pub mod sampling;
pub mod scene;
pub mod study;

pub use error::{Error, Result};
