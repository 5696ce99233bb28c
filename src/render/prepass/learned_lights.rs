//! Learns which emissive triangles light each part of the scene, and decides whether light samples are chosen by that. The
//! pre-pass renders the same view at low resolution. Its result depends only on the scene, the view and the seed, so that
//! every part, crop and session learns the same.

use std::f32::consts::SQRT_2;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use tracing::debug;

use super::super::stats::LearnedLightsStats;
use super::super::{Choice, RenderSettings};
use super::low_resolution::{divisors, in_tiles, low_resolution, relative_variance, thin, tiles};
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::film::compare::sums_without_outliers;
use crate::integrator::clients::LightSampleRecorder;
use crate::integrator::{PixelSums, PixelTask, PreparedScene, Transport, Wave};
use crate::light::{AreaLights, LearnedLights, LightSampleRecord};
use crate::sampling::hash;

/// Pixels of the picture per pixel of the pre-pass, and the minimum and maximum pixels of the pre-pass.
const PIXELS_PER_PREPASS_PIXEL: f64 = 8.0;
const MIN_PIXELS: f64 = 64.0;
const MAX_PIXELS: f64 = 8192.0;
/// Paths per pixel of the pre-pass, round by round. The second round measures the efficiency of what the first has
/// taught.
const PATHS_PER_ROUND: [u32; 3] = [2, 2, 12];
/// Learned lights are used where at most this fraction of the variance remains: the last round and the longer traversal of
/// the light tree take time.
const MAX_REMAINING_VARIANCE: f64 = 0.9;
/// Maximum light-sample records that are kept.
const MAX_RECORDS: usize = 1 << 18;

/// The result of the pre-pass.
#[derive(Debug)]
pub struct LearnedLightsResult {
    /// Which lights matter in which part of the scene; `None` where that would not reduce the variance enough.
    pub lights: Option<LearnedLights>,
    /// Variance with learned lights over that without them, as the first rounds estimate it.
    pub remaining_variance: f64,
    /// Wall seconds.
    pub seconds: f64,
}

impl LearnedLightsResult {
    /// Its statistics, for reports.
    pub fn stats(&self) -> LearnedLightsStats {
        let (cells, bytes) = self.lights.as_ref().map_or((0, 0), |lights| (lights.cells(), lights.bytes()));
        LearnedLightsStats {
            on: self.lights.is_some(),
            cells,
            bytes,
            remaining_variance: self.remaining_variance,
            seconds: self.seconds,
        }
    }
}

/// Maximum bytes that the pre-pass of a render with these settings takes, in a scene of at most so many area lights.
pub fn bytes(settings: &RenderSettings, lights: u64) -> u64 {
    let vertices = pixels(settings) * f64::from(PATHS_PER_ROUND.iter().sum::<u32>()) * f64::from(settings.max_depth);
    match settings.uses_prepass(settings.learned_lights) && lights > 1 {
        true => LearnedLights::bytes_to_learn((vertices as u64).min(MAX_RECORDS as u64), lights),
        false => 0,
    }
}

/// Pixels of the pre-pass.
fn pixels(settings: &RenderSettings) -> f64 {
    (f64::from(settings.width) * f64::from(settings.height) / PIXELS_PER_PREPASS_PIXEL).clamp(MIN_PIXELS, MAX_PIXELS)
}

/// Learns which lights matter along the paths of `transport`, a render with these settings. `None` where the balance method
/// uses no pre-passes or there is nothing to choose, and soon after `stop` is raised.
pub fn learned(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<LearnedLightsResult> {
    let area = scene.lights.area.as_ref().filter(|area| area.tree().top(3) > 1)?;
    if !settings.uses_prepass(settings.learned_lights) {
        return None;
    }
    let began = Instant::now();
    let (size, camera) = low_resolution(scene, settings, pixels(settings));
    let normals = 0.25 * scene.scene.radius();
    let learn =
        |light_sample_records: &[LightSampleRecord]| LearnedLights::learn(area.tree(), light_sample_records, normals);
    let round = |number: usize| {
        let seed = hash(settings.seed ^ hash(0x6c61_6d70 + number as u32));
        trace(&Transport { camera: camera.clone(), seed, ..transport.clone() }, size, PATHS_PER_ROUND[number], stop)
    };
    let (first, second) = (round(0)?, round(1)?);
    let remaining_variance =
        learn(&first.light_sample_records).map_or(1.0, |lights| relative_variance_with(area, &lights, &second));
    let mut lights = None;
    if remaining_variance < MAX_REMAINING_VARIANCE || settings.learned_lights == Choice::On {
        lights =
            learn(&[first.light_sample_records, second.light_sample_records, round(2)?.light_sample_records].concat());
    }
    let result = LearnedLightsResult { lights, remaining_variance, seconds: began.elapsed().as_secs_f64() };
    debug!("learned lights leave {remaining_variance:.2} of the variance; {:?}", result.stats());
    Some(result)
}

/// What a round has recorded.
#[derive(Default)]
struct Round {
    light_sample_records: Vec<LightSampleRecord>,
    /// For each pixel, the variance of a path over the divisor of relMSE.
    variances: Vec<f64>,
}

/// Traces a round; `None` if `stop` was raised.
fn trace(transport: &Transport, size: [u32; 2], paths: u32, stop: &AtomicBool) -> Option<Round> {
    let most = MAX_RECORDS * paths as usize / PATHS_PER_ROUND.iter().sum::<u32>() as usize / tiles(size).len();
    let counts = Counts::half(paths);
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let (mut recorder, mut round) = (LightSampleRecorder::default(), Round::default());
        for tasks in tasks.chunks((2048 / paths) as usize) {
            let mut stats = vec![PixelStats::default(); tasks.len()];
            wave.run(transport, tasks, &mut (PixelSums::new(&mut stats), &mut recorder));
            let divisors = divisors(tasks, &stats);
            let light_sample_records = recorder.take(&divisors);
            let variances =
                stats.iter().zip(divisors).map(|(stats, divisor)| relative_variance(stats, divisor)).collect();
            round.add(Round { light_sample_records, variances });
        }
        while thin(&mut round.light_sample_records, most) {
            // The records that remain stand for those that are left out.
            round
                .light_sample_records
                .iter_mut()
                .for_each(|light_sample_record| light_sample_record.contribution *= SQRT_2);
        }
        round
    };
    let of_tiles = in_tiles(size, stop, of_tile)?;
    Some(of_tiles.into_iter().fold(Round::default(), |mut all, tile| {
        all.add(tile);
        all
    }))
}

impl Round {
    /// Adds more pixels.
    fn add(&mut self, more: Self) {
        let before = self.variances.len() as u32;
        let numbered = more.light_sample_records.into_iter().map(|light_sample_record| LightSampleRecord {
            pixel: before + light_sample_record.pixel,
            ..light_sample_record
        });
        self.light_sample_records.extend(numbered);
        self.variances.extend(more.variances);
    }
}

/// Variance with `lights` over that of paths without them: the second moments of light samples are reweighted to the
/// learned choice.
fn relative_variance_with(area: &AreaLights, lights: &LearnedLights, round: &Round) -> f64 {
    let mut pixels: Vec<_> = round.variances.iter().map(|variance| [*variance; 2]).collect();
    for light_sample_record in
        round.light_sample_records.iter().filter(|light_sample_record| light_sample_record.contribution > 0.0)
    {
        let [by_tree, mixed] = area.tree().pmfs(
            light_sample_record.position,
            light_sample_record.normal,
            light_sample_record.emitter,
            Some(lights),
        );
        let moment = f64::from(light_sample_record.contribution).powi(2);
        pixels[light_sample_record.pixel as usize][1] += moment * f64::from(by_tree / mixed - 1.0);
    }
    let [without, with] = sums_without_outliers(pixels);
    if without > 0.0 { (with / without).max(0.0) } else { 1.0 }
}
