//! `bismar render SCENE`

mod args;
mod choose;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use tracing::{info, warn};

pub use args::{RenderArgs, Size, threads};

use super::progress::Reporter;
use super::stats::{Seconds, Stats, sample_range};
use super::{Verbosity, Verdict, host, say};
use crate::film::{atomic, exr_file, preview};
use crate::render::{RenderSettings, Rendered, StopReason, render};
use crate::scene::import::{self, ImportOptions, NoteKind};
use crate::scene::{Environment, Scene};
use crate::{Error, Result, rays};

pub fn run(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    args.check()?;
    let output = args.output();
    let outputs = [Some(&output), args.preview.as_ref(), args.stats.as_ref()];
    check_outputs(&outputs.into_iter().flatten().collect::<Vec<_>>())?;
    let (threads, source) = host::threads(args.threads)?;
    info!("{threads} threads ({source})");
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::Host(format!("cannot start {threads} threads: {e}")))?;
    pool.install(|| on_pool(args, verbosity, &output, threads))
}

fn on_pool(args: &RenderArgs, verbosity: Verbosity, output: &Path, threads: usize) -> Result<Verdict> {
    let start = Instant::now();
    let stop = stop_flag()?;
    let mut seconds = Seconds::default();
    let scene = read_scene(args)?;
    let settings = settings(args, &scene)?;
    seconds.read = start.elapsed().as_secs_f64();
    info!("read {} in {:.2} s", args.scene.display(), seconds.read);

    let built = Instant::now();
    let scene = Arc::new(scene);
    let reporter = Reporter::new(args.progress, verbosity.quiet);
    let rays = rays::build_watched(args.rays, Arc::clone(&scene), &|done| {
        reporter.building(done, built.elapsed().as_secs_f64());
        !stop.load(Ordering::Relaxed)
    })
    .inspect_err(|_| reporter.finish(false))?;
    let backend = rays.info();
    seconds.build = built.elapsed().as_secs_f64();
    let mebibytes = backend.memory_bytes as f64 / 2_f64.powi(20);
    info!("built {} {} ({}): {:.2} s, {mebibytes:.1} MiB", backend.name, backend.version, backend.isa, seconds.build);

    let rendered = render(&scene, rays.as_ref(), &settings, &stop, &|p| reporter.update(p));
    reporter.finish(rendered.stop != StopReason::Interrupted);
    seconds.render = rendered.stats.render_seconds;
    let (fewest, most) = sample_range(&rendered.film);
    if most == 0 {
        return Err(nothing_rendered(&rendered, output));
    }

    let writing = Instant::now();
    let mut stats = Stats::new(&args.scene, &scene, &settings, backend, threads, &rendered, seconds);
    exr_file::write(output, &rendered.film, args.aovs(), &stats.header()?)?;
    if let Some(path) = &args.preview {
        preview::write(path, &rendered.film, args.view, args.exposure)?;
    }
    stats.seconds.write = writing.elapsed().as_secs_f64();
    stats.seconds.total = start.elapsed().as_secs_f64();
    if let Some(path) = &args.stats {
        stats.write(path)?;
    }
    if rendered.stop == StopReason::Interrupted {
        let spp = if fewest == most { fewest.to_string() } else { format!("{fewest} to {most}") };
        return Err(Error::Interrupted(format!(
            "interrupted: {} is saved with {spp} paths a pixel; this version cannot go on from there",
            output.display()
        )));
    }
    if !verbosity.quiet {
        say(format_args!("{}: {}", output.display(), stats.summary()));
    }
    Ok(Verdict::Done)
}

fn nothing_rendered(rendered: &Rendered, output: &Path) -> Error {
    let output = output.display();
    match rendered.stop {
        StopReason::Interrupted => {
            Error::Interrupted(format!("interrupted before the first path: {output} is not written"))
        }
        _ => Error::Usage(format!("--time is over before the first path: {output} is not written; give it longer")),
    }
}

/// Finds out before the work whether its results can be kept.
fn check_outputs(outputs: &[&PathBuf]) -> Result<()> {
    for (i, path) in outputs.iter().enumerate() {
        if outputs[..i].contains(path) && path.as_path() != Path::new("/dev/null") {
            return Err(Error::Usage(format!("{}: named for two outputs", path.display())));
        }
        atomic::check(path)?;
    }
    Ok(())
}

fn read_scene(args: &RenderArgs) -> Result<Scene> {
    let imported = import::import(&args.scene, &ImportOptions { strict: args.strict })?;
    let inexact = imported.report.notes.iter().filter(|n| matches!(n.kind, NoteKind::Approximated | NoteKind::Ignored));
    let inexact = inexact.map(|n| n.text.as_str()).collect::<Vec<_>>();
    if let [first, rest @ ..] = &inexact[..] {
        let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
        warn!("not exactly as {} asks: {first}{more} (`bismar inspect` lists it)", args.scene.display());
    }
    let mut scene = imported.scene;
    if args.no_env {
        scene.environment = None;
    } else if let Some(path) = &args.env {
        scene.environment = Some(import::environment(path, args.env_rotate, args.env_strength)?);
    }
    let lit = scene.environment.is_some()
        || !scene.lights.is_empty()
        || scene.materials.iter().any(|m| m.is_emissive() || m.unlit);
    let name = args.scene.display();
    match (lit, args.no_env) {
        (true, _) => {}
        (false, true) => warn!("{name} has no light and --no-env takes the sky away: the picture will be black"),
        (false, false) => {
            warn!("{name} has no light: a plain white sky lights it (--env FILE chooses another)");
            scene.environment = Some(Environment::constant([1.0; 3]));
        }
    }
    Ok(scene)
}

fn settings(args: &RenderArgs, scene: &Scene) -> Result<RenderSettings> {
    let camera = choose::camera(&scene.cameras, args.camera.as_deref())?;
    let (width, height) = args.size.map_or_else(|| choose::size(&scene.cameras[camera]), |s| (s.0, s.1));
    let crop = args.crop.map(|c| c.inside(width, height)).transpose()?;
    let [x0, y0, x1, y1] = crop.unwrap_or([0, 0, width, height]);
    let pixels = u64::from(x1 - x0) * u64::from(y1 - y0);
    // Once in the film, once in its tiles.
    let bytes_a_pixel = 2 * size_of::<crate::film::PixelStats>() as u64;
    host::check_memory(&format!("a picture of {} x {} pixels", x1 - x0, y1 - y0), pixels * bytes_a_pixel)?;
    let unlimited = args.spp.is_none() && args.time.is_none() && args.noise.is_none();
    Ok(RenderSettings {
        camera,
        width,
        height,
        crop,
        integrator: args.integrator,
        max_depth: args.max_depth,
        spp: if unlimited { RenderSettings::default().spp } else { args.spp },
        time: args.time,
        noise: args.noise,
        balance: args.balance,
        seed: args.seed,
        filter: args.filter,
        aovs: args.aovs().iter().any(|a| a.needs_sums()),
        ..RenderSettings::default()
    })
}

/// Raised by the first SIGINT or SIGTERM; the second one ends the program as if nobody had listened.
pub(super) fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // In this order: the first signal finds the flag still down and raises it.
        signal_hook::flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .map_err(|e| Error::Host(format!("cannot listen to signal {signal}: {e}")))?;
    }
    Ok(stop)
}
