//! The view of pre-passes: that of the picture, with fewer pixels.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::color::luminance;
use crate::film::PixelStats;
use crate::film::compare::relative_to;
use crate::integrator::{CameraRays, PixelTask, PreparedScene, Wave};
use crate::render::settings::RenderSettings;
use crate::render::settings::camera::{camera_of_size, lens};

/// Side of a tile in pixels.
const TILE: u32 = 32;
/// Side of a block in pixels. The divisor of relMSE is the same for a whole block.
const BLOCK: u32 = 8;

/// A view of about `pixels` pixels, not larger than the picture: its width and height, and its camera.
pub fn low_resolution(scene: &PreparedScene, settings: &RenderSettings, pixels: f64) -> ([u32; 2], CameraRays) {
    let scale = (pixels / settings.pixels()).sqrt().min(1.0);
    let size = [settings.width, settings.height].map(|n| (f64::from(n) * scale).ceil().max(1.0) as u32);
    let camera = camera_of_size(&scene.scene, settings, size);
    (size, camera.with_lens(lens(scene, settings).unwrap_or_default()))
}

/// The upper left pixels of a picture's tiles.
pub fn tiles([width, height]: [u32; 2]) -> Vec<[u32; 2]> {
    let row = |y| (0..width).step_by(TILE as usize).map(move |x| [x, y]);
    (0..height).step_by(TILE as usize).flat_map(row).collect()
}

/// Calls `of_tile` with the pixels of each tile, block by block, and a wave. The results are in the order of [`tiles`]; `None` if
/// `stop` was raised. There are as many waves as tiles in work at a time. With a wave of each thread's own, the few tiles of a
/// pre-pass would leave one in every thread.
pub fn in_tiles<T: Send>(
    size: [u32; 2],
    stop: &AtomicBool,
    of_tile: impl Fn(&mut Wave, Vec<[u32; 2]>) -> T + Sync,
) -> Option<Vec<T>> {
    let [width, height] = size;
    let pixels = |[x0, y0]: [u32; 2]| {
        let row = move |y| (x0..width.min(x0 + TILE)).map(move |x| [x, y]);
        let mut pixels: Vec<_> = (y0..height.min(y0 + TILE)).flat_map(row).collect();
        pixels.sort_by_key(block);
        pixels
    };
    let free = Mutex::new(Vec::new());
    let free = || free.lock().unwrap_or_else(PoisonError::into_inner);
    let take = |tile| {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let mut wave: Wave = free().pop().unwrap_or_default();
        let found = of_tile(&mut wave, pixels(tile));
        free().push(wave);
        Some(found)
    };
    tiles(size).into_par_iter().with_max_len(1).map(take).collect()
}

/// Which block of pixels a pixel is in.
fn block(&[x, y]: &[u32; 2]) -> [u32; 2] {
    [y / BLOCK, x / BLOCK]
}

/// The divisor of relMSE for each pixel, from the mean of its block: the few paths of one pixel do not estimate its own.
/// Tasks must be ordered by block.
pub fn divisors(tasks: &[PixelTask], stats: &[PixelStats]) -> Vec<f32> {
    let alike = |a: &PixelTask, b: &PixelTask| block(&[a.x, a.y]) == block(&[b.x, b.y]);
    let mut stats = stats.iter();
    let of_block = |tasks: &[PixelTask]| {
        let sum: f64 = stats.by_ref().take(tasks.len()).map(|s| f64::from(luminance(s.mean().into()))).sum();
        vec![relative_to(sum / tasks.len() as f64) as f32; tasks.len()]
    };
    tasks.chunk_by(alike).flat_map(of_block).collect()
}
