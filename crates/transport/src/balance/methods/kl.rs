//! `kl`: the light share whose mixture of pdfs has the least Kullback-Leibler divergence from the integrand, to first order.

use crate::balance::method::take_pass_and_update;
use crate::balance::{LearnedPixels, Method, Moments, Sampler};

/// The method of [`Moments::kl_linear`].
#[derive(Debug)]
pub struct Kl;

impl Method for Kl {
    fn name(&self) -> &'static str {
        "kl"
    }

    fn about(&self) -> &'static str {
        "The share whose mixture of pdfs has the least Kullback-Leibler divergence from the integrand, to first order"
    }

    fn sums_moments(&self) -> bool {
        true
    }

    /// Its shares move furthest: with one scramble for all passes, tests of 10⁴ replicas show a bias (11 standard errors in
    /// a pixel). They show none for `second-order` and `efficiency-aware`, which gain more by one sequence.
    fn scrambles_passes(&self) -> bool {
        true
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        take_pass_and_update(learned, sampler, paths, Moments::kl_linear);
    }
}

#[cfg(test)]
mod tests {
    use crate::balance::Balance;
    use crate::balance::methods::passes;

    #[test]
    fn passes_double_and_end_at_the_goal() {
        assert_eq!(passes(Balance::Kl, 300, None), [8, 8, 16, 32, 64, 128, 44]);
    }
}
