//! Runs tiles through passes on the current rayon pool, as the scheduler says.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use tracing::debug;

use super::allocation::Allocation;
use super::lens::lens;
use super::prepass::Prepasses;
use super::progress::{Meter, Progress};
use super::scheduler::{self, Next, State};
use super::stats::AdaptiveStats;
use super::tile::{Tile, TileWork};
use super::{Integrator, RenderSettings, RenderStats, Rendered, Saved, StopReason, fresh_tiles, noise, paths_range};
use crate::film::Background;
use crate::integrator::{CameraRays, PreparedScene, Transport};
use crate::light::Drawing;
use crate::sampling::{FilterSampler, hash};
use crate::scene::Scene;

/// How to run a render, besides its settings.
pub struct RunOptions<'a> {
    /// Raised to stop it, then within a tile's time.
    pub stop: &'a AtomicBool,
    /// Called after every tile, from any thread.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// When the clock of [`RenderSettings::time`] began, for this session.
    pub began: Instant,
    /// What an earlier session left. Its tiles must be those of the settings
    /// ([`checkpoint::fits`](super::checkpoint::fits)).
    pub from: Option<Saved>,
    /// Called now and then, with what there is.
    pub pauses: Vec<Pause<'a>>,
}

/// A pause of a render, in which it is saved or shown, and after which it goes on.
pub struct Pause<'a> {
    /// Seconds from one to the next, at least; more where one takes long, so that it takes a twentieth of the time at
    /// most.
    pub seconds: f64,
    /// Is handed a render that can go on. What fails here is its own affair: rendering goes on.
    pub at: &'a mut dyn FnMut(&Rendered),
}

/// Seconds after which the first pause is due, at most: what has begun to cost something is kept.
const FIRST: f64 = 4.0;
/// Seconds between pauses, over the seconds that one takes, at least.
const SECONDS_PER_PAUSE_SECOND: f64 = 19.0;

/// When the next pause is due.
struct Watch<'a> {
    own: Pause<'a>,
    last: Instant,
    /// Seconds from the last one to the next.
    wait: f64,
}

impl<'a> Watch<'a> {
    fn new(own: Pause<'a>) -> Self {
        Self { last: Instant::now(), wait: own.seconds.min(FIRST), own }
    }

    /// Seconds after `start` at which the next one is due.
    fn due(&self, start: Instant) -> f64 {
        (self.last - start).as_secs_f64() + self.wait
    }

    /// Pauses if it is time for that.
    fn pause(&mut self, now: &mut Rendered, seconds: f64) {
        if self.last.elapsed().as_secs_f64() < self.wait {
            return;
        }
        let began = Instant::now();
        now.stats.seconds = seconds;
        now.stop = StopReason::Interrupted;
        (self.own.at)(now);
        self.last = Instant::now();
        self.wait = self.own.seconds.max(SECONDS_PER_PAUSE_SECOND * began.elapsed().as_secs_f64());
    }
}

/// [`run`] from the beginning to the end, without pauses, the clock beginning now.
pub fn render(
    scene: &PreparedScene,
    settings: &RenderSettings,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Rendered {
    let began = Instant::now();
    run(scene, settings, RunOptions { stop, progress, began, from: None, pauses: Vec::new() })
}

/// The camera of a render with these settings.
pub fn camera(scene: &Scene, settings: &RenderSettings) -> CameraRays {
    let RenderSettings { camera, width, height, .. } = *settings;
    CameraRays::new(&scene.camera(camera, width, height), width, height)
}

/// How the paths of a render with these settings go that no pilot leads.
pub fn transport<'a>(scene: &'a PreparedScene, settings: &RenderSettings) -> Transport<'a> {
    Transport {
        scene: &scene.scene,
        rays: scene.rays.as_ref(),
        geometry: &scene.geometry,
        materials: &scene.materials,
        lights: &scene.lights,
        names: &scene.names,
        // Who asks for what cannot be was told before.
        camera: camera(&scene.scene, settings).with_lens(lens(scene, settings).unwrap_or_default()),
        filter: FilterSampler::new(settings.filter),
        heuristic: settings.balance.method().heuristic(),
        max_depth: match settings.integrator {
            Integrator::Path => settings.max_depth,
            Integrator::Direct => settings.max_depth.min(2),
        },
        seed: settings.seed,
        limits: [settings.clamp_direct, settings.clamp_indirect].map(|most| most.map_or(f32::INFINITY, |x| x as f32)),
        hides_environment: settings.transparent,
        field: None,
        drawing: Drawing::default(),
    }
}

/// The seed of a pass that begins after `done` paths.
pub fn pass_seed(settings: &RenderSettings, done: u32) -> u32 {
    let scrambles = settings.balance.method().scrambles_passes();
    settings.seed
        ^ match () {
            // Points that nobody learns from, and none of those that the pilot has.
            () if scheduler::is_early(settings, done) => hash(u32::MAX),
            () if scrambles => hash(done),
            () => 0,
        }
}

/// Mean paths of these tiles' pixels, rounded down.
fn mean_paths(tiles: &[Tile]) -> u32 {
    let paths: u64 = tiles.iter().map(|tile| u64::from(tile.paths()) * tile.pixels() as u64).sum();
    let pixels: u64 = tiles.iter().map(|tile| tile.pixels() as u64).sum();
    (paths / pixels.max(1)) as u32
}

/// Renders on the current rayon pool until a stop rule of `settings` holds or the stop flag is raised (then within a
/// tile's time). Without a time limit the film's bits depend on the scene, the backend's hits and `settings` alone: not
/// on threads, nor on how often it was interrupted and continued.
pub fn run(scene: &PreparedScene, settings: &RenderSettings, options: RunOptions) -> Rendered {
    let RunOptions { stop, progress, began, from, pauses } = options;
    let start = Instant::now();
    let Saved { tiles, stats } =
        from.unwrap_or_else(|| Saved { tiles: fresh_tiles(settings), stats: RenderStats::default() });
    let goes_on = scheduler::planned(settings, paths_range(&tiles).0).is_some();
    let pilots = if goes_on { Prepasses::send(scene, settings) } else { Prepasses::default() };
    let transport = pilots.lead(transport(scene, settings));
    let guiding = pilots.guiding.as_ref().map(|found| found.stats()).or(stats.guiding);
    let lamps = pilots.lamps.as_ref().map(|found| found.stats()).or(stats.lamps);
    let surveyed = Instant::now();
    let allocation = if goes_on { Allocation::new(&transport, settings) } else { None };
    let of = |a: &Allocation| AdaptiveStats { worth: a.worth(), seconds: surveyed.elapsed().as_secs_f64() };
    let adaptive = allocation.as_ref().map(of).or(stats.adaptive);
    let before = RenderStats { noise: f64::INFINITY, guiding, lamps, adaptive, ..stats };
    let goal = |tile: &Tile| match &allocation {
        Some(allocation) => settings.spp.map(|mean| allocation.paths(tile, mean)),
        None => settings.spp,
    };
    let is_done = |tile: &Tile| match &allocation {
        Some(_) => scheduler::planned_to(settings, goal(tile), tile.paths()).is_none(),
        None => tile.is_clean(settings),
    };
    // With goals of their own, tiles go their own ways.
    let per_tile_counts = settings.noise.is_some() || (allocation.is_some() && settings.spp.is_some());
    let background = match &scene.scene.environment {
        None => Background::Black,
        Some(_) if settings.transparent => Background::Transparent,
        Some(_) => Background::Environment,
    };
    let stop_reason = StopReason::Interrupted;
    let mut now = Rendered { settings: settings.clone(), tiles, stats: before, stop: stop_reason, background };
    // Seconds so far, of this session and those before it: since the clock began, and inside of this function.
    let elapsed = || before.seconds + began.elapsed().as_secs_f64();
    let rendering = || before.render_seconds + start.elapsed().as_secs_f64();
    let stopped = || stop.load(Ordering::Relaxed);
    let mut watches: Vec<_> = pauses.into_iter().map(Watch::new).collect();
    now.stop = loop {
        if now.tiles.is_empty() {
            break StopReason::Samples;
        }
        let clean: Vec<bool> = now.tiles.par_iter().map(is_done).collect();
        let open = || now.tiles.iter().zip(&clean).filter(|(_, clean)| !**clean).map(|(tile, _)| tile);
        let (done, ahead) = match allocation.is_some() && settings.spp.is_none() {
            true => [mean_paths(&now.tiles); 2].into(),
            false => paths_range(open()),
        };
        let ahead = if per_tile_counts { done } else { ahead };
        if ahead == done {
            now.stats.noise = noise(&now.tiles, settings.window());
        }
        let state = State {
            done,
            ahead,
            goal: open().filter_map(goal).max(),
            passes: now.stats.passes,
            clean: open().next().is_none(),
            seconds: elapsed(),
            render_seconds: rendering(),
            stopped: stopped(),
        };
        let pass = match scheduler::next(settings, &state) {
            Next::Stop(StopReason::Noise) if allocation.is_some() => break StopReason::Samples,
            Next::Pass(paths) => paths,
            Next::Stop(reason) => break reason,
        };
        let target = done + pass;
        let most = settings.time.map_or(u32::MAX, |_| pass);
        let passes = |(tile, clean): (&Tile, &bool)| match &allocation {
            _ if *clean => 0,
            _ if per_tile_counts => scheduler::planned_to(settings, goal(tile), tile.paths()).unwrap_or(0).min(most),
            Some(allocation) => allocation.paths(tile, target).saturating_sub(tile.paths()),
            None => target.saturating_sub(tile.paths()),
        };
        let passes: Vec<u32> = now.tiles.iter().zip(&clean).map(passes).collect();
        let left = passes.iter().filter(|paths| **paths > 0).count() as u64;
        if left == 0 {
            // Not even a block of the sequence fits into what is left.
            break StopReason::Time;
        }
        let traced = now.tiles.iter().map(|tile| tile.pixels() as f64).sum::<f64>();
        let meter = Meter {
            settings,
            start,
            before: elapsed() - start.elapsed().as_secs_f64(),
            deadline: settings.time.map(|limit| limit - elapsed() + start.elapsed().as_secs_f64()),
            pause: watches.iter().map(|w| w.due(start)).fold(f64::INFINITY, f64::min),
            stop,
            rays: AtomicU64::new(now.stats.rays()),
            tiles: AtomicU64::new(0),
            clean: clean.iter().filter(|clean| **clean).count() as f64 / clean.len() as f64,
            done,
            paths: AtomicU64::new(now.stats.paths),
            traced,
            noise: now.stats.noise,
        };
        let take = |(tile, paths): (&mut Tile, &u32)| {
            if meter.should_stop() {
                return TileWork::default();
            }
            let transport = Transport { seed: pass_seed(settings, tile.paths()), ..transport.clone() };
            let work = tile.pass(&transport, settings, *paths);
            progress(meter.after(&work));
            work
        };
        let tiles = now.tiles.par_iter_mut().with_max_len(1).zip(&passes).filter(|(_, paths)| **paths > 0);
        let work = tiles.map(take).reduce(TileWork::default, TileWork::plus);
        let taken = meter.tiles.into_inner();
        now.stats.add(&work);
        now.stats.render_seconds = rendering();
        debug!("{pass} paths a pixel after {done}: {taken} of {left} tiles took them, {:.2} s so far", elapsed());
        if taken == left {
            now.stats.passes += 1;
        } else if let Some(reason) = scheduler::cut(settings, elapsed(), stopped()) {
            break reason;
        }
        watches.iter_mut().for_each(|watch| watch.pause(&mut now, elapsed()));
    };
    now.stats.render_seconds = rendering();
    now.stats.seconds = elapsed();
    now
}
