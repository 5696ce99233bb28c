//! Closed-form oracles. Domain [0, 1], p_l = 2x, p_b = 2(1 − x), so S = 2, r = 2x − 1, Y = f, unless a test says
//! otherwise.

use super::*;
use proptest::prelude::*;

/// Moments of f by the midpoint rule (error below 1e-9 for the smooth f used here).
fn moments(f: impl Fn(f64) -> f64) -> Moments {
    let n = 100_000;
    let mut m = Moments::default();
    for i in 0..n {
        let x = (f64::from(i) + 0.5) / f64::from(n);
        let r = 2.0 * x - 1.0;
        let (y, n) = (f(x), f64::from(n));
        let (w, z) = (y * y / n, y / n);
        m.s0 += w;
        m.s1 += w * r;
        m.s2 += w * r * r;
        m.k1 += z * r;
        m.k2 += z * r * r;
    }
    m
}

/// Atoms (mass of Y², r), exact.
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
fn second_moment(list: &[(f64, f64)], alpha: f64) -> f64 {
    let t = 2.0 * alpha - 1.0;
    list.iter().map(|(w, r)| w / (1.0 + t * r)).sum()
}

fn t_of(alpha: f32) -> f64 {
    2.0 * f64::from(alpha) - 1.0
}

/// α is an f32.
const F32: f64 = 2.0 * f32::EPSILON as f64;

#[test]
fn blend_of_the_pdfs_gives_the_taylor_value_and_is_exact_for_the_linear_divergence() {
    // f = a p_l + b p_b: t = ρ/(1 + 0.6ρ²) with ρ = (a − b)/(a + b).
    for (a, b, t) in [(3.0, 1.0, 0.434_782_608_7), (1.0, 9.0, -0.578_034_682_1)] {
        let m = moments(|x| a * 2.0 * x + b * 2.0 * (1.0 - x));
        let [second_order, linear] = [m.second_order(), m.kl_linear()].map(t_of);
        assert!((second_order - t).abs() < 1e-6, "{second_order}");
        assert!((linear - (a - b) / (a + b)).abs() < 1e-6, "{linear}");
    }
    assert_eq!(moments(|x| x * x).kl_linear(), 1.0);
}

#[test]
fn constant_integrand_stays_at_half() {
    assert!((moments(|_| 1.0).second_order() - 0.5).abs() < 1e-6);
}

#[test]
fn x_squared_gives_nine_elevenths() {
    let m = moments(|x| x * x);
    assert!((m.s0 - 0.2).abs() < 1e-8 && (m.s1 - 2.0 / 15.0).abs() < 1e-8 && (m.s2 - 11.0 / 105.0).abs() < 1e-8);
    assert!((m.second_order() - 9.0 / 11.0).abs() < 1e-6);
}

#[test]
fn disjoint_supports_have_their_taylor_value() {
    for (a, b) in [(0.9f64, 0.1f64), (0.2, 0.8), (0.5, 0.5)] {
        let m = atoms(&[(a, 1.0), (b, -1.0)]);
        assert!((f64::from(m.second_order()) - (0.5 + (a - b) / (4.0 * (a + b)))).abs() < F32);
    }
}

#[test]
fn equal_pdfs_stay_at_half() {
    assert_eq!(atoms(&[(1.0, 0.0)]).second_order(), 0.5);
}

#[test]
fn truncated_odd_order_case_has_its_taylor_value() {
    let t = t_of(atoms(&[(0.1, -1.0), (0.9, 0.9)]).second_order());
    assert!((t - 0.428_2).abs() < 5e-5, "{t}");
}

#[test]
fn newton_overshoot_is_clamped_and_does_not_raise_the_second_moment() {
    // F1: f supported where r = 0.1; raw t = 5.
    let list = [(1.0, 0.1)];
    let alpha = atoms(&list).second_order();
    assert_eq!(alpha, 1.0);
    assert!(second_moment(&list, f64::from(alpha)) <= second_moment(&list, 0.5));
}

#[test]
fn nothing_seen_stays_at_half() {
    let m = Moments::default();
    assert_eq!((m.second_order(), m.kl_linear()), (0.5, 0.5));
}

#[test]
fn bad_samples_are_dropped_and_large_ones_do_not_overflow() {
    // F16 and F17.
    let mut m = Moments::default();
    for (w, r) in [(f32::NAN, 0.0), (-1.0, 0.5), (f32::INFINITY, 0.5), (1.0, f32::NAN)] {
        m.add(w, r, 1.0);
    }
    assert_eq!(m, Moments::default());
    m.add(1e38, 0.5, 1e19);
    m.add(1e38, 0.5, 1e19);
    let share = m.second_order();
    assert!(share > 0.5 && share <= 1.0, "{share}");
}

/// Random measures of up to eight atoms.
fn measures() -> impl Strategy<Value = Vec<(f64, f64)>> {
    prop::collection::vec((1e-6f64..1.0, -1.0f64..=1.0), 1..8)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn any_share_is_bounded_by_its_distance_from_the_ends(list in measures(), alpha in 0.01f64..0.99) {
        let bound = second_moment(&list, 0.5) / (2.0 * alpha.min(1.0 - alpha));
        prop_assert!(second_moment(&list, alpha) <= bound * (1.0 + 1e-12));
    }
}
