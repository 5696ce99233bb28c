//! `bismar render SCENE`

mod args;
mod checkpoints;
mod choose;
mod command;
mod denoise;
mod flags;
mod identity;
mod loaded;
mod names;
mod output;
mod replay;
mod scene;
mod session;
mod values;
mod warnings;

use std::io::stdin;
use std::path::{Path, PathBuf};
use std::time::Instant;

use tracing::info;

pub use args::RenderArgs;
pub use choose::{settings, size};
pub use command::PictureCommand;
pub use denoise::{DenoiseWorkerArgs, work as denoise_work};
pub use flags::given;
pub use identity::Inputs;
pub use loaded::Loaded;
pub use output::{OutputWriter, preview_mark};
pub use session::{Done, Session};

use crate::Result;
use crate::cli::memory;
use crate::console::{Paths, Reporter, Signals, Verbosity, Verdict, host, progress, say};
use crate::film::atomic;
use crate::film::lock::{Claim, claim};

pub fn run(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let result = render(args, verbosity);
    result.inspect_err(|error| progress::failed(args.progress, error))
}

fn render(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let began = Instant::now();
    args.check()?;
    let mut args = args.on_this_machine()?;
    let from_pipe = args.takes_standard_input();
    let args = &args;
    let (threads, source) = host::threads(args.threads)?;
    if let Some(pixel_path) = args.replay_pixel {
        return host::pool(threads)?.install(|| replay::run(args, pixel_path));
    }
    let mut paths = Paths::default();
    [&args.output, &args.preview, &args.stats].into_iter().flatten().for_each(|path| atomic::named(path));
    atomic::confine(&[]);
    declare(args, "", &mut paths)?;
    // Before any file is touched.
    let signals = if args.signals_from_parent { Signals::from_parent() } else { Signals::listen() }?;
    let _claims = claim_outputs(args)?;
    info!("{threads} threads ({source})");
    host::pool(threads)?.install(|| {
        let reporter = Reporter::new(args.progress, verbosity.quiet);
        let prepared = signals.nothing_to_save(|| {
            let inputs = if from_pipe { Inputs::read_pipe(args, &mut stdin().lock()) } else { Inputs::read(args) }?;
            inputs.declare(&mut paths)?;
            let session = Session { args, inputs: &inputs, threads, began, replaces: false };
            if let Some(earlier) = session.finished_before()? {
                return Ok(Err(session.develop(&earlier)?));
            }
            memory::hold(session.check_memory()?);
            // A signal ends the process here, so the build need not stop by itself.
            let loaded = Loaded::load(args, &inputs, &|done, seconds| {
                reporter.building(done, seconds);
                true
            });
            Ok(Ok((loaded.inspect_err(|_| reporter.finish(false))?, inputs)))
        });
        let (loaded, inputs) = match prepared? {
            Ok(work) => work,
            Err(done) => {
                if !verbosity.quiet {
                    say(done);
                }
                return Ok(Verdict::Done);
            }
        };
        let session = Session { args, inputs: &inputs, threads, began, replaces: false };
        let done =
            session.render(&loaded, &signals.stop, &|p| reporter.update(p), &|complete| reporter.finish(complete))?;
        if !verbosity.quiet {
            say(done);
        }
        Ok(Verdict::Done)
    })
}

/// Declares the files that a command reads and writes; `suffix` is appended to their description in errors.
///
/// # Errors
/// Those of [`Paths::writes`].
pub fn declare(args: &RenderArgs, suffix: &str, paths: &mut Paths) -> Result<()> {
    paths.reads(&format!("the scene{suffix}"), &args.scene)?;
    for (flag, path) in [("--env", &args.env), ("--path-mapping", &args.path_mapping)] {
        path.iter().try_for_each(|path| paths.reads(&format!("{flag}{suffix}"), path))?;
    }
    paths.writes(&format!("-o{suffix}"), &args.output())?;
    for (flag, path) in [("--preview", &args.preview), ("--stats", &args.stats)] {
        path.iter().try_for_each(|path| paths.writes(&format!("{flag}{suffix}"), path))?;
    }
    Ok(())
}

/// Locks a command's outputs, so that an output that cannot be written or that another process writes is an error before
/// the render. Removes temporary files of killed processes.
///
/// # Errors
/// Those of [`claim_output`].
pub fn claim_outputs(args: &RenderArgs) -> Result<Vec<Claim>> {
    outputs(args).map(|path| claim_output(&path)).collect()
}

/// The picture, its preview and its statistics.
pub fn outputs(args: &RenderArgs) -> impl Iterator<Item = PathBuf> {
    [Some(args.output()), args.preview.clone(), args.stats.clone()].into_iter().flatten()
}

/// Locks one output.
///
/// # Errors
/// Those of [`atomic::check`] and [`claim`].
pub fn claim_output(path: &Path) -> Result<Claim> {
    atomic::check(path)?;
    let claim = claim(path)?;
    atomic::sweep(path);
    Ok(claim)
}
