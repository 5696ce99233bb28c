//! MIS weights of two techniques with sample counts.

use crate::lanes::F;

/// The heuristic that weights the samples of two techniques (Veach and Guibas 1995, *Optimally Combining Sampling
/// Techniques for Monte Carlo Rendering*).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heuristic {
    /// w_i ∝ n_i p_i.
    Balance,
    /// w_i ∝ (n_i p_i)².
    Power,
    /// w_i = 1 for the largest n_i p_i, ½ for each where both are equal.
    Max,
}

impl Heuristic {
    /// The weight, in [0, 1], of the technique with `own` = n_i p_i > 0 against the other with `other` = n_j p_j ≥ 0. The
    /// weights of the two techniques add up to one.
    #[inline]
    pub fn weight(self, own: f32, other: f32) -> f32 {
        // The ratio does not overflow for any pdf, and own = ∞ gives 1.
        let ratio = other / own;
        match self {
            Heuristic::Balance => 1.0 / (1.0 + ratio),
            Heuristic::Power => 1.0 / (1.0 + ratio * ratio),
            Heuristic::Max => match own.total_cmp(&other) {
                std::cmp::Ordering::Greater => 1.0,
                std::cmp::Ordering::Equal => 0.5,
                std::cmp::Ordering::Less => 0.0,
            },
        }
    }

    /// [`weight`](Self::weight) of eight lanes.
    #[inline(always)]
    pub fn weights(self, own: F, other: F) -> F {
        let ratio = other / own;
        match self {
            Heuristic::Balance => F::ONE / (F::ONE + ratio),
            Heuristic::Power => F::ONE / ratio.mul_add(ratio, F::ONE),
            Heuristic::Max => own.simd_gt(other).select(F::ONE, own.simd_eq(other) & F::HALF),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_of_the_two_techniques_add_up_to_one(a in 1e-30f32..1e30, b in 1e-30f32..1e30) {
            for h in [Heuristic::Balance, Heuristic::Power, Heuristic::Max] {
                let sum = h.weight(a, b) + h.weight(b, a);
                // Two divisions and a sum, each within half an ulp.
                prop_assert!((sum - 1.0).abs() <= 4.0 * f32::EPSILON, "{h:?} {sum}");
                let eight = h.weights(F::splat(a), F::splat(b)).as_array()[3];
                prop_assert!((eight - h.weight(a, b)).abs() <= 2.0 * f32::EPSILON, "{h:?} {eight}");
            }
        }
    }

    #[test]
    fn a_technique_alone_has_all_the_weight() {
        for h in [Heuristic::Balance, Heuristic::Power, Heuristic::Max] {
            assert_eq!(h.weight(0.3, 0.0), 1.0);
        }
    }
}
