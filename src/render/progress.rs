//! How far a render is, counted by its threads.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use serde::{Deserialize, Deserializer, Serialize};

use super::{RenderSettings, scheduler};

/// How far a render is; handed to the progress callback after every tile, from any thread.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Progress {
    /// In [0, 1], of the stop rule that is nearest.
    pub fraction: f64,
    /// Seconds since rendering began.
    pub seconds: f64,
    /// Rays of all kinds so far.
    pub rays: u64,
    /// Estimated relative error after the last finished pass; infinite before.
    #[serde(deserialize_with = "or_infinite")]
    pub noise: f64,
    /// Paths a pixel after the last finished pass.
    pub spp: u32,
    /// Mean paths a pixel, those of the pass under way included.
    pub mean_spp: f64,
}

/// JSON says null for infinity.
fn or_infinite<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// What the tiles of a pass share. Seconds count from `start`, unless it is said otherwise.
pub(super) struct Meter<'a> {
    pub settings: &'a RenderSettings,
    pub start: Instant,
    /// Seconds that the time limit counts besides those since `start`.
    pub before: f64,
    pub deadline: Option<f64>,
    /// When a pause is due.
    pub pause: f64,
    pub stop: &'a AtomicBool,
    pub rays: AtomicU64,
    /// Tiles that have taken the pass, and that had when this session came to it.
    pub tiles: AtomicU64,
    pub tiles_before: u64,
    pub all_tiles: u64,
    /// Paths before the pass, and of it.
    pub done: u32,
    pub pass: u32,
    pub noise: f64,
}

impl Meter<'_> {
    /// Is it time to end, or to pause?
    pub fn should_stop(&self) -> bool {
        let seconds = self.start.elapsed().as_secs_f64();
        // No pause before a tile is done, or nothing would ever be.
        let pause = seconds > self.pause && self.tiles.load(Ordering::Relaxed) > self.tiles_before;
        pause || self.stop.load(Ordering::Relaxed) || self.deadline.is_some_and(|d| seconds > d)
    }

    /// Counts a tile that took so many rays.
    pub fn after(&self, traced: u64) -> Progress {
        let tiles = self.tiles.fetch_add(1, Ordering::Relaxed) + 1;
        let rays = self.rays.fetch_add(traced, Ordering::Relaxed) + traced;
        let seconds = self.start.elapsed().as_secs_f64();
        let paths = f64::from(self.done) + f64::from(self.pass) * tiles as f64 / self.all_tiles as f64;
        let fraction = scheduler::fraction(self.settings, paths, self.before + seconds, self.noise);
        Progress { fraction, seconds, rays, noise: self.noise, spp: self.done, mean_spp: paths }
    }
}
