//! `progressive`, the default: a pilot of equal counts, each pixel's share from its neighbours' pilots by measured
//! variance ([`spread`](crate::balance::spread)), all samples weighed together by the total counts.

use crate::balance::method::{EARLY, FIRST_PASS, LONGEST_PASS, at_once, up_to};
use crate::balance::sampler::Lights;
use crate::balance::spread::{Candidates, Caution, Spreads};
use crate::balance::{Cost, Counts, Learned, Method, Sampler};

/// The pilot is this part of the first pass.
const PILOT: u32 = 4;

/// See the file's head.
#[derive(Debug)]
pub struct Progressive;

impl Method for Progressive {
    fn name(&self) -> &'static str {
        "progressive"
    }

    fn about(&self) -> &'static str {
        "A pilot of equal counts; each pixel's share from its neighbours' pilots, by measured variance; all samples weighed \
         by the total counts (the default)"
    }

    fn uses_prepasses(&self) -> bool {
        true
    }

    /// Passes of 128, or 32 at first where it is not known how many there will be.
    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        let size = goal.map_or(done.clamp(PILOT * FIRST_PASS, LONGEST_PASS), |_| LONGEST_PASS);
        up_to(goal, done, size)
    }

    /// Shares are chosen once, in the first pass that is not an early one, and hold for all passes.
    fn pass(&self, learned: &mut Learned, sampler: &mut dyn Sampler, done: u32, paths: u32) {
        let Some(lights) = sampler.lights().filter(|_| done <= EARLY) else {
            return at_once(learned, sampler, paths);
        };
        let candidates = candidates(lights);
        match pilot(paths) {
            Some(pilot) => with_pilot(learned, sampler, &candidates, (candidates.pilot(pilot), paths), lights.choice),
            None => {
                learned.shares.iter_mut().for_each(|share| share.environment = candidates.prior().environment);
                at_once(learned, sampler, paths);
            }
        }
    }
}

/// How many paths of a first pass of `paths` are a pilot: whole blocks of four.
fn pilot(paths: u32) -> Option<u32> {
    (paths >= PILOT * FIRST_PASS).then_some(paths / PILOT / 4 * 4)
}

/// The shares that a pixel may have by what shines and how far light may go.
fn candidates(lights: Lights) -> Candidates {
    let caution = if lights.indirect { Caution::INDIRECT } else { Caution::DIRECT };
    match lights.environment {
        Some(probability) => Candidates::three(probability, caution),
        None => Candidates::two(caution),
    }
}

/// A pass of `paths` paths that begins with a pilot of equal counts; all are then weighed by the total counts.
/// Light samples cost `choice` more than their rays.
fn with_pilot(
    learned: &mut Learned,
    sampler: &mut dyn Sampler,
    candidates: &Candidates,
    (pilot, paths): (Counts, u32),
    choice: f32,
) {
    let n = sampler.pixels();
    let spreads = Spreads::new(candidates, sampler.pilot(pilot), n, pilot.paths);
    let (width, rays, guides) = (sampler.width(), sampler.cost(), sampler.guides());
    let cost = Cost { light: rays.light + choice, ..rays };
    for (i, share) in learned.shares.iter_mut().enumerate() {
        *share = spreads.choose(i, width, &guides, cost);
    }
    let total: Vec<_> = learned.shares.iter().map(|share| Counts::of(*share, paths)).collect();
    sampler.reweight(&total);
    let rest: Vec<_> = total.iter().map(|total| total.after(pilot)).collect();
    sampler.take(&rest, &total, None);
}

#[cfg(test)]
mod tests {
    use crate::balance::Balance;
    use crate::balance::methods::passes;

    #[test]
    fn passes_are_long_where_the_goal_is_known() {
        assert_eq!(passes(Balance::Progressive, 300, None), [128, 128, 44]);
        assert_eq!(passes(Balance::Progressive, 300, Some(0.25)), [128, 128, 44]);
        assert_eq!([5, 31, 32, 44, 128].map(super::pilot), [None, None, Some(8), Some(8), Some(32)]);
    }
}
