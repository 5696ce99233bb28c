//! Whether light samples toward the environment are to be drawn by what of it is above its mean. A pilot of a smaller picture
//! of the same view tells, at all surfaces at once: what it finds depends on the scene, the view and the seed alone, so that
//! every part, crop and session decides alike.

use rayon::prelude::*;
use tracing::debug;

use super::super::RenderSettings;
use super::super::sampler::with_buffers;
use super::low_resolution::low_resolution;
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::film::compare::{relative_to, sums_without_outliers};
use crate::integrator::{PixelBatch, PixelTask, PreparedScene, Transport};
use crate::light::{Density, Drawing};
use crate::sampling::hash;

/// Pixels of a picture for each of its pilot's, which has neither fewer nor more than this.
const PIXELS_OF: f64 = 32.0;
const FEWEST: f64 = 64.0;
const MOST: f64 = 1024.0;
/// Paths of each of the pilot's pixels, drawn in either way.
const PATHS: u32 = 16;
/// What may be left of the variance where it pays.
const PAYS: f64 = 0.97;

/// By what the paths of `transport`, a render with these settings, draw directions from the environment.
pub fn density(scene: &PreparedScene, settings: &RenderSettings, transport: &Transport) -> Density {
    let uneven = scene.lights.environment.as_ref().is_some_and(|environment| environment.has_compensated());
    if !settings.balance.method().uses_prepasses() || !uneven {
        return Density::Radiance;
    }
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    let ([width, height], camera) = low_resolution(scene, settings, (pixels / PIXELS_OF).clamp(FEWEST, MOST));
    let [plain, compensated] = [Density::Radiance, Density::Compensated].map(|density| {
        let seed = hash(settings.seed ^ hash(0x736b_7921));
        let drawing = Drawing { density, learned: None };
        take(&Transport { camera: camera.clone(), seed, drawing, ..transport.clone() }, [width, height])
    });
    let left = left(&plain, &compensated);
    debug!("samples of the environment's compensated leave {left:.2} of the variance, by {width} x {height} pixels");
    if left < PAYS { Density::Compensated } else { Density::Radiance }
}

/// What a picture of this size finds.
fn take(transport: &Transport, [width, height]: [u32; 2]) -> Vec<PixelStats> {
    let counts = Counts::half(PATHS);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    let tasks: Vec<_> = pixels.map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
    let of_some = |tasks: &[PixelTask]| {
        let mut stats = vec![PixelStats::default(); tasks.len()];
        let mut batch = PixelBatch::radiance_only(tasks, &mut stats);
        with_buffers(|buffers| buffers.wave().run(transport, &mut batch));
        stats
    };
    tasks.par_chunks(128).flat_map_iter(of_some).collect()
}

/// What one way of drawing leaves of the other's relative variance, over the pixels of a picture; infinite if nothing varies.
fn left(plain: &[PixelStats], compensated: &[PixelStats]) -> f64 {
    let of = |(a, b): (&PixelStats, &PixelStats)| {
        let mut sums = [0.0; 2];
        for c in 0..3 {
            // By both means: chance favours neither.
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
        let n = f64::from(PATHS);
        let squares = n * mean * mean + variance * (n - 1.0);
        PixelStats { samples: PATHS, sum: [n * mean; 3], sum_squared: [squares; 3], ..PixelStats::EMPTY }
    }

    #[test]
    fn what_is_left_counts_relative_errors_and_no_pixel_alone() {
        let all = |pixel| vec![pixel; 200];
        let half = left(&all(pixel(1.0, 2.0)), &all(pixel(1.0, 1.0)));
        assert!((half - 0.5).abs() < 1e-6, "{half}");
        // Dark pixels count as bright ones: here nine tenths and the half of it.
        let both = |bright: f64, dark: f64| [all(pixel(10.0, 100.0 * bright)), all(pixel(1.0, dark))].concat();
        let three_quarters = left(&both(1.0, 1.0), &both(1.0, 0.5));
        assert!((three_quarters - 0.75).abs() < 1e-2, "{three_quarters}");
        let mut firefly = all(pixel(1.0, 1.0));
        firefly[7] = pixel(50.0, 1e6);
        assert!((left(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-6);
        firefly[8] = pixel(f64::NAN, 1.0);
        assert!((left(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-2);
        assert_eq!(left(&all(pixel(0.0, 0.0)), &all(pixel(0.0, 0.0))), f64::INFINITY);
        assert_eq!(left(&[], &[]), f64::INFINITY);
    }
}
