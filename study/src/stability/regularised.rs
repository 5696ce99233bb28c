//! Light shares by regularised moments, which no `--balance` uses: the second-order formula with a ridge, and the minimax
//! share. Both regularise with `kappa` pseudo-observations of the typical size c = Q₀/S₀ of samples with large contributions.

use bismar::balance::Moments;
use bismar::balance::moments::light_share_of;

/// [`Moments::second_order`] with a ridge: half of each pseudo-observation at each end r = ±1. It vanishes as samples
/// accumulate and bounds α while a single sample carries the weight: |t| ≤ 1/(2(1 + κ)) for one firefly.
pub fn second_order_ridge(moments: &Moments, kappa: f64) -> f32 {
    if moments.s0 <= 0.0 {
        return 0.5;
    }
    let ridge = kappa * moments.q0 / moments.s0;
    light_share_of(moments.s1 / (2.0 * (moments.s2 + ridge)))
}

/// The light share that is best against the worst integrand with these m₀, m₁, m₂ (a two-atom measure, by Chebyshev and
/// Markov), with the same ridge. With exact moments its second moment is never above that of ½, for any integrand.
pub fn minimax_ridge(moments: &Moments, kappa: f64) -> f32 {
    if moments.s0 <= 0.0 {
        return 0.5;
    }
    let ridge = kappa * moments.q0 / moments.s0;
    let (m0, m1, m2) = (moments.s0 + ridge, moments.s1.abs(), moments.s2 + ridge);
    // Atoms at r = −1 (mass w) and r = ξ (mass v), for m₁ ≥ 0; mirrored otherwise.
    let v = (m0 + m1) * (m0 + m1) / (m0 + 2.0 * m1 + m2);
    let xi = (m1 + m2) / (m0 + m1);
    let w = (m0 - v).max(0.0);
    let (heavy, light) = ((v * xi).sqrt(), w.sqrt());
    let denominator = heavy + xi * light;
    let t = if denominator > 0.0 { ((heavy - light) / denominator).max(0.0) } else { 0.0 };
    light_share_of(t.copysign(moments.s1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bismar::sampling::SplitMix64;

    /// Moments of atoms (mass of Y², r), exact.
    fn atoms(list: &[(f64, f64)]) -> Moments {
        let mut m = Moments::default();
        for &(w, r) in list {
            m.s0 += w;
            m.s1 += w * r;
            m.s2 += w * r * r;
        }
        m
    }

    /// M(α) of atoms.
    fn second_moment(list: &[(f64, f64)], light_share: f64) -> f64 {
        let t = 2.0 * light_share - 1.0;
        list.iter().map(|(w, r)| w / (1.0 + t * r)).sum()
    }

    fn t_of(light_share: f32) -> f64 {
        2.0 * f64::from(light_share) - 1.0
    }

    #[test]
    fn minimax_has_its_closed_forms() {
        // f = x² with p_l = 2x, p_b = 2(1 − x).
        let square = Moments { s0: 0.2, s1: 2.0 / 15.0, s2: 11.0 / 105.0, ..Default::default() };
        assert!((minimax_ridge(&square, 0.0) - 17.0 / 20.0).abs() < 1e-6);
        for (a, b) in [(0.9f64, 0.1f64), (0.2, 0.8), (0.5, 0.5)] {
            let share = f64::from(minimax_ridge(&atoms(&[(a, 1.0), (b, -1.0)]), 0.0));
            assert!((share - a.sqrt() / (a.sqrt() + b.sqrt())).abs() < 2.0 * f64::from(f32::EPSILON));
        }
        let truncated = t_of(minimax_ridge(&atoms(&[(0.1, -1.0), (0.9, 0.9)]), 0.0));
        assert!((truncated - 0.492_8).abs() < 5e-5, "{truncated}");
    }

    #[test]
    fn equal_pdfs_and_no_samples_stay_at_half_and_large_ones_do_not_overflow() {
        let (equal, none) = (atoms(&[(1.0, 0.0)]), Moments::default());
        assert_eq!([second_order_ridge(&equal, 1.0), minimax_ridge(&equal, 0.0)], [0.5; 2]);
        assert_eq!([second_order_ridge(&none, 1.0), minimax_ridge(&none, 1.0)], [0.5; 2]);
        let mut large = Moments::default();
        large.add(1e38, 0.5, 1e19);
        large.add(1e38, 0.5, 1e19);
        for share in [second_order_ridge(&large, 1.0), minimax_ridge(&large, 1.0)] {
            assert!(share > 0.5 && share <= 1.0, "{share}");
        }
    }

    #[test]
    fn one_firefly_is_bounded_by_the_ridge() {
        // F4: one sample has 99 % of the weight, so N_eff ≈ 1.
        let mut m = Moments::default();
        for _ in 0..99 {
            m.add(1.0, -0.2, 1.0);
        }
        m.add(9801.0, 1.0, 99.0);
        for kappa in [1.0, 2.0] {
            let (t, bound) = (t_of(second_order_ridge(&m, kappa)), 1.0 / (2.0 * (1.0 + kappa)));
            assert!(t <= bound + 0.02, "{t}");
        }
    }

    #[test]
    fn minimax_never_raises_the_second_moment() {
        let mut random = SplitMix64(9);
        for _ in 0..20_000 {
            let n = 1 + (7.0 * random.f64()) as usize;
            let list: Vec<_> = (0..n).map(|_| (1e-6 + random.f64(), 2.0 * random.f64() - 1.0)).collect();
            let share = f64::from(minimax_ridge(&atoms(&list), 0.0));
            let (at_half, minimax) = (second_moment(&list, 0.5), second_moment(&list, share));
            assert!(minimax <= at_half * (1.0 + 1e-6), "{share}: {minimax} > {at_half}");
        }
    }
}
