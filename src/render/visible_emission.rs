//! The emission that the camera sees directly: light sources and the environment. Where their edges cross a pixel, few of its
//! paths meet a light of great radiance. A few paths do not see this variance, but neighbouring pixels show it.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use super::prepass::low_resolution::in_tiles;
use crate::balance::Counts;
use crate::color::luminance;
use crate::film::PixelStats;
use crate::film::compare::relative_to;
use crate::integrator::{PixelSums, PixelTask, Transport, Wave};
use crate::lanes::F;
use crate::sampling::{FilterSampler, PixelFilter, hash};

/// Minimum mass of the pixel filter over a neighbour's column or row: an edge can also lie in the pixel itself.
const MIN_NEIGHBOR_MASS: f64 = 0.05;
/// Effect of stratification: of the variance of a light that covers p of the pixel, 1/(1 + c p (1 − p)) remains beside
/// independent points, because an edge crosses only √n of n strata. Fitted to relMSE of scenes with many small lights, one
/// textured light, and silhouettes of lights before black.
const STRATIFICATION: f64 = 192.0;

/// Emitted luminance in the pixels of a picture, by one path each.
#[derive(Debug)]
pub struct VisibleEmission {
    size: [u32; 2],
    /// Row by row.
    luminance: Vec<f32>,
    /// Mass of the pixel filter along an axis: over the pixel itself, and over a neighbour.
    mass: [f64; 2],
}

impl VisibleEmission {
    /// Traces one camera ray for each pixel of a picture of this size. `None` if all of them see the same, and soon after `stop`
    /// is raised.
    pub fn new(transport: &Transport, size: [u32; 2], stop: &AtomicBool) -> Option<Self> {
        if !transport.lights.has_extent() {
            return None;
        }
        // A position anywhere in the pixel's square, and nothing behind the first surface.
        let filter = FilterSampler::new(PixelFilter::Box);
        let seed = hash(transport.seed ^ hash(0x656d_6974));
        let seen = Transport { filter, seed, max_depth: 1, ..transport.clone() };
        let all: Vec<_> = (0..size[0] as usize * size[1] as usize).map(|_| AtomicU32::new(0)).collect();
        let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
            let tasks: Vec<_> = pixels.iter().map(|&pixel| PixelTask::first(pixel, Counts::bsdf_only(1), 0)).collect();
            let mut stats = vec![PixelStats::default(); tasks.len()];
            wave.run(&seen, &tasks, &mut PixelSums::new(&mut stats));
            for ([x, y], stats) in pixels.into_iter().zip(stats) {
                let luminance = luminance(stats.mean().into());
                let luminance = if luminance.is_finite() { luminance } else { 0.0 };
                // Each pixel belongs to one tile.
                all[y as usize * size[0] as usize + x as usize].store(luminance.to_bits(), Ordering::Relaxed);
            }
        };
        in_tiles(size, stop, of_tile)?;
        // In place: large pictures are not in memory twice.
        let all: Vec<_> = all.into_iter().map(|luminance| f32::from_bits(luminance.into_inner())).collect();
        let differ = all.iter().any(|luminance| *luminance != all[0]);
        differ.then(|| Self { size, luminance: all, mass: mass(&transport.filter) })
    }

    /// Mean and variance of the emitted luminance that a path of pixel (`x`, `y`) sees, as stratified points leave it.
    fn moments(&self, x: u32, y: u32) -> [f64; 2] {
        let [width, height] = self.size;
        let near = |at: u32, end: u32| [(at.saturating_sub(1), 1), (at, 0), ((at + 1).min(end - 1), 1)];
        // Not 0: what is squared is a divisor.
        let (mut mean, mut square, mut max) = (0.0, 0.0, 1e-100);
        for (row, dy) in near(y, height) {
            for (column, dx) in near(x, width) {
                let emitted = f64::from(self.luminance[row as usize * width as usize + column as usize]);
                let mass: f64 = self.mass[dx] * self.mass[dy];
                mean += mass * emitted;
                square += mass * emitted * emitted;
                max = emitted.max(max);
            }
        }
        let variance = (square - mean * mean).max(0.0);
        [mean, variance / (1.0 + STRATIFICATION * variance / (max * max))]
    }

    /// Mean emitted luminance that paths of a pixel see.
    pub fn mean(&self, [x, y]: [u32; 2]) -> f64 {
        self.moments(x, y)[0]
    }

    /// Relative variance of the emission that a path of a pixel sees, where other light has the mean luminance `scattered`.
    pub fn relative_variance(&self, [x, y]: [u32; 2], scattered: f64) -> f64 {
        let [mean, variance] = self.moments(x, y);
        variance / relative_to(mean + scattered)
    }
}

/// Mass of a filter along an axis: over the pixel itself, and over a neighbour.
fn mass(filter: &FilterSampler) -> [f64; 2] {
    const N: usize = 256;
    let inside = |i: usize| filter.offsets(F::splat((i as f32 + 0.5) / N as f32)).as_array()[0].abs() < 0.5;
    let own = (0..N).filter(|i| inside(*i)).count() as f64 / N as f64;
    let neighbor = (0.5 * (1.0 - own)).max(MIN_NEIGHBOR_MASS);
    [1.0 - 2.0 * neighbor, neighbor]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture with this luminance by column.
    fn columns(luminance: &[f32]) -> VisibleEmission {
        let height = 4;
        let filter = FilterSampler::new(PixelFilter::Gaussian);
        VisibleEmission {
            size: [luminance.len() as u32, height],
            luminance: luminance.repeat(height as usize),
            mass: mass(&filter),
        }
    }

    #[test]
    fn pixels_beside_a_light_have_the_variance_and_no_others() {
        let seen = columns(&[0.0, 0.0, 5.0, 5.0, 5.0, 0.0, 0.0]);
        let of = |x| seen.relative_variance([x, 1], 0.1);
        assert_eq!([of(0), of(3), of(6)], [0.0; 3]);
        // The dark side of the edge has the mean of a few paths, to which the variance is relative.
        assert!(of(1) > 10.0 * of(2) && of(2) > 0.0, "{} {}", of(1), of(2));
        assert!(of(1) == of(5) && of(2) == of(4));
        // Light from elsewhere hides it.
        assert!(seen.relative_variance([1, 1], 10.0) < 0.1 * of(1));
        assert!((columns(&[2.0; 5]).mean([2, 2]) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn no_light_is_too_bright_or_too_dark_for_it() {
        for light in [f32::MAX, f32::MIN_POSITIVE, 0.0] {
            let seen = columns(&[0.0, light, 0.0]);
            let all = [0, 1, 2].map(|x| seen.relative_variance([x, 0], 0.0));
            assert!(all.iter().all(|v| v.is_finite() && *v >= 0.0), "{light}: {all:?}");
        }
    }

    #[test]
    fn the_filter_reaches_the_neighbours_by_its_mass() {
        // Gaussian of standard deviation ½, cut at 3/2: erf(1/√2) and erf(3/√2).
        let [own, neighbor] = mass(&FilterSampler::new(PixelFilter::Gaussian));
        assert!((own - 0.682_689 / 0.997_300).abs() < 1.0 / 128.0, "{own}");
        assert!((own + 2.0 * neighbor - 1.0).abs() < 1e-12);
        assert_eq!(mass(&FilterSampler::new(PixelFilter::Box)), [1.0 - 2.0 * MIN_NEIGHBOR_MASS, MIN_NEIGHBOR_MASS]);
    }
}
