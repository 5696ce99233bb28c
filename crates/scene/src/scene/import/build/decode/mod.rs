//! Decoders of compressed geometry and pictures. They are other people's and young: each has a limit of memory from what
//! the document says of its result, and a panic of theirs is an error of the file.

pub mod basis;
pub mod draco;
pub mod meshopt;

use std::fmt::Display;

use crate::error::Error;
use crate::guard;

/// What a decoder makes, or why it makes nothing.
fn guarded<T, E: Display>(decode: impl FnOnce() -> Result<T, E>) -> Result<T, String> {
    guard::guarded("its decoder gave up", decode)
}

/// A damaged stream, as an error of the file.
fn damaged(at: &str, what: &str, why: &str) -> Error {
    Error::Data(format!("{at}: the {what} is damaged: {why}; export the file again"))
}
