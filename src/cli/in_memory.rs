//! The commands for front ends that give options as data (the Python package). Scenes and pictures in memory are those of [`LoadedScene`](crate::job::LoadedScene).

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;

use super::develop::DevelopArgs;
use super::labels::LabelsArgs;
use super::look::LookArgs;
pub use super::look::{Looked, Shot};
use super::merge::MergeArgs;
use super::options::parse;
pub use super::options::{Options, with_keywords};
pub use super::render::request;
use crate::Result;
use crate::color::ColorSpace;
use crate::console::{Paths, Verbosity};
use crate::film::{Exposure, atomic};
use crate::job::{RenderedPicture, ViewOptions, value_of};

/// `bismar merge`: parts of a picture, or pictures of different seeds.
pub fn merge(options: &Options, parts: &[PathBuf]) -> Result<()> {
    let args = parse::<MergeArgs>("merge", options, parts)?;
    atomic::command(|| super::merge::run(&args, QUIET).map(drop))
}

/// `bismar labels`: annotations, ids, depth and normals of pictures.
pub fn labels(options: &Options, pictures: &[PathBuf]) -> Result<()> {
    let args = parse::<LabelsArgs>("labels", options, pictures)?;
    atomic::command(|| super::labels::run(&args, QUIET).map(drop))
}

/// `bismar develop`: a picture file to PNG.
pub fn develop(options: &Options, input: &Path) -> Result<()> {
    let args = parse::<DevelopArgs>("develop", options, &[input])?;
    atomic::command(|| super::develop::run(&args, QUIET).map(drop))
}

/// `bismar look`: a contact sheet of a scene, or of two, and what is in them; on the current rayon pool. Nothing is written, and
/// `paths` gets the files that are read.
/// Errors: Those of the command; [`Error::Interrupted`](crate::Error::Interrupted) soon after `stop` is raised.
pub fn look(options: &Options, scenes: &[PathBuf], paths: &mut Paths, stop: &AtomicBool) -> Result<Looked> {
    scenes.iter().try_for_each(|scene| paths.reads("the scene", scene))?;
    super::look::look(&parse::<LookArgs>("look", options, scenes)?, paths, stop)
}

/// How a picture in memory is saved.
#[derive(Debug, Args)]
struct SaveArgs {
    #[command(flatten)]
    view: ViewOptions,
    #[arg(long, default_value_t = Exposure::Auto, allow_negative_numbers = true)]
    exposure: Exposure,
    #[arg(long)]
    resumable: bool,
    #[arg(long)]
    half: bool,
    #[arg(long, value_parser = value_of::<ColorSpace>(), default_value = ColorSpace::Rec709.name())]
    colorspace: ColorSpace,
}

pub fn save(picture: &RenderedPicture, path: &Path, options: &Options) -> Result<()> {
    let SaveArgs { view, exposure, resumable, half, colorspace } = parse("save", options, &[] as &[&Path])?;
    picture.save(path, (view, exposure), resumable, (half, colorspace))
}

const QUIET: Verbosity = Verbosity { quiet: true, verbose: 0, log: crate::console::LogFormat::Text };
