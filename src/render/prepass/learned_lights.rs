//! Learns which emissive triangles light each part of the scene, and decides whether light samples are chosen by that. A round of
//! the pre-pass measures the efficiency of what those before it have taught.

use tracing::debug;

use super::effort;
use super::rounds::{Learner, Round, Wanted};
use super::trial::{Candidate, GAIN};
use crate::film::compare::sums_without_outliers;
use crate::integrator::{PreparedScene, Proposal};
use crate::light::{AreaLights, LearnedLights, LightProposal, LightSampleRecord};
use crate::render::pass::decisions::{RuledOut, TechniqueStats};
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
    /// Begins to learn.
    ///
    /// # Errors
    /// Why there is nothing to choose.
    pub fn new(scene: &'a PreparedScene, settings: &RenderSettings) -> Result<Self, RuledOut> {
        let area = scene.lights.area.as_ref().filter(|area| area.tree().top(3) > 1);
        let area = area.ok_or(RuledOut::FewLights)?;
        Ok(Self {
            area,
            always: settings.techniques[Technique::LearnedLights] == Choice::On,
            scale: 0.25 * scene.scene.radius(),
            pixels: effort::learned_lights_pixels(settings.pixels()),
            records: Vec::new(),
            paths: 0.0,
            finished: false,
            lights: None,
            stats: TechniqueStats::default(),
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
        debug!("learned lights: {:?}", self.stats());
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

impl Candidate for LightsLearner<'_> {
    fn technique(&self) -> Technique {
        Technique::LearnedLights
    }

    fn ways<'a>(&'a self, of: Proposal<'a>) -> Vec<Proposal<'a>> {
        let way = |learned| Proposal { lights: LightProposal { learned: Some(learned), ..of.lights }, ..of };
        self.lights.as_ref().map(way).into_iter().collect()
    }

    fn stats(&self) -> TechniqueStats {
        let lights = self.lights.as_ref();
        let (cells, bytes) = lights.map_or((0, 0), |lights| (lights.cells(), lights.bytes()));
        TechniqueStats { cells: Some(cells), bytes: Some(bytes), ..self.stats }
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
            if remaining > 1.0 - GAIN && !self.always {
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
