//! Progress of a render, counted by its threads.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use serde::{Deserialize, Deserializer, Serialize};

use super::scheduler;
use super::tile::TileWork;
use crate::render::settings::RenderSettings;

/// Progress of a render; passed to the progress callback after every tile, from any thread.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Progress {
    /// Finished fraction in [0, 1], by the stop rule that is nearest.
    pub fraction: f64,
    /// Seconds since rendering began.
    pub seconds: f64,
    /// Rays of all kinds so far.
    pub rays: u64,
    /// Estimated relative error after the last finished pass; infinite before.
    #[serde(deserialize_with = "or_infinite")]
    pub noise: f64,
    /// Paths per pixel after the last finished pass.
    pub spp: u32,
    /// Mean paths per pixel, including the current pass.
    pub mean_spp: f64,
}

/// JSON has null for infinity.
fn or_infinite<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// What the tiles of a pass share. Seconds count from `start`.
pub(in crate::render) struct PassProgress<'a> {
    pub settings: &'a RenderSettings,
    pub start: Instant,
    /// Seconds that the time limit counts in addition to those since `start`.
    pub before: f64,
    /// When a pause is due.
    pub pause: f64,
    pub stop: &'a AtomicBool,
    pub rays: AtomicU64,
    /// Tiles that have taken the pass in this session.
    pub tiles: AtomicU64,
    /// The share of all tiles that are finished.
    pub finished: f64,
    /// Paths per pixel before the pass.
    pub done: u32,
    /// Paths so far, of all pixels.
    pub paths: AtomicU64,
    /// Pixels of all tiles.
    pub pixels: f64,
    pub noise: f64,
}

impl PassProgress<'_> {
    /// Is it time to end or to pause?
    pub fn should_stop(&self) -> bool {
        let seconds = self.start.elapsed().as_secs_f64();
        // At least one tile between pauses, so that the render advances.
        let pause = seconds > self.pause && self.tiles.load(Ordering::Relaxed) > 0;
        let is_over = self.settings.time.is_some_and(|limit| self.before + seconds > limit);
        pause || self.stop.load(Ordering::Relaxed) || is_over
    }

    /// Adds a tile's work.
    pub fn add(&self, work: &TileWork) -> Progress {
        self.tiles.fetch_add(1, Ordering::Relaxed);
        let add = |to: &AtomicU64, n: u64| to.fetch_add(n, Ordering::Relaxed) + n;
        let (rays, paths) = (add(&self.rays, work.rays()), add(&self.paths, work.paths));
        let seconds = self.start.elapsed().as_secs_f64();
        let mean_spp = paths as f64 / self.pixels;
        let fraction = scheduler::fraction(self.settings, mean_spp, self.before + seconds, self.finished);
        Progress { fraction, seconds, rays, noise: self.noise, spp: self.done, mean_spp }
    }
}
