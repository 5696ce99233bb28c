//! What is kept of a render in files.

pub mod build_info;
pub mod checkpoint;
pub mod goals;
pub mod identity;
pub mod merge;
