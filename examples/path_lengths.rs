//! A client of a wave: a histogram of path lengths. `cargo run --release --example path_lengths [SCENE.glb]`.

use std::path::PathBuf;
use std::sync::Arc;

use bismar::balance::Counts;
use bismar::integrator::data::queues::PathRays;
use bismar::integrator::{PathEvents, PixelTask, PreparedScene, Wave, WaveContext};
use bismar::rays::{Backend, HitBatch};
use bismar::render::{RenderSettings, transport};
use bismar::scene::import::import;
use bismar::{Error, Result};
use glam::Vec3;

/// Counts paths by their number of segments, camera ray included.
#[derive(Default)]
struct PathLengths {
    /// By path of the wave, its number of segments.
    segments: Vec<usize>,
    /// By number of segments, the number of paths.
    histogram: Vec<u64>,
    /// By number of segments, the sum of their paths' radiance in green.
    radiance: Vec<f64>,
}

impl PathEvents for PathLengths {
    fn begin(&mut self, at: &WaveContext) {
        self.segments.clear();
        self.segments.resize(at.paths.len(), 0);
    }

    fn hits(&mut self, at: &WaveContext, rays: &PathRays, _hits: &HitBatch) {
        // A path that was split at its first surface has several rays; the longest counts.
        rays.path[..rays.len].iter().for_each(|path| self.segments[*path as usize] = at.depth as usize + 1);
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        let most = at.transport.longest_path() as usize;
        self.histogram.resize(most + 1, 0);
        self.radiance.resize(most + 1, 0.0);
        for (segments, radiance) in self.segments.iter().zip(radiance) {
            self.histogram[*segments] += 1;
            self.radiance[*segments] += f64::from(radiance.y);
        }
    }
}

fn main() -> Result<()> {
    let path = std::env::args_os().nth(1).map_or("scenes/cornell.glb".into(), PathBuf::from);
    let scene = PreparedScene::build(Arc::new(import(&path, &Default::default())?.scene), Backend::Embree)?;
    let settings = RenderSettings { width: 128, height: 128, max_depth: 16, ..RenderSettings::even() };
    let transport = transport(&scene, &settings);
    // One wave per row, 16 paths per pixel.
    let (mut wave, mut lengths) = (Wave::default(), PathLengths::default());
    for y in 0..settings.height {
        let tasks: Vec<_> = (0..settings.width).map(|x| PixelTask::first([x, y], Counts::half(16), x)).collect();
        wave.run(&transport, &tasks, &mut lengths);
    }
    let paths = lengths.histogram.iter().sum::<u64>().max(1) as f64;
    let light = lengths.radiance.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut text = String::from("segments   paths   light\n");
    for (segments, (n, radiance)) in lengths.histogram.iter().zip(&lengths.radiance).enumerate().skip(1) {
        let [paths, light] = [*n as f64 / paths, radiance / light].map(|part| 100.0 * part);
        text += &format!("{segments:8} {paths:5.1} % {light:5.1} %  {}\n", "#".repeat(paths.round() as usize));
    }
    std::io::Write::write_all(&mut std::io::stdout().lock(), text.as_bytes()).map_err(|e| Error::Io(e.to_string()))
}
