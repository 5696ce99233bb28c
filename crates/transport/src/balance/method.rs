//! The interface of a method of `--balance`: its MIS weights, its passes, and the light shares of the next pass. Each method
//! is a file in [`methods`](super::methods).

use super::{Contribution, Counts, Heuristic, LearnedPixels, Moments, Observer, Sampler, Shares};

/// Paths per pixel of the first pass and of the second; each later pass doubles the total.
pub const FIRST_PASS_PATHS: u32 = 8;
/// With a time limit, each pixel first takes so many paths, in passes of 1, 1 and 2, so that a whole picture exists early
/// however slow the scene is. Methods learn nothing from them.
pub const EARLY_PATHS: u32 = 4;
/// Largest number of paths per pixel of a pass. A stop or a checkpoint waits for a tile's pass at most.
pub const MAX_PASS_PATHS: u32 = 128;

/// A method that divides the samples at a camera path's first surface between light and BSDF sampling.
pub trait Method: Sync {
    /// The name on the command line.
    fn name(&self) -> &'static str;

    /// A sentence for the help.
    fn about(&self) -> &'static str;

    /// The MIS heuristic.
    fn heuristic(&self) -> Heuristic {
        Heuristic::Balance
    }

    /// Whether it learns from samples.
    fn learns(&self) -> bool {
        true
    }

    /// Whether it keeps [`Moments`] of all samples of a pixel.
    fn sums_moments(&self) -> bool {
        false
    }

    /// Whether each pass begins the low-discrepancy sequence anew with another scramble. The points of one sequence depend
    /// on each other, so a light share that follows from a pixel's own points and weights the next ones of the same sequence
    /// is biased, although it is fixed before each pass begins.
    fn scrambles_passes(&self) -> bool {
        false
    }

    /// Whether pre-passes may decide the density of light samples at all surfaces: compensated or not toward the
    /// environment, learned or not toward area lights.
    fn uses_prepasses(&self) -> bool {
        false
    }

    /// Whether the passes depend on the number of paths, which must then be known at the start.
    fn needs_goal(&self) -> bool {
        false
    }

    /// Paths per pixel of the pass that begins after `done` paths, of `goal` in total (`None`: until another criterion
    /// stops the render), or `None` when the goal is reached. `pilot` is the fraction of all paths that form a pilot, in
    /// (0, 1), for methods that need a goal. By default the passes are 8, 8, 16, 32, 64, 128, 128, … whatever the goal, so
    /// that a render can be resumed with a higher goal.
    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        doubling_pass(done, goal)
    }

    /// Takes a pass of `paths` paths per pixel after `done` paths. The light share of each pixel follows from the earlier
    /// passes of its tile, or from its neighbours' parts of this pass's pilot.
    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        take_pass(learned, sampler, paths);
    }
}

/// The default of [`Method::next_pass`].
pub fn doubling_pass(done: u32, goal: Option<u32>) -> Option<u32> {
    pass_within_goal(goal, done, done.clamp(FIRST_PASS_PATHS, MAX_PASS_PATHS))
}

/// A pass of `size` paths after `done`, at most up to the goal; `None` when the goal is reached.
pub fn pass_within_goal(goal: Option<u32>, done: u32, size: u32) -> Option<u32> {
    let left = goal.map_or(u32::MAX, |goal| goal.saturating_sub(done));
    (left > 0).then(|| size.min(left))
}

/// Takes a pass with the shares that the pixels have. A long pass is taken in parts with the same shares.
pub fn take_pass(learned: &mut LearnedPixels, sampler: &mut dyn Sampler, paths: u32) {
    let lights = sampler.lights().is_some();
    let mut sums = MomentSums(learned.moments);
    let mut left = paths;
    while left > 0 {
        let part = left.min(sampler.max_paths());
        let pixel_counts = |(paths, shares): (u32, &Shares)| match lights && paths > 0 {
            true => Counts::from_shares(*shares, paths),
            false => Counts::bsdf_only(paths),
        };
        let counts: Vec<_> = sampler.paths(part).into_iter().zip(&*learned.shares).map(pixel_counts).collect();
        let observer = if lights && !sums.0.is_empty() { Some(&mut sums as &mut dyn Observer) } else { None };
        sampler.take(&counts, &counts, observer);
        left -= part;
    }
}

/// Takes a pass with the shares that the pixels have, then sets the light shares of the next pass to `light_share` of the
/// moments of all samples so far.
pub fn take_pass_and_update(
    learned: &mut LearnedPixels,
    sampler: &mut dyn Sampler,
    paths: u32,
    light_share: impl Fn(&Moments) -> f32,
) {
    take_pass(learned, sampler, paths);
    if sampler.lights().is_some() {
        let pixels = learned.shares.iter_mut().zip(learned.moments.iter());
        pixels.for_each(|(shares, moments)| shares.light_share = light_share(moments));
    }
}

/// Adds contributions to the moments of their pixels.
struct MomentSums<'a>(&'a mut [Moments]);

impl Observer for MomentSums<'_> {
    fn contribution(&mut self, contribution: &Contribution) {
        self.0[contribution.pixel as usize].add(contribution.w, contribution.r, contribution.z());
    }
}
