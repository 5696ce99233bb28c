//! Decides whether light samples of the environment are drawn by the compensated density (radiance above the mean; MIS
//! compensation, Karlík et al. 2019). A pre-pass at low resolution compares both densities over all surfaces. Its result
//! depends only on the scene, the view and the seed, so that every part, crop and session decides alike.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use tracing::debug;

use super::super::sampler::with_buffers;
use super::super::stats::CompensationStats;
use super::super::{Choice, RenderSettings};
use super::low_resolution::low_resolution;
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::film::compare::{relative_to, sums_without_outliers};
use crate::integrator::{PixelSums, PixelTask, PreparedScene, Proposal, Transport};
use crate::light::{Density, LightProposal};
use crate::sampling::hash;

/// Pixels of the picture per pixel of the pre-pass, and the minimum and maximum pixels of the pre-pass.
const PIXELS_PER_PREPASS_PIXEL: f64 = 32.0;
const MIN_PIXELS: f64 = 64.0;
const MAX_PIXELS: f64 = 1024.0;
/// Paths per pixel of the pre-pass, for each density.
const PATHS_PER_PIXEL: u32 = 16;
/// The compensated density is used where at most this fraction of the variance remains.
const MAX_REMAINING_VARIANCE: f64 = 0.97;

/// Decides by which density the paths of `transport`, a render with these settings, sample the environment. `None` where
/// there is nothing to decide: the density is then the radiance. Ends soon after `stop` is raised.
pub fn compensation(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<CompensationStats> {
    let began = Instant::now();
    let uneven = || scene.lights.environment.as_ref().is_some_and(|environment| environment.has_compensated());
    // The table of the compensated density is as large as the plain one: it is made only where it may be used.
    if !settings.uses_prepass(settings.compensation) || !uneven() {
        return None;
    }
    if settings.compensation == Choice::On {
        return Some(CompensationStats { on: true, remaining_variance: None, seconds: 0.0 });
    }
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    let ([width, height], camera) =
        low_resolution(scene, settings, (pixels / PIXELS_PER_PREPASS_PIXEL).clamp(MIN_PIXELS, MAX_PIXELS));
    let [plain, compensated] = [Density::Radiance, Density::Compensated].map(|density| {
        let seed = hash(settings.seed ^ hash(0x736b_7921));
        let lights = LightProposal { density, ..transport.proposal.lights };
        let proposal = Proposal { lights, ..transport.proposal };
        trace(&Transport { camera: camera.clone(), seed, proposal, ..transport.clone() }, [width, height], stop)
    });
    let remaining = remaining_variance(&plain?, &compensated?);
    debug!("the environment's compensated density leaves {remaining:.2} of the variance, by {width} x {height} pixels");
    Some(CompensationStats {
        on: remaining < MAX_REMAINING_VARIANCE,
        // Infinite where nothing varies.
        remaining_variance: Some(if remaining.is_finite() { remaining } else { 1.0 }),
        seconds: began.elapsed().as_secs_f64(),
    })
}

/// Traces a picture of this size; `None` if `stop` was raised.
fn trace(transport: &Transport, [width, height]: [u32; 2], stop: &AtomicBool) -> Option<Vec<PixelStats>> {
    let counts = Counts::half(PATHS_PER_PIXEL);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    let tasks: Vec<_> = pixels.map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
    let of_some = |tasks: &[PixelTask]| {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let mut stats = vec![PixelStats::default(); tasks.len()];
        with_buffers(|buffers| buffers.wave().run(transport, tasks, &mut PixelSums::new(&mut stats)));
        Some(stats)
    };
    let all: Option<Vec<_>> = tasks.par_chunks(128).map(of_some).collect();
    all.map(|all| all.concat())
}

/// Relative variance with the compensated density over that with the plain one, over the pixels of a picture. Infinite if
/// the plain variance is 0.
fn remaining_variance(plain: &[PixelStats], compensated: &[PixelStats]) -> f64 {
    let of = |(a, b): (&PixelStats, &PixelStats)| {
        let mut sums = [0.0; 2];
        for c in 0..3 {
            // The mean of both, so that noise favours neither.
            let divisor = relative_to(0.5 * f64::from(a.mean()[c] + b.mean()[c]));
            for (sum, stats) in sums.iter_mut().zip([a, b]) {
                *sum += f64::from(stats.variance_of_mean()[c]) / divisor;
            }
        }
        sums
    };
    let [plain, compensated] = sums_without_outliers(plain.iter().zip(compensated).map(of).collect());
    if plain > 0.0 { compensated / plain } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pixel with this mean and variance of its paths.
    fn pixel(mean: f64, variance: f64) -> PixelStats {
        let n = f64::from(PATHS_PER_PIXEL);
        let squares = n * mean * mean + variance * (n - 1.0);
        PixelStats { samples: PATHS_PER_PIXEL, sum: [n * mean; 3], sum_squared: [squares; 3], ..PixelStats::EMPTY }
    }

    #[test]
    fn what_is_left_counts_relative_errors_and_no_pixel_alone() {
        let all = |pixel| vec![pixel; 200];
        let half = remaining_variance(&all(pixel(1.0, 2.0)), &all(pixel(1.0, 1.0)));
        assert!((half - 0.5).abs() < 1e-6, "{half}");
        // Dark pixels count as bright ones: here nine tenths and the half of it.
        let both = |bright: f64, dark: f64| [all(pixel(10.0, 100.0 * bright)), all(pixel(1.0, dark))].concat();
        let three_quarters = remaining_variance(&both(1.0, 1.0), &both(1.0, 0.5));
        assert!((three_quarters - 0.75).abs() < 1e-2, "{three_quarters}");
        let mut firefly = all(pixel(1.0, 1.0));
        firefly[7] = pixel(50.0, 1e6);
        assert!((remaining_variance(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-6);
        firefly[8] = pixel(f64::NAN, 1.0);
        assert!((remaining_variance(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-2);
        assert_eq!(remaining_variance(&all(pixel(0.0, 0.0)), &all(pixel(0.0, 0.0))), f64::INFINITY);
        assert_eq!(remaining_variance(&[], &[]), f64::INFINITY);
    }
}
