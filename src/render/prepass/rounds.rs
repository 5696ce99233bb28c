//! The rounds of the pre-pass: one picture of the same view at low resolution, with 1, 2, 4, … paths per pixel. The paths of a
//! round teach every [`Learner`] that has not finished, and are sampled by what the learners know from the rounds before.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::low_resolution::{divisors, in_tiles, low_resolution, tiles};
use super::trial::Candidate;
use crate::film::PixelStats;
use crate::guiding::{TrainingSample, VertexRecord};
use crate::integrator::clients::{LightSampleRecorder, TrainingRecorder};
use crate::integrator::{PixelSums, PixelTask, PreparedScene, Transport, Wave, WaveCounts};
use crate::light::LightSampleRecord;
use crate::render::pass::sampler::PATHS_PER_WAVE;
use crate::render::settings::RenderSettings;
use crate::sampling::hash;

/// Something that learns from paths how to sample them better.
pub trait Learner: Candidate {
    /// Pixels of the low-resolution picture that it needs at least.
    fn pixels(&self) -> f64;

    /// What it needs from the next round; `None` once it has finished.
    fn wants(&self) -> Option<Wanted>;

    /// Learns from the next round, and may take records that no other learner wants. `seconds` is the wall time that it took,
    /// divided by the number of learners.
    fn learn(&mut self, round: &mut Round, seconds: f64);
}

/// Maximum numbers of records of a round; 0 for those that are not needed.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wanted {
    /// Training samples of the guiding field.
    pub training_samples: usize,
    /// Vertex records of the roulette.
    pub vertex_records: usize,
    /// Light samples of area lights.
    pub light_sample_records: usize,
}

impl Wanted {
    fn or(self, other: Self) -> Self {
        Self {
            training_samples: self.training_samples.max(other.training_samples),
            vertex_records: self.vertex_records.max(other.vertex_records),
            light_sample_records: self.light_sample_records.max(other.light_sample_records),
        }
    }
}

/// What the paths of a round have recorded.
#[derive(Debug, Default)]
pub struct Round {
    /// Number of the round, from 0.
    pub number: u32,
    /// Paths per pixel.
    pub paths: u32,
    /// Per pixel, tile by tile.
    pub pixels: Vec<RoundPixel>,
    /// Directions in which light was found, tile by tile, as all records are: they are many, and never copied.
    pub training_samples: Vec<Vec<TrainingSample>>,
    /// Vertices beyond the first.
    pub vertex_records: Vec<Vec<VertexRecord>>,
    /// Light samples of area lights, with indices into `pixels`.
    pub light_sample_records: Vec<Vec<LightSampleRecord>>,
    /// Rays of all paths.
    pub rays: u64,
}

/// A pixel of a round.
#[derive(Debug, Clone, Copy)]
pub struct RoundPixel {
    /// Variance of the sum of its paths, the mean over colour channels.
    pub variance: f64,
    /// Divisor of relMSE, from the mean of the pixels around.
    pub divisor: f32,
}

impl RoundPixel {
    /// Relative variance of the sum of its paths.
    pub fn relative_variance(&self) -> f64 {
        self.variance / f64::from(self.divisor)
    }
}

impl Round {
    /// Paths of all pixels.
    pub fn all_paths(&self) -> f64 {
        self.pixels.len() as f64 * f64::from(self.paths)
    }

    /// Appends more pixels with their records.
    fn append(&mut self, mut more: Self) {
        let before = self.pixels.len() as u32;
        self.pixels.extend(more.pixels);
        self.training_samples.extend(more.training_samples);
        self.vertex_records.extend(more.vertex_records);
        more.light_sample_records.iter_mut().flatten().for_each(|record| record.pixel += before);
        self.light_sample_records.append(&mut more.light_sample_records);
        self.rays += more.rays;
    }
}

/// A list of at most so many records. Every other one is left out as often as there are too many, as soon as there are: before
/// that, a tile could have many times as many.
struct Thinned<T> {
    most: usize,
    records: Vec<T>,
    /// Number of records so far, with those that are left out.
    all: usize,
    /// One of this number of records, a power of two, is kept.
    step: usize,
}

impl<T> Extend<T> for Thinned<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, more: I) {
        for record in more {
            self.all += 1;
            if self.all.is_multiple_of(self.step) {
                self.records.push(record);
            }
            if self.records.len() > self.most {
                let mut kept = 0..;
                self.records.retain(|_| kept.next().is_some_and(|i: usize| i % 2 == 1));
                self.step *= 2;
            }
        }
    }
}

impl<T> Thinned<T> {
    fn of_at_most(most: usize) -> Self {
        Self { most, records: Vec::new(), all: 0, step: 1 }
    }

    /// The list, without room for more. `double` changes a record as often as half of them were left out.
    fn weighted(mut self, double: impl Fn(&mut T)) -> Vec<T> {
        for record in &mut self.records {
            (0..self.step.ilog2()).for_each(|_| double(record));
        }
        self.records.shrink_to_fit();
        self.records
    }
}

/// Runs rounds until all `learners` of a render with these settings have finished. `None` soon after `stop` is raised.
pub fn run(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    learners: &mut [&mut dyn Learner],
    stop: &AtomicBool,
) -> Option<()> {
    let pixels = learners.iter().filter(|learner| learner.wants().is_some()).map(|learner| learner.pixels());
    let (size, camera) = low_resolution(scene, settings, pixels.fold(0.0, f64::max));
    for number in 0.. {
        let wanted: Vec<_> = learners.iter().filter_map(|learner| learner.wants()).collect();
        let Some(wants) = wanted.iter().copied().reduce(Wanted::or) else { break };
        let began = Instant::now();
        let mut round = {
            let mut proposal = transport.proposal;
            // What a learner that has finished knows is not decided about yet.
            for learner in learners.iter().filter(|learner| learner.wants().is_some()) {
                proposal = learner.ways(proposal).first().copied().unwrap_or(proposal);
            }
            let seed = hash(transport.seed ^ hash(0x6775_6964 + number));
            let transport = Transport { camera: camera.clone(), seed, proposal, ..transport.clone() };
            trace(&transport, size, (number, 1 << number), wants, stop)?
        };
        let seconds = began.elapsed().as_secs_f64() / wanted.len() as f64;
        for learner in learners.iter_mut().filter(|learner| learner.wants().is_some()) {
            learner.learn(&mut round, seconds);
        }
    }
    Some(())
}

/// Traces a round of a picture of this size: its number and paths per pixel. `None` if `stop` was raised.
pub fn trace(
    transport: &Transport,
    size: [u32; 2],
    (number, paths): (u32, u32),
    wants: Wanted,
    stop: &AtomicBool,
) -> Option<Round> {
    let counts = transport.half(paths);
    let tiles = tiles(size).len();
    let most = [wants.training_samples, wants.vertex_records, wants.light_sample_records].map(|n| n.div_ceil(tiles));
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let mut training = (wants.training_samples > 0).then(TrainingRecorder::default);
        let mut lights = (wants.light_sample_records > 0).then(LightSampleRecorder::default);
        let mut found = Round::default();
        let mut training_samples = Thinned::of_at_most(most[0]);
        let mut vertex_records = Thinned::of_at_most(most[1]);
        let mut light_sample_records = Thinned::of_at_most(most[2]);
        wave.counts = WaveCounts::default();
        for tasks in tasks.chunks((PATHS_PER_WAVE / paths).max(1) as usize) {
            let mut stats = vec![PixelStats::default(); tasks.len()];
            wave.run(transport, tasks, &mut (PixelSums::new(&mut stats), &mut training, &mut lights));
            let divisors = divisors(tasks, &stats);
            if let Some(recorder) = &mut training {
                recorder.append_to(&divisors, &mut training_samples, &mut vertex_records);
            }
            if let Some(recorder) = &mut lights {
                let before = found.pixels.len() as u32;
                let numbered = |record: LightSampleRecord| LightSampleRecord { pixel: before + record.pixel, ..record };
                light_sample_records.extend(recorder.take(&divisors).into_iter().map(numbered));
            }
            let pixel = |(stats, divisor): (&PixelStats, f32)| {
                let variance = stats.variance_of_mean().iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0;
                RoundPixel { variance: variance * f64::from(stats.samples).powi(2), divisor }
            };
            found.pixels.extend(stats.iter().zip(divisors).map(pixel));
        }
        // The records that remain stand for those that are left out.
        found.training_samples = vec![training_samples.weighted(|sample| sample.weight *= 2.0)];
        found.vertex_records = vec![vertex_records.weighted(|_| ())];
        let weighted = light_sample_records.weighted(|record| record.contribution *= std::f32::consts::SQRT_2);
        found.light_sample_records = vec![weighted];
        found.rays = wave.counts.rays();
        found
    };
    let of_tiles = in_tiles(size, stop, of_tile)?;
    let mut all = Round { number, paths, ..Default::default() };
    of_tiles.into_iter().for_each(|tile| all.append(tile));
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_left_out_as_if_all_were_there_before() {
        for (n, most) in [(10, 16), (16, 16), (17, 16), (100, 7), (1000, 1), (4097, 64)] {
            let mut thinned = Thinned::of_at_most(most);
            (0..n).for_each(|i| thinned.extend([(i, 1)]));
            let (mut all, mut weight): (Vec<usize>, _) = ((0..n).collect(), 1);
            while all.len() > most {
                all = all.into_iter().skip(1).step_by(2).collect();
                weight *= 2;
            }
            let expected: Vec<_> = all.into_iter().map(|i| (i, weight)).collect();
            assert_eq!(thinned.weighted(|record| record.1 *= 2), expected, "{n} {most}");
        }
    }
}
