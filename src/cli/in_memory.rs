//! The commands for front ends that name options as the command line does: names of flags without dashes, and their values (the
//! Python package). Scenes and pictures in memory are those of [`LoadedScene`](crate::job::LoadedScene).

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use super::develop::DevelopArgs;
pub use super::flag_values::Options;
use super::flag_values::parse;
use super::labels::LabelsArgs;
use super::look::LookArgs;
pub use super::look::{Looked, Shot};
use super::merge::MergeArgs;
pub use super::render::request;
use crate::Result;
use crate::console::{Paths, Verbosity};
use crate::film::atomic;
use crate::job::ViewOptions;

/// `bismar merge`: parts of a picture, or pictures of different seeds.
///
/// # Errors
/// Those of the command.
pub fn merge(options: &Options, parts: &[PathBuf]) -> Result<()> {
    let args = parse::<MergeArgs>("merge", options, parts)?;
    atomic::command(|| super::merge::run(&args, QUIET).map(drop))
}

/// `bismar labels`: annotations, ids, depth and normals of pictures.
///
/// # Errors
/// Those of the command.
pub fn labels(options: &Options, pictures: &[PathBuf]) -> Result<()> {
    let args = parse::<LabelsArgs>("labels", options, pictures)?;
    atomic::command(|| super::labels::run(&args, QUIET).map(drop))
}

/// `bismar develop`: a picture file to PNG.
///
/// # Errors
/// Those of the command.
pub fn develop(options: &Options, input: &Path) -> Result<()> {
    let args = parse::<DevelopArgs>("develop", options, &[input])?;
    atomic::command(|| super::develop::run(&args, QUIET).map(drop))
}

/// `bismar look`: a contact sheet of a scene, or of two, and what is in them; on the current rayon pool. Nothing is written, and
/// `paths` gets the files that are read.
///
/// # Errors
/// Those of the command; [`Error::Interrupted`](crate::Error::Interrupted) soon after `stop` is raised.
pub fn look(options: &Options, scenes: &[PathBuf], paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    scenes.iter().try_for_each(|scene| paths.reads("the scene", scene))?;
    super::look::look(&parse::<LookArgs>("look", options, scenes)?, paths, stop)
}

/// The values of `--view` and `--view-space`.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage).
pub fn view(options: &Options) -> Result<ViewOptions> {
    parse("view", options, &[] as &[&Path])
}

const QUIET: Verbosity = Verbosity { quiet: true, verbose: 0, log: crate::console::LogFormat::Text };
