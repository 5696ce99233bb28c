//! The pre-pass of path guiding: a field of incident light is learned from paths of the same view at low resolution. Its
//! result depends only on the scene, the view, the seed and the expected paths per pixel, so that every part and crop
//! learns the same.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use tracing::debug;

use super::super::stats::{GuidingEfficiency, GuidingStats};
use super::super::{Choice, RenderSettings};
use super::low_resolution::{divisors, in_tiles, low_resolution, relative_variance, thin, tiles};
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::guiding::learn::LEARNING_CELL_BYTES;
use crate::guiding::{Field, PathStatistics, TrainingSample, VertexRecord, learn};
use crate::integrator::clients::TrainingRecorder;
use crate::integrator::{PixelSums, PixelTask, PreparedScene, Transport, Wave, WaveCounts};
use crate::sampling::hash;

/// Minimum pixels of the pre-pass.
const MIN_PIXELS: f64 = 8192.0;
/// Pixels of the picture per pixel of the pre-pass.
const PIXELS_PER_PREPASS_PIXEL: f64 = 16.0;
/// Maximum rounds, of 1, 2, 4, … paths per pixel. Each is guided by the field that those before it taught.
const MAX_ROUNDS: u32 = 9;
/// Paths per pixel of the picture for which the next two constants are meant.
const REFERENCE_SPP: f64 = 64.0;
/// Maximum paths of the pre-pass per pixel of the picture.
const MAX_PATHS_PER_PICTURE_PIXEL: f64 = 12.0;
/// No further round begins after this number of training samples or half the picture's pixels, whichever is larger.
const SUFFICIENT_TRAINING_SAMPLES: f64 = 150_000.0;
/// The round, counted from 0, after which `auto` first estimates the efficiency.
const FIRST_DECISION_ROUND: u32 = 1;
/// Learning continues there if at most this fraction of variance times rays remains, or if less than
/// [`MIN_SAMPLES_PER_PATH`] training samples per path were found, which is too few for an estimate.
const MAX_REMAINING_AT_FIRST_DECISION: f32 = 0.72;
const MIN_SAMPLES_PER_PATH: f64 = 0.04;
/// Paths are guided if at most this fraction of variance times rays remains after the last round: a guided ray takes
/// longer, and smooth light (cornell: 0.55) loses the benefit of stratified points.
const MAX_REMAINING: f32 = 0.45;
/// Maximum seconds of the pre-pass over those of a time limit, as far as rounds tell: the next one takes twice as long as
/// all before it.
const MAX_TIME_SHARE: f64 = 0.1;
/// Default maximum bytes of a field and its training samples.
pub const MEMORY: u64 = 256 << 20;

/// Maximum bytes that the pre-pass of a render with these settings takes.
pub fn bytes(settings: &RenderSettings) -> u64 {
    if !settings.guides() {
        return 0;
    }
    let most = settings.guiding_memory.unwrap_or(MEMORY);
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    // A round has twice the paths of the one before it: in the end there are up to three times as many as suffice. They are
    // copied once, and the field takes as much again.
    let training_samples = 3.0 * SUFFICIENT_TRAINING_SAMPLES.max(pixels / 2.0) * worthwhile(settings);
    ((3.0 * training_samples * size_of::<TrainingSample>() as f64) as u64).min(most)
}

/// Factor of the effort, fitted to relMSE × CPU seconds of pictures of 64, 256 and 1024 paths per pixel.
fn worthwhile(settings: &RenderSettings) -> f64 {
    let root = (f64::from(settings.expected_spp()) / REFERENCE_SPP).sqrt();
    root * root.sqrt()
}

/// The result of the pre-pass.
#[derive(Debug)]
pub struct Learned {
    /// The field of incident light; `None` where guiding would not reduce the variance enough.
    pub field: Option<Field>,
    /// Its estimated efficiency.
    pub efficiency: GuidingEfficiency,
    /// Wall seconds.
    pub seconds: f64,
}

impl Learned {
    /// Its statistics, for reports.
    pub fn stats(&self) -> GuidingStats {
        let (cells, bytes) = self.field.as_ref().map_or((0, 0), |field| (field.cells(), field.bytes()));
        GuidingStats { on: self.field.is_some(), cells, bytes, efficiency: self.efficiency, seconds: self.seconds }
    }
}

/// Learns a field along the paths of `transport`. `None` where `settings` turn guiding off or there is no indirect light, and
/// soon after `stop` is raised.
pub fn learned(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<Learned> {
    if !settings.guides() || transport.max_depth < 3 {
        return None;
    }
    let began = Instant::now();
    let most = settings.guiding_memory.unwrap_or(MEMORY) as f64;
    // A quarter for training samples and an eighth for vertex records, which are copied once; a quarter for cells while they
    // learn.
    let max_training_samples = (most / 4.0 / size_of::<TrainingSample>() as f64) as usize;
    let max_vertex_records = (most / 8.0 / size_of::<VertexRecord>() as f64) as usize;
    let most_cells = (most / 4.0 / LEARNING_CELL_BYTES as f64).max(1.0) as usize;
    let pixels = f64::from(settings.width) * f64::from(settings.height);
    let (size, camera) = low_resolution(scene, settings, MIN_PIXELS.max(pixels / PIXELS_PER_PREPASS_PIXEL));
    let normals = 0.25 * scene.scene.radius();
    let mut training_samples = Vec::new();
    let mut known = None;
    // Rays per path of the first round, which is unguided.
    let mut unguided = None;
    let mut efficiency = GuidingEfficiency::default();
    let worthwhile = worthwhile(settings);
    // With three quarters of what memory allows, most of the next round would be left out.
    let enough = (SUFFICIENT_TRAINING_SAMPLES.max(pixels / 2.0) * worthwhile).min(0.75 * max_training_samples as f64);
    let pilot_pixels = f64::from(size[0]) * f64::from(size[1]);
    for round in 0..MAX_ROUNDS {
        let paths = 1 << round;
        let fresh = training_samples.len();
        let transport = Transport {
            camera: camera.clone(),
            seed: hash(settings.seed ^ hash(0x6775_6964 + round)),
            proposal: transport.proposal.guided(known.as_ref()),
            ..transport.clone()
        };
        let mut recorded = trace(&transport, size, paths, [max_training_samples - fresh, max_vertex_records], stop)?;
        let round_paths = pilot_pixels * f64::from(paths);
        let cost = recorded.rays as f64 / round_paths;
        let unguided = *unguided.get_or_insert(cost);
        let few = (recorded.training_samples.len() as f64) < MIN_SAMPLES_PER_PATH * round_paths;
        training_samples.append(&mut recorded.training_samples);
        // Paths including the next round.
        let all = pilot_pixels * f64::from(4 * paths - 1);
        let last = round + 1 == MAX_ROUNDS
            || settings.time.is_some_and(|time| 3.0 * began.elapsed().as_secs_f64() > MAX_TIME_SHARE * time)
            || all > (MAX_PATHS_PER_PICTURE_PIXEL * worthwhile * pixels).max(15.0 * pilot_pixels)
            || training_samples.len() as f64 >= enough;
        let decides = last || round == FIRST_DECISION_ROUND;
        // The first round was unguided.
        let fresh = if decides && round > 0 { fresh } else { usize::MAX };
        let (mut field, gain) = learn(&training_samples, fresh, normals, most_cells);
        if decides {
            efficiency = GuidingEfficiency {
                variance: gain.variance(recorded.variance),
                cost: (cost / unguided) as f32,
                share: gain.guiding_probability,
            };
            debug!("round {round}: {} cells, {efficiency:?}", field.cells());
            let most = if last { MAX_REMAINING } else { MAX_REMAINING_AT_FIRST_DECISION };
            if settings.guiding == Choice::Auto && efficiency.variance * efficiency.cost > most && (last || !few) {
                return Some(Learned { field: None, efficiency, seconds: began.elapsed().as_secs_f64() });
            }
        }
        // One path per pixel has no variance.
        if last || round > 0 {
            let all = PathStatistics {
                cost,
                variance: recorded.variance / round_paths,
                inverse: recorded.inverse / pilot_pixels,
            };
            field.learn_roulette(&recorded.vertex_records, all);
        }
        known = Some(field);
        if last {
            break;
        }
    }
    Some(Learned { field: known, efficiency, seconds: began.elapsed().as_secs_f64() })
}

/// What a round has recorded.
#[derive(Default)]
struct Round {
    training_samples: Vec<TrainingSample>,
    vertex_records: Vec<VertexRecord>,
    /// Sum of the pixels' variances, each over its divisor of relMSE.
    variance: f64,
    /// Sum over pixels of 1 / divisor.
    inverse: f64,
    rays: u64,
}

/// Traces a picture of this size and records at most `most` training samples and vertex records; `None` if `stop` was raised.
fn trace(transport: &Transport, size: [u32; 2], paths: u32, most: [usize; 2], stop: &AtomicBool) -> Option<Round> {
    let counts = if transport.lights.has_extent() { Counts::half(paths) } else { Counts::bsdf_only(paths) };
    let most = most.map(|most| most / tiles(size).len());
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let (mut recorder, mut recorded) = (TrainingRecorder::default(), Round::default());
        wave.counts = WaveCounts::default();
        for tasks in tasks.chunks((2048 / paths).max(1) as usize) {
            let mut stats = vec![PixelStats::default(); tasks.len()];
            wave.run(transport, tasks, &mut (PixelSums::new(&mut stats), &mut recorder));
            let divisors = divisors(tasks, &stats);
            recorder.append_to(&divisors, &mut recorded.training_samples, &mut recorded.vertex_records);
            let of = |(stats, divisor): (&PixelStats, &f32)| relative_variance(stats, *divisor);
            recorded.variance += stats.iter().zip(&divisors).map(of).filter(|v| v.is_finite()).sum::<f64>();
            recorded.inverse += divisors.iter().map(|divisor| 1.0 / f64::from(*divisor)).sum::<f64>();
        }
        recorded.rays = wave.counts.rays();
        while thin(&mut recorded.training_samples, most[0]) {
            recorded.training_samples.iter_mut().for_each(|training_sample| training_sample.weight *= 2.0);
        }
        while thin(&mut recorded.vertex_records, most[1]) {}
        recorded.training_samples.shrink_to_fit();
        recorded.vertex_records.shrink_to_fit();
        recorded
    };
    let of_tiles = in_tiles(size, stop, of_tile)?;
    Some(of_tiles.into_iter().fold(Round::default(), |mut all, tile| {
        all.training_samples.extend(tile.training_samples);
        all.vertex_records.extend(tile.vertex_records);
        all.variance += tile.variance;
        all.inverse += tile.inverse;
        all.rays += tile.rays;
        all
    }))
}
