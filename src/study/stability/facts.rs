//! What a share is after samples that break naive rules: answers that need no chance.

use glam::Vec3;
use serde::Serialize;

use super::domain::Image;
use crate::balance::pilot::{Candidates, Spreads};
use crate::balance::{Balance, Finding, Moments, Technique};

/// A question about shares and the answers of those who learn.
#[derive(Debug, Clone, Serialize)]
pub struct Fact {
    /// F1 … F17.
    pub mode: &'static str,
    /// What was shown to them.
    pub shown: &'static str,
    /// What is right.
    pub right: &'static str,
    /// Name, share, and is it right?
    pub answers: Vec<(String, f32, bool)>,
}

/// Light and BSDF samples of the pilots.
const PILOT: u32 = 16;

/// The share after samples (Y, r) that came alternately from light and BSDF samples. Who learns from neighbours has seen
/// them in one neighbour, and `others` in the rest.
fn share(balance: Balance, samples: &[(f32, f32)], others: &[(f32, f32)]) -> f32 {
    if balance != Balance::Progressive {
        let mut moments = Moments::default();
        samples.iter().for_each(|&(y, r)| moments.add(y * y, r, y));
        return balance.share(&moments).unwrap_or(0.5);
    }
    let image = Image::flat(&super::domain::Domain::grey([(0.0, 0.5, 0.5)]));
    let mut findings = Vec::new();
    for pixel in 0..image.pixels.len() as u32 {
        for (i, &(y, r)) in if pixel == 0 { samples } else { others }.iter().enumerate() {
            let technique = if i % 2 == 0 { Technique::Light } else { Technique::Bsdf };
            let radiance = Vec3::splat(y / 6.0);
            findings.push(Finding { pixel, technique, lamp: false, index: i as u32 / 2, r, radiance });
        }
    }
    let candidates = Candidates::two();
    let spreads = Spreads::new(&candidates, &findings, image.pixels.len(), PILOT);
    spreads.choose(image.width + 1, image.width, &image.guides).light
}

/// All of them.
pub fn facts() -> Vec<Fact> {
    // Sixteen of each: light samples of r = 0.6 that vary, BSDF samples that do not.
    let plain: Vec<_> =
        (0..2 * PILOT).map(|i| if i % 2 == 0 { (1.0 + (i * i % 13) as f32, 0.6) } else { (1.0, -0.6) }).collect();
    let scaled = |by: f32| plain.iter().map(|&(y, r)| (y * by, r)).collect::<Vec<_>>();
    let mut firefly = plain.iter().map(|&(_, r)| (1.0, r)).collect::<Vec<_>>();
    firefly[6] = (1e3, 0.5);
    let broken = [(f32::NAN, 0.1), (f32::INFINITY, 0.2), (1.0, f32::NAN)];
    let with_broken = plain.iter().copied().chain(broken).collect::<Vec<_>>();
    let learners = || Balance::all().iter().copied().filter(|b| b.learns());
    let fact = |mode, shown, right, [samples, others]: [&[(f32, f32)]; 2], holds: &dyn Fn(Balance, f32) -> bool| {
        let answer = |b: Balance| {
            let share = share(b, samples, others);
            (b.name(), share, (0.0..=1.0).contains(&share) && holds(b, share))
        };
        Fact { mode, shown, right, answers: learners().map(answer).collect() }
    };
    let as_plain = |b: Balance, s: f32| (s - share(b, &plain, &plain)).abs() <= 1e-6 || s == 0.5;
    vec![
        fact("F1", "light only at r = 0.1", "in [0, 1]", [&[(1.0, 0.1); 32]; 2], &|_, _| true),
        fact("F4", "one sample has 99.9 % of the weight, at r = 0.5", "in [1/3, 2/3]", [&firefly, &plain], &|_, s| {
            (1.0 / 3.0..=2.0 / 3.0).contains(&s)
        }),
        fact("F5", "nothing", "1/2", [&[]; 2], &|_, s| s == 0.5),
        fact("F16", "NaN and infinity among good samples", "as without, or 1/2", [&with_broken; 2], &as_plain),
        fact("F17", "good samples times 1e25", "as without, or 1/2", [&scaled(1e25); 2], &as_plain),
        fact("F17", "good samples times 1e−25", "as without, or 1/2", [&scaled(1e-25); 2], &as_plain),
    ]
}
