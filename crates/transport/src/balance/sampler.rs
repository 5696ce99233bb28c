//! The interface between a method of the balance and the code that takes its samples.

use super::{Contribution, Cost, Counts, Moments, Observer, PixelFeatures, Shares};

/// Takes samples for the pixels of a tile: paths of a scene, or points of an integrand that is known exactly. It adds their
/// contributions to the picture.
pub trait Sampler {
    /// Number of pixels, which are in row-major order.
    fn pixels(&self) -> usize;

    /// Pixels per row.
    fn width(&self) -> usize;

    /// The lights that light samples can reach; `None` if no light has an extent.
    fn lights(&self) -> Option<LightInfo>;

    /// Do pixels share paths? In a pilot then only those whose columns have the same parity, so that the others' samples, which
    /// share none with theirs, may decide how theirs are weighted.
    fn shares_paths(&self) -> bool {
        false
    }

    /// Largest number of paths per pixel of one call of [`take`](Self::take).
    fn max_paths(&self) -> u32;

    /// The number of paths that each pixel takes in a pass of `paths` paths: pixels that have reached a noise goal take fewer.
    fn paths(&mut self, paths: u32) -> Vec<u32> {
        vec![paths; self.pixels()]
    }

    /// Takes `counts[i]` samples in pixel i and weights them by `weighed[i]`. `observer` receives their contributions.
    fn take(&mut self, counts: &[Counts], weighed: &[Counts], observer: Option<&mut dyn Observer>);

    /// Takes the same `counts`, one light and one BSDF sample per path, in each pixel, and keeps the contributions until
    /// [`reweight`](Self::reweight).
    fn pilot(&mut self, counts: Counts) -> &[Contribution];

    /// Weights the samples of the pilot by the `total` counts of each pixel and adds them to the picture.
    fn reweight(&mut self, total: &[Counts]);

    /// The features of each pixel.
    fn features(&mut self) -> Vec<PixelFeatures>;

    /// The cost of paths that took one sample of each technique in this pass so far.
    fn cost(&self) -> Cost;
}

/// Properties of the lights that have an extent.
#[derive(Debug, Clone, Copy)]
pub struct LightInfo {
    /// The probability that a light sample that chooses its kind at random goes to the environment, where there are both an
    /// environment and area lights. They are then techniques of their own for methods that divide light samples too.
    pub environment_probability: Option<f32>,
    /// Whether light can arrive by other surfaces.
    pub indirect: bool,
    /// Cost of the choice of an area light for a light sample, in rays.
    pub selection_cost: f32,
}

/// What the pixels of a tile have learned, one entry per pixel.
#[derive(Debug)]
pub struct LearnedPixels<'a> {
    /// The shares of the next samples.
    pub shares: &'a mut [Shares],
    /// Moments of the samples so far; empty for methods that keep none.
    pub moments: &'a mut [Moments],
}
