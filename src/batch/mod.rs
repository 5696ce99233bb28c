//! Many renders from one file: the [`mod@file`], its [`job`]s, the [`frames`] of a sequence, the [`views`] of a scene, the messages between processes
//! ([`message`]), the work [`queue`] and the [`report`].

pub mod file;
pub mod frames;
pub mod job;
pub mod message;
pub mod numbering;
pub mod queue;
pub mod report;
pub mod split;
mod values;
pub mod views;
