//! `bismar render SCENE`

mod args;
mod choose;
mod flags;
mod identity;
mod keep;
mod loaded;
mod names;
mod replay;
mod session;
mod values;
mod warnings;

use std::path::Path;
use std::time::Instant;

use tracing::{debug, info, warn};

pub use args::RenderArgs;
pub use flags::given;
use identity::Files;
pub use identity::Inputs;
pub use loaded::Loaded;
pub use session::{Done, Session};

use crate::Result;
use crate::cli::memory;
use crate::console::progress::Style;
use crate::console::{Paths, Reporter, Signals, Verbosity, Verdict, host, print, say};
use crate::film::atomic;
use crate::film::lock::{Claim, claim};
use crate::scene::import::NoteKind;
use crate::scene::{Environment, Scene};

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
    let mut paths = Paths::default();
    declare(args, "", &mut paths)?;
    // Before anything is touched.
    let signals = if args.led { Signals::led() } else { Signals::listen() }?;
    let _claims = claim_outputs(args)?;
    info!("{threads} threads ({source})");
    host::pool(threads)?.install(|| {
        let reporter = Reporter::new(args.progress, verbosity.quiet);
        let prepared = signals.nothing_to_save(|| {
            let inputs = Inputs::read(args)?;
            inputs.declare(&mut paths)?;
            let session = Session { args, inputs: &inputs, threads, began, replaces: false };
            if let Some(earlier) = session.done_before()? {
                return Ok(Err(session.develop(&earlier)?));
            }
            memory::hold(session.check_memory()?);
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

/// Adds what a command reads and writes to a run's files; `of` is added to what they are for.
///
/// # Errors
/// As [`Paths::writes`].
pub fn declare(args: &RenderArgs, of: &str, paths: &mut Paths) -> Result<()> {
    paths.reads(&format!("the scene{of}"), &args.scene)?;
    for (flag, path) in [("--env", &args.env), ("--path-mapping", &args.path_mapping)] {
        path.iter().try_for_each(|path| paths.reads(&format!("{flag}{of}"), path))?;
    }
    paths.writes(&format!("-o{of}"), &args.output())?;
    for (flag, path) in [("--preview", &args.preview), ("--stats", &args.stats)] {
        path.iter().try_for_each(|path| paths.writes(&format!("{flag}{of}"), path))?;
    }
    Ok(())
}

/// Finds out before the work whether its results can be kept and nobody else is writing them, and removes what a killed
/// process left beside them.
pub fn claim_outputs(args: &RenderArgs) -> Result<Vec<Claim>> {
    let output = args.output();
    let outputs = [Some(&output), args.preview.as_ref(), args.stats.as_ref()].into_iter().flatten();
    outputs.map(|path| claim_output(path)).collect()
}

/// As [`claim_outputs`], of one.
pub fn claim_output(path: &Path) -> Result<Claim> {
    atomic::check(path)?;
    let claim = claim(path)?;
    atomic::sweep(path);
    Ok(claim)
}

fn make_scene(args: &RenderArgs, files: Files) -> Result<Scene> {
    let imported = files.scene.import(&args.shown.options(args.strict, args.has_velocities()))?;
    drop(files.scene);
    let inexact = imported.report.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored));
    let inexact = inexact.map(|n| n.text.as_str()).collect::<Vec<_>>();
    inexact.iter().for_each(|note| debug!("{note}"));
    if let [first, rest @ ..] = &inexact[..] {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        warn!("not exactly as {} asks: {first}{more} (`bismar inspect` lists it)", args.scene.display());
    }
    let mut scene = imported.scene;
    let unit = args.light_unit.radiant();
    for light in &mut scene.lights {
        light.intensity *= unit;
        light.motion.iter_mut().for_each(|key| key.intensity *= unit);
    }
    if args.no_env {
        scene.environment = None;
    } else if args.sky {
        scene.environment = Some(Environment { strength: args.env_strength, ..Environment::constant([1.0; 3]) });
    } else if let Some(file) = &files.environment {
        scene.environment = Some(file.decode(args.env_rotate, args.env_strength)?);
    }
    let name = args.scene.display();
    if args.no_env {
        if !scene.is_lit() {
            warn!("{name} has no light and --no-env takes the sky away: the picture will be black");
        }
    } else if scene.light_if_dark() {
        warn!("{name} has no light: a studio's soft light is added (--env FILE or --sky choose another)");
    }
    if args.is_framed() {
        scene.frame();
    }
    Ok(scene)
}
