//! Tiles, passes, stopping: from a scene and settings to a film.

pub mod settings;
pub mod tile;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use crate::film::Film;
use crate::integrator::{CameraRays, Geometry, Materials, Transport};
use crate::light::Lights;
use crate::rays::RayQueries;
use crate::sampling::FilterSampler;
use crate::scene::Scene;
pub use settings::{Balance, Integrator, PixelFilter, RenderSettings};
use tile::{Tile, TileWork};

/// Why a render ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
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

/// Counts and times of a render.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
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
    /// Wall seconds of the passes.
    pub render_seconds: f64,
    /// Thread seconds inside ray queries, over all threads.
    pub ray_query_seconds: f64,
    /// Thread seconds inside tiles, over all threads.
    pub tile_seconds: f64,
    /// Passes completed.
    pub passes: u32,
    /// Estimated relative error of the picture: see `docs/noise.md`.
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
    /// What it took.
    pub stats: RenderStats,
    /// Why it ended.
    pub stop: StopReason,
}

/// Renders on the current rayon pool until a stop rule of `settings` holds or `stop` is raised (then within a tile's
/// time). Without a time limit the film's bits depend on the scene, the backend's hits and `settings` alone, not on
/// threads.
pub fn render(
    scene: &Scene,
    rays: &dyn RayQueries,
    settings: &RenderSettings,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Rendered {
    let start = Instant::now();
    let transport = Transport {
        scene,
        rays,
        geometry: Geometry::new(scene),
        materials: Materials::new(scene),
        lights: Lights::new(scene, scene.radius()),
        camera: CameraRays::new(&scene.cameras[settings.camera], settings.width, settings.height),
        filter: FilterSampler::new(settings.filter),
        heuristic: settings.balance.heuristic(),
        max_depth: match settings.integrator {
            Integrator::Path => settings.max_depth,
            Integrator::Direct => settings.max_depth.min(2),
        },
        seed: settings.seed,
        learns: settings.balance.learns(),
        aovs: settings.aovs,
    };
    let window = settings.crop.unwrap_or([0, 0, settings.width, settings.height]);
    let mut film = Film::new(settings.width, settings.height, window, settings.aovs);
    let mut tiles = Tile::cover(settings.width, settings.height, window);
    if let Some(shares) = &settings.shares {
        tiles.iter_mut().for_each(|tile| tile.begin_with(shares, settings.width));
    }
    let pixels: usize = tiles.iter().map(Tile::pixels).sum();
    let mut stats = RenderStats { noise: f64::INFINITY, ..Default::default() };
    let mut done = 0;
    let reason = loop {
        if stop.load(Ordering::Relaxed) {
            break StopReason::Interrupted;
        }
        if settings.passes.is_some_and(|most| stats.passes >= most) {
            break StopReason::Samples;
        }
        let elapsed = start.elapsed().as_secs_f64();
        let Some(mut pass) = settings.balance.next_pass(done, settings.spp) else { break StopReason::Samples };
        if let Some(limit) = settings.time {
            // What fits into the time that is left, by what a path has cost so far.
            let fits = if done == 0 { pass } else { ((limit - elapsed) / (elapsed / f64::from(done))) as u32 };
            if elapsed >= limit || fits == 0 {
                break StopReason::Time;
            }
            pass = pass.min(fits);
        }
        let shared = Shared {
            start,
            deadline: settings.time,
            stop,
            rays: AtomicU64::new(stats.rays()),
            tiles: AtomicU64::new(0),
            all_tiles: tiles.len() as u64,
        };
        let work = tiles
            .par_iter_mut()
            .with_max_len(1)
            .map(|tile| {
                if shared.should_stop() {
                    return TileWork::default();
                }
                let work = tile.pass(&transport, settings.balance, pass);
                progress(shared.progress(&work, settings, done, pass, stats.noise));
                work
            })
            .reduce(TileWork::default, TileWork::plus);
        stats.add(&work);
        if work.paths < u64::from(pass) * pixels as u64 {
            break if stop.load(Ordering::Relaxed) { StopReason::Interrupted } else { StopReason::Time };
        }
        done += pass;
        stats.passes += 1;
        stats.noise = noise(&tiles, window);
        if settings.noise.is_some_and(|goal| stats.noise <= goal) {
            break StopReason::Noise;
        }
    };
    for tile in &tiles {
        for (x, y, sum) in tile.inside(window) {
            let at = ((y - window[1]) * (window[2] - window[0]) + (x - window[0])) as usize;
            film.pixels[at] = sum.stats;
            if settings.aovs {
                film.aovs[at] = sum.aovs;
            }
        }
    }
    stats.render_seconds = start.elapsed().as_secs_f64();
    Rendered { film, stats, stop: reason }
}

/// Root of the mean over pixels and channels of variance/(mean² + 0.01): the relative error that relMSE will find, as
/// estimated from the samples themselves.
fn noise(tiles: &[Tile], window: [u32; 4]) -> f64 {
    let (mut sum, mut n) = (0.0, 0u64);
    for (.., pixel) in tiles.iter().flat_map(|t| t.inside(window)) {
        let (mean, variance) = (pixel.stats.mean(), pixel.stats.variance_of_mean());
        for c in 0..3 {
            sum += f64::from(variance[c]) / (f64::from(mean[c]).powi(2) + 0.01);
        }
        n += 3;
    }
    (sum / n as f64).sqrt()
}

/// What the tiles of a pass share.
struct Shared<'a> {
    start: Instant,
    deadline: Option<f64>,
    stop: &'a AtomicBool,
    rays: AtomicU64,
    tiles: AtomicU64,
    all_tiles: u64,
}

impl Shared<'_> {
    fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|d| self.start.elapsed().as_secs_f64() > d)
    }

    fn progress(&self, work: &TileWork, settings: &RenderSettings, done: u32, pass: u32, noise: f64) -> Progress {
        let tiles = self.tiles.fetch_add(1, Ordering::Relaxed) + 1;
        let traced = work.rays();
        let rays = self.rays.fetch_add(traced, Ordering::Relaxed) + traced;
        let seconds = self.start.elapsed().as_secs_f64();
        let paths = f64::from(done) + f64::from(pass) * tiles as f64 / self.all_tiles as f64;
        let by_samples = settings.spp.map_or(0.0, |goal| paths / f64::from(goal));
        let by_time = settings.time.map_or(0.0, |limit| seconds / limit);
        // Error falls with the root of the samples.
        let by_noise = settings.noise.map_or(0.0, |goal| (goal / noise).powi(2));
        let fraction = by_samples.max(by_time).max(by_noise).clamp(0.0, 1.0);
        Progress { fraction, seconds, rays, noise, spp: done }
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
