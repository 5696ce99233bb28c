//! The pixels of a picture's window, and the film that holds them.

use serde::{Deserialize, Serialize};

use super::stats::{AovSums, ExtraSums, PixelStats};

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
