//! MIS weights for two techniques with sample counts.

use crate::lanes::F;

/// How two techniques share a contribution that both could have found (Veach and Guibas 1995).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heuristic {
    /// w_i ∝ n_i p_i.
    Balance,
    /// w_i ∝ (n_i p_i)².
    Power,
    /// All weight to the larger n_i p_i; ties are shared equally.
    Max,
}

impl Heuristic {
    /// Weight of the technique with `own` = n_i p_i against the other's `other` = n_j p_j, both ≥ 0 and `own` > 0.
    /// The two weights add up to one. In [0, 1].
    #[inline]
    pub fn weight(self, own: f32, other: f32) -> f32 {
        // In terms of the ratio: no overflow for any pdf, and own = ∞ gives 1.
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
}

impl Heuristic {
    /// [`weight`](Self::weight), of eight.
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
