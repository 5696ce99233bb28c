//! The pilot of guiding: paths of a smaller picture of the same view, of which a field is learned. What it finds depends on
//! the scene, the view, the seed and the paths that the picture is to have, so that every part and crop learns the same.

use std::time::Instant;

use serde::{Deserialize, Serialize};
use tracing::debug;

use super::super::stats::GuidingStats;
use super::super::{Guiding, RenderSettings};
use super::low_resolution::{divisors, in_tiles, low_resolution, relative_variance, thin, tiles};
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::guiding::learn::LEARNING_CELL_BYTES;
use crate::guiding::{Field, Paths, TrainingSample, VertexRecord, learn};
use crate::integrator::{PixelBatch, PixelTask, PreparedScene, Transport, Wave, WaveCounts};
use crate::sampling::hash;

/// Pixels of the pilot's picture, at least; that of a large picture has a fraction of its pixels.
const PIXELS: f64 = 8192.0;
/// Pixels of a picture for each of its pilot's.
const PIXELS_OF: f64 = 16.0;
/// Rounds, at most: of 1, 2, 4, … paths a pixel, each led by what those before it found.
const ROUNDS: u32 = 9;
/// Paths a pixel of the picture for which the next two are meant.
const USUAL: f64 = 64.0;
/// Paths of the pilot for each pixel of the picture, at most.
const PATHS_A_PIXEL: f64 = 12.0;
/// Training samples after which no further round is worth its time, or as many as half the picture's pixels.
const ENOUGH: f64 = 150_000.0;
/// The round after which `auto` asks whether it pays, counted from 0.
const ASKS: u32 = 1;
/// Then, it goes on where it is to leave no more than this of variance times rays, or where so few of a pilot's paths have found
/// anything that nobody can tell.
const PROMISES: f32 = 0.72;
const FEW: f64 = 0.04;
/// At the end, it guides where no more than this is to be left: a guided ray takes longer, and smooth light (cornell: 0.55) loses
/// what stratified points do for it.
const PAYS: f32 = 0.45;
/// Bytes that a field and its training samples may take.
pub const MEMORY: u64 = 256 << 20;

/// What a render's pilot has found.
#[derive(Debug)]
pub struct Learned {
    /// Where light comes from, if it pays to know.
    pub field: Option<Field>,
    /// What it is worth.
    pub efficiency: EstimatedEfficiency,
    /// Wall seconds that it took.
    pub seconds: f64,
}

/// What a field is worth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatedEfficiency {
    /// The variance that it is to leave, over that without it.
    pub variance: f32,
    /// The rays of a path, over those of one that is not guided.
    pub cost: f32,
    /// Mean share of samples that follow it.
    pub share: f32,
}

impl Learned {
    /// For people.
    pub fn stats(&self) -> GuidingStats {
        let (cells, bytes) = self.field.as_ref().map_or((0, 0), |field| (field.cells(), field.bytes()));
        GuidingStats { on: self.field.is_some(), cells, bytes, efficiency: self.efficiency, seconds: self.seconds }
    }
}

/// Learns what `settings` ask for along `transport`'s paths.
pub fn learned(scene: &PreparedScene, settings: &RenderSettings, transport: &Transport) -> Option<Learned> {
    if settings.guiding == Guiding::Off || transport.max_depth < 3 {
        return None;
    }
    let began = Instant::now();
    let most = settings.guiding_memory.unwrap_or(MEMORY) as f64;
    // A quarter for training samples and an eighth for vertex records, which are copied once; a quarter for cells, as they are while they learn.
    let max_training_samples = (most / 4.0 / size_of::<TrainingSample>() as f64) as usize;
    let max_vertex_records = (most / 8.0 / size_of::<VertexRecord>() as f64) as usize;
    let most_cells = (most / 4.0 / LEARNING_CELL_BYTES as f64).max(1.0) as usize;
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    let (size, camera) = low_resolution(scene, settings, PIXELS.max(pixels / PIXELS_OF));
    let normals = 0.25 * scene.scene.radius();
    let mut training_samples = Vec::new();
    let mut known = None;
    // Rays of a path of the first round, which nothing leads.
    let mut unguided = None;
    let mut efficiency = EstimatedEfficiency::default();
    // By relMSE × CPU seconds of pictures of 64, 256 and 1024 paths a pixel.
    let worthwhile = (f64::from(settings.expected_spp()) / USUAL).sqrt();
    let worthwhile = worthwhile * worthwhile.sqrt();
    // With three quarters of what memory allows, the next round would be mostly left out.
    let enough = (ENOUGH.max(pixels / 2.0) * worthwhile).min(0.75 * max_training_samples as f64);
    let pilot_pixels = f64::from(size[0]) * f64::from(size[1]);
    for round in 0..ROUNDS {
        let paths = 1 << round;
        let fresh = training_samples.len();
        let transport = Transport {
            camera: camera.clone(),
            seed: hash(settings.seed ^ hash(0x6775_6964 + round)),
            field: known.as_ref(),
            ..transport.clone()
        };
        let mut taken = take(&transport, size, paths, [max_training_samples - fresh, max_vertex_records]);
        let taken_paths = pilot_pixels * f64::from(paths);
        let cost = taken.rays as f64 / taken_paths;
        let unguided = *unguided.get_or_insert(cost);
        let few = (taken.training_samples.len() as f64) < FEW * taken_paths;
        training_samples.append(&mut taken.training_samples);
        // Those of the next round, and all before.
        let all = pilot_pixels * f64::from(4 * paths - 1);
        let last = round + 1 == ROUNDS
            || all > (PATHS_A_PIXEL * worthwhile * pixels).max(15.0 * pilot_pixels)
            || training_samples.len() as f64 >= enough;
        let asks = last || (round == ASKS && settings.guiding == Guiding::Auto);
        // The first round has led nobody.
        let fresh = if asks && round > 0 { fresh } else { usize::MAX };
        let (mut field, gain) = learn(&training_samples, fresh, normals, most_cells);
        if asks {
            efficiency = EstimatedEfficiency {
                variance: gain.variance(taken.variance),
                cost: (cost / unguided) as f32,
                share: gain.share,
            };
            debug!("round {round}: {} cells, {efficiency:?}", field.cells());
            let most = if last { PAYS } else { PROMISES };
            if settings.guiding == Guiding::Auto && efficiency.variance * efficiency.cost > most && (last || !few) {
                return Some(Learned { field: None, efficiency, seconds: began.elapsed().as_secs_f64() });
            }
        }
        // One path of each pixel tells no variance.
        if last || round > 0 {
            let all = Paths { cost, variance: taken.variance / taken_paths, inverse: taken.inverse / pilot_pixels };
            field.learn_roulette(&taken.vertex_records, all);
        }
        known = Some(field);
        if last {
            break;
        }
    }
    Some(Learned { field: known, efficiency, seconds: began.elapsed().as_secs_f64() })
}

/// What a round's paths teach.
#[derive(Default)]
struct Taken {
    training_samples: Vec<TrainingSample>,
    vertex_records: Vec<VertexRecord>,
    /// Sum of their variances, over what relMSE divides their pixels by.
    variance: f64,
    /// Sum over pixels of one over that.
    inverse: f64,
    rays: u64,
}

/// What paths of a picture of this size teach: at most so many training samples and vertex records.
fn take(transport: &Transport, size: [u32; 2], paths: u32, most: [usize; 2]) -> Taken {
    let counts = if transport.lights.has_extent() { Counts::half(paths) } else { Counts::bsdf_only(paths) };
    let most = most.map(|most| most / tiles(size).len());
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let mut taken = Taken::default();
        wave.counts = WaveCounts::default();
        for tasks in tasks.chunks((2048 / paths).max(1) as usize) {
            let mut stats = vec![PixelStats::default(); tasks.len()];
            let mut batch = PixelBatch::plain(tasks, &mut stats);
            let divisors =
                wave.learn(transport, &mut batch, &divisors, (&mut taken.training_samples, &mut taken.vertex_records));
            let of = |(stats, divisor): (&PixelStats, &f32)| relative_variance(stats, *divisor);
            taken.variance += stats.iter().zip(&divisors).map(of).filter(|v| v.is_finite()).sum::<f64>();
            taken.inverse += divisors.iter().map(|divisor| 1.0 / f64::from(*divisor)).sum::<f64>();
        }
        taken.rays = wave.counts.rays();
        while thin(&mut taken.training_samples, most[0]) {
            taken.training_samples.iter_mut().for_each(|training_sample| training_sample.weight *= 2.0);
        }
        while thin(&mut taken.vertex_records, most[1]) {}
        taken.training_samples.shrink_to_fit();
        taken.vertex_records.shrink_to_fit();
        taken
    };
    let of_tiles = in_tiles(size, of_tile);
    of_tiles.into_iter().fold(Taken::default(), |mut all, tile| {
        all.training_samples.extend(tile.training_samples);
        all.vertex_records.extend(tile.vertex_records);
        all.variance += tile.variance;
        all.inverse += tile.inverse;
        all.rays += tile.rays;
        all
    })
}
