//! Learns the field of incident light that guides paths. Each round of the pre-pass is guided by the field that those before it
//! taught. The result also depends on the expected paths per pixel.

use std::sync::atomic::AtomicBool;

use tracing::debug;

use super::effort::{self, GUIDED_RAY_COST, MAX_TIME_SHARE};
use super::rounds::{self, Learner, Round, Wanted};
use super::trial::{Candidate, GAIN, affords, decide};
use crate::guiding::{Field, PathStatistics, TrainingSample, VertexRecord, learn};
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::render::pass::decisions::{RuledOut, TechniqueStats};
use crate::render::settings::GUIDING_MEMORY;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};

/// Maximum rounds.
const MAX_ROUNDS: u32 = 9;
/// Paths per pixel of the picture for which the next constant is meant.
const REFERENCE_SPP: f64 = 64.0;
/// No further round begins after this number of training samples or half the picture's pixels, whichever is larger.
const SUFFICIENT_TRAINING_SAMPLES: f64 = 150_000.0;
/// Maximum vertex records of a round, over the training samples that suffice.
const VERTEX_RECORDS_PER_SUFFICIENT_SAMPLE: f64 = 2.0;
/// Learning is not given up where fewer training samples per path were found, too few for an estimate.
const MIN_SAMPLES_PER_PATH: f64 = 0.04;
/// Bytes of memory for each cell of a field, where memory limits their number. They take less; more cells would change pictures.
const BYTES_PER_CELL: f64 = 13_468.0;

/// Factor of the effort, fitted to relMSE × CPU seconds of pictures of 64, 256 and 1024 paths per pixel.
fn worthwhile(settings: &RenderSettings) -> f64 {
    let root = (f64::from(settings.expected_spp()) / REFERENCE_SPP).sqrt();
    root * root.sqrt()
}

/// Number of records in all parts.
fn count<T>(parts: &[Vec<T>]) -> usize {
    parts.iter().map(Vec::len).sum()
}

/// Learns from the rounds of a pre-pass.
pub struct GuidingLearner<'s> {
    settings: &'s RenderSettings,
    /// Is the field used whatever it leaves?
    always: bool,
    max: Wanted,
    max_cells: usize,
    /// Training samples after which no further round is needed.
    sufficient: f64,
    /// Weight of differences of normals against distances, in metres.
    scale: f32,
    /// In parts, in the order of the rounds.
    training_samples: Vec<Vec<TrainingSample>>,
    /// Rays per path of the first round, which is unguided.
    unguided: Option<f64>,
    finished: bool,
    /// The field of incident light; `None` where guiding would not reduce the variance enough.
    field: Option<Field>,
    stats: TechniqueStats,
}

impl<'s> GuidingLearner<'s> {
    /// Begins to learn along paths of `transport`.
    ///
    /// # Errors
    /// Why there is nothing to learn.
    pub fn new(scene: &PreparedScene, settings: &'s RenderSettings, transport: &Transport) -> Result<Self, RuledOut> {
        if transport.max_depth < 3 {
            return Err(RuledOut::Direct);
        }
        let most = settings.guiding_memory.unwrap_or(GUIDING_MEMORY) as f64;
        // A quarter for training samples, an eighth for vertex records, a quarter for cells while they learn.
        let max_training_samples = (most / 4.0 / size_of::<TrainingSample>() as f64) as usize;
        let sufficient = SUFFICIENT_TRAINING_SAMPLES.max(settings.pixels() / 2.0) * worthwhile(settings);
        let max_vertex_records = (most / 8.0 / size_of::<VertexRecord>() as f64)
            .min(VERTEX_RECORDS_PER_SUFFICIENT_SAMPLE * sufficient) as usize;
        Ok(Self {
            settings,
            always: settings.techniques[Technique::Guiding] == Choice::On,
            max: Wanted {
                training_samples: max_training_samples,
                vertex_records: max_vertex_records,
                ..Default::default()
            },
            max_cells: (most / 4.0 / BYTES_PER_CELL).max(1.0) as usize,
            // With three quarters of what memory allows, most of the next round would be left out.
            sufficient: sufficient.min(0.75 * max_training_samples as f64),
            scale: 0.25 * scene.scene.radius(),
            training_samples: Vec::new(),
            unguided: None,
            finished: false,
            field: None,
            stats: TechniqueStats::default(),
        })
    }

    /// Ends learning, and frees the training samples.
    fn finish_with(&mut self, field: Option<Field>) {
        (self.field, self.training_samples, self.finished) = (field, Vec::new(), true);
    }
}

impl Candidate for GuidingLearner<'_> {
    fn technique(&self) -> Technique {
        Technique::Guiding
    }

    fn ways<'a>(&'a self, of: Proposal<'a>) -> Vec<Proposal<'a>> {
        self.field.as_ref().map(|field| of.guided(Some(field))).into_iter().collect()
    }

    fn stats(&self) -> TechniqueStats {
        let (cells, bytes) = self.field.as_ref().map_or((0, 0), |field| (field.cells(), field.bytes()));
        TechniqueStats { cells: Some(cells), bytes: Some(bytes), ..self.stats }
    }
}

impl Learner for GuidingLearner<'_> {
    fn pixels(&self) -> f64 {
        effort::guiding_pixels(self.settings.pixels())
    }

    fn wants(&self) -> Option<Wanted> {
        let training_samples = self.max.training_samples.saturating_sub(count(&self.training_samples)).max(1);
        (!self.finished).then_some(Wanted { training_samples, ..self.max })
    }

    fn learn(&mut self, round: &mut Round, seconds: f64) {
        self.stats.seconds += seconds;
        let cost = round.rays as f64 / round.all_paths();
        let unguided = *self.unguided.get_or_insert(cost);
        let few = (count(&round.training_samples) as f64) < MIN_SAMPLES_PER_PATH * round.all_paths();
        let before = count(&self.training_samples);
        self.training_samples.append(&mut round.training_samples);
        let suffices = count(&self.training_samples) as f64 >= self.sufficient;
        let ends = round.number + 1 == MAX_ROUNDS
            || self.settings.time.is_some_and(|time| 3.0 * self.stats.seconds > MAX_TIME_SHARE * time)
            || suffices;
        let learned =
            |fresh, ends| learn(self.training_samples.iter().flatten(), fresh, ends, self.scale, self.max_cells);
        let variances = round.pixels.iter().map(|pixel| pixel.relative_variance()).filter(|v| v.is_finite());
        let variance: f64 = variances.sum();
        // The first round was unguided.
        let fresh = if round.number > 0 { before } else { usize::MAX };
        let (mut field, gain) = learned(fresh, ends);
        let mut last = ends;
        if round.number > 0 {
            let remaining = f64::from(gain.variance(variance)) * GUIDED_RAY_COST * cost / unguided;
            debug!("round {}: {} cells, leaves {remaining:.2}, {gain:?}", round.number, field.cells());
            self.stats.remaining = Some(remaining);
            if !self.always && remaining > 1.0 - GAIN && (ends || !few) {
                return self.finish_with(None);
            }
            // The next round costs twice as many paths.
            last = ends
                || !affords(
                    self.settings,
                    self.settings.expected_spp(),
                    2.0 * round.all_paths(),
                    if few { 0.0 } else { remaining },
                );
            if last && !ends {
                field = learned(fresh, true).0;
            }
        }
        // One path per pixel has no variance.
        if last || round.number > 0 {
            let inverse = round.pixels.iter().map(|pixel| 1.0 / f64::from(pixel.divisor)).sum::<f64>();
            let (paths, pixels) = (round.all_paths(), round.pixels.len() as f64);
            let all = PathStatistics { cost, variance: variance / paths, inverse: inverse / pixels };
            field.learn_roulette(round.vertex_records.iter().flatten(), all);
        }
        if last { self.finish_with(Some(field)) } else { self.field = Some(field) }
    }
}

/// The field by which paths of `transport` are guided, without other techniques, if they are, and what was found. `None` where
/// `settings` turn guiding off or there is nothing to learn, and soon after `stop` is raised.
pub fn learned(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<(Option<Field>, TechniqueStats)> {
    settings.asks_for(Technique::Guiding).then_some(())?;
    let mut learner = GuidingLearner::new(scene, settings, transport).ok()?;
    rounds::run(scene, settings, transport, &mut [&mut learner], stop)?;
    let stats = decide(&[&learner], transport, settings, stop)[0].stats;
    Some((learner.field.filter(|_| stats.on), stats))
}
