//! Exact cases: failure modes on images of discrete integrands.

use super::domain::{Domain, Image, SIDE};

pub struct Case {
    /// Number of the failure mode: F1 … F17.
    pub mode: &'static str,
    /// In a few words.
    pub name: &'static str,
    /// Description of the case.
    pub construct: &'static str,
    pub paths: u32,
    /// Largest variance ratio to `half` in any pixel and channel that counts as survived.
    pub bar: f64,
    pub image: Image,
}

/// No pixel and channel may be worse than this, where a mode has no bar of its own.
pub const BAR: f64 = 1.05;
/// Paths a pixel, where a mode does not ask for another number.
const PATHS: u32 = 64;

/// A smooth blend that prefers light samples a little.
fn blend() -> Domain {
    Domain::grey([(0.5, 0.55, 0.15), (0.3, 0.25, 0.25), (0.2, 0.1, 0.4)])
}

/// f = x² on [0, 1] with p_l = 2x and p_b = 2(1 − x), in eight equal steps.
fn square() -> Domain {
    Domain::grey(std::array::from_fn::<_, 8, _>(|i| {
        let (a, b) = (i as f64 / 8.0, (i + 1) as f64 / 8.0);
        ((b.powi(3) - a.powi(3)) / 3.0, b * b - a * a, (b - a) * (2.0 - a - b))
    }))
}

/// Main light from light samples; an event of one BSDF sample in fifty that no light sample finds.
fn rare() -> Domain {
    Domain::grey([(0.6, 0.6, 0.2), (0.3, 0.0, 0.02)])
}

pub fn cases() -> Vec<Case> {
    let case = |mode, name, construct, image| Case { mode, name, construct, paths: PATHS, bar: BAR, image };
    let few = |paths, bar, case: Case| Case { paths, bar, ..case };
    let lit = || Domain::grey([(1.0, 0.5, 0.05), (0.1, 0.05, 0.5)]);
    let shadow = || Domain::grey([(0.0, 0.5, 0.05), (0.1, 0.05, 0.5)]);
    let base = || Domain::grey([(0.6, 0.7, 0.1), (0.4, 0.1, 0.5)]);
    vec![
        case("F1", "Newton overshoot", "light only where r = 0.1: a raw step is t = 5", {
            Image::flat(&Domain::grey([(1.0, 0.55, 0.45)]))
        }),
        case("F2", "truncated odd order", "masses of Y²: 0.1 at r = −1, 0.9 at r = 0.9", {
            Image::flat(&Domain::grey([(0.02f64.sqrt(), 0.0, 0.4), (0.18f64.sqrt(), 0.38, 0.02)]))
        }),
        few(4, 1.15, case("F3", "tiny pilot", "f = x², 4 paths", Image::flat(&square()))),
        few(32, 1.15, case("F3", "smallest pilots", "f = x², 32 paths", Image::flat(&square()))),
        case(
            "F4",
            "firefly",
            "one pixel of 16 meets, once in 500 samples, a contribution a thousand times everything else",
            {
                Image::new(|x, y| match (x, y) {
                    (1, 1) => (Domain::grey([(0.6, 0.7, 0.1), (0.4, 0.1, 0.5), (2.0, 0.003, 0.001)]), 1),
                    _ => (base(), 1),
                })
            },
        ),
        few(PATHS, 1.0, case("F5", "black", "no light at all", Image::flat(&Domain::grey([(0.0, 0.6, 0.3)])))),
        few(
            PATHS,
            1.01,
            case("F7", "near tie", "p_l and p_b 2 % apart, f uneven", {
                Image::flat(&Domain::grey([
                    (0.5, 0.255, 0.25),
                    (0.1, 0.245, 0.25),
                    (0.3, 0.25, 0.245),
                    (0.1, 0.25, 0.255),
                ]))
            }),
        ),
        case(
            "F8",
            "partial support",
            "a contribution that no light sample finds, and 2 % of BSDF samples",
            Image::flat(&rare()),
        ),
        case("F9", "channels disagree", "red by light samples, blue by BSDF samples, alike in brightness", {
            Image::flat(&Domain::new([([1.0, 0.1, 0.0], 0.5, 0.05), ([0.0, 0.1, 1.0], 0.05, 0.5)]))
        }),
        case("F9", "channels disagree, one stronger", "as before, red three times as bright", {
            Image::flat(&Domain::new([([3.0, 0.1, 0.0], 0.5, 0.05), ([0.0, 0.1, 1.0], 0.05, 0.5)]))
        }),
        case("F10", "noise of shares between pixels", "the same smooth blend in all pixels", Image::flat(&blend())),
        few(
            32,
            BAR,
            case(
                "F12",
                "pilot used again",
                "a bright region that light samples find, a dim one for BSDF samples; 32 paths",
                Image::flat(&dim_and_bright()),
            ),
        ),
        case(
            "F13",
            "stratification regime",
            "disjoint supports, strong light ∝ p_l, weak light ∝ p_b but for 10 %",
            Image::flat(&Domain::grey([(0.8, 1.0, 0.0), (0.09, 0.0, 0.5), (0.11, 0.0, 0.5)])),
        ),
        case("F14", "material edge", "two materials with opposite optimal shares, side by side", {
            let flip = |d: Domain| Domain::new(d.atoms.iter().map(|a| (a.f, a.bsdf, a.light)));
            Image::new(|x, _| if x < SIDE / 2 { (lit(), 1) } else { (flip(lit()), 2) })
        }),
        case("F15", "shadow edge", "one material, half of the pixels without the part that light samples find", {
            Image::new(|x, _| if x < SIDE / 2 { (lit(), 1) } else { (shadow(), 1) })
        }),
        case("F16", "broken values", "f < 0 and f = NaN on one sample in ten each", {
            let broken = [(-0.05, 0.1, 0.1), (f64::NAN, 0.1, 0.1)];
            Image::flat(&Domain::grey([(0.6, 0.5, 0.2), broken[0], broken[1], (0.3, 0.1, 0.4)]))
        }),
        case("F17", "overflow", "radiance of 1e25: squares leave the range of f32", {
            Image::flat(&blend().times(1e25))
        }),
        case("F17", "underflow", "radiance of 1e−25", Image::flat(&blend().times(1e-25))),
    ]
}

/// A bright region that light samples find, a dim one for BSDF samples.
fn dim_and_bright() -> Domain {
    Domain::grey([(1.0, 0.3, 0.05), (0.3, 0.1, 0.5)])
}

/// The case in which the biased control must be caught: 8 paths.
pub fn biased_control() -> Case {
    Case {
        mode: "F12",
        name: "a pixel's own pilot, reweighted",
        construct: "a bright region that light samples find, a dim one for BSDF samples; 8 paths",
        paths: 8,
        bar: f64::INFINITY,
        image: Image::flat(&dim_and_bright()),
    }
}

/// The case in which the unsafe control must be caught.
pub fn unsafe_control() -> Case {
    Case {
        mode: "F8",
        name: "minimum of own samples without pseudo-observations",
        construct: "partial support, as above",
        paths: PATHS,
        bar: BAR,
        image: Image::flat(&rare()),
    }
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
        let places = std::array::from_fn::<_, 64, _>(|i| {
            let (a, b) = (i as f64 / 64.0, (i + 1) as f64 / 64.0);
            let (l, s) = (b * b - a * a, (b - a) * (2.0 - a - b));
            (0.75 * l + 0.25 * s, l, s)
        });
        let domain = Domain::grey(places);
        assert!((share("second-order", &domain) - (0.5 + 0.5 * 0.5 / 1.15)).abs() < 1e-3);
        assert!((share("kl", &domain) - 0.75).abs() < 1e-6);
    }

    #[test]
    fn exact_variances_are_those_of_closed_forms() {
        // f = x²: N V of fixed equal counts (N samples, N/2 each) is 0.061111; here 2N samples.
        let fine = Domain::grey(std::array::from_fn::<_, 512, _>(|i| {
            let (a, b) = (i as f64 / 512.0, (i + 1) as f64 / 512.0);
            ((b.powi(3) - a.powi(3)) / 3.0, b * b - a * a, (b - a) * (2.0 - a - b))
        }));
        let v = fine.variance(Heuristic::Balance, Counts::half(8))[0];
        assert!((v * 16.0 - 0.061111).abs() < 1e-5, "{}", v * 16.0);
    }
}
