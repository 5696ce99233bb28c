//! Measurements of Bismar: what each of its choices costs and what it is worth, with how sure that is.
//!
//! The program `bismar-study`, which `bismar study` starts, takes them through the library's public interface.

pub mod balance;
pub mod cli;
pub mod clock;
pub mod files;
pub mod provenance;
pub mod rays;
pub mod report;
pub mod stability;
pub mod statistics;
