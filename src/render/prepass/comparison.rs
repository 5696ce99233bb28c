//! Compares guided and unguided paths by rendering both. The estimate of guiding takes paths for independent. But light that
//! varies little over a surface is integrated faster by stratified points, and directions from a histogram lose most of that.

use rayon::prelude::*;

use crate::film::PixelStats;
use crate::film::compare::relative_to;
use crate::integrator::{PixelSums, PixelTask, Transport, Wave, WaveCounts};
use crate::render::pass::sampler::{PATHS_PER_WAVE, with_buffers};
use crate::render::settings::RenderSettings;
use crate::sampling::hash;

/// Paths of the picture over those of the comparison.
const PICTURE_PATHS: f64 = 64.0;
/// Minimum and maximum pixels.
const PIXELS: [f64; 2] = [256.0, 16_384.0];
/// Maximum paths per pixel in each of two scrambles, whose difference is the error with stratified points.
const MAX_PATHS: u32 = 64;
/// The noisiest pixel of this number is left out of a second comparison: a few pixels can have most of the error, with guided
/// paths or without.
const TRIMMED: usize = 100;
/// Steps of the R2 sequence (Roberts 2018): the inverse of the plastic number, and its square.
const R2: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// Guided paths over unguided ones.
#[derive(Debug, Clone, Copy)]
pub struct Compared {
    /// Error with stratified points; the lesser of those with all pixels and without the noisiest ones.
    pub variance: f64,
    /// Rays.
    pub rays: f64,
}

/// Colours of a pixel in two scrambles.
pub type Colors = [[f32; 3]; 2];

/// Renders both in some of the picture's pixels. Those of a smaller picture would contain more edges, whose error is the same
/// with any directions. `None` soon after `stopped`.
pub fn compare(
    settings: &RenderSettings,
    guided: &Transport,
    unguided: &Transport,
    stopped: impl Fn() -> bool + Sync,
) -> Option<Compared> {
    let spp = settings.expected_spp();
    let paths = 1 << spp.clamp(1, MAX_PATHS).ilog2();
    let pixels = settings.pixels() * f64::from(spp) / PICTURE_PATHS / f64::from(4 * paths);
    let pixels = spread([settings.width, settings.height], pixels.clamp(PIXELS[0], PIXELS[1]) as u32);
    let of_group = |pixels: &[[u32; 2]]| {
        let both = |wave: &mut Wave| [guided, unguided].map(|transport| trace(wave, transport, pixels, paths));
        (!stopped()).then(|| with_buffers(|buffers| both(buffers.wave())))
    };
    let groups: Option<Vec<_>> = pixels.par_chunks((PATHS_PER_WAVE / paths) as usize).map(of_group).collect();
    let (mut errors, mut rays) = ([Vec::new(), Vec::new()], [0.0; 2]);
    for [guided, unguided] in groups? {
        for (guided, unguided) in guided.0.iter().zip(&unguided.0) {
            // The mean of all, so that noise favours neither.
            let divisors = [0, 1, 2].map(|c| {
                let sum: f32 = [guided, unguided].into_iter().flatten().map(|color| color[c]).sum();
                relative_to(f64::from(sum) / 4.0)
            });
            errors[0].extend(error(guided, divisors));
            errors[1].extend(error(unguided, divisors));
        }
        rays[0] += guided.1;
        rays[1] += unguided.1;
    }
    let [guided, unguided] = errors;
    Some(Compared { variance: remaining(guided, unguided), rays: rays[0] / rays[1].max(1.0) })
}

/// About so many pixels, all over a picture of this size.
pub fn spread(size: [u32; 2], pixels: u32) -> Vec<[u32; 2]> {
    let at = |i: u32, axis: usize| (R2[axis] * f64::from(i)).fract() * f64::from(size[axis]);
    (1..=pixels).map(|i| [0, 1].map(|axis| at(i, axis) as u32)).collect()
}

/// Colours of these pixels, and rays of their paths.
fn trace(wave: &mut Wave, transport: &Transport, pixels: &[[u32; 2]], paths: u32) -> (Vec<Colors>, f64) {
    let counts = transport.half(paths);
    let tasks: Vec<_> = pixels.iter().map(|pixel| PixelTask::first(*pixel, counts, 0)).collect();
    wave.counts = WaveCounts::default();
    let [a, b] = [0, 1].map(|scramble| {
        let transport = Transport { seed: hash(transport.seed ^ hash(0x636f_6d70 + scramble)), ..transport.clone() };
        let mut stats = vec![PixelStats::default(); tasks.len()];
        wave.run(&transport, &tasks, &mut PixelSums::new(&mut stats));
        stats
    });
    (a.iter().zip(&b).map(|(a, b)| [a.mean(), b.mean()]).collect(), wave.counts.rays() as f64)
}

/// The relative error of a pixel; `None` if a colour is not finite.
pub fn error([a, b]: &Colors, divisors: [f64; 3]) -> Option<f64> {
    let error: f64 = (0..3).map(|c| f64::from(a[c] - b[c]).powi(2) / divisors[c]).sum();
    error.is_finite().then_some(error)
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

    #[test]
    fn compared_pixels_lie_all_over_the_picture() {
        let size = [320, 240];
        let pixels = spread(size, 300);
        assert!(pixels.iter().all(|pixel| pixel[0] < size[0] && pixel[1] < size[1]));
        // Each of 48 equal parts has about 300 / 48.
        let mut counts = [0; 48];
        pixels.iter().for_each(|[x, y]| counts[(y / 40 * 8 + x / 40) as usize] += 1);
        assert!(counts.iter().all(|count| (4..=9).contains(count)), "{counts:?}");
    }
}
