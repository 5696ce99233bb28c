//! Runs tiles through passes on the current rayon pool, as the scheduler says.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use tracing::{debug, info, warn};

use super::pass::decisions::Decisions;
use super::pass::progress::{PassProgress, Progress};
use super::pass::rendered::{Rendered, noise, paths_range, study_tiles};
use super::pass::scheduler::{self, Next, State, pass_seed};
use super::pass::stats::{RenderStats, StopReason};
use super::pass::tile::{Tile, TileWork};
use super::prepass::Prepasses;
use super::prepass::allocation::Allocation;
use super::record::checkpoint::Saved;
use super::record::goals;
use super::settings::camera::lens;
use super::settings::techniques::Technique;
use super::settings::transport::transport;
use super::settings::{RenderSettings, StudyOptions};
use crate::Result;
use crate::film::Background;
use crate::integrator::{PreparedScene, Transport};
use crate::scene::Scene;

/// How to run a render, besides its settings.
pub struct RunOptions<'a> {
    /// Raised to stop the render: it then ends within a tile's time.
    pub stop: &'a AtomicBool,
    /// Called after every tile, from any thread.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// When the clock of [`RenderSettings::time`] began, for this session.
    pub began: Instant,
    /// What an earlier session left. Its tiles must be those of the settings
    /// ([`checkpoint::fits`](super::record::checkpoint::fits)).
    pub from: Option<Saved>,
    /// Called now and then with what has been rendered so far.
    pub pauses: Vec<Pause<'a>>,
    /// What only studies use.
    pub study: StudyOptions,
}

impl<'a> RunOptions<'a> {
    /// A render from the beginning, without pauses, whose clock begins now.
    pub fn new(stop: &'a AtomicBool, progress: &'a (dyn Fn(Progress) + Sync)) -> Self {
        Self { stop, progress, began: Instant::now(), from: None, pauses: Vec::new(), study: StudyOptions::default() }
    }
}

/// A pause of a render, in which it is saved or shown, and after which it continues.
pub struct Pause<'a> {
    /// Minimum seconds between pauses. They are farther apart where a pause takes long, so that pauses take at most a
    /// twentieth of the time.
    pub seconds: f64,
    /// Receives a render that can be resumed. It handles its own errors: rendering continues in any case.
    pub at: &'a mut dyn FnMut(&Rendered),
}

/// Maximum seconds before the first pause: a render that has begun to cost something is soon saved.
const MAX_SECONDS_TO_FIRST_PAUSE: f64 = 4.0;
/// Minimum seconds between pauses, over the seconds that a pause takes.
const SECONDS_PER_PAUSE_SECOND: f64 = 19.0;

/// Decides when the next pause is due.
struct PauseTimer<'a> {
    pause: Pause<'a>,
    last: Instant,
    /// Seconds from the last pause to the next.
    wait: f64,
}

impl<'a> PauseTimer<'a> {
    fn new(pause: Pause<'a>) -> Self {
        Self { last: Instant::now(), wait: pause.seconds.min(MAX_SECONDS_TO_FIRST_PAUSE), pause }
    }

    /// Seconds after `start` at which the next pause is due.
    fn due(&self, start: Instant) -> f64 {
        (self.last - start).as_secs_f64() + self.wait
    }

    /// Pauses if a pause is due. `seconds` is the render's time so far.
    fn pause_if_due(&mut self, rendered: &mut Rendered, seconds: f64) {
        if self.last.elapsed().as_secs_f64() < self.wait {
            return;
        }
        let began = Instant::now();
        rendered.stats.seconds = seconds;
        rendered.stop = StopReason::Interrupted;
        (self.pause.at)(rendered);
        self.last = Instant::now();
        self.wait = self.pause.seconds.max(SECONDS_PER_PAUSE_SECOND * began.elapsed().as_secs_f64());
    }
}

/// Renders from the beginning to the end, without pauses. The clock begins now.
///
/// # Errors
/// Those of [`run`].
pub fn render(
    scene: &PreparedScene,
    settings: &RenderSettings,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Rendered> {
    run(scene, settings, RunOptions::new(stop, progress))
}

/// Mean paths per pixel of these tiles, rounded down.
fn mean_paths(tiles: &[Tile]) -> u32 {
    let paths: u64 = tiles.iter().map(|tile| u64::from(tile.paths()) * tile.pixels() as u64).sum();
    let pixels: u64 = tiles.iter().map(|tile| tile.pixels() as u64).sum();
    (paths / pixels.max(1)) as u32
}

/// Renders on the current rayon pool until a stop rule of `settings` holds or the stop flag is raised (then within a
/// tile's time). Without a time limit the film's bits depend only on the scene, the backend's hits and `settings`: not on
/// threads, nor on how often the render was interrupted and resumed. Settings without `spp`, `time` and `noise` end by the
/// stop flag alone.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) for settings that [`RenderSettings::validate`] refuses, for a lens that cannot be
/// made ([`lens`]), for groups of lights that overlap or match nothing, and for study options that do not fit the picture.
pub fn run(scene: &PreparedScene, settings: &RenderSettings, options: RunOptions) -> Result<Rendered> {
    let RunOptions { stop, progress, began, from, pauses, study } = options;
    settings.validate(&scene.scene)?;
    study.validate(settings)?;
    lens(scene, settings)?;
    let layers = settings.light_groups.as_ref().map_or(Ok(None), |groups| groups.table(scene))?;
    let start = Instant::now();
    let most = from.as_ref().map_or(0, |saved| paths_range(&saved.tiles).1);
    let goal = settings.noise_goal();
    let begins = |saved: &Saved| saved.tiles.iter().map(|tile| tile.paths_before_pass(goal.as_ref())).min();
    let fewest = from.as_ref().and_then(begins).unwrap_or(0);
    let unfinished = scheduler::planned(settings, fewest).is_some();
    let prepasses = if unfinished { Prepasses::run(scene, settings, stop) } else { Prepasses::default() };
    let transport = Transport { layers, ..prepasses.apply(transport(scene, settings)) };
    // Made after the pre-passes, so that the memory of both is not taken at once.
    let fresh = || Saved { tiles: study_tiles(settings, &study), stats: RenderStats::default(), goals: Vec::new() };
    let Saved { tiles, stats, mut goals } = from.unwrap_or_else(fresh);
    if unfinished {
        goals::add(&mut goals, settings, most);
    }
    let before = stats.techniques;
    let stats = RenderStats { noise: f64::INFINITY, techniques: prepasses.stats().or(&before), ..stats };
    if unfinished {
        Decisions::of(settings, &stats.techniques).lines().for_each(|line| info!("{line}"));
    }
    let [on, was_on] = [stats.techniques, before].map(|found| found[Technique::Guiding].map(|guiding| guiding.on));
    if was_on == Some(false) && on == Some(true) {
        warn!(
            "paths are guided from here on: the picture is unbiased, but not bit-identical to an uninterrupted render"
        );
    }
    let (stop_reason, background) = (StopReason::Interrupted, background(&scene.scene, settings));
    let mut rendered = Rendered { settings: settings.clone(), tiles, stats, goals, stop: stop_reason, background };
    let clock = Clock { began, start, seconds: stats.seconds, render_seconds: stats.render_seconds };
    let allocation = prepasses.allocation.as_ref();
    let driver = Driver { settings, transport, allocation, max_passes: study.max_passes, stop, progress, clock };
    let mut timers: Vec<_> = pauses.into_iter().map(PauseTimer::new).collect();
    // What a pre-pass that was stopped has found means nothing.
    let is_stopped_early = unfinished && driver.is_stopped();
    rendered.stop = loop {
        if is_stopped_early {
            break StopReason::Interrupted;
        }
        let pass = match driver.next_pass(&mut rendered) {
            Ok(pass) => pass,
            Err(reason) => break reason,
        };
        let pause = timers.iter().map(|timer| timer.due(start)).fold(f64::INFINITY, f64::min);
        if let Err(reason) = driver.trace(&mut rendered, &pass, pause) {
            break reason;
        }
        timers.iter_mut().for_each(|timer| timer.pause_if_due(&mut rendered, driver.clock.seconds()));
    };
    rendered.stats.render_seconds = driver.clock.render_seconds();
    rendered.stats.seconds = driver.clock.seconds();
    Ok(rendered)
}

/// What the picture shows behind all surfaces.
fn background(scene: &Scene, settings: &RenderSettings) -> Background {
    match &scene.environment {
        _ if settings.transparent || settings.catches_shadows() => Background::Transparent,
        None => Background::Black,
        Some(_) => Background::Environment,
    }
}

/// Wall time of a render over all sessions.
struct Clock {
    /// When this session's time limit began to count.
    began: Instant,
    /// When this session began to render.
    start: Instant,
    /// [`RenderStats::seconds`] of earlier sessions.
    seconds: f64,
    /// [`RenderStats::render_seconds`] of earlier sessions.
    render_seconds: f64,
}

impl Clock {
    /// Seconds that the time limit counts.
    fn seconds(&self) -> f64 {
        self.seconds + self.began.elapsed().as_secs_f64()
    }

    /// Seconds of passes.
    fn render_seconds(&self) -> f64 {
        self.render_seconds + self.start.elapsed().as_secs_f64()
    }
}

/// One round over the tiles.
struct Pass {
    /// Paths per pixel before the pass: the fewest of a tile that takes part.
    done: u32,
    /// Paths per pixel that the scheduler has planned.
    size: u32,
    /// Paths per pixel that each tile takes; 0 for tiles that are finished.
    paths: Vec<u32>,
    /// The share of tiles that are finished.
    finished: f64,
}

/// A render in progress.
struct Driver<'a> {
    settings: &'a RenderSettings,
    transport: Transport<'a>,
    allocation: Option<&'a Allocation>,
    max_passes: Option<u32>,
    stop: &'a AtomicBool,
    progress: &'a (dyn Fn(Progress) + Sync),
    clock: Clock,
}

impl Driver<'_> {
    /// Paths per pixel of the next pass of a tile with a goal of its own; `None` if it has reached that.
    fn planned(&self, tile: &Tile) -> Option<u32> {
        match &self.allocation {
            Some(allocation) => allocation.next_pass(self.settings, tile),
            None => {
                let done = tile.paths_before_pass(self.settings.noise_goal().as_ref());
                scheduler::planned_to(self.settings, self.goal(tile), done)
            }
        }
    }

    /// Paths per pixel at which a tile is to end.
    fn goal(&self, tile: &Tile) -> Option<u32> {
        match &self.allocation {
            Some(allocation) => self.settings.spp.map(|mean| allocation.paths(tile, mean)),
            None => self.settings.spp,
        }
    }

    /// Does the tile take no more passes?
    fn is_finished(&self, tile: &Tile) -> bool {
        match &self.allocation {
            Some(_) => self.planned(tile).is_none(),
            None => self.settings.noise_goal().is_some_and(|goal| tile.tile_stats().open_paths(&goal).is_none()),
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The next pass, or why there is none. Estimates the noise where no pass is half done.
    fn next_pass(&self, rendered: &mut Rendered) -> std::result::Result<Pass, StopReason> {
        let Self { settings, allocation, .. } = self;
        let Rendered { tiles, stats, .. } = rendered;
        if tiles.is_empty() {
            return Err(StopReason::Samples);
        }
        let finished: Vec<bool> = tiles.par_iter().map(|tile| self.is_finished(tile)).collect();
        let open = || tiles.iter().zip(&finished).filter(|(_, finished)| !**finished).map(|(tile, _)| tile);
        // Tiles with their own goals take their own passes.
        let per_tile_counts = settings.noise.is_some() || (allocation.is_some() && settings.spp.is_some());
        let (done, ahead) = match allocation.is_some() && settings.spp.is_none() {
            true => [mean_paths(tiles); 2].into(),
            false => paths_range(open()),
        };
        let noise_goal = settings.noise_goal();
        let begins = open().filter_map(|tile| tile.tile_stats().open_paths(noise_goal.as_ref()?)).min();
        let done = begins.unwrap_or(done);
        let ahead = if per_tile_counts { done } else { ahead };
        if ahead == done {
            stats.noise = noise(tiles, settings.window());
        }
        let state = State {
            done,
            ahead,
            goal: open().filter_map(|tile| self.goal(tile)).max(),
            passes: stats.passes,
            max_passes: self.max_passes,
            clean: open().next().is_none(),
            seconds: self.clock.seconds(),
            render_seconds: self.clock.render_seconds(),
            stopped: self.is_stopped(),
        };
        let is_clean = |tile: &Tile| noise_goal.is_some_and(|goal| tile.is_clean(&goal));
        let size = match scheduler::next(settings, &state) {
            Next::Stop(StopReason::Noise) if !tiles.iter().all(is_clean) => {
                return Err(StopReason::Samples);
            }
            Next::Pass(size) => size,
            Next::Stop(reason) => return Err(reason),
        };
        let target = done + size;
        let max_paths = settings.time.map_or(u32::MAX, |_| size);
        let paths_of = |(tile, finished): (&Tile, &bool)| match allocation {
            _ if *finished => 0,
            _ if per_tile_counts => self.planned(tile).unwrap_or(0).min(max_paths),
            Some(allocation) => allocation.paths(tile, target).saturating_sub(tile.paths()),
            None => target.saturating_sub(tile.paths()),
        };
        let paths: Vec<u32> = tiles.iter().zip(&finished).map(paths_of).collect();
        if paths.iter().all(|paths| *paths == 0) {
            // Not even one block of the sequence fits into the remaining time.
            return Err(StopReason::Time);
        }
        let finished = finished.iter().filter(|finished| **finished).count() as f64 / finished.len() as f64;
        Ok(Pass { done, size, paths, finished })
    }

    /// Traces a pass until it is complete, a pause is due (`pause` seconds after the session's start) or the render must
    /// end, which is the error.
    fn trace(&self, rendered: &mut Rendered, pass: &Pass, pause: f64) -> std::result::Result<(), StopReason> {
        let Self { settings, transport, clock, .. } = self;
        let Rendered { tiles, stats, .. } = rendered;
        let meter = PassProgress {
            settings,
            start: clock.start,
            before: clock.seconds() - clock.start.elapsed().as_secs_f64(),
            pause,
            stop: self.stop,
            rays: AtomicU64::new(stats.rays()),
            tiles: AtomicU64::new(0),
            finished: pass.finished,
            done: pass.done,
            paths: AtomicU64::new(stats.paths),
            pixels: tiles.iter().map(|tile| tile.pixels() as f64).sum::<f64>(),
            noise: stats.noise,
        };
        let trace_tile = |(tile, paths): (&mut Tile, &u32)| {
            if meter.should_stop() {
                return TileWork::default();
            }
            let transport = Transport { seed: pass_seed(settings, tile.paths()), ..transport.clone() };
            let work = tile.pass(&transport, settings, *paths);
            (self.progress)(meter.add(&work));
            work
        };
        let open = tiles.par_iter_mut().with_max_len(1).zip(&pass.paths).filter(|(_, paths)| **paths > 0);
        let work = open.map(trace_tile).reduce(TileWork::default, TileWork::plus);
        let traced = meter.tiles.into_inner();
        let all = pass.paths.iter().filter(|paths| **paths > 0).count() as u64;
        stats.add(&work);
        stats.render_seconds = clock.render_seconds();
        debug!(
            "pass of {} paths per pixel after {}: {traced} of {all} tiles traced, {:.2} s so far",
            pass.size,
            pass.done,
            clock.seconds()
        );
        if traced == all {
            stats.passes += 1;
        } else if let Some(reason) = scheduler::cut(settings, clock.seconds(), self.is_stopped()) {
            return Err(reason);
        }
        Ok(())
    }
}
