//! `second-order`: Lu, Pacanowski and Granier 2013 to the letter, a pilot and then one share for each pixel.

use crate::balance::method::{by_moments, doubling, up_to};
use crate::balance::{Learned, Method, Moments, Sampler};

/// The pilot, as a share of all paths, where nothing else is said: the paper's N_m = N/2.
pub const HALF_PILOT: f64 = 0.5;

/// See [`Moments::second_order`].
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

    /// With a goal: the share `pilot` of it, or [`HALF_PILOT`], rounded, at least a path and at least a path short of
    /// it; then the rest.
    fn next_pass(&self, done: u32, goal: Option<u32>, pilot: Option<f64>) -> Option<u32> {
        match goal {
            Some(goal) if done == 0 => {
                let paths = (pilot.unwrap_or(HALF_PILOT) * f64::from(goal)).round() as u32;
                up_to(Some(goal), 0, paths.clamp(1, goal.saturating_sub(1).max(1)))
            }
            Some(_) => up_to(goal, done, u32::MAX),
            None => doubling(done, None),
        }
    }

    fn pass(&self, learned: &mut Learned, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        by_moments(learned, sampler, paths, Moments::second_order);
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
