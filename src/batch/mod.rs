//! Many renders from one file: what the file says ([`mod@file`]), a sequence's [`frames`], who works on what ([`order`],
//! [`queue`]), what came of it ([`report`]).

pub mod file;
pub mod frames;
pub mod message;
pub mod queue;
pub mod report;
mod values;
