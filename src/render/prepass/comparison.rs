//! Compares guided and unguided paths by rendering both. The estimate of guiding takes paths for independent. But light that
//! varies little over a surface is integrated faster by stratified points, and directions from a histogram lose most of that.

use std::sync::atomic::AtomicBool;

use super::super::RenderSettings;
use super::low_resolution::low_resolution;
use super::rounds::{self, Round, Wanted};
use crate::integrator::{PreparedScene, Transport};
use crate::sampling::hash;

/// Paths of the picture over those of the comparison.
const PICTURE_PATHS: f64 = 64.0;
/// Minimum pixels.
const MIN_PIXELS: f64 = 256.0;
/// Minimum and maximum paths per pixel in each of two scrambles, whose difference is the error with stratified points.
const PATHS: [u32; 2] = [4, 64];
/// The noisiest pixel of this number is left out of a second comparison: a few pixels can have most of the error, with guided
/// paths or without.
const TRIMMED: usize = 100;

/// Guided paths over unguided ones.
#[derive(Debug, Clone, Copy)]
pub struct Compared {
    /// Error with stratified points; the lesser of those with all pixels and without the noisiest ones.
    pub variance: f64,
    /// Rays.
    pub rays: f64,
}

/// Renders both at low resolution. `None` soon after `stop` is raised.
pub fn compare(
    scene: &PreparedScene,
    settings: &RenderSettings,
    [guided, unguided]: [&Transport; 2],
    stop: &AtomicBool,
) -> Option<Compared> {
    let spp = settings.expected_spp();
    let paths = 1 << (spp / 2).clamp(PATHS[0], PATHS[1]).ilog2();
    let pixels = settings.pixels() * f64::from(spp) / PICTURE_PATHS / f64::from(4 * paths);
    let (size, camera) = low_resolution(scene, settings, pixels.max(MIN_PIXELS));
    let rounds = |transport: &Transport| {
        let round = |scramble: u32| {
            let seed = hash(settings.seed ^ hash(0x636f_6d70 + scramble));
            let transport = Transport { camera: camera.clone(), seed, ..transport.clone() };
            rounds::trace(&transport, size, (0, paths), Wanted::default(), stop)
        };
        Some([round(0)?, round(1)?])
    };
    let (guided, unguided) = rayon::join(|| rounds(guided), || rounds(unguided));
    let both = [guided?, unguided?];
    let [guided, unguided] = [0, 1].map(|i| errors(&both[i]));
    let [guided_rays, unguided_rays] = [0, 1].map(|i| both[i].iter().map(|round| round.rays).sum::<u64>() as f64);
    Some(Compared { variance: remaining(guided, unguided), rays: guided_rays / unguided_rays.max(1.0) })
}

/// The relative error of each pixel, by two scrambles.
fn errors([a, b]: &[Round; 2]) -> Vec<f64> {
    let error = |(a, b): (&rounds::RoundPixel, &rounds::RoundPixel)| {
        f64::from(a.mean - b.mean).powi(2) / f64::from(0.5 * (a.divisor + b.divisor))
    };
    a.pixels.iter().zip(&b.pixels).map(error).filter(|error| error.is_finite()).collect()
}

/// The lesser ratio of the sums, with all pixels and without the noisiest of each; 1 where there is no error to reduce.
fn remaining(mut guided: Vec<f64>, mut unguided: Vec<f64>) -> f64 {
    let ratio = |trimmed: bool, guided: &[f64], unguided: &[f64]| {
        let sum = |errors: &[f64]| {
            let left_out = if trimmed { errors.len() / TRIMMED } else { 0 };
            errors[..errors.len() - left_out].iter().sum::<f64>()
        };
        if sum(unguided) > 0.0 { sum(guided) / sum(unguided) } else { 1.0 }
    };
    guided.sort_by(f64::total_cmp);
    unguided.sort_by(f64::total_cmp);
    ratio(false, &guided, &unguided).min(ratio(true, &guided, &unguided))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_pixels_do_not_decide_alone() {
        let quiet = vec![1.0; 200];
        let with = |firefly: f64, of: f64| [vec![of; 198], vec![firefly; 2]].concat();
        assert_eq!(remaining(with(0.5, 0.5), quiet.clone()), 0.5);
        assert_eq!(remaining(with(1e6, 0.5), quiet.clone()), 0.5);
        assert_eq!(remaining(quiet.clone(), with(1e6, 1.0)), 200.0 / (198.0 + 2e6));
        assert_eq!(remaining(quiet, vec![0.0; 200]), 1.0);
    }
}
