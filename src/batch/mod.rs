//! Many renders from one file: what the file says ([`mod@file`]), who works on what ([`queue`]), what came of it
//! ([`report`]).

pub mod file;
pub mod queue;
pub mod report;
mod values;
