//! Tiles, passes, stopping: from a scene and settings to a film.

pub mod fingerprint;
pub mod part;
pub mod sampler;
pub mod saved;
pub mod settings;
pub mod tile;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use crate::film::Film;
use crate::integrator::{CameraRays, PreparedScene, Transport};
use crate::sampling::{FilterSampler, hash};
pub use fingerprint::Fingerprint;
pub use part::Part;
pub use saved::Saved;
pub use settings::{Balance, Integrator, PixelFilter, RenderSettings};
use tile::{Tile, TileWork};

/// Why a render ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// All samples taken.
    Samples,
    /// Out of time.
    Time,
    /// The noise goal was reached.
    Noise,
    /// The stop flag was raised.
    Interrupted,
}

/// Counts and times of a render, over all its sessions.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub struct RenderStats {
    /// Camera paths.
    pub paths: u64,
    /// Camera rays.
    pub camera_rays: u64,
    /// Rays of the first bounce.
    pub first_bounce_rays: u64,
    /// Rays of later bounces.
    pub later_bounce_rays: u64,
    /// Shadow rays.
    pub shadow_rays: u64,
    /// Wall seconds from the clock's beginning to the end of rendering: what `--time` limits.
    pub seconds: f64,
    /// Wall seconds of the passes.
    pub render_seconds: f64,
    /// Thread seconds inside ray queries, over all threads.
    pub ray_query_seconds: f64,
    /// Thread seconds inside tiles, over all threads.
    pub tile_seconds: f64,
    /// Passes completed.
    pub passes: u32,
    /// Estimated relative error of the picture after its last whole pass; not kept, but computed again.
    #[serde(skip_deserializing)]
    pub noise: f64,
}

/// How far a render is; handed to the progress callback after every tile, from any thread.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// In [0, 1], of the stop rule that is nearest.
    pub fraction: f64,
    /// Seconds since rendering began.
    pub seconds: f64,
    /// Rays of all kinds so far.
    pub rays: u64,
    /// Estimated relative error after the last finished pass; infinite before.
    pub noise: f64,
    /// Paths a pixel after the last finished pass.
    pub spp: u32,
}

/// A finished or stopped render.
#[derive(Debug)]
pub struct Rendered {
    /// What was collected.
    pub film: Film,
    /// The same, tile by tile, row by row, with all that is needed to go on.
    pub tiles: Vec<Tile>,
    /// What it took.
    pub stats: RenderStats,
    /// Why it ended.
    pub stop: StopReason,
}

/// How to run a render, besides its settings.
pub struct Run<'a> {
    /// Raised to stop it, then within a tile's time.
    pub stop: &'a AtomicBool,
    /// Called after every tile, from any thread.
    pub progress: &'a (dyn Fn(Progress) + Sync),
    /// When the clock of [`RenderSettings::time`] began, for this session.
    pub began: Instant,
    /// What an earlier session left. Its tiles must be those of the settings ([`saved::fits`]).
    pub from: Option<Saved>,
    /// Saves what there is, now and then.
    pub checkpoint: Option<Checkpoint<'a>>,
}

/// Saving while rendering.
pub struct Checkpoint<'a> {
    /// Seconds from one to the next, at least; more where saving takes long, so that it takes a twentieth of the time
    /// at most.
    pub seconds: f64,
    /// Saves a render that can go on. What fails here is its own affair: rendering goes on.
    pub save: &'a mut dyn FnMut(&Rendered),
}

/// Seconds between checkpoints, over the seconds that one takes, at least.
const SECONDS_PER_SAVING_SECOND: f64 = 19.0;

/// [`run`] from the beginning to the end, without checkpoints, the clock beginning now.
pub fn render(
    scene: &PreparedScene,
    settings: &RenderSettings,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Rendered {
    let began = Instant::now();
    run(scene, settings, Run { stop, progress, began, from: None, checkpoint: None })
}

/// The tiles that a render of these settings begins with, row by row.
pub fn fresh_tiles(settings: &RenderSettings) -> Vec<Tile> {
    let mut all = Tile::cover(settings.width, settings.height, settings.window(), settings.columns());
    if let Some(shares) = &settings.shares {
        all.iter_mut().for_each(|tile| tile.begin_with(shares, settings.width));
    }
    match settings.part {
        Some(part) => part.of(all),
        None => all,
    }
}

/// Renders on the current rayon pool until a stop rule of `settings` holds or the stop flag is raised (then within a
/// tile's time). Without a time limit the film's bits depend on the scene, the backend's hits and `settings` alone: not
/// on threads, nor on how often it was interrupted and continued.
pub fn run(scene: &PreparedScene, settings: &RenderSettings, job: Run) -> Rendered {
    let method = settings.balance.method();
    let mut transport = Transport {
        scene: &scene.scene,
        rays: scene.rays.as_ref(),
        geometry: &scene.geometry,
        materials: &scene.materials,
        lights: &scene.lights,
        camera: CameraRays::new(&scene.scene.cameras[settings.camera], settings.width, settings.height),
        filter: FilterSampler::new(settings.filter),
        heuristic: method.heuristic(),
        max_depth: match settings.integrator {
            Integrator::Path => settings.max_depth,
            Integrator::Direct => settings.max_depth.min(2),
        },
        seed: settings.seed,
    };
    let Run { stop, progress, began, from, mut checkpoint } = job;
    let start = Instant::now();
    let Saved { tiles, stats } =
        from.unwrap_or_else(|| Saved { tiles: fresh_tiles(settings), stats: RenderStats::default() });
    let before = RenderStats { noise: f64::INFINITY, ..stats };
    let mut now = Rendered { film: Film::default(), tiles, stats: before, stop: StopReason::Interrupted };
    // Seconds so far, of this session and those before it: since the clock began, and inside of this function.
    let elapsed = || before.seconds + began.elapsed().as_secs_f64();
    let rendering = || before.render_seconds + start.elapsed().as_secs_f64();
    let mut saved_at = Instant::now();
    let mut pause_after = checkpoint.as_ref().map_or(f64::INFINITY, |c| c.seconds);
    loop {
        let (done, ahead) = paths_range(&now.tiles);
        // A pass that an interruption has left half-way is finished first: then no bit can tell.
        let mut pass = ahead - done;
        if pass == 0 {
            now.stats.noise = noise(&now.tiles, settings.window());
            if settings.noise.is_some_and(|goal| done >= NOISE_PATHS && now.stats.noise <= goal) {
                now.stop = StopReason::Noise;
                break;
            }
            let enough = now.tiles.is_empty() || settings.passes.is_some_and(|most| now.stats.passes >= most);
            match method.next_pass(done, settings.spp, settings.pilot) {
                Some(next) if !enough => pass = next,
                _ => {
                    now.stop = StopReason::Samples;
                    break;
                }
            }
        }
        if stop.load(Ordering::Relaxed) {
            now.stop = StopReason::Interrupted;
            break;
        }
        if let Some(limit) = settings.time {
            let left = limit - elapsed();
            // What fits into the time that is left, by what a path has cost so far.
            let fits = if done == 0 { pass } else { (left * f64::from(done) / rendering()) as u32 };
            if left <= 0.0 || fits == 0 {
                now.stop = StopReason::Time;
                break;
            }
            if ahead == done {
                pass = pass.min(fits);
            }
        }
        let target = done + pass;
        if method.scrambles_passes() {
            transport.seed = settings.seed ^ hash(done);
        }
        let shared = Shared {
            start,
            deadline: settings.time.map(|limit| limit - elapsed() + start.elapsed().as_secs_f64()),
            pause: (saved_at - start).as_secs_f64() + pause_after,
            stop,
            rays: AtomicU64::new(now.stats.rays()),
            before: now.tiles.iter().filter(|t| t.paths() == target).count() as u64,
            tiles: AtomicU64::new(0),
            all_tiles: now.tiles.len() as u64,
        };
        let work = now
            .tiles
            .par_iter_mut()
            .with_max_len(1)
            .filter(|tile| tile.paths() < target)
            .map(|tile| {
                if shared.should_stop() {
                    return TileWork::default();
                }
                let work = tile.pass(&transport, settings.balance, pass);
                progress(shared.progress(&work, settings, done, pass, now.stats.noise, elapsed()));
                work
            })
            .reduce(TileWork::default, TileWork::plus);
        now.stats.add(&work);
        now.stats.render_seconds = rendering();
        if paths_range(&now.tiles).0 == target {
            now.stats.passes += 1;
        } else if stop.load(Ordering::Relaxed) {
            now.stop = StopReason::Interrupted;
            break;
        } else if settings.time.is_some_and(|limit| elapsed() >= limit) {
            now.stop = StopReason::Time;
            break;
        }
        if let Some(checkpoint) = &mut checkpoint
            && saved_at.elapsed().as_secs_f64() >= pause_after
        {
            let saving = Instant::now();
            now.stats.seconds = elapsed();
            now.stop = StopReason::Interrupted;
            now.film = film_of(&now.tiles, settings);
            (checkpoint.save)(&now);
            now.film = Film::default();
            saved_at = Instant::now();
            pause_after = checkpoint.seconds.max(SECONDS_PER_SAVING_SECOND * saving.elapsed().as_secs_f64());
        }
    }
    now.film = film_of(&now.tiles, settings);
    now.stats.render_seconds = rendering();
    now.stats.seconds = elapsed();
    now
}

/// Fewest and most paths that a pixel of these tiles has taken.
fn paths_range(tiles: &[Tile]) -> (u32, u32) {
    let paths = tiles.iter().map(Tile::paths);
    (paths.clone().min().unwrap_or(0), paths.max().unwrap_or(0))
}

/// The window's statistics, gathered from tiles. Where no tile is, nothing was sampled.
pub fn film_of(tiles: &[Tile], settings: &RenderSettings) -> Film {
    let window = settings.window();
    let mut film = Film::new(settings.width, settings.height, window, settings.aovs);
    for tile in tiles {
        for (x, y, i) in tile.inside(window) {
            let at = ((y - window[1]) * (window[2] - window[0]) + (x - window[0])) as usize;
            film.pixels[at] = tile.stats[i];
            if settings.aovs {
                film.aovs[at] = tile.aovs[i];
            }
        }
    }
    film
}

/// Paths a pixel below which a noise goal is not asked for. A stop rule that looks at the samples prefers pictures that
/// have missed rare bright paths so far: fewest looks at few samples hold that bias down.
pub const NOISE_PATHS: u32 = 32;

/// Root of the mean over pixels and channels of variance/(mean² + 0.01): the relative error that relMSE will find, as
/// estimated from the samples themselves. Infinite while a pixel has less than two paths.
pub fn noise(tiles: &[Tile], window: [u32; 4]) -> f64 {
    let (mut sum, mut n) = (0.0, 0u64);
    for stats in tiles.iter().flat_map(|tile| tile.inside(window).map(|(.., i)| &tile.stats[i])) {
        let (mean, variance) = (stats.mean(), stats.variance_of_mean());
        for c in 0..3 {
            sum += f64::from(variance[c]) / (f64::from(mean[c]).powi(2) + 0.01);
        }
        n += 3;
    }
    (sum / n.max(1) as f64).sqrt()
}

/// What the tiles of a pass share. Seconds count from `start`.
struct Shared<'a> {
    start: Instant,
    deadline: Option<f64>,
    /// When a checkpoint is due.
    pause: f64,
    stop: &'a AtomicBool,
    rays: AtomicU64,
    /// Tiles that had taken the pass before, and that have now.
    before: u64,
    tiles: AtomicU64,
    all_tiles: u64,
}

impl Shared<'_> {
    fn should_stop(&self) -> bool {
        let seconds = self.start.elapsed().as_secs_f64();
        // No pause before a tile is done, or nothing would ever be.
        let pause = seconds > self.pause && self.tiles.load(Ordering::Relaxed) > 0;
        pause || self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|d| seconds > d)
    }

    fn progress(
        &self,
        work: &TileWork,
        settings: &RenderSettings,
        done: u32,
        pass: u32,
        noise: f64,
        elapsed: f64,
    ) -> Progress {
        let tiles = self.before + self.tiles.fetch_add(1, Ordering::Relaxed) + 1;
        let traced = work.rays();
        let rays = self.rays.fetch_add(traced, Ordering::Relaxed) + traced;
        let paths = f64::from(done) + f64::from(pass) * tiles as f64 / self.all_tiles as f64;
        let by_samples = settings.spp.map_or(0.0, |goal| paths / f64::from(goal));
        let by_time = settings.time.map_or(0.0, |limit| elapsed / limit);
        // Error falls with the root of the samples.
        let by_noise = settings.noise.map_or(0.0, |goal| (goal / noise).powi(2));
        let fraction = by_samples.max(by_time).max(by_noise).clamp(0.0, 1.0);
        Progress { fraction, seconds: self.start.elapsed().as_secs_f64(), rays, noise, spp: done }
    }
}

impl TileWork {
    fn plus(self, other: Self) -> Self {
        Self {
            counts: self.counts.plus(&other.counts),
            seconds: self.seconds + other.seconds,
            paths: self.paths + other.paths,
        }
    }

    fn rays(&self) -> u64 {
        let c = &self.counts;
        c.camera_rays + c.first_bounce_rays + c.later_bounce_rays + c.shadow_rays
    }
}

impl RenderStats {
    /// Rays of all kinds.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// Adds another render's: of another part or seed of the same picture.
    pub fn join(&mut self, other: &Self) {
        self.paths += other.paths;
        self.camera_rays += other.camera_rays;
        self.first_bounce_rays += other.first_bounce_rays;
        self.later_bounce_rays += other.later_bounce_rays;
        self.shadow_rays += other.shadow_rays;
        self.seconds += other.seconds;
        self.render_seconds += other.render_seconds;
        self.ray_query_seconds += other.ray_query_seconds;
        self.tile_seconds += other.tile_seconds;
        self.passes = self.passes.max(other.passes);
    }

    fn add(&mut self, work: &TileWork) {
        self.paths += work.paths;
        self.camera_rays += work.counts.camera_rays;
        self.first_bounce_rays += work.counts.first_bounce_rays;
        self.later_bounce_rays += work.counts.later_bounce_rays;
        self.shadow_rays += work.counts.shadow_rays;
        self.ray_query_seconds += work.counts.query_seconds;
        self.tile_seconds += work.seconds;
    }
}
