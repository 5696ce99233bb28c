//! Per-pixel statistics and what becomes of them: EXR, PNG, comparison.

pub mod aov;
pub mod atomic;
pub mod compare;
pub mod cryptomatte;
pub mod denoise;
pub mod exposure;
pub mod exr_file;
pub mod flip;
pub mod lock;
pub mod picture;
pub mod preview;
pub mod view;

use cryptomatte::Matte;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

pub use aov::Aov;
pub use exposure::Exposure;
pub use picture::Picture;
pub use preview::Look;
pub use view::View;

/// What one pixel has collected. Every sample belongs to one pixel.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct PixelStats {
    /// Paths so far.
    pub samples: u32,
    /// Sum over paths of radiance, linear RGB.
    pub sum: [f64; 3],
    /// Sum over paths of radiance squared, a channel.
    pub sum_squared: [f64; 3],
    /// Paths whose camera ray hit a surface.
    pub covered: u32,
    /// The share of light samples α that the next pass would use, in [0, 1].
    pub balance: f32,
}

/// The brightest path of a pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Peak {
    /// Of its radiance.
    pub luminance: f32,
    /// Its number in the pixel.
    pub path: u32,
}

impl Peak {
    /// Takes another path in; the first of equals stays.
    #[inline]
    pub fn add(&mut self, luminance: f32, path: u32) {
        if luminance > self.luminance {
            *self = Self { luminance, path };
        }
    }
}

/// Optional sums over paths, kept only when an AOV asks for them.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct AovSums {
    /// Base colour at the first hit.
    pub albedo: [f32; 3],
    /// Unit world-space shading normal at the first hit.
    pub normal: [f32; 3],
    /// Distance to the first hit in metres, summed over `covered` paths.
    pub depth: f32,
    /// Radiance from lights seen directly and one bounce of them.
    pub direct: [f32; 3],
    /// The rest of the radiance.
    pub indirect: [f32; 3],
    /// Instance index + 1 of the last path that hit one, 0 for none.
    pub object: u32,
    /// Material index + 1 of the last path that hit one, 0 for none.
    pub material: u32,
}

/// More optional sums over paths, kept only when an AOV asks for one of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ExtraSums {
    /// World space position of the first hit in metres, over `covered` paths.
    pub position: [f32; 3],
    /// The first hit's TEXCOORD_0, over `covered` paths.
    pub uv: [f32; 2],
    /// Radiance that the surface of the first hit emits.
    pub emission: [f32; 3],
    /// Base colour of the first hit, seen in mirrors where it is one.
    pub guide_albedo: [f32; 3],
    /// Unit normal of the same surface.
    pub guide_normal: [f32; 3],
    /// Radiance by what it came from: environment, surfaces that shine, lights without size.
    pub lights: [[f32; 3]; 3],
    /// Names of objects that paths hit first.
    pub objects: Matte,
    /// Names of materials that paths hit first.
    pub materials: Matte,
    /// Pixels from the frame before to the first hit, and from there to the next frame, to the right and up, over `covered`
    /// paths. Saved apart: files without them are as they were.
    #[serde(skip)]
    pub velocity: [f32; 4],
}

/// Adds a colour to a sum.
fn accumulate(sum: &mut [f32; 3], more: [f32; 3]) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

impl ExtraSums {
    /// Adds light of a group: 0 from the environment, 1 from surfaces, 2 from lights without size.
    #[inline]
    pub fn add_light(&mut self, group: usize, radiance: Vec3) {
        accumulate(&mut self.lights[group], radiance.to_array());
    }

    /// Adds radiance that the surface of a first hit emits.
    #[inline]
    pub fn add_emission(&mut self, radiance: Vec3) {
        accumulate(&mut self.emission, radiance.to_array());
    }

    /// Adds what a path's camera ray hit: position, texture coordinates, hashes of the names of object and material.
    #[inline]
    pub fn add_surface(&mut self, position: Vec3, uv: Vec2, [object, material]: [u32; 2]) {
        accumulate(&mut self.position, position.to_array());
        self.uv = [self.uv[0] + uv.x, self.uv[1] + uv.y];
        self.objects.add(object, 1);
        self.materials.add(material, 1);
    }

    /// Adds how the surface of a first hit moves in the picture.
    #[inline]
    pub fn add_velocity(&mut self, [before, after]: [Vec2; 2]) {
        let more = [before.x, before.y, after.x, after.y];
        self.velocity.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    }

    /// Adds light of unknown origin to all groups, in proportion to what they have.
    #[inline]
    pub fn share_light(&mut self, more: Vec3) {
        for c in 0..3 {
            let all: f32 = self.lights.iter().map(|light| light[c]).sum();
            if all > 0.0 {
                self.lights.iter_mut().for_each(|light| light[c] *= (all + more[c]) / all);
            }
        }
    }

    /// Adds the surface that a denoiser is to be guided by.
    #[inline]
    pub fn add_guide(&mut self, albedo: Vec3, normal: Vec3) {
        accumulate(&mut self.guide_albedo, albedo.to_array());
        accumulate(&mut self.guide_normal, normal.to_array());
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        accumulate(&mut self.position, other.position);
        accumulate(&mut self.emission, other.emission);
        accumulate(&mut self.guide_albedo, other.guide_albedo);
        accumulate(&mut self.guide_normal, other.guide_normal);
        self.uv.iter_mut().zip(other.uv).for_each(|(sum, more)| *sum += more);
        self.lights.iter_mut().zip(other.lights).for_each(|(sum, more)| accumulate(sum, more));
        self.velocity.iter_mut().zip(other.velocity).for_each(|(sum, more)| *sum += more);
        self.objects.join(&other.objects);
        self.materials.join(&other.materials);
    }
}

/// What is shown where camera rays hit nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// There is no environment: black, and A is the share of paths that hit something.
    #[default]
    Black,
    /// The environment: A is 1.
    Environment,
    /// The environment gives light, but is left out of the picture; A as for `Black`, and PNGs have it too.
    Transparent,
}

/// How noise is taken out of a finished picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Denoise {
    /// Intel's Open Image Denoise, where it is installed.
    Oidn,
}

/// What the pixels of a picture's window have collected, wherever it is kept: what files are written from.
pub trait Pixels: Sync {
    /// Whole picture's pixels a row, and rows.
    fn size(&self) -> [u32; 2];

    /// The window that is kept: x0, y0, x1, y1 with x1 and y1 exclusive.
    fn window(&self) -> [u32; 4];

    /// Are there sums for AOVs?
    fn has_aovs(&self) -> bool;

    /// More sums of that pixel; `None` if there are none.
    fn extras(&self, _x: u32, _y: u32) -> Option<ExtraSums> {
        None
    }

    /// What is behind everything.
    fn background(&self) -> Background;

    /// Of the pixel in column x and row y of the whole picture, inside the window. Without sums for AOVs, zeros.
    fn at(&self, x: u32, y: u32) -> (PixelStats, AovSums);
}

/// Mean radiance of the pixels, row by row.
pub fn colors(pixels: &dyn Pixels) -> impl Iterator<Item = [f32; 3]> {
    let [x0, y0, x1, y1] = pixels.window();
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| pixels.at(x, y).0.mean()))
}

/// The beauty without its noise, row by row, guided by albedo and normals; pixels must have extra sums.
///
/// # Errors
/// As [`Denoiser::denoise`](denoise::Denoiser::denoise).
pub fn denoised(denoiser: &denoise::Denoiser, pixels: &dyn Pixels) -> crate::Result<Vec<[f32; 3]>> {
    let [x0, y0, x1, y1] = pixels.window();
    let (mut color, mut albedo, mut normal) = (Vec::new(), Vec::new(), Vec::new());
    for (x, y) in (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))) {
        let (stats, extras) = (pixels.at(x, y).0, pixels.extras(x, y).unwrap_or_default());
        let n = stats.samples.max(1) as f32;
        color.push(stats.mean());
        albedo.push(extras.guide_albedo.map(|sum| (sum / n).clamp(0.0, 1.0)));
        normal.push(extras.guide_normal.map(|sum| sum / n));
    }
    denoiser.denoise(denoise::Noisy { width: (x1 - x0) as usize, color: &color, albedo: &albedo, normal: &normal })
}

/// The statistics of a picture's window, row by row.
#[derive(Debug, Clone, Default)]
pub struct Film {
    /// Whole picture's pixels a row.
    pub width: u32,
    /// Whole picture's rows.
    pub height: u32,
    /// The window that is kept: x0, y0, x1, y1 with x1 and y1 exclusive.
    pub window: [u32; 4],
    /// Row-major over the window.
    pub pixels: Vec<PixelStats>,
    /// As `pixels`, or empty when no AOV needs it.
    pub aovs: Vec<AovSums>,
    /// What is behind everything.
    pub background: Background,
}

impl PixelStats {
    /// Of a pixel without paths.
    pub const EMPTY: Self = Self { samples: 0, sum: [0.0; 3], sum_squared: [0.0; 3], covered: 0, balance: 0.5 };

    /// Adds a path's radiance; `covered` if its camera ray hit a surface.
    #[inline]
    pub fn add(&mut self, radiance: Vec3, covered: bool) {
        self.samples += 1;
        self.covered += u32::from(covered);
        for c in 0..3 {
            let x = f64::from(radiance[c]);
            self.sum[c] += x;
            self.sum_squared[c] += x * x;
        }
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        let share = f64::from(other.samples) / f64::from((self.samples + other.samples).max(1));
        self.balance += ((other.balance - self.balance) as f64 * share) as f32;
        self.samples += other.samples;
        self.covered += other.covered;
        for c in 0..3 {
            self.sum[c] += other.sum[c];
            self.sum_squared[c] += other.sum_squared[c];
        }
    }

    /// Mean radiance; black without samples.
    pub fn mean(&self) -> [f32; 3] {
        let n = f64::from(self.samples.max(1));
        self.sum.map(|s| (s / n) as f32)
    }

    /// Share of paths that hit something, in [0, 1].
    pub fn coverage(&self) -> f32 {
        self.covered as f32 / self.samples.max(1) as f32
    }

    /// Estimated variance of [`mean`](Self::mean), a channel: the paths' sample variance over their number. Paths of
    /// a low-discrepancy sequence do better than that, so it errs on the high side. Infinite below two samples.
    pub fn variance_of_mean(&self) -> [f32; 3] {
        if self.samples < 2 {
            return [f32::INFINITY; 3];
        }
        let n = f64::from(self.samples);
        std::array::from_fn(|c| {
            let mean = self.sum[c] / n;
            ((self.sum_squared[c] / n - mean * mean).max(0.0) / (n - 1.0)) as f32
        })
    }
}

impl AovSums {
    /// Adds what a path's camera ray hit: base colour, unit normal, distance.
    #[inline]
    pub fn add_surface(&mut self, albedo: Vec3, normal: Vec3, depth: f32) {
        for c in 0..3 {
            self.albedo[c] += albedo[c];
            self.normal[c] += normal[c];
        }
        self.depth += depth;
    }

    /// Adds a path's light.
    #[inline]
    pub fn add_light(&mut self, direct: Vec3, indirect: Vec3) {
        for c in 0..3 {
            self.direct[c] += direct[c];
            self.indirect[c] += indirect[c];
        }
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        for c in 0..3 {
            self.albedo[c] += other.albedo[c];
            self.normal[c] += other.normal[c];
            self.direct[c] += other.direct[c];
            self.indirect[c] += other.indirect[c];
        }
        self.depth += other.depth;
        self.object = if self.object == 0 { other.object } else { self.object };
        self.material = if self.material == 0 { other.material } else { self.material };
    }
}

impl Film {
    /// A copy of pixels.
    pub fn of(pixels: &dyn Pixels) -> Self {
        let window @ [x0, y0, x1, y1] = pixels.window();
        let [width, height] = pixels.size();
        let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
        let (stats, mut aovs): (Vec<_>, Vec<_>) = places.map(|(x, y)| pixels.at(x, y)).unzip();
        if !pixels.has_aovs() {
            aovs = Vec::new();
        }
        Self { width, height, window, pixels: stats, aovs, background: pixels.background() }
    }

    /// An empty film.
    pub fn new(width: u32, height: u32, window: [u32; 4], with_aovs: bool) -> Self {
        let n = (window[2] - window[0]) as usize * (window[3] - window[1]) as usize;
        Self {
            width,
            height,
            window,
            pixels: vec![PixelStats::EMPTY; n],
            aovs: if with_aovs { vec![AovSums::default(); n] } else { Vec::new() },
            background: Background::default(),
        }
    }
}

impl Pixels for Film {
    fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    fn window(&self) -> [u32; 4] {
        self.window
    }

    fn has_aovs(&self) -> bool {
        !self.aovs.is_empty()
    }

    fn background(&self) -> Background {
        self.background
    }

    fn at(&self, x: u32, y: u32) -> (PixelStats, AovSums) {
        let [x0, y0, x1, _] = self.window;
        let i = (y - y0) as usize * (x1 - x0) as usize + (x - x0) as usize;
        (self.pixels[i], self.aovs.get(i).copied().unwrap_or_default())
    }
}
