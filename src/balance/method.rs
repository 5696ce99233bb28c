//! The methods of `--balance`: which weights, which passes, which share next.

use serde::{Deserialize, Serialize};

use super::{Heuristic, Moments};

/// How light and BSDF sampling share the work at a camera path's first surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Balance {
    /// A pilot of equal counts; each pixel's share from its neighbours' pilots, by measured variance; all samples weighed
    /// by the total counts (the default).
    Progressive,
    /// Lu, Pacanowski and Granier 2013 to the letter: a pilot (--pilot, half the samples), then one balance for each pixel.
    SecondOrder,
    /// The share whose mixture of pdfs is nearest to the light in Kullback-Leibler divergence, to first order.
    Kl,
    /// Grittmann et al. 2022: a pilot of 32 paths, then the share with the least second moment times cost.
    EfficiencyAware,
    /// Balance heuristic, one sample of each.
    Half,
    /// Power heuristic (exponent 2), one sample of each.
    Power,
    /// Maximum heuristic, one sample of each.
    Max,
}

/// `second-order`'s pilot, as a share of all paths, where nothing else is said: the paper's N_m = N/2.
pub const HALF_PILOT: f64 = 0.5;
/// `progressive`'s pilot is this part of its first pass.
const PILOT: u32 = 4;
/// Paths a pixel in the first two passes; each later pass doubles what there is.
const FIRST_PASS: u32 = 8;
/// No pass is longer: a stop or a checkpoint waits for the pass's tile at most.
const LONGEST_PASS: u32 = 128;

impl Balance {
    /// All of them, in the order of the help.
    pub fn all() -> &'static [Self] {
        clap::ValueEnum::value_variants()
    }

    /// As on the command line.
    pub fn name(self) -> String {
        clap::ValueEnum::to_possible_value(&self).map_or_else(String::new, |v| v.get_name().to_owned())
    }

    /// Weights between the techniques.
    pub fn heuristic(self) -> Heuristic {
        match self {
            Balance::Power => Heuristic::Power,
            Balance::Max => Heuristic::Max,
            _ => Heuristic::Balance,
        }
    }

    /// Does it learn from samples?
    pub fn learns(self) -> bool {
        matches!(self, Balance::Progressive | Balance::SecondOrder | Balance::Kl | Balance::EfficiencyAware)
    }

    /// Does each pass begin the low-discrepancy sequence anew, with another scramble? Points of one sequence know of each
    /// other: where they may not fall follows from where others fell. So a share that follows from a pixel's own points,
    /// and weighs the next ones, is biased, though each pass is fixed before it begins. For `kl`, whose shares move
    /// furthest, tests of 10⁴ replicas see it (a pixel 11 standard errors off); for `second-order` and `efficiency-aware`
    /// they do not, and the better points are worth more.
    pub fn scrambles_passes(self) -> bool {
        self == Balance::Kl
    }

    /// Does a pixel learn from sums over all its samples, pass by pass?
    pub fn sums_moments(self) -> bool {
        matches!(self, Balance::SecondOrder | Balance::Kl)
    }

    /// Paths a pixel of the pass that begins after `done` paths, of `goal` in all (`None`: until some other rule
    /// stops), or `None` when the goal is reached. `second-order` needs a goal: its pilot is the share `pilot` of it, in
    /// (0, 1), or [`HALF_PILOT`], rounded, and at least a path short of it; no other method asks for it. `progressive`
    /// takes passes of 128, or begins with 32 where it does not know how many there will be; `efficiency-aware` always
    /// begins with 32. The others' passes are 8, 8, 16, 32, 64, 128, 128, … whatever the goal, so that a render can go on
    /// to a higher one.
    pub fn next_pass(self, done: u32, goal: Option<u32>, pilot: Option<f64>) -> Option<u32> {
        let left = goal.map_or(u32::MAX, |g| g.saturating_sub(done));
        if left == 0 {
            return None;
        }
        let size = match (self, goal) {
            (Balance::SecondOrder, Some(goal)) if done == 0 => {
                let paths = (pilot.unwrap_or(HALF_PILOT) * f64::from(goal)).round() as u32;
                paths.clamp(1, (goal - 1).max(1))
            }
            (Balance::SecondOrder, Some(_)) => left,
            (Balance::Progressive, Some(_)) => LONGEST_PASS,
            (Balance::EfficiencyAware, _) | (Balance::Progressive, None) => {
                done.clamp(PILOT * FIRST_PASS, LONGEST_PASS)
            }
            _ => done.clamp(FIRST_PASS, LONGEST_PASS),
        };
        Some(size.min(left))
    }

    /// How many paths of the pass of `paths` that begins after `done` are a pilot of equal counts, from which the shares
    /// of the same pass follow.
    pub fn pilot(self, done: u32, paths: u32) -> Option<u32> {
        let learns = self == Balance::Progressive && done == 0 && paths >= PILOT * FIRST_PASS;
        // Whole blocks of four.
        learns.then_some(paths / PILOT / 4 * 4)
    }

    /// Are later passes' shares chosen, once, from what the pass that begins after `done` paths finds in the tile?
    pub fn learns_at_once(self, done: u32) -> bool {
        self == Balance::EfficiencyAware && done == 0
    }

    /// The share of light samples α for a pixel's next pass, in [0, 1], from what it has itself seen; `None` where that
    /// decides nothing.
    pub fn share(self, seen: &Moments) -> Option<f32> {
        match self {
            Balance::SecondOrder => Some(seen.second_order()),
            Balance::Kl => Some(seen.kl_linear()),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passes(balance: Balance, goal: u32) -> Vec<u32> {
        with_pilot(balance, goal, None)
    }

    fn with_pilot(balance: Balance, goal: u32, pilot: Option<f64>) -> Vec<u32> {
        let mut done = 0;
        std::iter::from_fn(|| {
            let n = balance.next_pass(done, Some(goal), pilot)?;
            done += n;
            Some(n)
        })
        .collect()
    }

    #[test]
    fn passes_double_and_end_at_the_goal() {
        assert_eq!(passes(Balance::Kl, 300), [8, 8, 16, 32, 64, 128, 44]);
        assert_eq!(passes(Balance::Progressive, 300), [128, 128, 44]);
        assert_eq!(passes(Balance::Half, 5), [5]);
        assert!(passes(Balance::Half, 0).is_empty());
    }

    #[test]
    fn a_higher_goal_begins_with_the_same_passes() {
        let (low, high) = (passes(Balance::Half, 128), passes(Balance::Half, 4096));
        assert_eq!(low[..], high[..low.len()]);
    }

    #[test]
    fn second_order_has_a_pilot_of_half_the_samples() {
        assert_eq!(passes(Balance::SecondOrder, 64), [32, 32]);
        assert_eq!(passes(Balance::SecondOrder, 5), [3, 2]);
        assert_eq!(passes(Balance::SecondOrder, 1), [1]);
    }

    #[test]
    fn second_orders_pilot_can_be_any_share_and_leaves_a_path() {
        assert_eq!(with_pilot(Balance::SecondOrder, 64, Some(0.25)), [16, 48]);
        assert_eq!(with_pilot(Balance::SecondOrder, 10, Some(0.75)), [8, 2]);
        assert_eq!(with_pilot(Balance::SecondOrder, 10, Some(1e-6)), [1, 9]);
        assert_eq!(with_pilot(Balance::SecondOrder, 10, Some(1.0 - 1e-6)), [9, 1]);
        assert_eq!(with_pilot(Balance::SecondOrder, 1, Some(0.25)), [1]);
        assert_eq!(with_pilot(Balance::Progressive, 300, Some(0.25)), passes(Balance::Progressive, 300));
    }
}
