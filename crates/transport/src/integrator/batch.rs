//! What a wave is asked for, and where what it finds goes.

use crate::balance::{Contribution, Counts, Observer};
use crate::film::{AovSums, ExtraSums, Peak, PixelStats};

/// One pixel's part in a wave.
#[derive(Debug, Clone, Copy)]
pub struct PixelTask {
    /// Position in the whole picture.
    pub x: u32,
    /// Position in the whole picture.
    pub y: u32,
    /// Paths that the pixel has taken before.
    pub first_path: u32,
    /// Light samples at first surfaces that it has taken before.
    pub first_light: u32,
    /// How many of these light samples were toward the environment by count, not by drawing.
    pub first_environment: u32,
    /// BSDF samples at first surfaces that it has taken before.
    pub first_bsdf: u32,
    /// Light and BSDF samples at first surfaces for the paths of this wave.
    pub counts: Counts,
    /// The counts of all the paths that are weighed together with this wave's: contributions are weighed by these.
    pub weighed: Counts,
    /// Number of the pixel in its tile, for observers.
    pub number: u32,
}

impl PixelTask {
    /// The first paths of a pixel, weighed by themselves.
    pub fn first([x, y]: [u32; 2], counts: Counts, number: u32) -> Self {
        Self {
            x,
            y,
            first_path: 0,
            first_light: 0,
            first_environment: 0,
            first_bsdf: 0,
            counts,
            weighed: counts,
            number,
        }
    }
}

/// What a wave works on and adds to, an entry a pixel, and who is told what first surfaces' samples find.
pub struct PixelBatch<'a> {
    /// What each pixel is to take.
    pub tasks: &'a [PixelTask],
    /// Radiance statistics.
    pub stats: &'a mut [PixelStats],
    /// Brightest paths; empty if nobody asks.
    pub peaks: &'a mut [Peak],
    /// AOV sums; empty if none are asked for.
    pub aovs: &'a mut [AovSums],
    /// More sums for AOVs; empty if none are asked for.
    pub extras: &'a mut [ExtraSums],
    /// Hears of contributions, if anybody does.
    pub observer: Option<&'a mut dyn Observer>,
}

impl<'a> PixelBatch<'a> {
    /// Of radiance alone, that nobody listens to.
    pub fn plain(tasks: &'a [PixelTask], stats: &'a mut [PixelStats]) -> Self {
        Self { tasks, stats, peaks: &mut [], aovs: &mut [], extras: &mut [], observer: None }
    }

    /// Tells the observer of a contribution in pixel `pixel` of the batch.
    pub(super) fn tell(&mut self, pixel: usize, found: Contribution) {
        if let Some(observer) = &mut self.observer {
            observer.contribution(&Contribution { pixel: self.tasks[pixel].number, ..found });
        }
    }
}
