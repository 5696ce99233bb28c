//! The pixels of a picture's window, and the film that holds them.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::stats::{AovSums, ExtraSums, PixelStats};

/// The background, where camera rays hit nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Black, without an environment. A is the fraction of paths that hit a surface.
    #[default]
    Black,
    /// The environment: A is 1.
    Environment,
    /// Nothing, with or without an environment that illuminates the scene. A is the fraction of paths that hit a surface, and PNGs
    /// have an alpha channel too.
    Transparent,
}

/// The statistics of the pixels of a picture's window, from which files are written.
pub trait Pixels: Sync {
    /// Width and height of the whole picture in pixels.
    fn size(&self) -> [u32; 2];

    /// The window in pixels: x0, y0, x1, y1 with x1 and y1 exclusive.
    fn window(&self) -> [u32; 4];

    /// Whether there are [`AovSums`].
    fn has_aovs(&self) -> bool;

    /// The extra sums of pixel (x, y) of the whole picture; `None` if there are none.
    fn extras(&self, _x: u32, _y: u32) -> Option<Cow<'_, ExtraSums>> {
        None
    }

    /// Names of the groups or kinds of lights that divide the beauty; empty if it is not divided.
    fn light_groups(&self) -> &[String] {
        &[]
    }

    /// Sum over paths of the light of a group, linear RGB, of pixel (x, y) of the whole picture.
    fn light(&self, _x: u32, _y: u32, _group: usize) -> [f32; 3] {
        [0.0; 3]
    }

    /// The light share α of pixel (x, y) of the whole picture, in [0, 1]: the fraction of samples that are light samples.
    fn light_share(&self, _x: u32, _y: u32) -> f32 {
        0.5
    }

    fn background(&self) -> Background;

    /// The statistics of pixel (x, y) of the whole picture, inside the window. The AOV sums are zeros if there are none.
    fn at(&self, x: u32, y: u32) -> (PixelStats, AovSums);
}

/// The positions of the window's pixels, row by row.
pub fn positions(pixels: &dyn Pixels) -> impl Iterator<Item = (u32, u32)> + use<> {
    let [x0, y0, x1, y1] = pixels.window();
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (x, y)))
}

/// Width of the window in pixels, and the pixels' mean radiance (linear RGB), row by row.
pub fn colors(pixels: &dyn Pixels) -> (usize, impl Iterator<Item = [f32; 3]>) {
    let [x0, _, x1, _] = pixels.window();
    ((x1 - x0) as usize, positions(pixels).map(|(x, y)| pixels.at(x, y).0.mean()))
}

/// The statistics of a picture's window, row by row.
#[derive(Debug, Clone, Default)]
pub struct Film {
    /// Width of the whole picture in pixels.
    pub width: u32,
    /// Height of the whole picture in pixels.
    pub height: u32,
    /// The window in pixels: x0, y0, x1, y1 with x1 and y1 exclusive.
    pub window: [u32; 4],
    /// Pixel statistics, row-major over the window.
    pub pixels: Vec<PixelStats>,
    /// AOV sums, row-major over the window; empty if no AOV needs them.
    pub aovs: Vec<AovSums>,
    pub background: Background,
}

impl Film {
    /// Copies pixels.
    pub fn of(pixels: &dyn Pixels) -> Self {
        let (window, [width, height]) = (pixels.window(), pixels.size());
        let (stats, mut aovs): (Vec<_>, Vec<_>) = positions(pixels).map(|(x, y)| pixels.at(x, y)).unzip();
        if !pixels.has_aovs() {
            aovs = Vec::new();
        }
        Self { width, height, window, pixels: stats, aovs, background: pixels.background() }
    }

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
