//! Tiles, passes, stopping: from a scene and settings to a film.

pub mod settings;

pub use settings::{Balance, Integrator, PixelFilter, RenderSettings};

use std::sync::atomic::AtomicBool;

use crate::film::Film;
use crate::rays::RayQueries;
use crate::scene::Scene;

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
/// time). The film's bits depend on the scene, the backend's hits and `settings` alone, not on threads.
pub fn render(
    scene: &Scene,
    rays: &dyn RayQueries,
    settings: &RenderSettings,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Rendered {
    let _ = (scene, rays, settings, stop, progress);
    todo!("render")
}
