//! Measurements of Bismar: the cost and benefit of its choices, with standard errors.
//!
//! The program `bismar-study`, which `bismar study` starts, measures through the library's public interface. This crate is
//! no interface for others: it is a library so that its tests and benchmark can use it.
#![allow(missing_docs, reason = "a program; docs/study-*.md describe its files")]

pub mod balance;
pub mod cli;
pub mod clock;
pub mod files;
pub mod means;
pub mod provenance;
pub mod rays;
pub mod report;
pub mod stability;
pub mod statistics;
