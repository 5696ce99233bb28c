//! Learns which emissive triangles light each part of the scene, and decides whether light samples are chosen by that. A round of
//! the pre-pass measures the efficiency of what those before it have taught.

use tracing::debug;

use super::effort;
use super::rounds::{Decided, Learner, Round, Wanted};
use crate::film::compare::sums_without_outliers;
use crate::integrator::{PreparedScene, Proposal};
use crate::light::{AreaLights, LearnedLights, LightProposal, LightSampleRecord};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};

/// Paths after which no further round is needed, per pixel of the pre-pass if it were alone: four rounds.
const SUFFICIENT_PATHS_PER_PIXEL: f64 = 15.0;
/// Maximum light-sample records of a round.
const MAX_RECORDS_PER_ROUND: usize = 1 << 16;

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
    /// Which lights matter in which part of the scene; `None` where that would not reduce the variance enough.
    pub lights: Option<LearnedLights>,
    stats: TechniqueStats,
}

impl<'a> LightsLearner<'a> {
    /// Begins to learn; `None` where the settings do not ask for it or there is nothing to choose.
    pub fn new(scene: &'a PreparedScene, settings: &RenderSettings) -> Option<Self> {
        let area = scene.lights.area.as_ref().filter(|area| area.tree().top(3) > 1)?;
        settings.asks_for(Technique::LearnedLights).then(|| Self {
            area,
            always: settings.techniques[Technique::LearnedLights] == Choice::On,
            scale: 0.25 * scene.scene.radius(),
            pixels: effort::learned_lights_pixels(settings.pixels()),
            records: Vec::new(),
            paths: 0.0,
            finished: false,
            lights: None,
            stats: TechniqueStats { remaining: Some(1.0), ..Default::default() },
        })
    }

    fn learned(&self) -> Option<LearnedLights> {
        LearnedLights::learn(self.area.tree(), self.records.iter().flatten(), self.scale)
    }

    /// Ends learning with this result, and frees the records.
    fn finish_with(&mut self, lights: Option<LearnedLights>) {
        self.lights = lights;
        self.finished = true;
        self.records = Vec::new();
        debug!("learned lights: {:?}", self.stats().1);
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

impl Decided for LightsLearner<'_> {
    fn stats(&self) -> (Technique, TechniqueStats) {
        let lights = self.lights.as_ref();
        let (cells, bytes) = lights.map_or((0, 0), |lights| (lights.cells(), lights.bytes()));
        let found = TechniqueStats { on: lights.is_some(), cells: Some(cells), bytes: Some(bytes), ..self.stats };
        (Technique::LearnedLights, found)
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        let lights = LightProposal { learned: self.lights.as_ref(), ..proposal.lights };
        Proposal { lights, ..proposal }
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
        self.stats.seconds += seconds;
        self.paths += round.all_paths();
        let is_last = round.number > 0 && self.paths >= SUFFICIENT_PATHS_PER_PIXEL * self.pixels;
        if round.number == 1 || is_last {
            let lights = self.learned();
            let remaining = lights.map_or(1.0, |lights| self.relative_variance_with(&lights, round));
            self.stats.remaining = Some(remaining);
            let most = if is_last { effort::MAX_REMAINING_LEARNED_LIGHTS } else { effort::MAX_REMAINING_PROMISING };
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
}
