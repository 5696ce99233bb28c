//! Renders on many machines: the [`plan`], for Slurm ([`slurm`]) or in the Open Job Description format ([`openjd`]), and the
//! [`sessions`] of its tasks. This module renders nothing: every task is one command that can be run again at any time, and
//! no shell interprets it.

pub mod array;
mod names;
pub mod openjd;
mod path_mapping;
pub mod plan;
pub mod sessions;
pub mod slurm;

pub use names::{printable, utf8};
pub use path_mapping::PathMapping;
pub use plan::{PLAN, Plan};
