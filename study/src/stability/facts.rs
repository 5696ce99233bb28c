//! Deterministic checks of the share after samples that break naive rules.

use bismar::balance::methods::efficiency_aware;
use bismar::balance::variance::{BlockVariances, Candidates, Caution};
use bismar::balance::{Balance, Contribution, Moments, Technique};
use glam::Vec3;
use serde::Serialize;

use super::domain::Image;
use super::simulate::EQUAL_COST;

/// A check of the share, and its result for every estimator that adapts.
#[derive(Debug, Clone, Serialize)]
pub struct Fact {
    /// F1 … F17, or none.
    pub mode: &'static str,
    pub shown: &'static str,
    /// Description of the correct share.
    pub right: &'static str,
    /// Name of the estimator, its share, and whether it is correct.
    pub answers: Vec<(String, f32, bool)>,
}

/// Number of light samples, and of BSDF samples, of the pilot.
const PILOT: u32 = 16;

/// The share after samples (Y, r), alternately light and BSDF samples. For estimators that use neighbours, one neighbouring
/// pixel has these samples and all others have `others`.
fn share(balance: Balance, samples: &[(f32, f32)], others: &[(f32, f32)]) -> f32 {
    let mut moments = Moments::default();
    samples.iter().for_each(|&(y, r)| moments.add(y * y, r, y));
    match balance {
        Balance::SecondOrder => return moments.second_order(),
        Balance::Kl => return moments.kl_linear(),
        _ => {}
    }
    let image = Image::flat(&super::domain::Domain::grey([(0.0, 0.5, 0.5)]));
    let mut contributions = Vec::new();
    for pixel in 0..image.pixels.len() as u32 {
        for (i, &(y, r)) in if pixel == 0 { samples } else { others }.iter().enumerate() {
            let technique = if i % 2 == 0 { Technique::Light } else { Technique::Bsdf };
            let radiance = Vec3::splat(y / 6.0);
            contributions.push(Contribution {
                pixel,
                technique,
                area: false,
                layer: 0,
                index: i as u32 / 2,
                r,
                w: 0.0,
                radiance,
            });
        }
    }
    let pixel = image.width + 1;
    if balance == Balance::EfficiencyAware {
        return efficiency_aware::light_shares(&contributions, image.pixels.len(), image.width, EQUAL_COST)[pixel];
    }
    let candidates = Candidates::light_and_bsdf(Caution::DIRECT);
    let variances = BlockVariances::new(&candidates, &contributions, image.pixels.len(), PILOT);
    variances.choose(image.width, &image.guides, EQUAL_COST, false)[pixel].light_share
}

pub fn facts() -> Vec<Fact> {
    // Sixteen of each: light samples with r = 0.9 and a variance, BSDF samples without variance.
    let plain: Vec<_> =
        (0..2 * PILOT).map(|i| if i % 2 == 0 { (1.0 + (i * i % 13) as f32, 0.9) } else { (1.0, -0.9) }).collect();
    let scaled = |by: f32| plain.iter().map(|&(y, r)| (y * by, r)).collect::<Vec<_>>();
    let mut firefly = plain.iter().map(|&(_, r)| (1.0, r)).collect::<Vec<_>>();
    firefly[6] = (1e3, 0.5);
    // Replaces three good samples.
    let replaced = |by: [(f32, f32); 3]| {
        let mut samples = plain.clone();
        [4, 7, 18].into_iter().zip(by).for_each(|(i, sample)| samples[i] = sample);
        samples
    };
    let broken = replaced([(f32::NAN, 0.1), (f32::INFINITY, 0.2), (1.0, f32::NAN)]);
    let without = replaced([(0.0, 0.9); 3]);
    let learners = || Balance::all().iter().copied().filter(|balance| balance.method().learns());
    let fact = |mode, shown, right, [samples, others]: [&[(f32, f32)]; 2], holds: &dyn Fn(Balance, f32) -> bool| {
        let answer = |s: Balance| {
            let share = share(s, samples, others);
            (s.name().to_owned(), share, (0.0..=1.0).contains(&share) && holds(s, share))
        };
        Fact { mode, shown, right, answers: learners().map(answer).collect() }
    };
    let as_after = |samples: &[(f32, f32)], s: Balance, found: f32| {
        (found - share(s, samples, samples)).abs() <= 1e-6 || found == 0.5
    };
    let as_plain = |s: Balance, found: f32| as_after(&plain, s, found);
    vec![
        fact("–", "good samples: those of light vary", "above 1/2", [&plain; 2], &|_, s| s > 0.5),
        fact("F1", "light only at r = 0.1", "in [0, 1]", [&[(1.0, 0.1); 32]; 2], &|_, _| true),
        fact(
            "F4",
            "one sample has 99.9 % of a pixel's weight, at r = 0.5",
            "in [1/3, 2/3], or as its neighbours without it",
            [&firefly, &plain],
            &|s, found| (1.0 / 3.0..=2.0 / 3.0).contains(&found) || (found - share(s, &plain, &plain)).abs() <= 1e-6,
        ),
        fact("F5", "nothing", "1/2", [&[]; 2], &|_, s| s == 0.5),
        fact("F16", "NaN and infinity among good samples", "as without, or 1/2", [&broken; 2], &|s, found| {
            as_after(&without, s, found)
        }),
        fact("F17", "good samples times 1e25", "as without, or 1/2", [&scaled(1e25); 2], &as_plain),
        fact("F17", "good samples times 1e−25", "as without, or 1/2", [&scaled(1e-25); 2], &as_plain),
    ]
}
