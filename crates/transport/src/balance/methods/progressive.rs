//! `progressive`, the default: a pilot of equal counts; the shares of each pixel from its neighbours' pilots by measured
//! variance ([`variance`](crate::balance::variance)); all samples weighted together by the total counts.

use crate::balance::method::{EARLY_PATHS, FIRST_PASS_PATHS, MAX_PASS_PATHS, pass_within_goal, take_pass};
use crate::balance::sampler::LightInfo;
use crate::balance::variance::{BlockVariances, Candidates, Caution};
use crate::balance::{Cost, Counts, LearnedPixels, Method, Sampler, Shares};

/// The first pass is so many times as long as its pilot.
const PASS_PER_PILOT: u32 = 4;

/// The method of this file.
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

    /// Passes of 128 paths; without a goal 32 at first.
    fn next_pass(&self, done: u32, goal: Option<u32>, _pilot: Option<f64>) -> Option<u32> {
        let size = goal.map_or(done.clamp(PASS_PER_PILOT * FIRST_PASS_PATHS, MAX_PASS_PATHS), |_| MAX_PASS_PATHS);
        pass_within_goal(goal, done, size)
    }

    /// Shares are chosen once, in the first pass after the early ones, and hold for all later passes.
    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, done: u32, paths: u32) {
        let Some(lights) = sampler.lights().filter(|_| done <= EARLY_PATHS) else {
            return take_pass(learned, sampler, paths);
        };
        let candidates = candidates(lights);
        match pilot_paths(paths) {
            Some(pilot) => {
                let pilot = candidates.pilot(pilot);
                take_pass_with_pilot(learned, sampler, &candidates, (pilot, paths), lights.selection_cost);
            }
            None => {
                let environment_share = candidates.prior().environment_share;
                learned.shares.iter_mut().for_each(|shares| shares.environment_share = environment_share);
                take_pass(learned, sampler, paths);
            }
        }
    }
}

/// The paths of a first pass of `paths` paths that form its pilot, a multiple of four; `None` if the pass is too short.
fn pilot_paths(paths: u32) -> Option<u32> {
    (paths >= PASS_PER_PILOT * FIRST_PASS_PATHS).then_some(paths / PASS_PER_PILOT / 4 * 4)
}

/// The shares that a pixel may have, by the lights of the scene.
fn candidates(lights: LightInfo) -> Candidates {
    let caution = if lights.indirect { Caution::INDIRECT } else { Caution::DIRECT };
    match lights.environment_probability {
        Some(probability) => Candidates::environment_area_and_bsdf(probability, caution),
        None => Candidates::light_and_bsdf(caution),
    }
}

/// Takes a pass of `paths` paths, which begins with a pilot of equal counts. All samples are weighted by the
/// total counts. A light sample costs `selection_cost` rays more than its shadow ray.
fn take_pass_with_pilot(
    learned: &mut LearnedPixels,
    sampler: &mut dyn Sampler,
    candidates: &Candidates,
    (pilot, paths): (Counts, u32),
    selection_cost: f32,
) {
    let n = sampler.pixels();
    let variances = BlockVariances::new(candidates, sampler.pilot(pilot), n, pilot.paths);
    let (width, rays, features) = (sampler.width(), sampler.cost(), sampler.features());
    let cost = Cost { light: rays.light + selection_cost, ..rays };
    learned.shares.copy_from_slice(&variances.choose(width, &features, cost, sampler.shares_paths()));
    let total_of = |shares: &Shares| Counts::from_shares(*shares, paths).at_least(pilot);
    let total: Vec<_> = learned.shares.iter().map(total_of).collect();
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
        assert_eq!([5, 31, 32, 44, 128].map(super::pilot_paths), [None, None, Some(8), Some(8), Some(32)]);
    }
}
