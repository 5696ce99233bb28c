//! Exact cases: failure modes on images of discrete integrands.

use super::domain::{Domain, Image, SIDE};

pub struct Case {
    /// Number of the failure mode: F1 … F17.
    pub mode: &'static str,
    /// In a few words.
    pub name: &'static str,
    pub construct: &'static str,
    pub paths: u32,
    /// Largest variance ratio to `half` in any pixel and channel that counts as survived.
    pub bar: f64,
    pub image: Image,
}

impl Case {
    fn new(mode: &'static str, name: &'static str, construct: &'static str, image: Image) -> Self {
        Self { mode, name, construct, paths: PATHS, bar: BAR, image }
    }
}

/// No pixel and channel may be worse than this, where a mode has no bar of its own.
pub(crate) const BAR: f64 = 1.05;
/// Paths a pixel, where a mode does not ask for another number.
const PATHS: u32 = 64;

/// A smooth blend that prefers light samples a little.
fn blend() -> Domain {
    Domain::grey([(0.5, 0.55, 0.15), (0.3, 0.25, 0.25), (0.2, 0.1, 0.4)])
}

/// Masses of p_l = 2x and p_b = 2(1 − x) on [0, 1] in equal steps, each with its ends.
fn steps(n: usize) -> impl Iterator<Item = ([f64; 2], f64, f64)> {
    let at = move |i: usize| i as f64 / n as f64;
    let step = move |(a, b): (f64, f64)| ([a, b], b * b - a * a, (b - a) * (2.0 - a - b));
    (0..n).map(move |i| step((at(i), at(i + 1))))
}

/// f = x² on [0, 1] with p_l = 2x and p_b = 2(1 − x), in equal steps.
fn parabola(n: usize) -> Domain {
    Domain::grey(steps(n).map(|([a, b], l, s)| ((b.powi(3) - a.powi(3)) / 3.0, l, s)))
}

/// Main light from light samples; an event of one BSDF sample in fifty that no light sample finds.
fn rare() -> Domain {
    Domain::grey([(0.6, 0.6, 0.2), (0.3, 0.0, 0.02)])
}

pub fn cases() -> Vec<Case> {
    let flat = |mode, name, construct, domain: &Domain| Case::new(mode, name, construct, Image::flat(domain));
    let grey = |mode, name, construct, atoms: &[_]| flat(mode, name, construct, &Domain::grey(atoms.iter().copied()));
    let lit = || Domain::grey([(1.0, 0.5, 0.05), (0.1, 0.05, 0.5)]);
    let flip = |d: Domain| Domain::new(d.atoms.iter().map(|a| (a.f, a.bsdf, a.light)));
    let shadow = || Domain::grey([(0.0, 0.5, 0.05), (0.1, 0.05, 0.5)]);
    let base = [(0.6, 0.7, 0.1), (0.4, 0.1, 0.5)];
    let firefly = Image::new(|x, y| match (x, y) {
        (1, 1) => (Domain::grey(base.into_iter().chain([(2.0, 0.003, 0.001)])), 1),
        _ => (Domain::grey(base), 1),
    });
    let red_and_blue = |red: f64| Domain::new([([red, 0.1, 0.0], 0.5, 0.05), ([0.0, 0.1, 1.0], 0.05, 0.5)]);
    let dim = "a bright region that light samples find, a dim one for BSDF samples; 32 paths";
    let broken = [(0.6, 0.5, 0.2), (-0.05, 0.1, 0.1), (f64::NAN, 0.1, 0.1), (0.3, 0.1, 0.4)];
    let rarely = "a contribution that no light sample finds, and 2 % of BSDF samples";
    let rare_firefly = "one pixel of 16 meets, once in 500 samples, a contribution a thousand times everything else";
    let disjoint = "disjoint supports, strong light ∝ p_l, weak light ∝ p_b but for 10 %";
    let half_shadow = "one material, half of the pixels without the part that light samples find";
    let uneven = [(0.5, 0.255, 0.25), (0.1, 0.245, 0.25), (0.3, 0.25, 0.245), (0.1, 0.25, 0.255)];
    let odd = [(0.02f64.sqrt(), 0.0, 0.4), (0.18f64.sqrt(), 0.38, 0.02)];
    let edge = Image::new(|x, _| if x < SIDE / 2 { (lit(), 1) } else { (flip(lit()), 2) });
    let shadowed = Image::new(|x, _| if x < SIDE / 2 { (lit(), 1) } else { (shadow(), 1) });
    vec![
        grey("F1", "Newton overshoot", "light only where r = 0.1: a raw step is t = 5", &[(1.0, 0.55, 0.45)]),
        grey("F2", "truncated odd order", "masses of Y²: 0.1 at r = −1, 0.9 at r = 0.9", &odd),
        Case { paths: 4, bar: 1.15, ..flat("F3", "tiny pilot", "f = x², 4 paths", &parabola(8)) },
        Case { paths: 32, bar: 1.15, ..flat("F3", "smallest pilots", "f = x², 32 paths", &parabola(8)) },
        Case::new("F4", "firefly", rare_firefly, firefly),
        Case { bar: 1.0, ..grey("F5", "black", "no light at all", &[(0.0, 0.6, 0.3)]) },
        Case { bar: 1.01, ..grey("F7", "near tie", "p_l and p_b 2 % apart, f uneven", &uneven) },
        flat("F8", "partial support", rarely, &rare()),
        flat(
            "F9",
            "channels disagree",
            "red by light samples, blue by BSDF samples, alike in brightness",
            &red_and_blue(1.0),
        ),
        flat("F9", "channels disagree, one stronger", "as before, red three times as bright", &red_and_blue(3.0)),
        flat("F10", "noise of shares between pixels", "the same smooth blend in all pixels", &blend()),
        Case { paths: 32, ..flat("F12", "pilot used again", dim, &dim_and_bright()) },
        grey("F13", "stratification regime", disjoint, &[(0.8, 1.0, 0.0), (0.09, 0.0, 0.5), (0.11, 0.0, 0.5)]),
        Case::new("F14", "material edge", "two materials with opposite optimal shares, side by side", edge),
        Case::new("F15", "shadow edge", half_shadow, shadowed),
        grey("F16", "broken values", "f < 0 and f = NaN on one sample in ten each", &broken),
        flat("F17", "overflow", "radiance of 1e25: squares leave the range of f32", &blend().times(1e25)),
        flat("F17", "underflow", "radiance of 1e−25", &blend().times(1e-25)),
    ]
}

/// A bright region that light samples find, a dim one for BSDF samples.
fn dim_and_bright() -> Domain {
    Domain::grey([(1.0, 0.3, 0.05), (0.3, 0.1, 0.5)])
}

/// The case in which the biased control must be caught.
pub(crate) fn biased_control() -> Case {
    let construct = "a bright region that light samples find, a dim one for BSDF samples; 8 paths";
    let case = Case::new("F12", "a pixel's own pilot, reweighted", construct, Image::flat(&dim_and_bright()));
    Case { paths: 8, bar: f64::INFINITY, ..case }
}

/// The case in which the unsafe control must be caught.
pub(crate) fn unsafe_control() -> Case {
    let name = "minimum of own samples without pseudo-observations";
    Case::new("F8", name, "partial support, as above", Image::flat(&rare()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bismar::balance::{Counts, Heuristic, Moments};

    #[test]
    fn probabilities_add_up_to_one() {
        for case in cases() {
            for domain in &case.image.pixels {
                let light: f64 = domain.atoms.iter().map(|a| a.light).sum();
                let bsdf: f64 = domain.atoms.iter().map(|a| a.bsdf).sum();
                for sum in [light, bsdf] {
                    assert!((sum - 1.0).abs() < 1e-12, "{} {}: {sum}", case.mode, case.name);
                }
            }
        }
    }

    #[test]
    fn exact_moments_give_the_shares_of_the_derivation() {
        let share = |name: &str, domain: &Domain| {
            let mut moments = Moments::default();
            for a in &domain.atoms {
                let half = 0.5 * (a.light + a.bsdf);
                let y = a.f[0] / half;
                moments.add((y * y * half) as f32, a.r() as f32, (y * half) as f32);
            }
            f64::from(if name == "kl" { moments.kl_linear() } else { moments.second_order() })
        };
        let of = |mode: &str| cases().into_iter().find(|c| c.mode == mode).unwrap().image.pixels[0].clone();
        assert_eq!(share("second-order", &of("F1")), 1.0);
        // t = 0.71/(2 · 0.829).
        assert!((share("second-order", &of("F2")) - (0.5 + 0.5 * 0.71 / 1.658)).abs() < 1e-6);
        // f = a p_l + b p_b: ρ/(1 + 0.6ρ²) where p_l = 2x, p_b = 2(1 − x), up to the steps' width; KL exactly ρ.
        let domain = Domain::grey(steps(64).map(|(_, l, s)| (0.75 * l + 0.25 * s, l, s)));
        assert!((share("second-order", &domain) - (0.5 + 0.5 * 0.5 / 1.15)).abs() < 1e-3);
        assert!((share("kl", &domain) - 0.75).abs() < 1e-6);
    }

    #[test]
    fn exact_variances_are_those_of_closed_forms() {
        // f = x²: N V of fixed equal counts (N samples, N/2 each) is 0.061111; here 2N samples.
        let v = parabola(512).variance(Heuristic::Balance, Counts::half(8))[0];
        assert!((v * 16.0 - 0.061111).abs() < 1e-5, "{}", v * 16.0);
    }
}
