//! Counts and times of a render, and why it ended.

use serde::{Deserialize, Serialize};

use super::decisions::Found;
use super::tile::TileWork;
use crate::render::settings::techniques::Technique;

/// Why a render ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
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
    /// Samples left out because their radiance was not finite.
    pub not_finite: u64,
    /// Column, row and path number of the first of them.
    pub first_not_finite: Option<[u32; 3]>,
    /// What the pre-passes of the last session found.
    #[serde(flatten)]
    pub techniques: Found,
    /// Estimated relative error of the picture after its last complete pass. Not read from files: it is computed again.
    #[serde(skip_deserializing)]
    pub noise: f64,
}

impl RenderStats {
    /// Rays of all kinds.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// Have its tiles their own numbers of paths, by a pre-pass?
    pub fn is_allocated(&self) -> bool {
        self.techniques[Technique::Adaptive].and_then(|stats| stats.range).is_some_and(|range| range != [1.0; 2])
    }

    /// Adds those of another part or seed of the same picture.
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
        self.not_finite += other.not_finite;
        self.first_not_finite = self.first_not_finite.or(other.first_not_finite);
        self.techniques = self.techniques.or(&other.techniques);
    }

    pub(in crate::render) fn add(&mut self, work: &TileWork) {
        self.paths += work.paths;
        self.camera_rays += work.counts.camera_rays + work.counts.emission_rays;
        self.first_bounce_rays += work.counts.first_bounce_rays;
        self.later_bounce_rays += work.counts.later_bounce_rays;
        self.shadow_rays += work.counts.shadow_rays;
        self.ray_query_seconds += work.counts.query_seconds;
        self.tile_seconds += work.seconds;
        self.not_finite += work.counts.not_finite;
        self.first_not_finite = self.first_not_finite.or(work.counts.first_not_finite);
    }
}

impl TileWork {
    pub(in crate::render) fn plus(self, other: Self) -> Self {
        Self {
            counts: self.counts.plus(&other.counts),
            seconds: self.seconds + other.seconds,
            paths: self.paths + other.paths,
        }
    }

    /// Rays of all kinds.
    pub(in crate::render) fn rays(&self) -> u64 {
        self.counts.rays()
    }
}
