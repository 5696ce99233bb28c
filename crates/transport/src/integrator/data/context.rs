//! The state of a wave.

use super::path_states::PathState;
use super::task::PixelTask;
use super::transport::Transport;

/// The state of a wave when an event occurs.
#[derive(Clone, Copy)]
pub struct WaveContext<'a> {
    pub transport: &'a Transport<'a>,
    pub tasks: &'a [PixelTask],
    /// The paths, pixel by pixel.
    pub paths: &'a [PathState],
    /// Number of path segments before the current rays: 0 for camera rays.
    pub depth: u32,
}

impl<'a> WaveContext<'a> {
    /// A column of the paths, pixel by pixel: each pixel's task and its paths' elements.
    pub fn by_pixel<'b, T>(&self, column: &'b [T]) -> impl Iterator<Item = (&'a PixelTask, &'b [T])> + use<'a, 'b, T> {
        let mut rest = column;
        self.tasks.iter().map(move |task| {
            let (paths, others) = rest.split_at(task.counts.paths as usize);
            rest = others;
            (task, paths)
        })
    }

    /// Index of a path's pixel in the wave.
    #[inline]
    pub fn pixel(&self, path: u32) -> usize {
        self.paths[path as usize].pixel as usize
    }

    /// Column and row of a path's pixel, and the path's number in it.
    pub fn place(&self, path: u32) -> [u32; 3] {
        let pixel = self.pixel(path);
        let before = self.tasks[..pixel].iter().map(|task| task.counts.paths).sum::<u32>();
        let task = &self.tasks[pixel];
        [task.x, task.y, task.first_path + path - before]
    }
}
