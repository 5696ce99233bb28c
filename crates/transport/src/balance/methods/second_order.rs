//! `second-order`: the method of Lu, Pacanowski and Granier 2013, a pilot and then one light share for each pixel.

use crate::balance::method::{doubling_pass, pass_within_goal, take_pass_and_update};
use crate::balance::{LearnedPixels, Method, Moments, Sampler};

/// The default fraction of all paths that form the pilot: the paper's N_m = N/2.
pub const DEFAULT_PILOT_FRACTION: f64 = 0.5;

/// The method of [`Moments::second_order`].
#[derive(Debug)]
pub struct SecondOrder;

impl Method for SecondOrder {
    fn name(&self) -> &'static str {
        "second-order"
    }

    fn about(&self) -> &'static str {
        "Lu, Pacanowski and Granier 2013 to the letter: a pilot (--pilot, half the samples), then one balance for each pixel"
    }

    fn sums_moments(&self) -> bool {
        true
    }

    fn needs_goal(&self) -> bool {
        true
    }

    /// With a goal, first the fraction `pilot` of it, or [`DEFAULT_PILOT_FRACTION`], rounded, at least one path and at most all
    /// but one; then the rest.
    fn next_pass(&self, done: u32, goal: Option<u32>, pilot: Option<f64>) -> Option<u32> {
        match goal {
            Some(goal) if done == 0 => {
                let paths = (pilot.unwrap_or(DEFAULT_PILOT_FRACTION) * f64::from(goal)).round() as u32;
                pass_within_goal(Some(goal), 0, paths.clamp(1, goal.saturating_sub(1).max(1)))
            }
            Some(_) => pass_within_goal(goal, done, u32::MAX),
            None => doubling_pass(done, None),
        }
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        take_pass_and_update(learned, sampler, paths, Moments::second_order);
    }
}

#[cfg(test)]
mod tests {
    use crate::balance::Balance;
    use crate::balance::methods::passes;

    #[test]
    fn the_pilot_is_half_the_samples() {
        assert_eq!(passes(Balance::SecondOrder, 64, None), [32, 32]);
        assert_eq!(passes(Balance::SecondOrder, 5, None), [3, 2]);
        assert_eq!(passes(Balance::SecondOrder, 1, None), [1]);
    }

    #[test]
    fn the_pilot_can_be_any_share_and_leaves_a_path() {
        assert_eq!(passes(Balance::SecondOrder, 64, Some(0.25)), [16, 48]);
        assert_eq!(passes(Balance::SecondOrder, 10, Some(0.75)), [8, 2]);
        assert_eq!(passes(Balance::SecondOrder, 10, Some(1e-6)), [1, 9]);
        assert_eq!(passes(Balance::SecondOrder, 10, Some(1.0 - 1e-6)), [9, 1]);
        assert_eq!(passes(Balance::SecondOrder, 1, Some(0.25)), [1]);
    }
}
