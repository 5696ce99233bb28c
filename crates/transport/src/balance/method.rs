//! What a method of `--balance` is: which weights, which passes, which share next. One file a method in `methods`.

use super::{Counts, Heuristic, Learned, Moments, Observer, Sampler, Share};

/// Paths a pixel in the first two passes; each later pass doubles what there is.
pub const FIRST_PASS: u32 = 8;
/// Against the clock, this many paths of each pixel come first, in passes of 1, 1 and 2: all of the picture is there
/// early, however slow it is. Nothing is learnt from them.
pub const EARLY: u32 = 4;
/// No pass is longer: a stop or a checkpoint waits for the pass's tile at most.
pub const LONGEST_PASS: u32 = 128;

/// A way to share the work at a camera path's first surface between light and BSDF sampling.
pub trait Method: Sync {
    /// As on the command line.
    fn name(&self) -> &'static str;

    /// For people, a sentence.
    fn about(&self) -> &'static str;

    /// Weights between the techniques.
    fn heuristic(&self) -> Heuristic {
        Heuristic::Balance
    }

    /// Does it learn from samples?
    fn learns(&self) -> bool {
        true
    }

    /// Does a pixel learn from sums over all its samples, pass by pass?
    fn sums_moments(&self) -> bool {
        false
    }

    /// Does each pass begin the low-discrepancy sequence anew, with another scramble? Points of one sequence know of each
    /// other: where they may not fall follows from where others fell. So a share that follows from a pixel's own points,
    /// and weighs the next ones, is biased, though each pass is fixed before it begins.
    fn scrambles_passes(&self) -> bool {
        false
    }

    /// May pilots decide what light samples are drawn by, at all surfaces: toward the environment what of it is above its mean, and
    /// the rest be left to BSDF samples; toward lamps what they are found to bring?
    fn uses_prepasses(&self) -> bool {
        false
    }

    /// Must the number of paths be known beforehand, as the passes depend on it?
    fn needs_goal(&self) -> bool {
        false
    }

    /// Paths a pixel of the pass that begins after `done` paths, of `goal` in all (`None`: until some other rule
    /// stops), or `None` when the goal is reached. `pilot` is the share of all paths that is a pilot, in (0, 1), for
    /// methods that need a goal. The passes are 8, 8, 16, 32, 64, 128, 128, … whatever the goal, so that a render can
    /// go on to a higher one.
    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        doubling(done, goal)
    }

    /// Takes a pass of `paths` paths a pixel after `done` paths. The share of each pixel follows from its own tile's
    /// earlier passes, or from its neighbours' parts of this pass's pilot.
    fn pass(&self, learned: &mut Learned, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        at_once(learned, sampler, paths);
    }
}

/// The passes of [`Method::next_pass`] where a method says nothing else.
pub fn doubling(done: u32, goal: Option<u32>) -> Option<u32> {
    up_to(goal, done, done.clamp(FIRST_PASS, LONGEST_PASS))
}

/// A pass of `size` paths after `done`, or what is left to the goal; `None` when nothing is.
pub fn up_to(goal: Option<u32>, done: u32, size: u32) -> Option<u32> {
    let left = goal.map_or(u32::MAX, |goal| goal.saturating_sub(done));
    (left > 0).then(|| size.min(left))
}

/// A pass at the shares that the pixels have. A long one goes in parts with the same shares.
pub fn at_once(learned: &mut Learned, sampler: &mut dyn Sampler, paths: u32) {
    let lights = sampler.lights().is_some();
    let mut sums = Sums(learned.moments);
    let mut left = paths;
    while left > 0 {
        let part = left.min(sampler.longest());
        let of = |(paths, share): (u32, &Share)| match lights && paths > 0 {
            true => Counts::of(*share, paths),
            false => Counts::bsdf_only(paths),
        };
        let counts: Vec<_> = sampler.paths(part).into_iter().zip(&*learned.shares).map(of).collect();
        let observer = if lights && !sums.0.is_empty() { Some(&mut sums as &mut dyn Observer) } else { None };
        sampler.take(&counts, &counts, observer);
        left -= part;
    }
}

/// A pass at the shares that the pixels have, from which, and from all before, their next ones follow by `share`.
pub fn by_moments(learned: &mut Learned, sampler: &mut dyn Sampler, paths: u32, share: impl Fn(&Moments) -> f32) {
    at_once(learned, sampler, paths);
    if sampler.lights().is_some() {
        learned.shares.iter_mut().zip(learned.moments.iter()).for_each(|(own, seen)| own.light = share(seen));
    }
}

/// Adds contributions to their pixels' sums.
struct Sums<'a>(&'a mut [Moments]);

impl Observer for Sums<'_> {
    fn contribution(&mut self, found: &super::Contribution) {
        self.0[found.pixel as usize].add(found.w, found.r, found.z());
    }
}
