//! What waves count: rays, the time of ray queries, samples that are not finite.

use std::time::Instant;

use super::context::WaveContext;

/// Ray counts and query time of waves.
#[derive(Debug, Clone, Copy, Default)]
pub struct WaveCounts {
    pub camera_rays: u64,
    /// Camera rays for directly visible emission alone ([`emission_rays`](crate::integrator::through::emission_rays)).
    pub emission_rays: u64,
    pub first_bounce_rays: u64,
    pub later_bounce_rays: u64,
    pub shadow_rays: u64,
    /// Those of them between first and second surfaces of path re-use.
    pub shared_rays: u64,
    /// Time in ray queries, in seconds.
    pub query_seconds: f64,
    /// Samples discarded because their radiance was not finite.
    pub not_finite: u64,
    /// The first of them: column, row, number of the path in its pixel.
    pub first_not_finite: Option<[u32; 3]>,
}

impl WaveCounts {
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.emission_rays + self.first_bounce_rays + self.later_bounce_rays + self.shadow_rays
    }

    /// The sum of two counts.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            camera_rays: self.camera_rays + other.camera_rays,
            emission_rays: self.emission_rays + other.emission_rays,
            first_bounce_rays: self.first_bounce_rays + other.first_bounce_rays,
            later_bounce_rays: self.later_bounce_rays + other.later_bounce_rays,
            shadow_rays: self.shadow_rays + other.shadow_rays,
            shared_rays: self.shared_rays + other.shared_rays,
            query_seconds: self.query_seconds + other.query_seconds,
            not_finite: self.not_finite + other.not_finite,
            first_not_finite: self.first_not_finite.or(other.first_not_finite),
        }
    }

    pub(in crate::integrator) fn add_not_finite(&mut self, at: &WaveContext, path: u32) {
        self.not_finite += 1;
        self.first_not_finite.get_or_insert_with(|| at.place(path));
    }

    pub(in crate::integrator) fn add_rays(&mut self, depth: u32, n: usize) {
        match depth {
            0 => self.camera_rays += n as u64,
            1 => self.first_bounce_rays += n as u64,
            _ => self.later_bounce_rays += n as u64,
        }
    }
}

/// Runs a ray query and adds its time.
pub(in crate::integrator) fn timed(counts: &mut WaveCounts, query: impl FnOnce()) {
    let start = Instant::now();
    query();
    counts.query_seconds += start.elapsed().as_secs_f64();
}
