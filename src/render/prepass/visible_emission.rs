//! The emission that the camera sees directly: light sources and the environment. Where their edges cross a pixel, few of its
//! paths meet a light of great radiance. A few paths do not see this variance, but neighbouring pixels show it. Such pixels get
//! several camera rays per path for this emission alone ([`emission_rays`](crate::integrator::through::emission_rays)).

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use glam::Vec3;
use half::f16;
use rayon::prelude::*;

use super::low_resolution::in_tiles;
use crate::balance::Counts;
use crate::color::luminance;
use crate::film::PixelStats;
use crate::film::compare::relative_to;
use crate::integrator::data::proposal::MAX_RAYS_PER_PATH;
use crate::integrator::{PixelSums, PixelTask, Transport, Wave};
use crate::lanes::F;
use crate::sampling::{FilterSampler, PixelFilter, hash};

/// Minimum mass of the pixel filter over a neighbour's column or row: an edge can also lie in the pixel itself.
const MIN_NEIGHBOR_MASS: f64 = 0.05;
/// Effect of stratification: of the variance of a light that covers p of the pixel, 1/(1 + c p (1 − p)) remains beside
/// independent points, because an edge crosses only √n of n strata. Fitted to relMSE of scenes with many small lights, one
/// textured light, and silhouettes of lights before black.
const STRATIFICATION: f64 = 192.0;
/// Stratified camera rays leave 1/n to this power of the variance.
const RAYS_EXPONENT: f64 = 1.5;
/// Emission gets camera rays of its own where its variance is at least this many times its mean times that of other light. A
/// camera ray finds either one or the other, hence their covariance is minus the product of their means: sampled separately,
/// they lose its help.
const MIN_CONTRAST: f64 = 4.0;

/// Camera rays of pixels beside an edge.
const EDGE_RAYS: u32 = 16;
/// The emitted luminance of neighbours differs at an edge by at least this many times the root of relMSE's divisor.
const MIN_EDGE: f64 = 2.0;
/// Pixels of a wave.
const PIXELS_PER_WAVE: usize = 128;

/// The emitted luminance that a path of a pixel sees.
#[derive(Debug, Clone, Copy)]
pub struct SeenEmission {
    /// Mean luminance of its camera rays.
    pub mean: f64,
    /// Variance of independent paths.
    variance: f64,
    /// What stratified points leave of it.
    stratified: f64,
}

/// Mean and root mean square of the emitted luminance that camera rays of a pixel found.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Emitted {
    mean: f16,
    rms: f16,
}

impl Emitted {
    fn of(stats: &PixelStats) -> Self {
        let n = f64::from(stats.samples.max(1));
        let luminance = |sum: [f64; 3]| luminance(Vec3::from(sum.map(|sum| (sum / n) as f32))).min(f32::MAX);
        let finite = |x: f32| if x.is_nan() { f16::ZERO } else { f16::from_f32(x.min(f16::MAX.to_f32())) };
        let mean = finite(luminance(stats.sum));
        // A pixel with one ray has no variance.
        Self { mean, rms: if stats.samples > 1 { finite(luminance(stats.sum_squared).sqrt()) } else { mean } }
    }

    fn from_bits(bits: u32) -> Self {
        Self { mean: f16::from_bits(bits as u16), rms: f16::from_bits((bits >> 16) as u16) }
    }

    fn to_bits(self) -> u32 {
        u32::from(self.mean.to_bits()) | u32::from(self.rms.to_bits()) << 16
    }
}

/// Emitted luminance in the pixels of a picture.
#[derive(Debug)]
pub struct VisibleEmission {
    size: [u32; 2],
    /// Row by row.
    pixels: Vec<Emitted>,
    /// Mass of the pixel filter along an axis: over the pixel itself, and over a neighbour.
    mass: [f64; 2],
}

impl VisibleEmission {
    /// Traces a camera ray for each pixel of a picture of this size, and [`EDGE_RAYS`] for each pixel beside an edge. `None` if
    /// all of the pixels see the same, and soon after `stop` is raised.
    pub fn new(transport: &Transport, size: [u32; 2], stop: &AtomicBool) -> Option<Self> {
        if transport.lights.environment.is_none() && transport.lights.area.is_none() {
            return None;
        }
        // A position anywhere in the pixel's square, and nothing behind the first surface.
        let filter = FilterSampler::new(PixelFilter::Box);
        let all: Vec<_> = (0..size[0] as usize * size[1] as usize).map(|_| AtomicU32::new(0)).collect();
        let trace = |rays: u32, seed: u32, is_traced: &(dyn Fn([u32; 2]) -> bool + Sync)| {
            let seed = hash(transport.seed ^ hash(seed));
            let seen = Transport { filter: filter.clone(), seed, max_depth: 1, ..transport.clone() };
            let of_tile = |wave: &mut Wave, mut pixels: Vec<[u32; 2]>| {
                pixels.retain(|at| is_traced(*at));
                for pixels in pixels.chunks(PIXELS_PER_WAVE) {
                    let task = |at: &[u32; 2]| PixelTask::first(*at, Counts::bsdf_only(rays), 0);
                    let tasks: Vec<_> = pixels.iter().map(task).collect();
                    let mut stats = vec![PixelStats::default(); tasks.len()];
                    wave.run(&seen, &tasks, &mut PixelSums::new(&mut stats));
                    for (at, stats) in pixels.iter().zip(&stats) {
                        // Each pixel belongs to one tile.
                        all[index(size, *at)].store(Emitted::of(stats).to_bits(), Ordering::Relaxed);
                    }
                }
            };
            in_tiles(size, stop, of_tile)
        };
        trace(1, 0x656d_6974, &|_| true)?;
        let mean = |at| Emitted::from_bits(all[index(size, at)].load(Ordering::Relaxed)).mean.to_f64();
        let row = |y| (0..size[0]).map(move |x| [x, y]);
        let pixels = (0..size[1]).into_par_iter().flat_map_iter(row);
        let is_edge: Vec<_> = pixels.map(|at| is_edge(neighbors(size, at).map(|(at, _)| mean(at)))).collect();
        trace(EDGE_RAYS, 0x6564_6765, &|at| is_edge[index(size, at)])?;
        drop(is_edge);
        // In place: large pictures are not in memory twice.
        let pixels: Vec<_> = all.into_iter().map(|bits| Emitted::from_bits(bits.into_inner())).collect();
        let differ = pixels.iter().any(|pixel| *pixel != pixels[0]);
        differ.then(|| Self { size, pixels, mass: mass(&transport.filter) })
    }

    /// The emission that paths of a pixel see.
    pub fn at(&self, at: [u32; 2]) -> SeenEmission {
        // Not 0: what is squared is a divisor.
        let (mut mean, mut square, mut max) = (0.0, 0.0, 1e-100);
        for (at, [dx, dy]) in neighbors(self.size, at) {
            let Emitted { mean: emitted, rms } = self.pixels[index(self.size, at)];
            let mass: f64 = self.mass[dx] * self.mass[dy];
            mean += mass * emitted.to_f64();
            square += mass * rms.to_f64() * rms.to_f64();
            max = rms.to_f64().max(max);
        }
        let variance = (square - mean * mean).max(0.0);
        SeenEmission { mean, variance, stratified: variance / (1.0 + STRATIFICATION * variance / (max * max)) }
    }
}

impl SeenEmission {
    /// Relative variance of what a path sees by `rays` camera rays, where other light has the mean luminance `scattered`.
    pub fn relative_variance(&self, scattered: f64, rays: u32) -> f64 {
        self.stratified / f64::from(rays).powf(RAYS_EXPONENT) / relative_to(self.mean + scattered)
    }

    /// Camera rays per path, a power of two: those that minimise the relative variance of the picture times its cost. `price` is
    /// the variance that a camera ray must save, > 0.
    pub fn rays_per_path(&self, scattered: f64, price: f64) -> u32 {
        if self.variance <= MIN_CONTRAST * self.mean * scattered {
            return 1;
        }
        // Where the derivative of V / n^a is the price.
        let rays = RAYS_EXPONENT * self.stratified / relative_to(self.mean + scattered) / price;
        let doublings = rays.log2() / (RAYS_EXPONENT + 1.0);
        // NaN, too, becomes 0.
        1 << (doublings.round().max(0.0) as u32).min(MAX_RAYS_PER_PATH.ilog2())
    }
}

/// Index of a pixel, row by row.
fn index([width, _]: [u32; 2], [x, y]: [u32; 2]) -> usize {
    y as usize * width as usize + x as usize
}

/// A pixel and its eight neighbours, at the border some of them twice, with their distances along both axes.
fn neighbors([width, height]: [u32; 2], [x, y]: [u32; 2]) -> impl Iterator<Item = ([u32; 2], [usize; 2])> {
    let near = |at: u32, end: u32| [(at.saturating_sub(1), 1), (at, 0), ((at + 1).min(end - 1), 1)];
    let columns = near(x, width);
    near(y, height).into_iter().flat_map(move |(y, dy)| columns.map(|(x, dx)| ([x, y], [dx, dy])))
}

/// Do emitted luminances of neighbours differ so much that it is most of a pixel's relative variance?
fn is_edge(luminance: impl Iterator<Item = f64>) -> bool {
    let (low, high) = luminance.fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    high - low > MIN_EDGE * relative_to(low).sqrt()
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
        let pixel = |x: &f32| Emitted::of(&PixelStats { samples: 1, sum: [f64::from(*x); 3], ..Default::default() });
        let row: Vec<_> = luminance.iter().map(pixel).collect();
        let size = [luminance.len() as u32, height];
        VisibleEmission { size, pixels: row.repeat(height as usize), mass: mass(&filter) }
    }

    #[test]
    fn pixels_beside_a_light_have_the_variance_and_no_others() {
        let seen = columns(&[0.0, 0.0, 5.0, 5.0, 5.0, 0.0, 0.0]);
        let of = |x| seen.at([x, 1]).relative_variance(0.1, 1);
        assert_eq!([of(0), of(3), of(6)], [0.0; 3]);
        // The dark side of the edge has the mean of a few paths, to which the variance is relative.
        assert!(of(1) > 10.0 * of(2) && of(2) > 0.0, "{} {}", of(1), of(2));
        assert!(of(1) == of(5) && of(2) == of(4));
        // Light from elsewhere hides it.
        assert!(seen.at([1, 1]).relative_variance(10.0, 1) < 0.1 * of(1));
        assert!((columns(&[2.0; 5]).at([2, 2]).mean - 2.0).abs() < 1e-12);
    }

    #[test]
    fn camera_rays_go_where_light_begins_unless_other_light_is_as_bright() {
        let seen = columns(&[0.0, 0.0, 5.0, 5.0, 5.0, 0.0, 0.0]);
        let of = |scattered, price| (0..7).map(|x| seen.at([x, 1]).rays_per_path(scattered, price)).collect::<Vec<_>>();
        let dark = of(0.01, 1e-4);
        assert!(dark[1] > 8 && dark[5] == dark[1] && [dark[0], dark[3], dark[6]] == [1; 3], "{dark:?}");
        // Camera rays that find other light as bright see no less.
        assert_eq!(of(2.0, 1e-4), [1; 7]);
        // The dearer, the fewer.
        assert_eq!(of(0.01, f64::INFINITY), [1; 7]);
        assert!(of(0.01, 1.0)[1] < dark[1]);
        assert_eq!(of(0.01, 0.0)[1], MAX_RAYS_PER_PATH);
        assert_eq!(columns(&[0.0; 3]).at([1, 1]).rays_per_path(0.0, 0.0), 1);
    }

    #[test]
    fn no_light_is_too_bright_or_too_dark_for_it() {
        for light in [f32::MAX, f32::MIN_POSITIVE, 0.0] {
            let seen = columns(&[0.0, light, 0.0]);
            let all = [0, 1, 2].map(|x| seen.at([x, 0]).relative_variance(0.0, 1));
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
