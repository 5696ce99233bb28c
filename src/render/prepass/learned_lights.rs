//! Learns which emissive triangles light each part of the scene, and decides whether light samples are chosen by that. A round of
//! the pre-pass measures the efficiency of what those before it have taught.

use std::sync::atomic::AtomicBool;

use tracing::debug;

use super::super::techniques::LearnedLightsStats;
use super::super::{Choice, RenderSettings};
use super::effort;
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
    /// Its statistics, for reports.
    pub stats: LearnedLightsStats,
}

/// Do so many rounds of so many paths in all suffice, where the pre-pass would have `pixels` if it were alone?
fn suffice(rounds: u32, paths: f64, pixels: f64) -> bool {
    rounds > 1 && paths >= SUFFICIENT_PATHS_PER_PIXEL * pixels
}

/// Pixels of the pre-pass that learning needs.
pub fn pixels(settings: &RenderSettings) -> f64 {
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
    /// In parts, in the order of the rounds.
    records: Vec<Vec<LightSampleRecord>>,
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
            result: LearnedLightsResult {
                lights: None,
                stats: LearnedLightsStats { on: false, cells: 0, bytes: 0, remaining_variance: 1.0, seconds: 0.0 },
            },
        })
    }

    fn learned(&self) -> Option<LearnedLights> {
        LearnedLights::learn(self.area.tree(), self.records.iter().flatten(), self.scale)
    }

    /// Ends learning with this result, and frees the records.
    fn finish_with(&mut self, lights: Option<LearnedLights>) {
        let (cells, bytes) = lights.as_ref().map_or((0, 0), |lights| (lights.cells(), lights.bytes()));
        let LearnedLightsStats { remaining_variance, seconds, .. } = self.result.stats;
        let stats = LearnedLightsStats { on: lights.is_some(), cells, bytes, remaining_variance, seconds };
        (self.result, self.finished) = (LearnedLightsResult { lights, stats }, true);
        self.records = Vec::new();
    }

    /// What was learned.
    pub fn result(self) -> LearnedLightsResult {
        debug!(
            "learned lights leave {:.2} of the variance; {:?}",
            self.result.stats.remaining_variance, self.result.stats
        );
        self.result
    }

    /// Variance with `lights` over that of paths without them: the second moments of light samples are reweighted to the
    /// learned choice.
    fn relative_variance_with(&self, lights: &LearnedLights, round: &Round) -> f64 {
        let mut pixels: Vec<_> = round.pixels.iter().map(|pixel| [pixel.relative_variance(); 2]).collect();
        for record in round.light_sample_records.iter().flatten().filter(|record| record.contribution > 0.0) {
            let [before, learned] = self.area.tree().pmfs(record.position, record.normal, record.emitter, Some(lights));
            let moment = f64::from(record.contribution).powi(2);
            pixels[record.pixel as usize][1] += moment * f64::from(before / learned - 1.0);
        }
        let [without, with] = sums_without_outliers(pixels);
        if without > 0.0 { (with / without).max(0.0) } else { 1.0 }
    }
}

impl Learner for LightsLearner<'_> {
    fn pixels(&self) -> f64 {
        self.pixels
    }

    fn wants(&self) -> Option<Wanted> {
        (!self.finished).then(|| Wanted { light_sample_records: MAX_RECORDS_PER_ROUND, ..Default::default() })
    }

    fn learn(&mut self, round: &mut Round, seconds: f64) {
        self.result.stats.seconds += seconds;
        self.paths += round.all_paths();
        let is_last = suffice(round.number + 1, self.paths, self.pixels);
        if round.number == 1 || is_last {
            let lights = self.learned();
            let remaining = lights.map_or(1.0, |lights| self.relative_variance_with(&lights, round));
            self.result.stats.remaining_variance = remaining;
            let most =
                if is_last { effort::MAX_REMAINING_LEARNED_LIGHTS } else { effort::MAX_REMAINING_AT_FIRST_ROUND };
            if remaining >= most && !self.always {
                return self.finish_with(None);
            }
        }
        // Records of all rounds follow the unlearned selection: learned choices begin when all are in.
        self.records.append(&mut round.light_sample_records);
        if is_last {
            self.finish_with(self.learned());
        }
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        let lights = LightProposal { learned: self.result.lights.as_ref(), ..proposal.lights };
        Proposal { lights, ..proposal }
    }
}

/// Lets a learner alone learn from the paths of `transport`, a render with these settings. `None` soon after `stop` is raised.
pub fn learned(
    mut learner: LightsLearner,
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<LearnedLightsResult> {
    rounds::run(scene, settings, transport, &mut [&mut learner], stop)?;
    Some(learner.result())
}
