//! Detection of fireflies: pixels that a single path has made much brighter than their neighbours.

use glam::Vec3;
use serde::Serialize;

use super::rendered::Rendered;
use crate::color::luminance;

/// Maximum number of fireflies that are listed.
const MAX_REPORTED: usize = 8;
/// Pixels with fewer paths are not examined.
const MIN_PATHS: u32 = 8;
/// A firefly has more than this fraction of its luminance from one path.
const MIN_PATH_FRACTION: f64 = 0.5;
/// A firefly is more than this many times as bright as all but two of its eight neighbours. Two, as a neighbour may be a
/// firefly too; at edges and corners of bright objects more neighbours are bright.
const MIN_CONTRAST: f32 = 3.0;

/// A pixel and the path that made it bright.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spot {
    /// Column in the whole picture.
    pub x: u32,
    /// Row in the whole picture.
    pub y: u32,
    /// The path's number, as `--replay-pixel` takes it.
    pub path: u32,
    /// Luminance of the path.
    pub luminance: f32,
}

/// The fireflies of a picture.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Fireflies {
    /// How many there are.
    pub count: u64,
    /// Fireflies per million pixels.
    pub per_megapixel: f64,
    /// The brightest ones, at most eight, in descending order.
    pub brightest: Vec<Spot>,
}

impl Fireflies {
    /// Finds the fireflies in a picture's window.
    pub fn of(rendered: &Rendered) -> Self {
        let window @ [x0, y0, x1, y1] = rendered.settings.window();
        let (width, height) = ((x1 - x0) as usize, (y1 - y0) as usize);
        let mut shown = vec![0.0_f32; width * height];
        let place = |x: u32, y: u32| (y - y0) as usize * width + (x - x0) as usize;
        let mut suspects = Vec::new();
        for tile in &rendered.tiles {
            for (x, y, i) in tile.inside(window) {
                let stats = &tile.stats[i];
                let light = luminance(Vec3::from(stats.mean()));
                shown[place(x, y)] = if light.is_finite() { light } else { 0.0 };
                let peak = tile.peaks[i];
                let total = f64::from(light) * f64::from(stats.samples);
                if stats.samples >= MIN_PATHS && f64::from(peak.luminance) > MIN_PATH_FRACTION * total {
                    suspects.push(Spot { x, y, path: peak.path, luminance: peak.luminance });
                }
            }
        }
        let is_alone = |spot: &Spot| {
            let (x, y) = ((spot.x - x0) as usize, (spot.y - y0) as usize);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let around = rows.flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| (u, v)));
            let mut around: Vec<f32> = around.filter(|at| *at != (x, y)).map(|(u, v)| shown[v * width + u]).collect();
            around.sort_unstable_by(|a, b| b.total_cmp(a));
            shown[y * width + x] > MIN_CONTRAST * around.get(2).copied().unwrap_or(f32::INFINITY)
        };
        suspects.retain(is_alone);
        suspects.sort_by(|a, b| b.luminance.total_cmp(&a.luminance).then((a.y, a.x).cmp(&(b.y, b.x))));
        let count = suspects.len() as u64;
        suspects.truncate(MAX_REPORTED);
        Self { count, per_megapixel: count as f64 * 1e6 / (width * height) as f64, brightest: suspects }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Background, Peak};
    use crate::render::{RenderSettings, RenderStats, StopReason, fresh_tiles};

    #[test]
    fn a_pixel_that_one_path_has_made_is_found_and_what_many_make_is_not() {
        let settings = RenderSettings { width: 40, height: 30, crop: Some([3, 2, 40, 30]), ..Default::default() };
        let mut tiles = fresh_tiles(&settings);
        // Grey 1 with an area light of 50 whose corner is thin; every path of a pixel the same.
        for tile in &mut tiles {
            for (x, y, i) in tile.inside([0, 0, 40, 30]).collect::<Vec<_>>() {
                let light = if x > 30 && y > 20 { 50.0 } else { 1.0 };
                tile.stats[i].samples = 32;
                tile.stats[i].sum = [32.0 * light; 3];
                tile.peaks[i] = Peak { luminance: light as f32, path: 3 };
                // Two by each other, one at the window's edge; one that is bright but among bright ones.
                if [(10, 12), (11, 12), (3, 2), (35, 25)].contains(&(x, y)) {
                    tile.stats[i].sum = [32.0 * light + 2000.0; 3];
                    tile.peaks[i] = Peak { luminance: 2000.0 + x as f32, path: x };
                }
            }
        }
        let (stats, stop, background) = (RenderStats::default(), StopReason::Samples, Background::Black);
        let found = Fireflies::of(&Rendered { settings, tiles, stats, goals: Vec::new(), stop, background });
        let places: Vec<_> = found.brightest.iter().map(|spot| (spot.x, spot.y, spot.path)).collect();
        assert_eq!(places, [(11, 12, 11), (10, 12, 10), (3, 2, 3)]);
        assert_eq!(found.count, 3);
        assert!((found.per_megapixel - 3e6 / (37.0 * 28.0)).abs() < 1e-9);
    }
}
