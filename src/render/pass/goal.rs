//! Goals of renders.

use serde::{Deserialize, Serialize};

use crate::render::settings::RenderSettings;

/// A goal of a render, from a number of paths on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    /// Maximum paths per pixel of a tile when it became the goal.
    pub from: u32,
    /// [`RenderSettings::spp`].
    pub spp: Option<u32>,
    /// [`RenderSettings::noise`].
    pub noise: Option<f64>,
    /// [`RenderSettings::min_spp`].
    pub min_spp: Option<u32>,
    /// Was there a time limit?
    pub timed: bool,
}

impl Goal {
    /// The goal of these settings.
    pub fn of(settings: &RenderSettings, from: u32) -> Self {
        let RenderSettings { spp, noise, min_spp, time, .. } = *settings;
        Self { from, spp, noise, min_spp, timed: time.is_some() }
    }

    /// Settings with this goal instead of theirs.
    pub fn instead(&self, settings: &RenderSettings) -> RenderSettings {
        let time = self.timed.then_some(settings.time.unwrap_or(1.0));
        RenderSettings { spp: self.spp, noise: self.noise, min_spp: self.min_spp, time, ..settings.clone() }
    }
}
