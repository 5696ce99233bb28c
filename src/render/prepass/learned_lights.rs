//! Learns which emissive triangles light each part of the scene, and decides whether light samples are chosen by that. The
//! second round of the pre-pass measures the efficiency of what the first has taught.

use std::sync::atomic::AtomicBool;

use tracing::debug;

use super::super::stats::LearnedLightsStats;
use super::super::{Choice, RenderSettings};
use super::effort::{self, MAX_REMAINING_LEARNED_LIGHTS};
use super::guiding;
use super::rounds::{self, Learner, Round, Wanted};
use crate::film::compare::sums_without_outliers;
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::light::{AreaLights, LearnedLights, LightProposal, LightSampleRecord};

/// Paths after which no further round is needed, per pixel of a pre-pass with the pixels above: four rounds.
const SUFFICIENT_PATHS_PER_PIXEL: f64 = 15.0;
/// Maximum light-sample records of a round.
const MAX_RECORDS_PER_ROUND: usize = 1 << 16;

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
    /// The proposal with learned lights, if there are any.
    pub fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        let learned = self.lights.as_ref();
        Proposal { lights: LightProposal { learned, ..proposal.lights }, ..proposal }
    }

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

/// Maximum bytes that learning takes for a render with these settings, in a scene of at most so many area lights.
pub fn bytes(settings: &RenderSettings, lights: u64) -> u64 {
    if !settings.uses_prepass(settings.learned_lights) || lights < 2 {
        return 0;
    }
    let own = pixels(settings);
    let shared = if settings.guides() { own.max(guiding::pixels(settings.pixels())) } else { own };
    let paths = |round: u32| shared * f64::from(1 << round);
    // Before a round there were as many paths as it has itself, less one per pixel.
    let rounds = (0..).take_while(|&round| !suffice(round, paths(round) - shared, own));
    let records =
        rounds.map(|r| (paths(r) * f64::from(settings.max_depth)).min(MAX_RECORDS_PER_ROUND as f64)).sum::<f64>();
    LearnedLights::bytes_to_learn(records as u64, lights)
}

/// Do so many rounds of so many paths in all suffice, where the pre-pass would have `pixels` if it were alone?
fn suffice(rounds: u32, paths: f64, pixels: f64) -> bool {
    rounds > 1 && paths >= SUFFICIENT_PATHS_PER_PIXEL * pixels
}

/// Pixels of the pre-pass that this learner needs.
fn pixels(settings: &RenderSettings) -> f64 {
    effort::LEARNED_LIGHTS.pixels(settings.pixels())
}

/// Learns from the rounds of a pre-pass.
pub struct LightsLearner<'a> {
    area: &'a AreaLights,
    /// Is it used whatever remains?
    always: bool,
    /// Weight of differences of normals against distances, in metres.
    scale: f32,
    /// Pixels of the pre-pass, if it were alone.
    pixels: f64,
    records: Vec<LightSampleRecord>,
    paths: f64,
    finished: bool,
    result: LearnedLightsResult,
}

impl<'a> LightsLearner<'a> {
    /// Begins to learn; `None` where the settings do not ask for it or there is nothing to choose.
    pub fn new(scene: &'a PreparedScene, settings: &RenderSettings) -> Option<Self> {
        let area = scene.lights.area.as_ref().filter(|area| area.tree().top(3) > 1)?;
        settings.uses_prepass(settings.learned_lights).then(|| Self {
            area,
            always: settings.learned_lights == Choice::On,
            scale: 0.25 * scene.scene.radius(),
            pixels: pixels(settings),
            records: Vec::new(),
            paths: 0.0,
            finished: false,
            result: LearnedLightsResult { lights: None, remaining_variance: 1.0, seconds: 0.0 },
        })
    }

    fn learned(&self) -> Option<LearnedLights> {
        LearnedLights::learn(self.area.tree(), &self.records, self.scale)
    }

    /// What was learned.
    pub fn result(self) -> LearnedLightsResult {
        debug!("learned lights leave {:.2} of the variance; {:?}", self.result.remaining_variance, self.result.stats());
        self.result
    }
}

impl Learner for LightsLearner<'_> {
    fn pixels(&self) -> f64 {
        self.pixels
    }

    fn wants(&self) -> Option<Wanted> {
        let wanted = Wanted { light_sample_records: MAX_RECORDS_PER_ROUND, ..Default::default() };
        (!self.finished).then_some(wanted)
    }

    fn learn(&mut self, round: &Round, seconds: f64) {
        self.result.seconds += seconds;
        if round.number == 1 {
            let lights = self.learned();
            self.result.remaining_variance =
                lights.map_or(1.0, |lights| relative_variance_with(self.area, &lights, round));
            if self.result.remaining_variance >= MAX_REMAINING_LEARNED_LIGHTS && !self.always {
                self.finished = true;
                return;
            }
        }
        // Records of all rounds follow the light tree: learned choices begin when all are in.
        self.records.extend_from_slice(&round.light_sample_records);
        self.paths += round.all_paths();
        if suffice(round.number + 1, self.paths, self.pixels) {
            self.result.lights = self.learned();
            self.finished = true;
        }
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        self.result.apply(proposal)
    }
}

/// Learns which lights matter along the paths of `transport`, a render with these settings, without other learners. `None`
/// where the settings do not ask for it or there is nothing to choose, and soon after `stop` is raised.
pub fn learned(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<LearnedLightsResult> {
    let mut learner = LightsLearner::new(scene, settings)?;
    rounds::run(scene, settings, transport, &mut [&mut learner], stop)?;
    Some(learner.result())
}

/// Variance with `lights` over that of paths without them: the second moments of light samples are reweighted to the
/// learned choice.
fn relative_variance_with(area: &AreaLights, lights: &LearnedLights, round: &Round) -> f64 {
    let mut pixels: Vec<_> = round.pixels.iter().map(|pixel| [pixel.relative_variance(); 2]).collect();
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
