//! What a method of the balance asks of whoever takes its samples.

use super::spread::Guide;
use super::{Contribution, Cost, Counts, Moments, Observer, Share};

/// Takes samples for the pixels of a tile: paths of a scene, or places of an exactly known integrand. What it finds goes
/// into the picture by itself.
pub trait Sampler {
    /// How many pixels, row by row.
    fn pixels(&self) -> usize;

    /// Pixels a row.
    fn width(&self) -> usize;

    /// What can be sampled besides BSDFs; `None` if there is no light with extent.
    fn lights(&self) -> Option<Lights>;

    /// Most paths a pixel that it takes at once.
    fn longest(&self) -> u32;

    /// How many paths each pixel takes of a pass of `paths`: some may need fewer.
    fn paths(&mut self, paths: u32) -> Vec<u32> {
        vec![paths; self.pixels()]
    }

    /// Takes `counts[i]` samples in pixel i and weighs them by `weighed[i]`; tells `observer` what they find.
    fn take(&mut self, counts: &[Counts], weighed: &[Counts], observer: Option<&mut dyn Observer>);

    /// Takes the same `counts`, one light and one BSDF sample a path, in each pixel, and keeps what they find until
    /// [`reweight`](Self::reweight).
    fn pilot(&mut self, counts: Counts) -> &[Contribution];

    /// Weighs the pilot's samples by each pixel's `total` counts.
    fn reweight(&mut self, total: &[Counts]);

    /// What the pixels' centres show, one a pixel.
    fn guides(&mut self) -> Vec<Guide>;

    /// What paths cost that were taken with one sample of each technique, so far in this pass.
    fn cost(&self) -> Cost;
}

/// The lights with extent.
#[derive(Debug, Clone, Copy)]
pub struct Lights {
    /// The chance that a light sample which draws goes to the environment, where there are both an environment and area
    /// lights: techniques of their own then, for methods that divide light samples too.
    pub environment: Option<f32>,
    /// May light come by other surfaces?
    pub indirect: bool,
    /// What it costs to choose a lamp for a light sample, in rays.
    pub choice: f32,
}

/// What a tile's pixels have learned, one entry a pixel.
#[derive(Debug)]
pub struct Learned<'a> {
    /// The shares that their next samples are taken by.
    pub shares: &'a mut [Share],
    /// Sums over their samples; empty for methods that keep none.
    pub moments: &'a mut [Moments],
}
