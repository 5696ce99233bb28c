//! Decoders of compressed geometry and pictures. The third-party decoders are given a memory limit derived from the
//! document, and a panic in one is reported as an error of the file.

pub mod basis;
pub mod draco;
pub mod meshopt;

use std::fmt::Display;

use crate::error::Error;
use crate::guard;

/// Runs a decoder; errors and panics become text.
fn guarded<T, E: Display>(decode: impl FnOnce() -> Result<T, E>) -> Result<T, String> {
    guard::guarded("its decoder gave up", decode)
}

/// A damaged stream, as an error of the file.
fn damaged(at: &str, what: &str, why: &str) -> Error {
    Error::Data(format!("{at}: the {what} is damaged: {why}; export the file again"))
}
