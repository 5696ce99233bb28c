//! Whether emissive triangles are to be chosen by what light samples find in each part of the scene, and what they find. A pilot of
//! a smaller picture of the same view tells: it depends on the scene, the view and the seed alone, so that every part, crop and
//! session comes to the same.

use std::f32::consts::SQRT_2;
use std::time::Instant;

use tracing::debug;

use super::super::RenderSettings;
use super::super::stats::LearnedLightsStats;
use super::low_resolution::{divisors, in_tiles, low_resolution, relative_variance, thin, tiles};
use crate::balance::Counts;
use crate::film::PixelStats;
use crate::integrator::{PixelBatch, PixelTask, PreparedScene, Transport, Wave};
use crate::light::{AreaLights, LearnedLights, LightSampleRecord};
use crate::sampling::hash;

/// Pixels of a picture for each of its pilot's, which has neither fewer nor more than this.
const PIXELS_OF: f64 = 8.0;
const FEWEST: f64 = 64.0;
const MOST: f64 = 8192.0;
/// Paths of each of the pilot's pixels, round by round. The second round judges what the first has taught.
const ROUNDS: [u32; 3] = [2, 2, 12];
/// One pixel in so many has no say in that, those that vary most: in a pilot, chance decides them.
const WORST: usize = 100;
/// What may then be left of the variance, for the last round and a longer way down the light tree to pay.
const PAYS: f64 = 0.9;
/// Attempts that are kept, at most.
const ATTEMPTS: usize = 1 << 18;

/// What a pilot has found.
#[derive(Debug)]
pub struct LearnedLightsResult {
    /// Which lights matter from where, if it pays to know.
    pub lights: Option<LearnedLights>,
    /// What is to be left of the variance, over that without, by the pilot's first rounds.
    pub left: f64,
    /// Wall seconds that it took.
    pub seconds: f64,
}

impl LearnedLightsResult {
    /// For people.
    pub fn stats(&self) -> LearnedLightsStats {
        let (cells, bytes) = self.lights.as_ref().map_or((0, 0), |lights| (lights.cells(), lights.bytes()));
        LearnedLightsStats { on: self.lights.is_some(), cells, bytes, left: self.left, seconds: self.seconds }
    }
}

/// Bytes that the pilot of a render with these settings takes, at most.
pub fn bytes(settings: &RenderSettings) -> u64 {
    let vertices = pixels(settings) * f64::from(ROUNDS.iter().sum::<u32>()) * f64::from(settings.max_depth);
    match settings.balance.method().uses_prepasses() {
        true => LearnedLights::bytes_to_learn((vertices as u64).min(ATTEMPTS as u64)),
        false => 0,
    }
}

/// Pixels of the pilot's picture.
fn pixels(settings: &RenderSettings) -> f64 {
    (f64::from(settings.width) * f64::from(settings.height) / PIXELS_OF).clamp(FEWEST, MOST)
}

/// Learns which lights matter along the paths of `transport`, a render with these settings; `None` where nobody asks or there is
/// nothing to choose.
pub fn learned(scene: &PreparedScene, settings: &RenderSettings, transport: &Transport) -> Option<LearnedLightsResult> {
    let area = scene.lights.area.as_ref().filter(|area| area.tree().top(3) > 1)?;
    if !settings.balance.method().uses_prepasses() {
        return None;
    }
    let began = Instant::now();
    let (size, camera) = low_resolution(scene, settings, pixels(settings));
    let normals = 0.25 * scene.scene.radius();
    let learn =
        |light_sample_records: &[LightSampleRecord]| LearnedLights::learn(area.tree(), light_sample_records, normals);
    let round = |number: usize| {
        let seed = hash(settings.seed ^ hash(0x6c61_6d70 + number as u32));
        take(&Transport { camera: camera.clone(), seed, ..transport.clone() }, size, ROUNDS[number])
    };
    let (first, second) = (round(0), round(1));
    let left = learn(&first.light_sample_records).map_or(1.0, |lights| left(area, &lights, &second));
    let mut lights = None;
    if left < PAYS {
        lights =
            learn(&[first.light_sample_records, second.light_sample_records, round(2).light_sample_records].concat());
    }
    let found = LearnedLightsResult { lights, left, seconds: began.elapsed().as_secs_f64() };
    debug!("learned lights leave {left:.2} of the variance; {:?}", found.stats());
    Some(found)
}

/// What a round has found.
#[derive(Default)]
struct Taken {
    light_sample_records: Vec<LightSampleRecord>,
    /// Of each pixel, the variance of its paths over what relMSE divides it by.
    variances: Vec<f64>,
}

fn take(transport: &Transport, size: [u32; 2], paths: u32) -> Taken {
    let most = ATTEMPTS * paths as usize / ROUNDS.iter().sum::<u32>() as usize / tiles(size).len();
    let counts = Counts::half(paths);
    let of_tile = |wave: &mut Wave, pixels: Vec<[u32; 2]>| {
        let tasks: Vec<_> = pixels.into_iter().map(|pixel| PixelTask::first(pixel, counts, 0)).collect();
        let mut taken = Taken::default();
        for tasks in tasks.chunks((2048 / paths) as usize) {
            let mut stats = vec![PixelStats::default(); tasks.len()];
            let (light_sample_records, divisors) =
                wave.light_sample_records(transport, &mut PixelBatch::plain(tasks, &mut stats), &divisors);
            let variances =
                stats.iter().zip(divisors).map(|(stats, divisor)| relative_variance(stats, divisor)).collect();
            taken.add(Taken { light_sample_records, variances });
        }
        while thin(&mut taken.light_sample_records, most) {
            // They stand for those that are left out.
            taken.light_sample_records.iter_mut().for_each(|light_sample_record| light_sample_record.found *= SQRT_2);
        }
        taken
    };
    in_tiles(size, of_tile).into_iter().fold(Taken::default(), |mut all, tile| {
        all.add(tile);
        all
    })
}

impl Taken {
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

/// What `lights` leave of the variance that paths had which did not know them: their light samples' second moments would be
/// others.
fn left(area: &AreaLights, lights: &LearnedLights, taken: &Taken) -> f64 {
    let mut pixels: Vec<_> = taken.variances.iter().map(|variance| [*variance; 2]).collect();
    for light_sample_record in
        taken.light_sample_records.iter().filter(|light_sample_record| light_sample_record.found > 0.0)
    {
        let [by_tree, mixed] = area.tree().pmfs(
            light_sample_record.position,
            light_sample_record.normal,
            light_sample_record.emitter,
            Some(lights),
        );
        let moment = f64::from(light_sample_record.found).powi(2);
        pixels[light_sample_record.pixel as usize][1] += moment * f64::from(by_tree / mixed - 1.0);
    }
    pixels.retain(|[without, with]| (without + with).is_finite());
    pixels.sort_by(|[a, b], [c, d]| (a + b).total_cmp(&(c + d)));
    pixels.truncate(pixels.len() - pixels.len() / WORST);
    let [without, with] = pixels.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
    if without > 0.0 { (with / without).max(0.0) } else { 1.0 }
}
