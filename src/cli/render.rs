//! `bismar render SCENE`

mod args;
mod choose;
mod identity;
mod replay;
mod session;

use std::path::{Path, PathBuf};
use std::time::Instant;

use tracing::{info, warn};

pub use args::RenderArgs;
pub use identity::{Files, Inputs};
pub use session::{Done, Loaded, Session};

use crate::console::progress::Style;
use crate::console::{Reporter, Signals, Verbosity, Verdict, host, print, say};
use crate::film::atomic;
use crate::scene::Scene;
use crate::scene::import::{ImportOptions, NoteKind};
use crate::{Error, Result};

pub fn run(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let result = render(args, verbosity);
    if let (Err(error), Style::Openjd) = (&result, args.progress) {
        // What Open Job Description shows of a task that failed.
        print(format_args!("openjd_fail: {}", error.to_string().replace('\n', " ")))?;
    }
    result
}

fn render(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let began = Instant::now();
    args.check()?;
    let args = &args.on_this_machine()?;
    let (threads, source) = host::threads(args.threads)?;
    if let Some(place) = args.replay_pixel {
        return host::pool(threads)?.install(|| replay::run(args, place));
    }
    check_outputs(args)?;
    info!("{threads} threads ({source})");
    let signals = Signals::listen()?;
    host::pool(threads)?.install(|| {
        let reporter = Reporter::new(args.progress, verbosity.quiet);
        let prepared = signals.nothing_to_save(|| {
            let inputs = Inputs::read(args)?;
            let session = Session { args, inputs: &inputs, threads, began, replaces: false };
            if let Some(record) = session.done_before()? {
                return Ok(Err(session.develop(&record)?));
            }
            session.check_memory()?;
            // Whoever waits for signals here ends the program itself.
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

/// Finds out before the work whether its results can be kept, and removes what a killed process left beside them.
pub fn check_outputs(args: &RenderArgs) -> Result<()> {
    let output = args.output();
    let outputs: Vec<&PathBuf> =
        [Some(&output), args.preview.as_ref(), args.stats.as_ref()].into_iter().flatten().collect();
    for (i, path) in outputs.iter().enumerate() {
        if outputs[..i].contains(path) && path.as_path() != Path::new("/dev/null") {
            return Err(Error::Usage(format!("{}: named for two outputs", path.display())));
        }
        atomic::check(path)?;
        atomic::sweep(path);
    }
    Ok(())
}

fn make_scene(args: &RenderArgs, files: Files) -> Result<Scene> {
    let imported = files.scene.import(&ImportOptions { strict: args.strict })?;
    drop(files.scene);
    let inexact = imported.report.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored));
    let inexact = inexact.map(|n| n.text.as_str()).collect::<Vec<_>>();
    if let [first, rest @ ..] = &inexact[..] {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        warn!("not exactly as {} asks: {first}{more} (`bismar inspect` lists it)", args.scene.display());
    }
    let mut scene = imported.scene;
    if args.no_env {
        scene.environment = None;
    } else if let Some(file) = &files.environment {
        scene.environment = Some(file.decode(args.env_rotate, args.env_strength)?);
    }
    let name = args.scene.display();
    if args.no_env {
        if !scene.is_lit() {
            warn!("{name} has no light and --no-env takes the sky away: the picture will be black");
        }
    } else if scene.light_if_dark() {
        warn!("{name} has no light: a plain white sky lights it (--env FILE chooses another)");
    }
    Ok(scene)
}
